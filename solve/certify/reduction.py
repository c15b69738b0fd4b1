"""Errors of a reduced system, estimated from the residual of its solution in a larger system.

The full system is represented by an enriched one, whose basis contains the reduced one and what the discarded
coordinates contribute at low frequency. The residual of the reduced orbit in the enriched equations is
orthogonal to the reduced basis; the response to it is the difference of both orbits. For a linear functional
of the orbit this is the dual-weighted residual with the adjoint solution of the enriched system (R. Becker,
R. Rannacher, Acta Numerica 10 (2001) 1), here for all coordinates, outputs and multipliers from one solution.
The estimate is valid near resonance too, as it does not linearise in the change of the operator.

Measured on the four-bar with 3 and 5 elements and 1 to 5 modes per link at 10 to 90 rad/s, errors of
multipliers are 0.35 to 1.2 times their estimates. Verdicts therefore allow for twice the estimate."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.certify.certified import Certified, Failed, ReductionError
from solve.certify.estimates import SAFETY
from solve.certify.refinement import certified
from solve.contracts import Reduction
from solve.equations import output_values
from solve.errors import SolveError
from solve.methods.method import Solutions
from solve.period.curve import PeriodicCurve
from solve.period.multipliers import matched
from solve.period.points import OnePoint
from solve.system import PeriodicSystem
from solve.terminal import progress


def with_reduction_errors(
    result: Certified, system_at: Callable[[int], tuple[PeriodicSystem, float]]
) -> Certified:
    """Points with the errors of their reduction, which widen the margins of the verdicts.

    Points of systems that are not reduced remain unchanged. system_at: function that returns the system and
    speed (rad/s) of a point."""
    if not len(result) or system_at(0)[0].capabilities.reduction is None:
        return result
    errors, margins = [], []
    with progress.task("error of the reduction", len(result)) as count:
        for row in range(len(result)):
            error, margin = _of_point(result, row, *system_at(row))
            errors.append(error)
            margins.append(margin)
            count.add(1)
    absolute = np.maximum(result.absolute, 0.0) + np.array(margins)
    return replace(result, reduction=tuple(errors), absolute=absolute)


def _of_point(
    result: Certified, row: int, system: PeriodicSystem, speed: float
) -> tuple[ReductionError, float]:
    """Reduction errors at a point, and the margin of its multipliers."""
    reduction = system.capabilities.reduction
    assert reduction is not None
    try:
        reduced = _reduced_solutions(result, row, system, speed)
        enriched = result.request.reduction_method.solutions(
            OnePoint(reduction.enriched, speed),
            reduced.grid,
            reduced.curve is not None,
            result.request.engine,
        )
        for reason in enriched.failures.values():
            raise reason
    except SolveError:
        return _reduction_error(reduction, system, np.nan, np.full(1, np.nan), 1.0, {}), np.inf
    rho, radius = reduced.multipliers.values[0], float(reduced.multipliers.spectral_radius[0])
    shifts = _multiplier_shifts(rho, enriched.multipliers.values[0])
    growth = float((np.abs(rho) + SAFETY * shifts).max()) - radius
    orbit, outputs = np.nan, {}
    if reduced.curve is not None and enriched.curve is not None:
        orbit, outputs = _orbit_errors(system, speed, reduced.curve[0], enriched.curve[0])
    error = _reduction_error(reduction, system, orbit, shifts, radius, outputs)
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
    """Solutions of a point by the method for general systems. The solutions of the result are reused if they
    were computed by this method."""
    method = result.request.reduction_method
    if result.method.name == method.name:
        return result.solutions[np.array([row])]
    request = replace(result.request, rtol=max(result.request.rtol, 1e-7), steps=None)
    (solved,) = certified(OnePoint(system, speed), method, request)
    if isinstance(solved, Failed):
        raise solved.reason
    return solved.solutions


def _multiplier_shifts(rho: Array, better: Array) -> Array:
    """Distances (N,) of multipliers from those of a larger system (N',), matched one to one."""
    distance = np.abs(rho[:, None] - better[None, :])
    rows, columns = matched(distance)
    shifts = np.zeros(len(rho))
    shifts[rows] = distance[rows, columns]
    return shifts


def _orbit_errors(
    system: PeriodicSystem, speed: float, reduced: PeriodicCurve, enriched: PeriodicCurve
) -> tuple[float, dict[str, float]]:
    """Largest relative error of the coordinates of the full system, and relative errors of the outputs.

    Orbits are compared at 720 phases at least. Coordinates below 1e-12 of the largest displacement count as
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
