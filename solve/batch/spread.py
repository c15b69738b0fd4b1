"""Points solved here, or in parts by an executor."""

from collections.abc import Callable
from concurrent.futures import Executor
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from solve.arrays import Array
from solve.batch.batch import Batch
from solve.batch.family import Family
from solve.batch.gathering import Count, chunk_size, gathered
from solve.certify.certified import Request
from solve.kernel.engines import chosen_engine
from solve.methods.auto import Rule
from solve.methods.choice import chosen
from solve.results.points import Kept, PointResults
from solve.single import request


@dataclass(frozen=True)
class Task:
    """What is to be found out about points of a family, and how; travels to other threads and processes."""

    family: Family
    method: Rule
    request: Request
    kept: Kept

    def batch(self, points: Array) -> Batch:
        """For points like these (P, v)."""
        return Batch(self.family, points, self.method, self.request)

    def solved(
        self, batch: Batch, points: Array, executor: Executor | None, progress: Callable[[int], None] | None
    ) -> PointResults:
        """The points (P, v), in a batch for them here or by the executor; progress is told the number of
        points done."""
        if executor is not None:
            return _spread(self, points, executor, progress)
        return gathered(batch, points, self.kept, progress)

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


def _spread(
    task: Task, points: Array, executor: Executor, progress: Callable[[int], None] | None
) -> PointResults:
    n, count = task.family.example.n, Count(progress)
    results = PointResults.blank(len(points), n, task.kept)
    parts = np.array_split(np.arange(len(points)), max(1, -(-len(points) // chunk_size(n))))
    waiting = [executor.submit(task, points[part]) for part in parts]
    try:
        for part, future in zip(parts, waiting, strict=True):
            results.insert(part, future.result())
            count.add(len(part))
    finally:
        # Nobody waits for the rest, where one fails or the user interrupts.
        for future in waiting:
            future.cancel()
    return results
