"""Nonlinear orbits at the points of a sweep, each found from its nearest solved neighbour."""

from contextlib import ExitStack
from pathlib import Path

import numpy as np

from solve.arrays import Array
from solve.batch.store import opened
from solve.batch.task import POINTS, Task
from solve.contracts import Statistics
from solve.errors import LinearModelError, SolveError
from solve.newton.orbits import nonlinear
from solve.period.multipliers import UNSTABLE, VERDICTS
from solve.period.quantities import FIGURES
from solve.results.points import Kept, PointResults
from solve.results.special_orbits import NonlinearOrbit
from solve.terminal import progress


def nonlinear_points(task: Task, points: Array, store: str | Path | None) -> PointResults:
    """Results of nonlinear orbits at points (P, v), in their order. A store keeps each point.

    Raises SolveError subclasses for errors that affect all points."""
    n = task.family.example.n
    results = PointResults.blank(len(points), n, task.kept)
    orbits = dict[int, NonlinearOrbit]()
    with ExitStack() as opening:
        kept = None
        if store is not None:
            columns = dict(zip(task.family.names, points.T, strict=True))
            description = {**task.description(points, points), "nonlinear": True}
            kept = opening.enter_context(opened(store, description, columns, n, task.kept, 1))
        count = opening.enter_context(progress.task(POINTS, len(points)))
        for at in range(len(points)):
            index = np.array([at])
            stored = None if kept is None else kept.read(index)
            if stored is None:
                stored = PointResults.blank(1, n, task.kept)
                _solve(task, points, at, stored, orbits)
                if kept is not None:
                    kept.write(index, stored)
            results.insert(index, stored)
            count.add()
        if kept is not None:
            kept.finish()
    return results


def _solve(
    task: Task, points: Array, at: int, results: PointResults, orbits: dict[int, NonlinearOrbit]
) -> None:
    """Write the results of a point; its orbit joins the others, from which neighbours are found."""
    try:
        orbit = _orbit(task, points, at, orbits)
    except LinearModelError:
        raise
    except SolveError as error:
        results.failures[0] = str(error)
        return
    orbits[at] = orbit
    results.multipliers[0], results.verdicts[0] = orbit.multipliers, VERDICTS.index(orbit.verdict)
    results.errors[0] = orbit.error_estimate
    results.steps[0], results.methods[0] = orbit.steps, orbit.method
    _write_figures(results, orbit)
    if orbit.warnings:
        results.warnings[0] = [*orbit.warnings]


def _orbit(task: Task, points: Array, at: int, orbits: dict[int, NonlinearOrbit]) -> NonlinearOrbit:
    """Orbit from the nearest solved point; without one, and if that leads nowhere or to an unstable orbit, by
    the strategies of `solve.nonlinear`."""
    system, speed = task.family.system(points[at])
    request = task.request
    given = {"method": task.method, "steps": request.steps, "rtol": request.rtol, "engine": request.engine}
    found = None
    if orbits:
        spans = np.ptp(points, axis=0)
        distance = np.abs(points[list(orbits)] - points[at]) / np.where(spans > 0, spans, 1.0)
        nearest = list(orbits)[int(distance.sum(axis=1).argmin())]
        try:
            found = nonlinear(system, speed, orbits[nearest], **given)
        except SolveError:
            found = None
        if found is not None and found.verdict != VERDICTS[UNSTABLE]:
            return found
    try:
        return nonlinear(system, speed, **given)
    except SolveError:
        if found is None:
            raise
        return found


def _write_figures(results: PointResults, orbit: NonlinearOrbit) -> None:
    """Write statistics and amplitudes of the quantities that are kept."""
    kept: Kept = results.kept
    for row, name in enumerate(kept.names):
        statistics: Statistics = orbit.statistics(name)
        results.figures[0, row] = [getattr(statistics, figure) for figure in FIGURES]
    for row, name in enumerate(kept.spectra):
        results.amplitudes[0, row], _ = orbit.harmonics(name, kept.harmonics)
