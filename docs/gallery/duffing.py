"""Where does a stiffening spring jump? Duffing's two amplitudes, at rising and at falling speeds."""

from contextlib import suppress

import numpy as np

import solve
from derive import Mechanism, cos, rate
from solve.views.style import BLUE, GREY, VERMILION, page


def oscillator():
    duffing = Mechanism("duffing", "Duffing's oscillator")
    q = duffing.coordinate("q", "m", "deflection")
    m, c, F = duffing.parameters(m=("kg", "mass", "> 0"), c=("N s/m", "damper"), F=("N", "load"))
    k1, k3 = duffing.parameters(k1=("N/m", "spring", "> 0"), k3=("N/m^3", "cubic spring"))
    duffing.kinetic = m * rate(q) ** 2 / 2
    duffing.potential = k1 * q**2 / 2 + k3 * q**4 / 4
    duffing.dissipation = c * rate(q) ** 2 / 2
    duffing.force(F * cos(duffing.phase), along=q)
    return duffing


def branch(speeds):
    found = [solve.nonlinear(model, speeds[0], rtol=1e-6)]
    with suppress(solve.SolveError):  # near the fold none is found from the last
        for speed in speeds[1:]:
            found.append(solve.nonlinear(model, speed, start=found[-1], rtol=1e-6))
    return np.transpose([(orbit.speed, orbit.harmonics("q")[0][1]) for orbit in found])


c, F, k3 = 0.06, 0.2, 0.2
model = solve.load(oscillator, m=1, c=c, F=F, k1=1, k3=k3)
branches = {"rising": branch(np.arange(0.6, 1.5, 0.0125)), "falling": branch(np.arange(1.6, 1.0, -0.0125))}
A = np.linspace(0.05, 2.42, 2000)[:, None]  # one harmonic: (1 - Ω² + ¾ k3 A²)² A² + c² Ω² A² = F²
root = np.sqrt(c**4 / 4 - c**2 * (1 + 0.75 * k3 * A**2) + F**2 / A**2)
square = 1 + 0.75 * k3 * A**2 - c**2 / 2 + root * [-1, 1]  # Ω² of both sides of the peak
with page(3.4, "q″ + 0.06 q′ + q + 0.2 q³ = 0.2 cos Ωt") as figure:
    axes = figure.subplots()
    axes.plot(np.sqrt(square.clip(0)), A, color=GREY, label=["single-harmonic approximation", None])
    for (way, points), mark, colour in zip(branches.items(), "^v", (BLUE, VERMILION), strict=True):
        axes.plot(*points, mark, color=colour, label=f"speed {way}")
    axes.set(xlabel="speed Ω (rad/s)", ylabel="first harmonic (m)", xlim=(0.6, 1.6))
    axes.legend()
    figure.savefig("duffing.png", dpi=150)
