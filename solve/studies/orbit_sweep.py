"""Sweeps in which orbits are computed one by one. The orbits are either nonlinear orbits, for which the
iteration starts from the nearest solved point, or the prescribed motions of mechanisms without
coordinates."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from solve.arrays import Array
from solve.batch.family import Family
from solve.batch.store import opened
from solve.batch.task import POINTS, Task
from solve.equations import exceeded_limits, warnings_of
from solve.errors import LinearModelError, SolveError
from solve.newton.orbits import nonlinear
from solve.period.multipliers import UNSTABLE, VERDICTS
from solve.results.orbit import Orbit
from solve.results.points import Kept, PointResults
from solve.results.special_orbits import NonlinearOrbit, RigidOrbit
from solve.system import multiplier_count
from solve.terminal import progress

_ON_A_LINE = 1e-9
"""Distance from a line, relative to the ranges of the quantities, up to which a point counts as lying on the
line. Chosen by judgement, well above round-off."""


def nonlinear_points(task: Task, points: Array, store: str | Path | None) -> PointResults:
    """Solve for nonlinear orbits at points (P, v), in the order of the points. If there is a store, each
    result is saved.

    Raises SolveError subclasses for errors that affect all points."""
    multipliers = multiplier_count(task.family.example)
    results = PointResults.blank(len(points), multipliers, task.kept)
    orbits = dict[int, NonlinearOrbit]()
    with ExitStack() as opening:
        opened_store = None
        if store is not None:
            columns = dict(zip(task.family.names, points.T, strict=True))
            description = {**task.description(points, points), "nonlinear": True}
            opened_store = opening.enter_context(
                opened(store, description, columns, multipliers, task.kept, 1)
            )
        count = opening.enter_context(progress.task(POINTS, len(points)))
        for at in range(len(points)):
            index = np.array([at])
            stored = None if opened_store is None else opened_store.read(index)
            if stored is None:
                stored = PointResults.blank(1, multipliers, task.kept)
                _solve(task, points, at, stored, orbits)
                if opened_store is not None:
                    opened_store.write(index, stored)
            results.insert(index, stored)
            count.add()
        if opened_store is not None:
            opened_store.finish()
    return results


def _solve(
    task: Task, points: Array, at: int, results: PointResults, orbits: dict[int, NonlinearOrbit]
) -> None:
    """Solve point `at`, write its results, and add its orbit to `orbits`. The solutions of neighbouring
    points start from these orbits."""
    try:
        orbit = _orbit(task, points, at, orbits)
    except LinearModelError:
        raise
    except SolveError as error:
        results.failures[0] = str(error)
        return
    orbits[at] = orbit
    results.multipliers[0], results.verdicts[0] = orbit.multipliers, VERDICTS.index(orbit.verdict)
    _write(results, 0, orbit, orbit.warnings)


def _orbit(task: Task, points: Array, at: int, orbits: dict[int, NonlinearOrbit]) -> NonlinearOrbit:
    """Solve for the orbit at point `at`, from the nearest solved point. If there is no solved point, if no
    orbit is found, or if the orbit is unstable, the strategies of `solve.nonlinear` are used."""
    system, speed = task.family.system(points[at])
    request = task.request
    settings = {"method": task.method, "steps": request.steps, "rtol": request.rtol, "engine": request.engine}
    orbit = None
    if orbits:
        try:
            orbit = nonlinear(system, speed, _predicted(points, at, orbits), **settings)
        except SolveError:
            orbit = None
        if orbit is not None and orbit.verdict != VERDICTS[UNSTABLE]:
            return orbit
    try:
        return nonlinear(system, speed, **settings)
    except SolveError:
        if orbit is None:
            raise
        return orbit


def _predicted(
    points: Array, at: int, orbits: dict[int, NonlinearOrbit]
) -> NonlinearOrbit | Callable[[Array], Array]:
    """Return the initial curve for point `at`: the linear extrapolation from the orbits at the two nearest
    solved points if all three points lie on a line, otherwise the orbit at the nearest solved point."""
    spans, solved = np.ptp(points, axis=0), list(orbits)
    scaled = (points - points[at]) / np.where(spans > 0, spans, 1.0)
    ways = scaled[solved]
    order = np.argsort(np.abs(ways).sum(axis=1), kind="stable")[:2]
    nearest, other = orbits[solved[order[0]]], orbits[solved[order[-1]]]
    one, two = ways[order[0]], ways[order[-1]]
    step = one - two
    square = float(step @ step)
    if not square:
        return nearest
    ahead = -float(one @ step) / square
    if np.abs(one + ahead * step).max() > _ON_A_LINE:
        return nearest
    return lambda phase: (1 + ahead) * nearest.curve(phase) - ahead * other.curve(phase)


def rigid_points(family: Family, points: Array, kept: Kept) -> PointResults:
    """Compute the statistics and amplitudes of the outputs at points (P, v), for a mechanism without
    coordinates."""
    results = PointResults.blank(len(points), 0, kept)
    with progress.task(POINTS, len(points)) as count:
        for at, point in enumerate(points):
            try:
                system, speed = family.system(point)
                orbit = RigidOrbit.at_speed(system, speed)
                limited = {name: orbit.statistics(name) for name in kept.names}
                warnings = [*warnings_of(system, speed), *exceeded_limits(system, limited)]
                _write(results, at, orbit, warnings)
                results.verdicts[at] = 0
            except SolveError as error:
                results.failures[at] = str(error)
            count.add()
    return results


def _write(results: PointResults, at: int, orbit: Orbit, warnings: Sequence[str]) -> None:
    """Write the errors, statistics, amplitudes and warnings of an orbit as those of point `at`."""
    results.errors[at] = orbit.error_estimate
    results.steps[at], results.methods[at] = orbit.steps, orbit.method
    for row, name in enumerate(results.kept.names):
        results.figures[at, row] = orbit.statistics(name)
    for row, name in enumerate(results.kept.spectra):
        results.amplitudes[at, row], _ = orbit.harmonics(name, results.kept.harmonics)
    if warnings:
        results.warnings[at] = [*warnings]
