"""How fast do methods converge? The trace of the period map on an edge of Mathieu's chart, where it is 2."""

import numpy as np
from scipy.special import mathieu_a

import solve
from solve.views.style import GREY, MANY, page

epsilon = 2.0
model = solve.load("mathieu", delta=mathieu_a(2, epsilon / 2), epsilon=epsilon, zeta=0)
methods = {
    "Newmark, order 2": (solve.Newmark(), 2, np.arange(5, 11)),
    "Runge–Kutta, order 4": (solve.RungeKutta4(), 4, np.arange(7, 12)),
    "Radau, order 5": (solve.Radau(5), 5, np.arange(3, 8)),
    "Gauss, order 8": (solve.Gauss(8), 8, np.arange(3, 6)),
}

errors = {}
for name, (method, _, powers) in methods.items():
    found = [solve.floquet(model, 1.0, method, steps=int(2**k), rtol=1e-3).multipliers for k in powers]
    errors[name] = np.array([abs(each.sum() - 2) for each in found])
slopes = {name: -np.polyfit(methods[name][2][-3:], np.log2(each[-3:]), 1)[0] for name, each in errors.items()}

with page(3.4, "Error of ρ1 + ρ2, which is exactly 2") as figure:
    axes = figure.subplots()
    for colour, (name, (_, order, powers)) in zip(MANY, methods.items(), strict=False):
        axes.loglog(2.0**powers, errors[name], "o-", color=colour, label=f"{name}: slope {slopes[name]:.2f}")
        line = errors[name][-1] * 2.0 ** (order * (powers[-1] - powers))
        axes.loglog(2.0**powers, line, ":", color=GREY)
    axes.plot([], [], ":", color=GREY, label="slope of the order")
    axes.set(xlabel="steps per period", ylabel="|ρ1 + ρ2 − 2|")
    figure.legend(loc="outside right center")
    figure.savefig("orders.png", dpi=150)
