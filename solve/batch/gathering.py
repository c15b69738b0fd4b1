"""Batch solution of points, and storage of their results."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.batch.batch import POINTS, Batch
from solve.certify.certified import Certified
from solve.certify.model_errors import with_model_errors
from solve.contracts import Statistics
from solve.equations import judged_quantities, limits_of, warnings_of
from solve.kernel.engines import COMPILED
from solve.period.curve import PeriodicCurve
from solve.period.frozen import PHASES
from solve.period.multipliers import UNDETERMINED, verdicts_by_moduli
from solve.period.quantities import Quantities
from solve.results.points import Kept, PointResults
from solve.system import PeriodicSystem, multiplier_count
from solve.terminal import progress
from solve.threads import one_thread

_MIN_POINTS = 8
"""Minimum number of points per chunk, even for large systems. Chosen by judgement."""

_CHUNK_BYTES = 2**25
"""Memory limit, in bytes, for the frozen coefficients of a chunk of points. Chosen by judgement."""


def gathered(batch: Batch, points: Array, kept: Kept | None = None) -> PointResults:
    """Solve points (P, v) in batches, and return their results."""
    n = batch.family.example.n
    results = PointResults.blank(len(points), multiplier_count(batch.family.example), kept or Kept())
    size = chunk_size(n)
    with one_thread(n), progress.task(POINTS, len(points)) as count:
        for start in range(0, len(points), size):
            for solved in _ResultWriter(batch, points[start : start + size], results, start).write():
                count.add(solved)
    return results


def on_one_grid(batch: Batch, points: Array, steps: int, kept: Kept) -> PointResults:
    """Compute multipliers and statistics of points (P, v) on one grid, without error estimates. All verdicts
    are "undetermined"."""
    n = batch.family.example.n
    results = PointResults.blank(len(points), multiplier_count(batch.family.example), kept)
    size = chunk_size(n)
    with one_thread(n), progress.task(POINTS, len(points)) as count:
        for start in range(0, len(points), size):
            writer = _ResultWriter(batch, points[start : start + size], results, start)
            for _, positions, solutions in batch.solutions(writer.points, steps):
                at = start + positions
                results.multipliers[at] = solutions.multipliers.values
                results.verdicts[at], results.steps[at] = UNDETERMINED, steps
                if solutions.curve is not None:
                    writer.write_figures(positions, solutions.curve)
                count.add(len(positions))
    return results


def chunk_size(n: int) -> int:
    """Number of points with n coordinates per chunk."""
    # With several coordinates, memory is also required for frozen matrices, for derived arrays of the same
    # size, and for solutions of points that await the next grid.
    copies = 1 if n == 1 else 4
    return max(_MIN_POINTS, _CHUNK_BYTES // (copies * 8 * PHASES * (3 * n**2 + n)))


@dataclass(frozen=True)
class _ResultWriter:
    """Object that solves points and writes their results into `results`, from index `start`."""

    batch: Batch
    points: Array
    results: PointResults
    start: int

    def write(self) -> Iterator[int]:
        """Solve all points in groups and write their results. Yield the number of points of each group."""
        for result in self.batch.solved(self.points):
            if isinstance(result, Certified):
                self._write(result)
                yield len(result)
            else:
                self.results.failures[self.start + result.position] = str(result.reason)
                yield 1

    def _write(self, found: Certified) -> None:
        """Write the results of points solved on the same grid."""
        at, results, solutions = self.start + found.positions, self.results, found.solutions
        if results.kept.warnings:
            found = with_model_errors(found, self._system_of(found))
            for place, error in zip(at, found.reduction, strict=False):
                results.reductions[place] = error.orbit, error.multipliers
        rho, errors = solutions.multipliers, found.errors
        results.multipliers[at], results.errors[at] = rho.values, errors
        results.verdicts[at] = (
            found.verdicts if results.kept.meetings else verdicts_by_moduli(rho, found.absolute)
        )
        if solutions.free is not None:
            results.rigid[at] = solutions.free.modes.multiplicity
        results.steps[at], results.methods[at] = found.steps, found.method.name
        if results.kept.warnings:
            self._write_warnings(found)
        if solutions.curve is None:
            results.errors[at, 0] = np.nan
        else:
            self.write_figures(found.positions, solutions.curve)

    def _system_of(self, found: Certified) -> Callable[[int], tuple[PeriodicSystem, float]]:
        """Function that returns the system and the speed (rad/s) of a point, given its index in `found`."""
        return lambda at: self.batch.family.system(self.points[found.positions[at]])

    def _write_warnings(self, found: Certified) -> None:
        doubtful = found.doubtful
        for position, point in enumerate(found.positions.tolist()):
            system, speed = self.batch.family.system(self.points[point])
            texts = [*(found.warnings(position) if doubtful[position] else ()), *warnings_of(system, speed)]
            if texts:
                self.results.warnings[self.start + point] = texts

    def write_figures(self, positions: Array, curve: PeriodicCurve) -> None:
        """Write statistics and amplitudes of the points with indices `positions` (k,)."""
        kept, points, family = self.results.kept, self.points[positions], self.batch.family
        if not (kept.names or kept.spectra):
            return
        system, at = family.example, self.start + positions
        needed = [name for name in system.outputs if name in (*kept.names, *kept.spectra)]
        order = [*system.coordinates, *needed]
        outputs = (lambda phase, *state: family.outputs(needed, phase, points, *state)) if needed else None
        engine = self.batch.request.engine
        formulas = family.output_formulas(points) if needed and engine == COMPILED else None
        output_indices = [system.outputs.index(name) for name in needed]
        quantities = Quantities(curve, family.speeds(points), outputs, engine, formulas, output_indices)
        self.results.figures[at] = quantities.figures()[:, [order.index(name) for name in kept.names]]
        if kept.spectra:
            chosen = [order.index(name) for name in kept.spectra]
            self.results.amplitudes[at] = quantities.amplitudes(chosen, kept.harmonics)
        if kept.warnings:
            finite = np.isfinite(self.results.figures[at]).all(axis=(1, 2))
            self._write_exceeded_limits(at if judged_quantities(system) else at[~finite])

    def _write_exceeded_limits(self, at: Array) -> None:
        """Write warnings for the points with indices `at` (k,) that exceed limits of the model."""
        names, figures = self.results.kept.names, self.results.figures[at]
        for limit in limits_of(self.batch.family.example, names):
            of_quantity = figures[:, names.index(limit.quantity)]
            for row in np.flatnonzero(limit.exceeded(Statistics(*of_quantity.T))).tolist():
                message = limit.message(Statistics(*of_quantity[row]))
                self.results.warnings.setdefault(int(at[row]), []).append(message)
