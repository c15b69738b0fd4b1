"""Errors due to the reduction of a system, and due to the interpolation of its matrices from samples.

**Reduction.** The full system is represented by an enriched one. The basis of the enriched system consists of
the reduced basis and the low-frequency contribution of the discarded coordinates. The residual of the reduced
orbit in the enriched equations is orthogonal to the reduced basis. The response to this residual is the
difference between the two orbits. For a linear functional of the orbit, this is the dual-weighted residual
with the adjoint solution of the enriched system (R. Becker, R. Rannacher, Acta Numerica 10 (2001) 1). Here,
one solution yields it for all coordinates, outputs and multipliers. The estimate is also valid near
resonance, because the change of the operator is not linearised. It was measured on the four-bar with 3 and 5
elements and 1 to 5 modes per link at 10 to 90 rad/s: the errors of multipliers are 0.35 to 1.2 times their
estimates. Verdicts therefore allow for twice the estimate.

**Interpolation.** Harmonics that the azimuths do not resolve are missing, and they alias to resolved
harmonics.

- A solution with fewer harmonics differs from the full solution by the effect of the omitted harmonics. Two
  such differences show how fast this effect decreases with the harmonic. Extrapolation yields the effect of
  the missing harmonics.
- The missing harmonics alias to the mean and to the resolved harmonics, which may be in resonance. The
  amplitudes of the missing harmonics are extrapolated from those of the resolved harmonics, and are added to
  the harmonics to which they alias.

The larger of the two errors is used. It is zero if the resolved harmonics end within round-off. Harmonics
beyond the resolved range that alias to lower harmonics are then not detected."""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from solve.arrays import Array
from solve.certify.certified import Certified, Failed, InterpolationError, ReductionError
from solve.certify.comparison import SAFETY, differences
from solve.certify.refinement import certified
from solve.contracts import Reduction
from solve.equations import output_values
from solve.errors import SolveError
from solve.methods.free import free, solutions_on
from solve.methods.method import Solutions
from solve.period.curve import PeriodicCurve
from solve.period.multipliers import matched
from solve.period.points import SinglePoint
from solve.samples import Samples
from solve.system import PeriodicSystem, with_samples
from solve.terminal import progress

_FASTEST = 1e-3
"""Lower limit of the ratio between the effects of successive harmonics in the extrapolation. Chosen by
judgement, because a difference may be zero by chance."""

_FLAT = 0.9
"""Ratio between the effects of successive multiples of the spacing above which the harmonics count as not
decaying. Chosen by judgement: at this ratio, one more accurate digit requires 22 multiples."""

Error = TypeVar("Error")
SystemAt = Callable[[int], tuple[PeriodicSystem, float]]
"""Type of functions that return the system and speed (rad/s) of a point."""


def with_model_errors(result: Certified, system_at: SystemAt) -> Certified:
    """Return solved points with the errors of reduction and interpolation. Both errors are added to the
    absolute errors of the multipliers, from which the verdicts follow. The error of interpolation is also
    added to the relative errors. Without reduction or interpolation, the points are returned unchanged.

    system_at: function that returns the system and the speed of the point with a given index."""
    if not len(result):
        return result
    capabilities = system_at(0)[0].capabilities
    if capabilities.reduction is not None:
        found = list(_at_each(result, system_at, "error of the reduction", _reduction_at))
        absolute = np.maximum(result.absolute, 0.0) + np.array([margin for _, margin in found])
        result = replace(result, reduction=tuple(error for error, _ in found), absolute=absolute)
    if capabilities.samples is not None:
        found = tuple(_at_each(result, system_at, "error of the interpolation", _interpolation_at))
        added = np.array([(error.orbit, error.multipliers) for error in found])
        radius = result.solutions.multipliers.spectral_radius
        with np.errstate(invalid="ignore"):
            absolute = result.absolute + np.where(radius > 0, added[:, 1] * radius, added[:, 1])
        result = replace(result, errors=result.errors + added, absolute=absolute, interpolation=found)
    return result


def _at_each(
    result: Certified,
    system_at: SystemAt,
    task: str,
    error_at: Callable[[Certified, int, PeriodicSystem, float], Error],
) -> Iterator[Error]:
    """Yield the result of `error_at` for each point. task: name of the task whose progress is displayed."""
    with progress.task(task, len(result)) as count:
        for row in range(len(result)):
            yield error_at(result, row, *system_at(row))
            count.add(1)


def _reduction_at(
    result: Certified, row: int, system: PeriodicSystem, speed: float
) -> tuple[ReductionError, float]:
    """Return the reduction error of a point, and the absolute error that it adds to the multipliers of the
    point."""
    reduction = system.capabilities.reduction
    assert reduction is not None
    try:
        reduced = _reduced_solutions(result, row, system, speed)
        request, orbit = result.request, reduced.curve is not None
        point = SinglePoint(reduction.enriched, speed)
        enriched = request.reduction_method.solutions(point, reduced.grid, orbit, request.engine).checked()
    except SolveError:
        return _reduction_error(reduction, system, np.nan, np.full(1, np.nan), 1.0, {}), np.inf
    rho, radius = reduced.multipliers.values[0], float(reduced.multipliers.spectral_radius[0])
    shifts = _multiplier_shifts(rho, enriched.multipliers.values[0])
    growth = float((np.abs(rho) + SAFETY * shifts).max()) - radius
    size, outputs = np.nan, {}
    if reduced.curve is not None and enriched.curve is not None:
        size, outputs = _orbit_errors(system, speed, reduced.curve[0], enriched.curve[0])
    error = _reduction_error(reduction, system, size, shifts, radius, outputs)
    return error, max(growth, SAFETY * float(shifts[0]))


def _reduction_error(
    reduction: Reduction,
    system: PeriodicSystem,
    orbit: float,
    shifts: Array,
    radius: float,
    outputs: Mapping[str, float],
) -> ReductionError:
    relative = shifts / radius if radius > 0 else np.zeros_like(shifts)
    sizes = reduction.modes_a_link, system.n, reduction.full_coordinates, reduction.discarded
    return ReductionError(*sizes, orbit, float(relative.max()), float(relative[0]), outputs)


def _reduced_solutions(result: Certified, row: int, system: PeriodicSystem, speed: float) -> Solutions:
    """Return the solution of a point by the method that is applicable to every system. The solution in
    `result` is used if it was computed by this method."""
    method = result.request.reduction_method
    if result.method.name == method.name:
        return result.solutions[np.array([row])]
    request = replace(result.request, rtol=max(result.request.rtol, 1e-7), steps=None)
    (solved,) = certified(SinglePoint(system, speed), method, request)
    if isinstance(solved, Failed):
        raise solved.reason
    return solved.solutions


def _multiplier_shifts(rho: Array, better: Array) -> Array:
    """Match the multipliers `rho` (N,) one to one with multipliers `better` (N',) of a larger system. Return
    the distances (N,)."""
    distance = np.abs(rho[:, None] - better)
    return distance[matched(distance)]


def _orbit_errors(
    system: PeriodicSystem, speed: float, reduced: PeriodicCurve, enriched: PeriodicCurve
) -> tuple[float, dict[str, float]]:
    """Return the largest relative error of the coordinates of the full system, and the relative error of each
    output.

    Orbits are compared at 720 or more phases. Coordinates below 1e-12 of the largest displacement count as
    zero."""
    reduction = system.capabilities.reduction
    assert reduction is not None
    count = max(720, 2 * len(reduced.nodes))
    phase = np.arange(count) * (system.period / count)

    def state(curve: PeriodicCurve) -> tuple[Any, ...]:
        return phase, speed, *(speed**order * curve(phase, order) for order in range(3))

    approximate, exact = state(reduced), state(enriched)
    q, exact_q = reduction.expanded(*approximate).q, reduction.enriched.expanded(*exact).q
    largest = np.abs(exact_q).max(axis=1)
    moves = largest > 1e-12 * largest.max(initial=0.0)
    orbit = float((np.abs(q - exact_q).max(axis=1)[moves] / largest[moves]).max(initial=0.0))
    values = output_values(system, *approximate)
    exact_values = output_values(reduction.enriched, *exact)
    return orbit, {name: _relative_error(values[name], exact_values[name]) for name in system.outputs}


def _relative_error(values: Array, exact: Array) -> float:
    largest = float(np.abs(exact).max())
    return float(np.abs(values - exact).max()) / largest if largest > 0 else 0.0


def _interpolation_at(
    result: Certified, row: int, system: PeriodicSystem, speed: float
) -> InterpolationError:
    """Return the interpolation error of a point."""
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
        # With non-uniform azimuths, the effect of truncation includes aliasing.
        is_uniform = samples.given is None
        aliased = _change(result, row, point, samples.with_aliases()) if is_uniform else np.zeros(2)
    except SolveError:
        return InterpolationError(samples.azimuths, last, math.inf, math.inf, None)
    ratios = _ratios(kept, changes)
    # Errors of fits to non-uniform azimuths decrease less regularly: the last difference is not extrapolated.
    extrapolated = changes[-1] * ratios ** (resolved - kept[-1] if samples.given is None else 0)
    errors = SAFETY * np.maximum(samples.amplification * extrapolated, aliased)
    half = samples.azimuths / 2
    ratios = np.maximum(ratios, samples.decay(half, half + spacing))
    enough = _sufficient(ratios, errors / result.request.rtol, spacing, samples.azimuths)
    return InterpolationError(samples.azimuths, last, float(errors[0]), float(errors[1]), enough)


def _change(result: Certified, row: int, point: tuple[PeriodicSystem, float], samples: Samples) -> Array:
    """Return the relative changes (2,) of orbit and multipliers at a point if the system is interpolated from
    `samples` instead. Raises SolveError."""
    system, speed = point
    solutions = result.solutions[np.array([row])]
    fewer = SinglePoint(with_samples(system, samples), speed)
    orbit, engine = solutions.curve is not None, result.request.engine
    other = solutions_on(result.method, fewer, solutions.grid, orbit, engine, free(fewer))
    return differences(other.checked(), solutions, result.modes[np.array([row])])[0]


def _ratios(kept: list[int], changes: list[Array]) -> Array:
    """Return the ratios (2,) between the effects of successive multiples of the spacing, at most 1. If there
    is only one effect, the ratios are 1.

    kept: multiples of the spacing above which harmonics are omitted. changes: the effects (2,) on orbit and
    multipliers."""
    if len(kept) < 2:
        return np.ones(2)
    (low, high), (more, less) = kept, changes
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.where(more > 0, less / np.where(more > 0, more, 1.0), 1.0) ** (1 / (high - low))
    return np.clip(ratios, _FASTEST, 1.0)


def _sufficient(ratios: Array, excess: Array, spacing: int, azimuths: int) -> int | None:
    """Return the number of azimuths for which the errors meet the tolerance; None if the harmonics hardly
    decay.

    ratios (2,): ratios between the effects of successive multiples of the spacing. excess (2,): errors
    divided by the tolerance."""
    missed = excess > 1
    if not missed.any():
        return azimuths
    if (ratios[missed] > _FLAT).any() or not np.isfinite(excess).all():
        return None
    more = math.ceil((np.log(excess[missed]) / -np.log(ratios[missed])).max())
    return azimuths + 2 * spacing * more
