"""How is an absorber tuned for the smallest resonance? On a stiffening spring it should stiffen too."""

import numpy as np

import solve
from derive import Mechanism, cos, rate
from solve.views.style import BLUE, GREY, VERMILION, page


def absorber():
    machine = Mechanism("absorber", "Mass on a stiffening spring, with a damped absorber")
    x, y = machine.coordinates(x=("m", "mass"), y=("m", "absorber, relative to the mass"))
    m, F, e = machine.parameters(m=("kg", "mass", "> 0"), F=("N", "load"), e=("1", "mass ratio", "> 0"))
    k1, k2 = machine.parameters(k1=("N/m", "spring", "> 0"), k2=("N/m", "absorber's", "> 0"))
    n1, n2 = machine.parameters(n1=("N/m^3", "cubic spring"), n2=("N/m^3", "absorber's"))
    c = machine.parameter("c", "N s/m", "absorber's damper", ">= 0")
    machine.kinetic = m * rate(x) ** 2 / 2 + e * m * rate(x + y) ** 2 / 2
    machine.potential = (k1 * x**2 + k2 * y**2) / 2 + (n1 * x**4 + n2 * y**4) / 4
    machine.dissipation = c * rate(y) ** 2 / 2
    machine.force(F * cos(machine.phase), along=x)
    return machine


e, F, n1 = 0.05, 0.05, 1.0
start = solve.load(absorber, m=1, F=F, e=e, k1=1, n1=n1, n2=0, k2=0.042, c=0.015)
free = {"k2": (0.03, 0.06), "c": (0.005, 0.03)}
optimum = solve.optimise(start.varied({"n1": 0.0}), "x.max_abs", free, "0.8:1.2:5 rad/s")
tuned = start.varied(optimum.free)
n2 = 2 * e**2 * n1 / (1 + 4 * e)  # Habib, Detroux, Viguié, Kerschen, Mech. Syst. Signal Process. 52-53 (2015)
speeds = np.linspace(0.8, 1.2, 81)
curves = {
    "linear spring": solve.sweep(optimum.system, speeds, rtol=1e-6),
    "stiffening spring": solve.sweep(tuned, speeds, rtol=1e-6, nonlinear=True),
    "both stiffen": solve.sweep(tuned.varied({"n2": n2}), speeds, rtol=1e-6, nonlinear=True),
}
heights = {label: curve.figures("x", "max_abs") for label, curve in curves.items()}
with page(3.4, "Main mass with an absorber of 1/20 of its mass") as figure:
    axes = figure.subplots()
    for (label, height), colour in zip(heights.items(), (GREY, VERMILION, BLUE), strict=True):
        axes.plot(speeds, height, color=colour, label=label)
    axes.set(xlabel="speed Ω (rad/s)", ylabel="largest deflection (m)")
    axes.legend()
    figure.savefig("absorber.png", dpi=150)
