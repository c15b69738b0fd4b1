"""How does forward flight affect a flapping blade? Its exponents as the advance ratio μ rises."""

import numpy as np

import solve
from solve.views.style import BLACK, GREY, VERMILION, page

gamma, nu = 12.0, 1.0  # Lock number; flapping frequency divided by the speed


def blade(mu):
    """β″ + γ/8 (1 + 4/3 μ sin ψ) β′ + (ν² + γ/8 (4/3 μ cos ψ + μ² sin 2ψ)) β = 0, Johnson 1980."""

    def matrices(psi, speed):
        damping = gamma / 8 * (1 + 4 * mu / 3 * np.sin(psi))
        stiffness = nu**2 + gamma / 8 * (4 * mu / 3 * np.cos(psi) + mu**2 * np.sin(2 * psi))
        one = np.ones((len(psi), 1, 1))
        return one, one * damping[:, None, None], one * stiffness[:, None, None], 0 * one[:, 0]

    return solve.PeriodicSystem(matrices, ["β"])


ratios = np.linspace(0, 0.5, 101)
exponents = np.array([solve.floquet(blade(mu), 1.0).exponents for mu in ratios])
frequency = np.sqrt(nu**2 - (gamma / 16) ** 2)  # in hover, divided by the speed; determined only modulo 1
hover = -gamma / 16 + 1j * (frequency - round(frequency))

with page(3.3, "Flapping blade, γ = 12, ν = 1: exponents versus advance ratio") as figure:
    left, right = figure.subplots(1, 2)
    for branch in exponents.T:
        dots = left.scatter(branch.real, branch.imag, c=ratios, s=8, cmap="viridis", zorder=3)
        right.plot(ratios, branch.real, ".", color=BLACK, markersize=3)
    left.plot(
        [hover.real] * 2, [hover.imag, -hover.imag], "o", color=VERMILION, markersize=7, fillstyle="none"
    )
    right.plot(
        0, hover.real, "o", color=VERMILION, markersize=7, fillstyle="none", label="hover, closed form"
    )
    right.axhline(-gamma / 16, color=GREY, linewidth=0.8, linestyle="--", label="mean, Liouville: −γ/16")
    left.set(xlabel="Re λ / Ω", ylabel="Im λ / Ω, modulo 1")
    right.set(xlabel="advance ratio μ", ylabel="Re λ / Ω")
    right.legend()
    figure.colorbar(dots, ax=left, label="advance ratio μ")
    figure.savefig("flapping.png", dpi=150)
