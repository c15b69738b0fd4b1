"""Points whose M is singular at some phase, whether or not a step samples it there."""

from collections.abc import Iterator

import numpy as np

from solve.arrays import Array
from solve.errors import MatricesError
from solve.period.frozen import Frozen
from solve.period.multipliers import EPS
from solve.period.points import Points, matrices

_DIP = 0.02
"""Part of its usual size to which a determinant has to fall for its least value to be looked for."""

_ZERO = 64 * EPS
"""Part of its usual size that counts as none."""

_PART, _ROUNDS = 16, 8
"""How much closer each round looks at the least value, and rounds that lead to the rounding of a phase."""


def singular(points: Points, modes: Frozen) -> Iterator[tuple[int, MatricesError]]:
    """Positions of the points whose M is singular at some phase, and why."""
    for position in np.flatnonzero(~modes.inertia_steady(_DIP)).tolist():
        phase = _singular_phase(points[np.array([position])], modes.phases)
        if phase is not None:
            yield (
                position,
                MatricesError(
                    f"M is singular near phase {phase:.6g}: some coordinate has no inertia there; give every "
                    "coordinate a mass at every phase"
                ),
            )


def _singular_phase(point: Points, phases: Array) -> float | None:
    """Where the determinant of M of a point changes its sign, or its least value is rounding."""
    h = float(phases[1] - phases[0])
    determinants = _determinants(point, phases)
    if not np.isfinite(determinants).all():
        return None
    usual = np.median(np.abs(determinants))
    for _ in range(_ROUNDS):
        changes = np.flatnonzero((determinants[1:] * determinants[:-1] < 0) & _together(point, phases))
        if len(changes):
            return float(phases[changes[0]]) % point.period
        sizes = np.abs(determinants)
        at = int(sizes.argmin())
        if sizes[at] <= _ZERO * usual:
            return float(phases[at]) % point.period
        if not sizes.max() > 2 * sizes[at]:
            return None
        phases = phases[at] + h * np.linspace(-1, 1, 2 * _PART + 1)
        h, determinants = h / _PART, _determinants(point, phases)
    return None


def _determinants(point: Points, phases: Array) -> Array:
    """Of M (k,), in units in which its diagonal is about 1."""
    M = matrices(point, np.mod(phases, point.period))[0][0]
    unit = np.sqrt(np.abs(np.einsum("kii->ki", M)).max(axis=0))
    unit[unit == 0] = 1.0
    with np.errstate(invalid="ignore"):
        return np.linalg.det(M / (unit[:, None] * unit))


def _together(point: Points, phases: Array) -> Array:
    """Whether no jump lies between a phase and the next (k-1,)."""
    turn, phase = np.divmod(phases, point.period)
    jumps = np.sort(np.mod(point.breaks, point.period)) if point.breaks else np.empty(0)
    passed = turn * len(jumps) + np.searchsorted(jumps, phase)
    return np.diff(passed) == 0
