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
"""Instability is searched for between stable speeds if the largest modulus of a multiplier exceeds this
number. Chosen by judgement: with stronger damping, only a parametric resonance that doubles the amplitude in
a period causes instability."""

INTERVALS = 40
"""Smallest number of intervals into which a range of speeds is divided: to search for narrow bands, and to
test whether matrices exist. Chosen by judgement."""

_PHASES = 16
"""Number of phases at which the rotation rate of the multipliers is computed from frozen matrices. Chosen by
judgement."""

DAMPED_OUT = 1e-2
"""Modes of the frozen matrices are ignored if the modulus of their multipliers is below this number. Such
modes can become unstable only by a parametric resonance that increases the amplitude a hundredfold in a
period. Chosen by judgement."""

_HALVINGS = 20
"""Maximum number of times that an interval in which two pairs of multipliers may pass through +1 or -1 is
halved. It limits the computing time. Chosen by judgement."""

_NEIGHBOURHOOD, _COINCIDENT = 0.5, 1e-4
"""Largest distance from +1 or -1 at which a pair of multipliers is assumed to be able to pass this point
before the next speed; and difference between the distances of two pairs below which they count as one pair.
Chosen by judgement."""

Rotation = Callable[[Array], Array]
"""Type of functions of speeds (k,). Such a function returns the angles (k,) by which the fastest relevant
multiplier rotates per unit of 1/Ω. Each angle is the frequency of the mode times the period of the phase."""


def no_rotation(speeds: Array) -> Array:
    """Return zero rotation at speeds (k,), for searches whose grid of speeds is not limited by rotation."""
    return np.zeros(len(speeds))


def multiplier_rotation(
    system: PeriodicSystem, ends: tuple[float, float], max_angle: float = np.inf
) -> Rotation:
    """Return the rotation of the multipliers, from the matrices frozen at several phases at the two ends of
    the range.

    Modes are ignored if they are damped out within a period, or if their phase advance per period exceeds
    `max_angle` at the lowest speed.
    """
    values = [omega * frozen(SinglePoint(system, omega), _PHASES).eigenvalues().ravel() for omega in ends]
    exponents = np.concatenate(values) * system.period
    exponents = exponents[np.abs(np.imag(exponents)) <= max_angle * ends[0]]

    def rotation(speeds: Array) -> Array:
        relevant = np.real(exponents) > np.log(DAMPED_OUT) * speeds[:, None]
        return np.where(relevant, np.abs(np.imag(exponents)), 0.0).max(axis=1, initial=0.0)

    return rotation


def by_speed(samples: StabilitySamples) -> StabilitySamples:
    """Return samples sorted by speed."""
    return samples[np.argsort(samples.points[:, 0])]


def separate_crossings(
    evaluate: Evaluate, samples: StabilitySamples, rotation: Rotation, signs: Sequence[int] = (1, -1)
) -> StabilitySamples:
    """Add samples between two neighbouring speeds if two pairs of multipliers may both pass through +1, or
    both through -1, between these speeds. Each pair then has a separate minimum of the distance."""
    for _ in range(_HALVINGS):
        speeds = samples.points[:, 0]
        max_change = np.minimum(-2 * np.diff(1 / speeds) * rotation(speeds[1:]), _NEIGHBOURHOOD)
        refine = np.any([_two_may_cross(samples, sign, max_change) for sign in signs], axis=0)
        if not refine.any():
            break
        samples = by_speed(samples + evaluate(((speeds[:-1] + speeds[1:]) / 2)[refine, None]))
    return samples


def _two_may_cross(samples: StabilitySamples, sign: int, max_change: Array) -> Array:
    """Return a mask (k - 1,) of the intervals in which two pairs may both pass through the point +1 (`sign`
    1) or -1. A pair may do so if its distances from this point at both ends are below `max_change` (k -
    1,)."""
    values = crossing_function(samples.multipliers, sign)
    distance, beyond = np.sqrt(np.maximum(values, 0.0)), values[:, 1:] < 0
    farther, separation = (
        np.maximum(ends[:-1], ends[1:]) for ends in (distance[:, 1:], np.diff(distance, axis=1))
    )
    both = (farther < max_change[:, None]) & (separation > _COINCIDENT) & ~(beyond[:-1] | beyond[1:])
    return np.asarray(both.any(axis=1))


def ends_with_matrices(system: PeriodicSystem, speeds: Array) -> tuple[float, float]:
    """Return the lowest and the highest speed (rad/s) with valid matrices. The ascending `speeds`, and speeds
    that divide their range evenly, are tested. If the matrices are valid at no speed, raise the exception for
    the highest speed."""
    evenly = np.linspace(speeds[0], speeds[-1], INTERVALS + 1)
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
    """Return a message with the number of failed speeds, their ranges, and the reason. `speeds` (P,) are
    ascending."""
    ranges = unit.spans((float(speeds[low]), float(speeds[high])) for low, high in runs(failed))
    of = f"of {len(speeds)} speeds"
    return f"{counted(failed.sum(), f'{of} has', f'{of} have')} no result, {ranges}: {reason}"
