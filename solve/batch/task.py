"""What is asked of many points, solved here or in parts by an executor, and kept in a store as they come."""

import hashlib
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, Executor, as_completed
from contextlib import ExitStack
from copy import copy
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.batch.batch import POINTS, Batch
from solve.batch.family import Family
from solve.batch.gathering import gathered
from solve.batch.store import Store, opened
from solve.batch.tables import training
from solve.certify.certified import SolveRequest
from solve.errors import WorkersError
from solve.kernel.engines import chosen_engine
from solve.methods.choice import Rule, chosen
from solve.results.contents import model_record
from solve.results.points import Kept, PointResults
from solve.single import request
from solve.terminal import progress

_PARTS, _FEWEST, _MOST = 32, 8, 2**14
"""Parts that points are dealt out in; fewer, or more, where a part would have fewer or more points."""

_WITNESSES = 256
"""Phases at which the matrices of some points show whether a store holds the same calculation, beside one
between each two at which they jump."""


@dataclass(frozen=True)
class Task:
    """A family, the method, what is asked of points and what is kept; goes to other threads and processes."""

    family: Family
    method: Rule
    request: SolveRequest
    kept: Kept

    def batch(self, points: Array) -> Batch:
        """For points like these (P, v)."""
        return Batch(self.family, training(points), self.method, self.request)

    def solved(
        self,
        batch: Batch,
        points: Array,
        executor: Executor | None = None,
        store: str | Path | None = None,
    ) -> PointResults:
        """The points (P, v), in a batch for them here, or in parts by the executor; with a store those that
        it has are read, the others written as their parts are finished. Raises FileError, WorkersError,
        MissingLibraryError."""
        if executor is None and store is None:
            return gathered(batch, points, self.kept)
        n = self.family.example.n
        size = min(_MOST, max(_FEWEST, -(-len(points) // _PARTS)))
        results = PointResults.blank(len(points), n, self.kept)
        with ExitStack() as opening:
            kept_in = None
            if store is not None:
                columns = dict(zip(self.family.names, points.T, strict=True))
                kept_in = opening.enter_context(
                    opened(store, self._description(batch.region, points), columns, n, self.kept, size)
                )
                size = kept_in.size
            count = opening.enter_context(progress.task(POINTS, len(points)))
            every = np.arange(len(points))
            parts = [every[at : at + size] for at in range(0, len(points), size)]
            left = list(_read(kept_in, parts, results, count)) if kept_in else parts
            for index, found in self._parts(batch, points, left, executor, count):
                if kept_in:
                    kept_in.write(index, found)
                results.insert(index, found)
            if kept_in:
                kept_in.finish()
        return results

    def _parts(
        self, batch: Batch, points: Array, parts: list[Array], executor: Executor | None, count: progress.Task
    ) -> Iterator[tuple[Array, PointResults]]:
        """Each part with its results, as they come."""
        if executor is None:
            for index in parts:
                with progress.subtask(POINTS, len(index)):
                    found = gathered(batch, points[index], self.kept)
                yield index, found
            return
        work = _Part(self, batch.region)
        waiting = {executor.submit(work, points[index]): index for index in parts}
        try:
            for future in as_completed(waiting):
                yield waiting[future], future.result()
                count.add(len(waiting[future]))
        except BrokenExecutor as error:
            raise WorkersError(
                f"the workers ended before their points were solved ({error}); was one killed, or the memory "
                "full? With a store the same call goes on from there"
            ) from None
        finally:
            # Nobody waits for the rest, where one fails or the user interrupts.
            for future in waiting:
                future.cancel()

    def _description(self, region: Array, points: Array) -> dict[str, Any]:
        """What decides the results, by which a store is known again."""
        family, asked, kept = self.family, self.request, self.kept
        example = family.example
        between = np.convolve(example.breaks, (0.5, 0.5), "valid") if len(example.breaks) > 1 else ()
        phases = np.append((np.arange(_WITNESSES) + 0.37) * (example.period / _WITNESSES), between)
        method = getattr(self.method, "__name__", None) or repr(self.method)
        return {
            **model_record(example),
            "points": _digest(points),
            "matrices": _digest(*(family.entries(phases, point[None]) for point in region)),
            "breaks": [*map(float, example.breaks)],
            "method": method,
            "rtol": asked.rtol,
            "steps": asked.steps,
            "engine": asked.engine,
            "orbit": asked.orbit,
            "quantities": [*kept.names],
            "spectra": [*kept.spectra],
            "harmonics": kept.harmonics,
            "version": version("parametric-vibration"),
        }


@dataclass(frozen=True)
class _Part:
    """Solves a part of the points, with tables that are learnt from some of all of them (T, v)."""

    task: Task
    region: Array

    def __call__(self, points: Array) -> PointResults:
        # Samplers of a model serve one thread.
        task = replace(self.task, family=copy(self.task.family))
        return gathered(Batch(task.family, self.region, task.method, task.request), points, task.kept)


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


def _read(store: Store, parts: list[Array], results: PointResults, count: progress.Task) -> Iterator[Array]:
    """Take over the parts that the store has; the others."""
    for index in parts:
        found = store.read(index)
        if found is None:
            yield index
        else:
            results.insert(index, found)
            count.add(len(index))


def _digest(*parts: Array) -> str:
    digest = hashlib.sha256()
    for values in parts:
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()[:16]
