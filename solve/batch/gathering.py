"""Points solved here, or in parts by an executor, and what is kept of each put in its place."""

from concurrent.futures import Executor
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from solve.arrays import Array
from solve.batch.batch import POINTS, Batch
from solve.batch.family import Family
from solve.certify.certified import Certified, Request
from solve.kernel.engines import COMPILED, chosen_engine
from solve.methods.choice import Rule, chosen
from solve.period.curve import PeriodicCurve
from solve.period.frozen import PHASES
from solve.period.multipliers import roughly
from solve.period.quantities import Quantities
from solve.progress import stage
from solve.results.points import Kept, PointResults
from solve.single import request
from solve.statistics import Statistics
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
    with one_thread(n), stage(POINTS, len(points)) as count:
        for start in range(0, len(points), size):
            keeper = _Keeper(batch, points[start : start + size], results, start)
            for result in batch.solved(keeper.points):
                if isinstance(result, Certified):
                    keeper.keep(result)
                    count.add(len(result))
                else:
                    results.failures[start + result.position] = str(result.reason)
                    count.add()
    return results


def chunk_size(n: int) -> int:
    """Points with n coordinates that are prepared together."""
    return max(_FEWEST, _MEMORY // (8 * PHASES * (3 * n**2 + n)))


@dataclass(frozen=True)
class _Keeper:
    """Puts the solutions of some points among the results, from position `start` on."""

    batch: Batch
    points: Array
    results: PointResults
    start: int

    def keep(self, found: Certified) -> None:
        """Points that the same grid served."""
        at, results, solutions = self.start + found.positions, self.results, found.solutions
        rho, errors = solutions.multipliers, found.errors
        results.multipliers[at], results.errors[at] = rho.values, errors
        results.verdicts[at] = found.verdicts if results.kept.meetings else roughly(rho, found.absolute)
        results.steps[at], results.methods[at] = found.steps, found.method.name
        if results.kept.warnings:
            self._keep_warnings(found)
        if solutions.curve is None:
            results.errors[at, 0] = np.nan
        else:
            self._keep_figures(found.positions, solutions.curve)

    def _keep_warnings(self, found: Certified) -> None:
        doubtful = found.doubtful
        for position, point in enumerate(found.positions.tolist()):
            system, speed = self.batch.family.system(self.points[point])
            texts = [*(found.warnings(position) if doubtful[position] else ()), *system.warnings(speed)]
            if texts:
                self.results.warnings[self.start + point] = texts

    def _keep_figures(self, positions: Array, curve: PeriodicCurve) -> None:
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
        if kept.warnings and system.judged_quantities:
            self._judge(at)

    def _judge(self, at: Array) -> None:
        """Bounds of the model that the solutions leave."""
        names, judged = self.results.kept.names, self.batch.family.example.judged
        for place in map(int, at):
            figures = (Statistics(*row) for row in self.results.figures[place])
            texts = judged(dict(zip(names, figures, strict=True)))
            if texts:
                self.results.warnings.setdefault(place, []).extend(texts)


@dataclass(frozen=True)
class Task:
    """A family, the method, what is asked of points and what is kept; goes to other threads and processes."""

    family: Family
    method: Rule
    request: Request
    kept: Kept

    def batch(self, points: Array) -> Batch:
        """For points like these (P, v)."""
        return Batch(self.family, points, self.method, self.request)

    def solved(self, batch: Batch, points: Array, executor: Executor | None) -> PointResults:
        """The points (P, v), in a batch for them here or by the executor."""
        if executor is not None:
            return _spread(self, points, executor)
        return gathered(batch, points, self.kept)

    def __call__(self, points: Array) -> PointResults:
        # Samplers of a model serve one thread.
        apart = replace(self, family=copy(self.family))
        return gathered(apart.batch(points), points, self.kept)


def task_of(
    family: Family,
    method: str | Rule,
    rtol: float,
    engine: str,
    kept: Kept | None = None,
    steps: int | None = None,
    orbit: bool = True,
) -> tuple[Task, list[str]]:
    """What is asked of points of the family, and what the user should know about the engine. Raises
    SolveError subclasses for an unknown method or engine, and for a tolerance out of bounds."""
    used, notes = chosen_engine(engine)
    return Task(family, chosen(method), request(steps, rtol, used, orbit), kept or Kept()), notes


def _spread(task: Task, points: Array, executor: Executor) -> PointResults:
    n = task.family.example.n
    results = PointResults.blank(len(points), n, task.kept)
    parts = np.array_split(np.arange(len(points)), max(1, -(-len(points) // chunk_size(n))))
    waiting = [executor.submit(task, points[part]) for part in parts]
    try:
        with stage(POINTS, len(points)) as count:
            for part, future in zip(parts, waiting, strict=True):
                results.insert(part, future.result())
                count.add(len(part))
    finally:
        # Nobody waits for the rest, where one fails or the user interrupts.
        for future in waiting:
            future.cancel()
    return results
