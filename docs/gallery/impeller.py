"""How soft may the support of an impeller be? Two unequal moments of inertia make it unstable in a band."""

import numpy as np

import solve
from derive import Matrix, Mechanism, cos, rate, sin
from solve.views.style import BLUE, GREY, page


def impeller():
    rotor = Mechanism("impeller", "Impeller with two vanes on a support of two stiffnesses")
    a, b = rotor.coordinates(a=("rad", "tilt about x"), b=("rad", "tilt about y"))
    I1, I2, Ip = rotor.parameters(
        I1=("kg m^2", "across the vanes", "> 0"),
        I2=("kg m^2", "along them", "> 0"),
        Ip=("kg m^2", "polar", "> 0"),
    )
    kx, ky = rotor.parameters(kx=("N m/rad", "support about x", "> 0"), ky=("N m/rad", "about y", "> 0"))
    c, U = rotor.parameters(c=("N m s/rad", "damper", ">= 0"), U=("kg m^2", "skew of the mass"))
    phi = rotor.phase
    turned = Matrix([[cos(phi), sin(phi)], [-sin(phi), cos(phi)]]) * Matrix([rate(a) * cos(b), rate(b)])
    spin = rotor.speed + rate(a) * sin(b)
    rotor.kinetic = (I1 * turned[0] ** 2 + I2 * turned[1] ** 2 + Ip * spin**2) / 2
    rotor.potential = (kx * a**2 + ky * b**2) / 2
    rotor.dissipation = c * (rate(a) ** 2 + rate(b) ** 2) / 2
    for tilt, shape in ((a, cos(phi)), (b, sin(phi))):
        rotor.force(U * rotor.speed**2 * shape, along=tilt)
    rotor.output("stiffness", kx + ky, "N m/rad", "of the support")
    return rotor


start = solve.load(impeller, I1=0.022, I2=0.018, Ip=0.012, kx=500, ky=650, c=0.06, U=1e-6)
free, limit = {"kx": (400, 1500), "ky": (400, 1500)}, ["spectral_radius < 0.99"]
optimum = solve.optimise(start, "stiffness.mean", free, "2000:2600:3 rpm", subject=limit, rtol=1e-6)
speeds = "2000:3200:121 rpm"
with page(3.0, "Impeller on a soft support, to run from 2000 to 2600 rpm") as figure:
    axes = figure.subplots()
    for model, label, colour in ((start, "before", GREY), (optimum.system, "optimum", BLUE)):
        sweep = solve.sweep(model, speeds, rtol=1e-6)
        axes.plot(sweep.speeds * 30 / np.pi, sweep.spectral_radius, color=colour, label=label)
    axes.axvline(2600, color=GREY, linestyle=":")
    axes.set(xlabel="speed (rpm)", ylabel="spectral radius")
    axes.legend()
    figure.savefig("impeller.png", dpi=150)
