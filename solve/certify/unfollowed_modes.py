"""Frozen modes that the steps of a method do not resolve.

With coefficients frozen at a phase, a step of a one-step method multiplies a mode of rate λ by R(hλ) instead
of exp(hλ). If the two differ, two solutions may agree on a wrong multiplier: L-stable methods damp an
undamped mode, others preserve a decaying one. The remainder of a disturbance after a period is bounded by the
larger of both factors."""

from functools import lru_cache

import numpy as np

from solve.arrays import Array
from solve.methods.collocation import Collocation
from solve.methods.method import Method
from solve.period.frozen import Frozen, surviving

_LOST = 0.25
"""Relative error of a mode over the period above which it is unresolved: a quarter of a radian of phase, far
below half a revolution, where two solutions may agree by chance."""

_FEW_PHASES_SUFFICE = 0.1
"""Fraction of the allowed remainder below which that at a sixteenth of the phases decides; the two differ by
at most a factor of 1.2 for the models of this project."""

_RADII, _ANGLES = np.geomspace(1e-3, 64.0, 400), np.pi * np.linspace(0.5, 1.0, 33)


def unfollowed(method: Method, modes: Frozen, steps: int, allowed: Array) -> Array:
    """Remainder (P,) of a unit disturbance after a period in modes that the steps do not resolve.

    Parameters
    ----------
    method : with a stability function, or an angle ω h that it follows
    modes : of P points
    steps : per period
    allowed : (P,), remainder that does not matter

    Returns
    -------
    (P,), 0 where all modes are followed; infinite where a method without stability function keeps modes
    that it does not follow.
    """
    stages = method.stages
    limit = _followed(method, steps) * steps / modes.period
    lost, open_ = np.zeros(len(modes)), np.flatnonzero(~modes.within(limit))
    for few in (True, False):
        if len(open_):
            some = modes[open_]
            rates = some.few_eigenvalues if few else some.eigenvalues()
            if stages is not None:
                lost[open_] = _remainder(stages, rates, modes.period / steps, steps)
            else:
                beyond = np.abs(rates).max(axis=(1, 2)) > limit
                left = surviving(rates, modes.period, limit * modes.period) if method.l_stable else np.inf
                lost[open_] = np.where(beyond, left, 0.0)
            open_ = open_[~((lost[open_] > 0) & (lost[open_] < _FEW_PHASES_SUFFICE * allowed[open_]))]
    return lost


def _followed(method: Method, steps: int) -> float:
    """Largest h|λ| up to which all modes that do not grow are followed over this number of steps."""
    if method.stages is not None:
        return _followed_by(method.stages, steps)
    return min(method.follows, float(method.in_phase(np.array(steps), _LOST)) / steps)


@lru_cache(maxsize=256)
def _followed_by(stages: Collocation, steps: int) -> float:
    lost = _is_lost(stages, _RADII[:, None] * np.exp(1j * _ANGLES), steps)[0].any(axis=1)
    return float(_RADII[max(int(lost.argmax()) - 1, 0)]) if lost.any() else float(_RADII[-1])


def _is_lost(stages: Collocation, z: Array, steps: int) -> tuple[Array, Array]:
    """Whether modes z = hλ are not followed, and the larger moduli of their exact and their computed
    factors."""
    with np.errstate(over="ignore"):
        exact, computed = np.exp(z), stages.stability_function(z)
        size = np.maximum(np.abs(exact), np.abs(computed))
        return ~(steps * np.abs(computed - exact) <= _LOST * size), size


def _remainder(stages: Collocation, rates: Array, h: float, steps: int) -> Array:
    """Product over the period (P,) of the largest factors of modes that are not followed, or of the fastest
    one where all are; from frozen rates (P, k, 2n)."""
    z = h * rates
    lost, size = _is_lost(stages, z, steps)
    counts = lost | (np.abs(z) == np.abs(z).max(axis=-1, keepdims=True))
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        factors = np.where(counts, np.log(size), -np.inf).max(axis=-1).mean(axis=-1)
        left = np.exp(steps * factors)
    return np.where(lost.any(axis=(-2, -1)), left, 0.0)
