"""Outputs of a rigid mechanism over a revolution at many points."""

import numpy as np

from solve.arrays import Array
from solve.batch.family import Family
from solve.contracts import Statistics
from solve.errors import SolveError
from solve.period.quantities import LEAST_SAMPLES, figures, harmonics
from solve.results.points import Kept, PointResults
from solve.results.rigid import RigidOrbit
from solve.system import PeriodicSystem
from solve.terminal import progress


def rigid_points(family: Family, points: Array, kept: Kept) -> PointResults:
    """Statistics and amplitudes at points (P, v), and the reason of each failure; there are no
    multipliers."""
    results = PointResults.blank(len(points), 0, kept)
    with progress.task("points", len(points)) as count:
        for at, point in enumerate(points):
            try:
                system, speed = family.system(point)
                _keep(results, at, RigidOrbit.of(system, speed))
            except SolveError as error:
                results.failures[at] = str(error)
            count.add(1)
    return results


def _keep(results: PointResults, at: int, orbit: RigidOrbit) -> None:
    system, names = orbit.system, results.kept.names
    results.verdicts[at], results.errors[at] = 0, orbit.error_estimate
    results.steps[at], results.methods[at] = orbit.steps, orbit.method
    found = _figures(system, orbit.speed)
    results.figures[at] = found[[system.outputs.index(name) for name in names]]
    for row, name in enumerate(results.kept.spectra):
        signal = orbit.signal(name)
        results.amplitudes[at, row], _ = harmonics(signal, system.period, results.kept.harmonics)
    judged = {name: Statistics(*found[system.outputs.index(name)].tolist()) for name in names}
    texts = [*system.warnings(orbit.speed), *system.judged(judged)]
    if texts:
        results.warnings[at] = texts


def _figures(system: PeriodicSystem, speed: float) -> Array:
    """Statistics (o, 7) of the outputs."""

    def values(phase: Array) -> Array:
        none = np.zeros((0, len(phase)))
        found = system.output_values(phase, speed, none, none, none)
        return np.array([found[name] for name in system.outputs])

    def each(phase: Array) -> Array:
        rows = np.arange(len(phase))
        return values(phase.ravel()).reshape(len(phase), *phase.shape)[rows, rows]

    even = np.arange(LEAST_SAMPLES) * (system.period / LEAST_SAMPLES)
    return figures(values(even), each, system.period)
