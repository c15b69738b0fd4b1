"""How is stability lost? Paths of the multipliers of a damped Mathieu equation as the speed rises."""

import numpy as np

import solve
from solve.views.style import BLACK, GREY, VERMILION, page

zeta, speeds = 0.05, np.linspace(0.42, 1.6, 900)  # rad/s; the stiffness varies twice per revolution
model = solve.load("mathieu", delta=1.0, epsilon=0.6, zeta=zeta)
rho = np.array([point.multipliers for point in solve.sweep(model, speeds).points])
shrinks = np.exp(-zeta * np.pi / speeds)  # Liouville: ρ1 ρ2 = exp(-2ζT), T = π/Ω

with page(3.6, "q″ + 0.1 q′ + (1 + 0.6 cos 2Ωt) q = 0") as figure:
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.25))
    turn = np.exp(1j * np.linspace(0, 2 * np.pi, 200))
    left.plot(turn.real, turn.imag, color=BLACK, linewidth=0.8)
    for branch in rho.T:
        dots = left.scatter(branch.real, branch.imag, c=speeds, s=5, cmap="viridis", zorder=3)
        right.scatter(speeds, np.abs(branch), c=speeds, s=3, cmap="viridis")
    right.plot(speeds, shrinks, color=VERMILION, linestyle=":", linewidth=2.5, label="exp(−ζπ/Ω), Liouville")
    right.axhline(1, color=BLACK, linewidth=0.8)
    left.set(xlabel="Re ρ", ylabel="Im ρ", aspect="equal")
    right.set(xlabel="speed Ω (rad/s)", ylabel="|ρ|", ylim=(0.45, 1.6))
    right.annotate("unstable:\nρ < −1", (1.14, 1.2), color=GREY)
    right.legend(loc="upper right")
    figure.colorbar(dots, ax=left, location="bottom", label="speed Ω (rad/s)")
    figure.savefig("multipliers.png", dpi=150)
