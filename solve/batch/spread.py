"""Points solved here, or in parts by an executor."""

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np

from solve.arrays import Array
from solve.batch.batch import Batch
from solve.batch.family import Family
from solve.batch.gathering import chunk_size, gathered
from solve.certify.certified import Request
from solve.methods.auto import Rule
from solve.results.points import Kept, PointResults


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

    def __call__(self, points: Array) -> PointResults:
        # A twin: samplers of a model serve one thread.
        apart = replace(self, family=self.family.twin())
        return gathered(apart.batch(points), points, self.kept)


def spread(
    task: Task, points: Array, executor: Executor, progress: Callable[[int], None] | None = None
) -> PointResults:
    """The points (P, v) in parts that the executor solves; progress is told the number of points done."""
    n = task.family.example.n
    results, done = PointResults.blank(len(points), n, task.kept), 0
    parts = np.array_split(np.arange(len(points)), max(1, -(-len(points) // chunk_size(n))))
    waiting = [executor.submit(task, points[part]) for part in parts]
    try:
        for part, future in zip(parts, waiting, strict=True):
            results.insert(part, future.result())
            done += len(part)
            if progress:
                progress(done)
    finally:
        # Nobody waits for the rest, where one fails or the user interrupts.
        for future in waiting:
            future.cancel()
    return results
