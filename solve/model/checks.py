"""Whether the matrices of a generated module repeat after the period, and M is that of a kinetic energy."""

from contextlib import suppress

import numpy as np

from solve.arrays import Array
from solve.errors import MatricesError
from solve.model.sampling import MatrixSampler
from solve.system import PERIODIC, PeriodicSystem, require_inertia

_LOOKS = 128
"""Phases of a period at which the matrices are looked at before a solution."""


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
    if (power[entry < system.n**2] != 2).any() or not (np.abs(later - now) <= allowed).all():
        return False
    M = system.at(phase, 1.0)[0]
    with suppress(MatricesError):
        require_inertia(M)
        return not _not_positive(M).any()
    return False


def _looked_at(system: PeriodicSystem) -> Array:
    """Phases over the period, none of them at a jump."""
    phase = (np.arange(_LOOKS) + 0.5) * (system.period / _LOOKS)
    breaks = np.array(system.breaks)
    return phase[np.abs(phase[:, None] - breaks).min(axis=1, initial=np.inf) > 1e-9 * system.period]


def _not_positive(M: Array) -> Array:
    """Which of the matrices (k, n, n) are not positive definite (k,)."""
    return np.linalg.eigvalsh(M).min(axis=1) <= 0
