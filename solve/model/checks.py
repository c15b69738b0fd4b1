"""Whether the matrices of a generated module repeat after the period and jump at its breaks alone, and M is
that of a kinetic energy."""

from contextlib import suppress

import numpy as np

from solve.arrays import Array
from solve.contracts import Matrices
from solve.errors import MatricesError
from solve.model.sampling import MatrixSampler
from solve.system import PERIODIC, PeriodicSystem, require_inertia

_LOOKS = 128
"""Phases of a period at which the matrices are looked at before a solution."""

_STEEP = 0.25
"""Change between neighbouring phases, relative to the whole variation, from which a jump is looked for: that
of a sine of order 10."""

_BESIDE = 8.0
"""The same relative to the larger of the changes before and after. Those of a parabola form an arithmetic
progression, of which the middle term is at most as large as the larger of its neighbours."""

_HALVINGS = 40
"""Of the distance of two phases, to 4e-14 of the turn; a rise over 1e-9 of the turn changes by 1e-4 of itself
there, a jump by itself."""

_JUMP = 1e-2
"""What is left of the change, relative to the whole variation, from which it is a jump: a hundred times what
a rise over 1e-9 of the turn leaves."""


def require_sound(system: PeriodicSystem, speed: float) -> None:
    """Raise MatricesError unless the matrices at a speed (rad/s) repeat at every phase, and M is positive
    definite."""
    phase = _looked_at(system)
    for symbol, change in system.changes(phase, phase + system.period, speed):
        raise MatricesError(
            f"{symbol} is not periodic: after the period {system.period:.6g} it has changed by "
            f"{change:.3g}; look at the mechanism's period and fundamental motion, and at "
            "parameters that count (teeth, orders)"
        )
    negative = _not_positive(system.at(phase, speed)[0])
    if negative.any():
        raise MatricesError(
            f"M is not positive definite at phase {phase[np.argmax(negative)]:.4g}: some motion there "
            "has no or negative kinetic energy; look at the masses and the signs in the kinetic energy"
        )


def sound_at_all_speeds(system: PeriodicSystem, sampler: MatrixSampler) -> bool:
    """Whether `require_sound` finds nothing wrong at any speed: the matrices are sums of powers of the speed,
    each with coefficients that repeat by themselves, and M is the same at all speeds and good."""
    phase = _looked_at(system)
    terms = sampler.terms(system.beside(phase, phase + system.period))
    if terms is None:
        return False
    table, entry, power = terms
    now, later, beside = np.split(table, 3)
    allowed = PERIODIC * np.abs(now).max(axis=0) + 2 * np.abs(beside - now)
    # Of what is not finite no comparison holds.
    if (
        _steep(system, phase, np.vstack((now, later[:1])), PERIODIC * np.abs(now).max(axis=0))[0].size
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
    """Raise MatricesError where matrices at a speed (rad/s) jump without a break, at a phase within the
    period."""
    phase = _looked_at(system)

    def entries(parts: Matrices) -> Array:
        return np.column_stack([part.reshape(len(part), -1) for part in parts])

    ends = np.append(phase, phase[0] + system.period)
    parts = system.at(ends, speed)
    values, roundoff = entries(parts), [part.ravel() for part in system.negligible(parts, speed)]
    at, entry = _steep(system, phase, values, np.concatenate(roundoff))
    if not at.size:
        return
    low, high, first, last = ends[at], ends[at + 1], values[at, entry], values[at + 1, entry]
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        between = entries(system.at(middle, speed))[np.arange(len(at)), entry]
        left = np.abs(between - first) >= np.abs(last - between)
        low, first = np.where(left, low, middle), np.where(left, first, between)
        high, last = np.where(left, middle, high), np.where(left, between, last)
    change = np.abs(last - first)
    jumps = np.flatnonzero(change >= _JUMP * np.ptp(values, axis=0)[entry])
    if jumps.size:
        here, symbols = jumps[0], np.repeat(list("MCKd"), [part[0].size for part in parts])
        raise MatricesError(
            f"{symbols[entry[here]]} jumps by {change[here]:.3g} at phase {low[here] % system.period:.6g}, "
            "where the model has no break; give angles that go on beyond half a turn (atan2 jumps there by "
            "2π), and state a jump that is meant by Heaviside, Piecewise or wrapped"
        )


def _steep(system: PeriodicSystem, phase: Array, values: Array, roundoff: Array) -> tuple[Array, Array]:
    """After which of the phases (k,) values (k+1, m) at these and one period after the first change so much,
    without a break, that they may jump (j,), and the entry of each that does so most. roundoff (m,): largest
    variation that counts as none."""
    change, variation = np.abs(np.diff(values, axis=0)), np.ptp(values, axis=0)
    neighbours = np.maximum(np.roll(change, 1, axis=0), np.roll(change, -1, axis=0))
    steep = (change >= _STEEP * variation) | (change > _BESIDE * neighbours)
    steep &= variation > roundoff
    steep[np.searchsorted(phase, np.mod(system.breaks, system.period)) - 1] = False
    at = np.flatnonzero(steep.any(axis=1))
    share = np.where(steep, change / np.where(variation > 0, variation, 1.0), 0.0)[at]
    return at, share.argmax(axis=1) if at.size else at


def _looked_at(system: PeriodicSystem) -> Array:
    """Phases over the period, none of them at a jump."""
    phase = (np.arange(_LOOKS) + 0.5) * (system.period / _LOOKS)
    breaks = np.array(system.breaks)
    return phase[np.abs(phase[:, None] - breaks).min(axis=1, initial=np.inf) > 1e-9 * system.period]


def _not_positive(M: Array) -> Array:
    """Which of the matrices (k, n, n) are not positive definite (k,)."""
    return np.linalg.eigvalsh(M).min(axis=1) <= 0
