"""Grids of speeds for stability searches: the range in which matrices exist, and the required density of
speeds."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from solve.arrays import Array, runs
from solve.errors import SolveError, counted
from solve.period.frozen import frozen
from solve.period.points import SinglePoint
from solve.studies.stability_samples import Evaluate, StabilitySamples, crossing_function
from solve.system import PeriodicSystem, check
from solve.units import ShownUnit

LIGHTLY_DAMPED = 0.5
"""Modulus of the largest multiplier above which instability is searched for between stable speeds. Chosen by
judgement: with stronger damping, only a parametric resonance that doubles the amplitude in a period causes
instability."""

_INTERVALS = 40
"""Number of intervals of the speed range at whose ends the existence of matrices is tested. Chosen by
judgement."""

_PHASES = 16
"""Number of phases at which the rotation rate of the multipliers is computed from frozen matrices. Chosen by
judgement."""

_DAMPED_OUT = 1e-2
"""Modulus of a multiplier of the frozen matrices below which its mode is ignored: it can become unstable only
by a parametric resonance that increases the amplitude a hundredfold in a period. Chosen by judgement."""

_HALVINGS = 20
"""Maximum number of halvings of an interval in which two pairs of multipliers may pass +1 or -1. A bound on
the work, and a choice."""

_NEIGHBOURHOOD, _COINCIDENT = 0.5, 1e-4
"""Largest distance from +1 or -1 at which a pair of multipliers may pass this point before the next speed;
difference between two such distances below which both pairs count as one. Chosen by judgement."""

Rotation = Callable[[Array], Array]
"""Type of functions of speeds (k,) that return the angle by which the fastest relevant multiplier rotates per
unit of 1/Ω: its frequency times the period in phase."""


def no_rotation(speeds: Array) -> Array:
    """Rotation of multipliers for methods whose grid is not limited by it: zero at speeds (k,)."""
    return np.zeros(len(speeds))


def multiplier_rotation(
    system: PeriodicSystem, ends: tuple[float, float], max_angle: float = np.inf
) -> Rotation:
    """Rotation from the matrices frozen at several phases and at the two ends of the range.

    Ignored are modes that are damped out within a period, and modes whose phase advance per period exceeds
    `max_angle` at the lowest speed.
    """
    values = [omega * frozen(SinglePoint(system, omega), _PHASES).eigenvalues().ravel() for omega in ends]
    exponents = np.concatenate(values) * system.period
    exponents = exponents[np.abs(np.imag(exponents)) <= max_angle * ends[0]]

    def rotation(speeds: Array) -> Array:
        relevant = np.real(exponents) > np.log(_DAMPED_OUT) * speeds[:, None]
        return np.where(relevant, np.abs(np.imag(exponents)), 0.0).max(axis=1, initial=0.0)

    return rotation


def by_speed(samples: StabilitySamples) -> StabilitySamples:
    """Samples sorted by speed."""
    return samples[np.argsort(samples.points[:, 0])]


def separate_crossings(
    evaluate: Evaluate, samples: StabilitySamples, rotation: Rotation, signs: Sequence[int] = (1, -1)
) -> StabilitySamples:
    """Samples over ascending speeds, refined where two pairs of multipliers may both pass +1, or both -1,
    between two speeds. Each pair then has a separate minimum of the distance."""
    for _ in range(_HALVINGS):
        speeds = samples.points[:, 0]
        max_change = np.minimum(-2 * np.diff(1 / speeds) * rotation(speeds[1:]), _NEIGHBOURHOOD)
        refine = np.any([_two_may_cross(samples, sign, max_change) for sign in signs], axis=0)
        if not refine.any():
            break
        samples = by_speed(samples + evaluate(((speeds[:-1] + speeds[1:]) / 2)[refine, None]))
    return samples


def _two_may_cross(samples: StabilitySamples, sign: int, max_change: Array) -> Array:
    """Mask (k - 1,) of the intervals in which two pairs may pass +1, or -1: at one end the distances of both
    pairs from this point are below the largest possible change."""
    values = crossing_function(samples.multipliers, sign)
    distance, beyond = np.sqrt(np.maximum(values, 0.0)), values[:, 1:] < 0
    farther, separation = (
        np.maximum(ends[:-1], ends[1:]) for ends in (distance[:, 1:], np.diff(distance, axis=1))
    )
    both = (farther < max_change[:, None]) & (separation > _COINCIDENT) & ~(beyond[:-1] | beyond[1:])
    return np.asarray(both.any(axis=1))


def ends_with_matrices(system: PeriodicSystem, speeds: Array) -> tuple[float, float]:
    """Lowest and highest speed (rad/s) with valid matrices, among ascending speeds and speeds that divide
    their range evenly. If the matrices are valid at no speed, raises the exception of the highest one."""
    evenly = np.linspace(speeds[0], speeds[-1], _INTERVALS + 1)
    candidates = np.unique(np.concatenate((speeds, evenly))).tolist()
    errors: list[SolveError] = []

    def first_valid(speeds: Iterable[float]) -> float:
        for speed in speeds:
            try:
                check(system, speed)
            except SolveError as error:
                errors.append(error)
                continue
            return speed
        raise errors[0]

    highest = first_valid(reversed(candidates))
    return first_valid(candidates), highest


def without_result(speeds: Array, failed: Array, unit: ShownUnit, reason: str) -> str:
    """Message with the number and the ranges of those ascending speeds (P,) that failed, and the reason."""
    ranges = unit.spans((float(speeds[low]), float(speeds[high])) for low, high in runs(failed))
    of = f"of {len(speeds)} speeds"
    return f"{counted(failed.sum(), f'{of} has', f'{of} have')} no result, {ranges}: {reason}"
