"""How much does pumping of the spring amplify a vibration? The gain depends on the phase of the load."""

import numpy as np

import solve
from solve.views.style import BLUE, GREEN, PURPLE, VERMILION, page

Q = 1000.0  # q″ + q′/Q + (1 + 2p/Q cos 2t) q = cos(t + ψ), of which p = 1 is unstable


def amplitude(pump, psi):
    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        stiffness = 1 + 2 * pump / Q * np.cos(2 * phase)
        return one, one / Q, stiffness[:, None, None], np.cos(phase + psi)[:, None]

    system = solve.PeriodicSystem(matrices, ["q"])
    return solve.periodic(system, 1.0).harmonics("q")[0][1]


pumps, phases = (0.3, 0.6, 0.9), np.radians(np.arange(0, 181, 7.5))
gain = {pump: np.array([amplitude(pump, psi) / Q for psi in phases]) for pump in pumps}

with page(3.2, "Gain of a parametric amplifier") as figure:
    axes = figure.subplots()
    fine = np.radians(np.linspace(0, 180, 361))
    for pump, colour in zip(pumps, (BLUE, GREEN, PURPLE), strict=True):
        turned = fine - np.pi / 4  # Rugar and Grütter, Physical Review Letters 67 (1991) 699
        exact = np.hypot(np.cos(turned) / (1 + pump), np.sin(turned) / (1 - pump))
        axes.semilogy(
            np.degrees(fine), exact, color=colour, label=f"pump at {100 * pump:.0f} % of the threshold"
        )
        axes.semilogy(np.degrees(phases), gain[pump], "o", color=colour)
    axes.plot([], [], "o", color="black", label="periodic solutions")
    axes.axhline(1, color=VERMILION, linewidth=0.8, linestyle="--", label="no pump")
    axes.set(xlabel="phase ψ of the load (°)", ylabel="gain", xticks=range(0, 181, 45), ylim=(0.4, 50))
    axes.legend(loc="upper left", ncols=2)
    figure.savefig("amplifier.png", dpi=150)
