"""Where Newmark's method is stable on the undamped oscillator η″ + ω²η = 0 (thesis 6.2.3, Fig. 6.1).

`angle` is ω h, the angle that the oscillator turns in a step.
"""

import math

import numpy as np

from solve.arrays import Array


def spectral_radius(gamma: float, beta: float, angle: Array | float) -> Array:
    """Largest |λ| of a step, from the characteristic equation, thesis (6.10)."""
    mu2 = np.square(angle) / (1 + beta * np.square(angle))
    half_sum, product = 1 - (gamma + 0.5) * mu2 / 2, 1 - (gamma - 0.5) * mu2
    root = np.sqrt(np.asarray(half_sum**2 - product, dtype=complex))
    return np.maximum(np.abs(half_sum + root), np.abs(half_sum - root))


def stability_limit(gamma: float, beta: float) -> float:
    """Largest ω h at which a step does not grow: 1/sqrt(γ/2 - β), where an eigenvalue passes -1.

    Infinite for 2β ≥ γ ≥ 1/2; 0 for γ < 1/2, where every step grows. The thesis asks more,
    β ≥ (γ + 1/2)²/4: that the eigenvalues stay complex, see `oscillation_limit`.
    """
    if gamma < 0.5:
        return 0.0
    return math.inf if 2 * beta >= gamma else 1 / math.sqrt(gamma / 2 - beta)


def oscillation_limit(gamma: float, beta: float) -> float:
    """Largest ω h at which the eigenvalues are complex, so that the step turns as the oscillator does:
    2/sqrt((γ + 1/2)² - 4β), thesis (6.11). Infinite for β ≥ (γ + 1/2)²/4."""
    rest = (gamma + 0.5) ** 2 - 4 * beta
    return math.inf if rest <= 0 else 2 / math.sqrt(rest)
