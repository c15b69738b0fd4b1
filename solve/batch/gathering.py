"""Points solved here, and what is kept of each put in its place."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.batch.batch import POINTS, Batch
from solve.certify.certified import Certified
from solve.certify.reduction import with_reduction_errors
from solve.kernel.engines import COMPILED
from solve.period.curve import PeriodicCurve
from solve.period.frozen import PHASES
from solve.period.multipliers import UNDETERMINED, verdicts_by_moduli
from solve.period.quantities import Quantities
from solve.results.points import Kept, PointResults
from solve.statistics import Statistics
from solve.system import PeriodicSystem
from solve.terminal import progress
from solve.threads import one_thread

_FEWEST = 8
"""Points prepared together, however large."""

_MEMORY = 2**25
"""Bytes that the frozen coefficients of points prepared together may take."""


def gathered(batch: Batch, points: Array, kept: Kept | None = None) -> PointResults:
    """All the points (P, v)."""
    n = batch.family.example.n
    results = PointResults.blank(len(points), n, kept or Kept())
    size = chunk_size(n)
    with one_thread(n), progress.task(POINTS, len(points)) as count:
        for start in range(0, len(points), size):
            for solved in _Keeper(batch, points[start : start + size], results, start).kept():
                count.add(solved)
    return results


def unjudged(batch: Batch, points: Array, steps: int, kept: Kept) -> PointResults:
    """Multipliers and statistics of the points (P, v) on one grid, without errors and with the verdict
    "undetermined"."""
    n = batch.family.example.n
    results, size = PointResults.blank(len(points), n, kept), chunk_size(n)
    with one_thread(n), progress.task(POINTS, len(points)) as count:
        for start in range(0, len(points), size):
            keeper = _Keeper(batch, points[start : start + size], results, start)
            for _, positions, solutions in batch.solutions(keeper.points, steps):
                at = start + positions
                results.multipliers[at] = solutions.multipliers.values
                results.verdicts[at], results.steps[at] = UNDETERMINED, steps
                if solutions.curve is not None:
                    keeper.keep_figures(positions, solutions.curve)
                count.add(len(positions))
    return results


def chunk_size(n: int) -> int:
    """Points with n coordinates that are prepared together."""
    # Of several coordinates the frozen matrices are needed, as much again is worked out from them, and points
    # wait with their solutions on one grid for others that come to the next.
    copies = 1 if n == 1 else 4
    return max(_FEWEST, _MEMORY // (copies * 8 * PHASES * (3 * n**2 + n)))


@dataclass(frozen=True)
class _Keeper:
    """Puts the solutions of some points among the results, from position `start` on."""

    batch: Batch
    points: Array
    results: PointResults
    start: int

    def kept(self) -> Iterator[int]:
        """All of the points, in groups: how many they are."""
        for result in self.batch.solved(self.points):
            if isinstance(result, Certified):
                self._keep(result)
                yield len(result)
            else:
                self.results.failures[self.start + result.position] = str(result.reason)
                yield 1

    def _keep(self, found: Certified) -> None:
        """Points that the same grid served."""
        at, results, solutions = self.start + found.positions, self.results, found.solutions
        if results.kept.warnings:
            found = with_reduction_errors(found, self._system_of(found))
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
            self._keep_warnings(found)
        if solutions.curve is None:
            results.errors[at, 0] = np.nan
        else:
            self.keep_figures(found.positions, solutions.curve)

    def _system_of(self, found: Certified) -> Callable[[int], tuple[PeriodicSystem, float]]:
        """System and speed (rad/s) of each of these points."""
        return lambda at: self.batch.family.system(self.points[found.positions[at]])

    def _keep_warnings(self, found: Certified) -> None:
        doubtful = found.doubtful
        for position, point in enumerate(found.positions.tolist()):
            system, speed = self.batch.family.system(self.points[point])
            texts = [*(found.warnings(position) if doubtful[position] else ()), *system.warnings(speed)]
            if texts:
                self.results.warnings[self.start + point] = texts

    def keep_figures(self, positions: Array, curve: PeriodicCurve) -> None:
        """Store statistics and amplitudes of the points at the positions (k,)."""
        kept, points, family = self.results.kept, self.points[positions], self.batch.family
        if not (kept.names or kept.spectra):
            return
        system, at = family.example, self.start + positions
        wanted = [name for name in system.outputs if name in (*kept.names, *kept.spectra)]
        order = [*system.coordinates, *wanted]
        outputs = (lambda phase, *state: family.outputs(wanted, phase, points, *state)) if wanted else None
        engine = self.batch.request.engine
        formulas = family.output_formulas(points) if wanted and engine == COMPILED else None
        places = [system.outputs.index(name) for name in wanted]
        quantities = Quantities(curve, family.speeds(points), outputs, engine, formulas, places)
        self.results.figures[at] = quantities.figures()[:, [order.index(name) for name in kept.names]]
        if kept.spectra:
            chosen = [order.index(name) for name in kept.spectra]
            self.results.amplitudes[at] = quantities.amplitudes(chosen, kept.harmonics)
        if kept.warnings:
            known = np.isfinite(self.results.figures[at]).all(axis=(1, 2))
            self._judge(at if system.judged_quantities else at[~known])

    def _judge(self, at: Array) -> None:
        """Limits of the model that the solutions leave."""
        names, figures = self.results.kept.names, self.results.figures[at]
        for limit in self.batch.family.example.limits(names):
            of_quantity = figures[:, names.index(limit.quantity)]
            for row in np.flatnonzero(limit.left(Statistics(*of_quantity.T))).tolist():
                says = limit.says(Statistics(*of_quantity[row]))
                self.results.warnings.setdefault(int(at[row]), []).append(says)
