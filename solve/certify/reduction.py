"""Errors of a reduced system, estimated by the residual of its solution in a larger one.

The full system is represented by an enriched one, whose basis contains the reduced one and what the discarded
coordinates contribute at low frequency. The residual of the reduced orbit in the enriched equations is
orthogonal to the reduced basis; the response to it is the difference of both orbits. For a linear functional
of the orbit this is the dual-weighted residual with the adjoint solution of the enriched system (R. Becker,
R. Rannacher, Acta Numerica 10 (2001) 1), here for all coordinates, outputs and multipliers from one solution.
It holds near resonance too, as nothing is linearised in the change of the operator.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.certify.certified import Certified, Failed, ReductionError
from solve.certify.refinement import certified
from solve.contracts import Reduction
from solve.errors import SolveError
from solve.methods.method import Solutions
from solve.period.curve import PeriodicCurve
from solve.period.points import OnePoint
from solve.system import PeriodicSystem
from solve.terminal import progress

MARGIN = 2.0
"""Times its estimate that an error of the reduction may be before a verdict depends on it. Measured on the
four-bar with 3 and 5 elements and 1 to 5 modes a link at 10 to 90 rad/s: errors of multipliers are 0.35 to
1.2 times their estimates."""

_PHASES = 720
"""Phases of a period, at least, at which orbits are compared."""

_RTOL = 1e-7
"""Accuracy of the solutions that stand for those of another method."""

_RESTING = 1e-12
"""Part of the largest displacement below which a coordinate rests except for round-off."""


def judged_by_enriched(
    found: Certified, system_at: Callable[[int], tuple[PeriodicSystem, float]]
) -> Certified:
    """Points with the errors of their reduction, which widen the margins of their verdicts; points of
    systems that are not reduced as they are. system_at: system and speed (rad/s) of one of them."""
    if not len(found) or system_at(0)[0].reduction is None:
        return found
    errors, margins = [], []
    with progress.task("error of the reduction", len(found)) as count:
        for at in range(len(found)):
            error, margin = _of_point(found, at, *system_at(at))
            errors.append(error)
            margins.append(margin)
            count.add(1)
    return replace(
        found, reduction=tuple(errors), absolute=np.maximum(found.absolute, 0.0) + np.array(margins)
    )


def _of_point(
    found: Certified, at: int, system: PeriodicSystem, speed: float
) -> tuple[ReductionError, float]:
    """Errors of a point, and the margin of its multipliers."""
    reduction = system.reduction
    assert reduction is not None
    try:
        own = _solutions(found, at, system, speed)
        better = found.request.witness.solutions(
            OnePoint(reduction.enriched, speed), own.grid, own.curve is not None, found.request.engine
        )
        for reason in better.failures.values():
            raise reason
    except SolveError:
        return _error(reduction, system, np.nan, np.full(1, np.nan), 1.0, {}), np.inf
    rho, radius = own.multipliers.values[0], float(own.multipliers.spectral_radius[0])
    moved = displacements(rho, better.multipliers.values[0])
    reach = float((np.abs(rho) + MARGIN * moved).max()) - radius
    orbit, outputs = np.nan, {}
    if own.curve is not None and better.curve is not None:
        orbit, outputs = _of_orbits(system, speed, own.curve[0], better.curve[0])
    return _error(reduction, system, orbit, moved, radius, outputs), max(reach, MARGIN * float(moved[0]))


def _error(
    reduction: Reduction,
    system: PeriodicSystem,
    orbit: float,
    moved: Array,
    radius: float,
    outputs: Mapping[str, float],
) -> ReductionError:
    part = moved / radius if radius > 0 else np.zeros_like(moved)
    sizes = reduction.modes_a_link, system.n, reduction.full_coordinates, reduction.discarded
    return ReductionError(*sizes, orbit, float(part.max()), float(part[0]), outputs)


def _solutions(found: Certified, at: int, system: PeriodicSystem, speed: float) -> Solutions:
    """The solutions of a point by a method that any system allows."""
    witness = found.request.witness
    if found.method.name == witness.name:
        return found.solutions[np.array([at])]
    request = replace(found.request, rtol=max(found.request.rtol, _RTOL), steps=None)
    (made,) = certified(OnePoint(system, speed), witness, request)
    if isinstance(made, Failed):
        raise made.reason
    return made.solutions


def displacements(rho: Array, better: Array) -> Array:
    """Distances (N,) of multipliers to those of a larger system (N',), each matched with one of them."""
    from scipy.optimize import linear_sum_assignment

    distance = np.abs(rho[:, None] - better[None, :])
    rows, columns = linear_sum_assignment(distance)
    made = np.zeros(len(rho))
    made[rows] = distance[rows, columns]
    return made


def _of_orbits(
    system: PeriodicSystem, speed: float, own: PeriodicCurve, better: PeriodicCurve
) -> tuple[float, dict[str, float]]:
    """Errors of the coordinates of the full system, the largest, and of each output."""
    reduction = system.reduction
    assert reduction is not None
    count = max(_PHASES, 2 * len(own.nodes))
    phase = np.arange(count) * (system.period / count)

    def states(curve: PeriodicCurve) -> tuple[Any, ...]:
        return tuple(speed**order * curve(phase, order) for order in range(3))

    given = phase, speed, *states(own)
    exact = phase, speed, *states(better)
    q, truth = reduction.expanded(*given).q, reduction.enriched.expanded(*exact).q
    largest = np.abs(truth).max(axis=1)
    moving = largest > _RESTING * largest.max(initial=0.0)
    orbit = float((np.abs(q - truth).max(axis=1)[moving] / largest[moving]).max(initial=0.0))
    values, true_values = system.output_values(*given), reduction.enriched.output_values(*exact)
    errors = {name: _relative(values[name], true_values[name]) for name in system.outputs}
    return orbit, errors


def _relative(values: Array, truth: Array) -> float:
    largest = float(np.abs(truth).max())
    return float(np.abs(values - truth).max()) / largest if largest > 0 else 0.0
