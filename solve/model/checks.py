"""Checks of generated matrices: they must be periodic and must jump only at the breaks, and M must be
positive definite."""

from contextlib import suppress

import numpy as np

from solve.arrays import Array, midpoint_phases
from solve.contracts import Matrices
from solve.errors import MatricesError
from solve.matrices import PERIODIC, changes, negligible_changes, require_inertia, with_neighbours
from solve.model.domain import BISECTIONS
from solve.model.sampling import MatrixSampler
from solve.system import PeriodicSystem, in_phase

_CHECK_PHASES = 128
"""Number of phases per period at which the matrices are checked. Chosen by judgement."""

_STEEP = 0.25
"""Change between neighbouring phases, relative to the total variation, above which a jump is sought. Chosen
by judgement: harmonic 10 changes by as much."""

_STEEPER_THAN_NEIGHBOURS = 8.0
"""Ratio of a change between neighbouring phases to the larger of the changes before and after it, above which
a jump is sought. For a parabola, the ratio is at most 1, because its changes form an arithmetic progression.
"""

_JUMP = 1e-2
"""Threshold for a jump: the change that remains after the bisections, relative to the total variation. Chosen
by judgement: after the bisections of a continuous flank with a width of 1e-9 of the period, less than a
hundredth of the threshold remains.
"""


def require_valid(system: PeriodicSystem, speed: float) -> None:
    """Raise MatricesError unless the matrices at a speed (rad/s) are periodic and M is positive definite."""
    phase = _check_phases(system)
    phases = with_neighbours(phase, phase + system.period, system.period)
    for symbol, change in changes(in_phase(system, phases, speed), speed):
        raise MatricesError(
            f"{symbol} is not periodic: it changes by {change:.3g} over the period "
            f"{system.period:.6g}; check the mechanism's period and fundamental motion, and integer "
            "parameters such as numbers of teeth"
        )
    negative = _not_positive(system.at(phase, speed)[0])
    if negative.any():
        raise MatricesError(
            f"M is not positive definite at phase {phase[np.argmax(negative)]:.4g}: some motion has "
            "zero or negative kinetic energy there; check the masses and the signs in the kinetic "
            "energy"
        )


def valid_at_all_speeds(system: PeriodicSystem, sampler: MatrixSampler) -> bool:
    """Whether the matrices are certain to pass `require_valid` at every speed.

    This is the case if the entries are polynomials in the speed with periodic coefficients, and M is positive
    definite and does not depend on the speed."""
    phase = _check_phases(system)
    terms = sampler.terms(with_neighbours(phase, phase + system.period, system.period))
    if terms is None:
        return False
    table, entry, power = terms
    now, later, beside = np.split(table, 3)
    negligible = PERIODIC * np.abs(now).max(axis=0)
    allowed = negligible + 2 * np.abs(beside - now)
    # Comparisons with NaN are False.
    if (
        _steep_intervals(system, phase, np.vstack((now, later[:1])), PERIODIC * np.abs(now).max(axis=0))[
            0
        ].size
        or (power[entry < system.n**2] != 2).any()
        or not (np.abs(later - now) <= allowed).all()
    ):
        return False
    M = system.at(phase, 1.0)[0]
    with suppress(MatricesError):
        require_inertia(M)
        return not _not_positive(M).any()
    return False


def require_no_jump(system: PeriodicSystem, speed: float) -> None:
    """Raise MatricesError if the matrices at a speed (rad/s) jump at a phase that is not a break."""
    phase = _check_phases(system)

    def entries(matrices: Matrices) -> Array:
        return np.column_stack([array.reshape(len(array), -1) for array in matrices])

    ends = np.append(phase, phase[0] + system.period)
    matrices = system.at(ends, speed)
    values, roundoff = entries(matrices), [array.ravel() for array in negligible_changes(matrices, speed)]
    index, entry = _steep_intervals(system, phase, values, np.concatenate(roundoff))
    if not index.size:
        return
    low, high, first, last = ends[index], ends[index + 1], values[index, entry], values[index + 1, entry]
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        between = entries(system.at(middle, speed))[np.arange(len(index)), entry]
        left = np.abs(between - first) >= np.abs(last - between)
        low, first = np.where(left, low, middle), np.where(left, first, between)
        high, last = np.where(left, middle, high), np.where(left, between, last)
    change = np.abs(last - first)
    jumps = np.flatnonzero(change >= _JUMP * np.ptp(values, axis=0)[entry])
    if jumps.size:
        jump, symbols = jumps[0], np.repeat(list("MCKd"), [array[0].size for array in matrices])
        raise MatricesError(
            f"{symbols[entry[jump]]} jumps by {change[jump]:.3g} at phase "
            f"{low[jump] % system.period:.6g}, where the model has no break; use angles that are "
            "continuous beyond π (atan2 jumps there by 2π), and declare an intended jump with Heaviside, "
            "Piecewise or wrapped"
        )


def _steep_intervals(
    system: PeriodicSystem, phase: Array, values: Array, roundoff: Array
) -> tuple[Array, Array]:
    """Find intervals between phases (k,) in which values (k+1, m) change so steeply that they may jump.

    values: values at the phases, and one period after the first phase. Intervals that contain a break are
    excluded. roundoff (m,): largest variation that counts as round-off. Return the indices (j,) of the
    intervals and, for each interval, the index of the entry with the largest relative change."""
    change, variation = np.abs(np.diff(values, axis=0)), np.ptp(values, axis=0)
    neighbours = np.maximum(np.roll(change, 1, axis=0), np.roll(change, -1, axis=0))
    steep = (change >= _STEEP * variation) | (change > _STEEPER_THAN_NEIGHBOURS * neighbours)
    steep &= variation > roundoff
    steep[np.searchsorted(phase, np.mod(system.breaks, system.period)) - 1] = False
    index = np.flatnonzero(steep.any(axis=1))
    relative = np.where(steep, change / np.where(variation > 0, variation, 1.0), 0.0)[index]
    return index, relative.argmax(axis=1) if index.size else index


def _check_phases(system: PeriodicSystem) -> Array:
    """Phases of one period at which matrices are checked. Phases at a break are excluded."""
    phase = midpoint_phases(_CHECK_PHASES, system.period)
    breaks = np.array(system.breaks)
    return phase[np.abs(phase[:, None] - breaks).min(axis=1, initial=np.inf) > 1e-9 * system.period]


def _not_positive(M: Array) -> Array:
    """Mask (k,) of the matrices (k, n, n) that are not positive definite."""
    return np.linalg.eigvalsh(M).min(axis=1) <= 0
