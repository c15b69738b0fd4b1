"""Errors of systems that are interpolated from samples, estimated from the decay of the samples' harmonics.

Harmonics that the azimuths do not resolve are missing, and alias to resolved ones.

- A solution with fewer harmonics of the samples differs from the solution with all of them by the effect of
the omitted harmonics. Two such differences give the decay rate of the effect, and by extrapolation the effect
of the missing harmonics.
- With k azimuths, harmonics near k alias to the lowest harmonics. A solution from every second or third
azimuth contains the alias of harmonics near k/2 or k/3 instead. The decay of the amplitudes relates the two
effects.
- A solution with means shifted by the amplitudes near k estimates the same effect.

The larger error is used. It is zero if the harmonics of the samples end below the resolved range. Higher
harmonics that alias into the harmonics below this end are not detected."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.certify.all_multipliers import RefinedMultipliers
from solve.certify.certified import Certified, InterpolationError
from solve.certify.estimates import NO_DIGIT, SAFETY, differences
from solve.errors import SolveError
from solve.methods.free import free, solutions_on
from solve.period.points import OnePoint
from solve.samples import Samples
from solve.system import PeriodicSystem, with_samples
from solve.terminal import progress

_FASTEST = 1e-3
"""Smallest ratio of the effects of successive multiples of harmonics that is extrapolated: a choice, as one
difference may vanish by chance."""

_FEWEST = 2
"""Number of azimuths above which a harmonic can be determined."""

_FLAT = 0.9
"""Ratio of the effects of successive multiples above which the harmonics count as not decaying. A choice: at
this ratio, one more accurate digit requires 22 multiples."""

_MOST_AZIMUTHS = 100_000
"""Largest number of azimuths that is recommended. If more are required, the harmonics hardly decay. A
choice."""


class _Effect(NamedTuple):
    """Relative differences (2,) of orbit and multipliers if the multiples of the spacing above `kept` are
    omitted."""

    kept: int
    change: Array


def with_interpolation_errors(
    result: Certified, system_at: Callable[[int], tuple[PeriodicSystem, float]]
) -> Certified:
    """Solved points with error estimates that include the interpolation of their samples.

    Points of systems that are not sampled remain unchanged. system_at: function that returns the system and
    speed (rad/s) of a point."""
    if not len(result) or system_at(0)[0].capabilities.samples is None:
        return result
    found = []
    with progress.task("error of the interpolation", len(result)) as count:
        for row in range(len(result)):
            found.append(_of_point(result, row, *system_at(row)))
            count.add(1)
    added = np.array([(error.orbit, error.multipliers) for error in found])
    radius = result.solutions.multipliers.spectral_radius
    with np.errstate(invalid="ignore"):
        margin = np.where(radius > 0, added[:, 1] * radius, added[:, 1])
    return replace(
        result,
        errors=result.errors + added,
        absolute=result.absolute + margin,
        interpolation=tuple(found),
    )


def with_margin(refined: RefinedMultipliers, error: float) -> RefinedMultipliers:
    """Multipliers whose errors are increased by `error`, relative to the spectral radius."""
    sizes = np.real(refined.logarithms)
    with np.errstate(over="ignore", invalid="ignore"):
        errors = refined.errors + error * np.exp(sizes.max() - sizes)
    return replace(refined, errors=np.where(errors < NO_DIGIT, errors, np.nan))


def _of_point(result: Certified, row: int, system: PeriodicSystem, speed: float) -> InterpolationError:
    """Interpolation error at a point."""
    samples = system.capabilities.samples
    assert samples is not None
    spacing, last = samples.spacing, int(samples.significant.max(initial=0))
    if samples.ends:
        return InterpolationError(samples.azimuths, last, 0.0, 0.0, samples.azimuths)
    resolved = samples.resolved // spacing
    kept = sorted({max(0, resolved - max(1, resolved // 4)), max(0, resolved - max(2, resolved // 2))})
    point = system, speed
    try:
        changes = [_change(result, row, point, samples.truncated(number * spacing)) for number in kept]
        aliased = _aliased(result, row, point, samples)
    except SolveError:
        return InterpolationError(samples.azimuths, last, math.inf, math.inf, None)
    effects = [_Effect(number, change) for number, change in zip(kept, changes, strict=True)]
    # Errors of fits to non-uniform azimuths decay irregularly: the last difference is not extrapolated.
    next_one = resolved + 1 if samples.given is None else effects[-1].kept + 1
    errors = SAFETY * samples.amplification * _extrapolated(effects, next_one)
    errors = np.maximum(errors, SAFETY * aliased)
    half = samples.azimuths / 2
    ratios = np.maximum(_ratios(effects), samples.decay(half, half + spacing))
    enough = _sufficient(ratios, errors / result.request.rtol, spacing, samples.azimuths)
    return InterpolationError(samples.azimuths, last, float(errors[0]), float(errors[1]), enough)


def _change(result: Certified, row: int, point: tuple[PeriodicSystem, float], samples: Samples) -> Array:
    """Relative differences (2,) of a point's orbit and multipliers with other samples. Raises SolveError."""
    system, speed = point
    solutions = result.solutions[np.array([row])]
    fewer = OnePoint(with_samples(system, samples), speed)
    orbit, engine = solutions.curve is not None, result.request.engine
    made = solutions_on(result.method, fewer, solutions.grid, orbit, engine, free(fewer))
    for reason in made.failures.values():
        raise reason
    return differences(made, solutions, result.modes[np.array([row])])[0]


def _aliased(result: Certified, row: int, point: tuple[PeriodicSystem, float], samples: Samples) -> Array:
    """Errors (2,) at a point due to harmonics that alias to the lowest ones; 0 if azimuths are not uniform,
    since then all harmonics alias. Raises SolveError."""
    errors = np.zeros(2)
    for stride in (2, 3) if samples.given is None else ():
        if samples.azimuths > _FEWEST * stride:
            change = _change(result, row, point, samples.thinned(stride))
            decay = samples.decay(samples.azimuths / stride, samples.azimuths)
            errors = np.maximum(errors, change * decay)
    if samples.given is None:
        errors = np.maximum(errors, _change(result, row, point, samples.shifted()))
    return errors


def _extrapolated(effects: list[_Effect], next_one: int) -> Array:
    """Errors (2,) due to the multiples of the spacing from `next_one`."""
    last = effects[-1]
    with np.errstate(divide="ignore", invalid="ignore"):
        return last.change * _ratios(effects) ** (next_one - last.kept - 1)


def _ratios(effects: list[_Effect]) -> Array:
    """Ratios (2,), at most 1, of the effects of successive multiples, from one or two effects."""
    if len(effects) < 2:
        return np.ones(2)
    (low, more), (high, less) = effects
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.where(more > 0, less / np.where(more > 0, more, 1.0), 1.0) ** (1 / (high - low))
    return np.clip(ratios, _FASTEST, 1.0)


def _sufficient(ratios: Array, excess: Array, spacing: int, azimuths: int) -> int | None:
    """Number of azimuths for which the errors meet the tolerance; None if the harmonics hardly decay.

    ratios (2,): of the effects of successive multiples of the spacing. excess (2,): errors over tolerance."""
    missed = excess > 1
    if not missed.any():
        return azimuths
    if (ratios[missed] > _FLAT).any() or not np.isfinite(excess).all():
        return None
    more = math.ceil((np.log(excess[missed]) / -np.log(ratios[missed])).max())
    enough = azimuths + 2 * spacing * more
    return enough if enough <= _MOST_AZIMUTHS else None
