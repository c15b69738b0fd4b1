"""How does the deflection of a flexible coupler grow with speed? Amplitudes of its first three modes."""

import numpy as np

import solve
from solve.views.style import MANY, page

printed = {  # Table 2 of the paper, mm, at these speeds in rpm
    "rpm": (600, 900, 1200, 1500),
    "q1": (0.2750, 0.6309, 1.1583, 1.8704),
    "q2": (0.0090, 0.0204, 0.0364, 0.0572),
    "q3": (0.0011, 0.0025, 0.0046, 0.0072),
}
coupler = solve.load("coupler", "table2")
sweep = solve.sweep(coupler, "300:1500:25 rpm")
rpm = sweep.speeds * 30 / np.pi
largest = {name: 1e3 * sweep.figures(name) for name in ("q1", "q2", "q3")}

with page(3.2, "Flexible coupler: largest amplitudes of three modes") as figure:
    axes = figure.subplots()
    for colour, (name, values) in zip(MANY, largest.items(), strict=False):
        axes.semilogy(rpm, values, color=colour, label=name)
        axes.semilogy(printed["rpm"], printed[name], "o", color=colour, fillstyle="none", markersize=6)
    axes.plot([], [], "o", color="black", fillstyle="none", markersize=6, label="printed")
    axes.set(xlabel="speed (rpm)", ylabel="amplitude (mm)")
    axes.legend(loc="lower right", ncols=4)
    figure.savefig("coupler_table2.png", dpi=150)
