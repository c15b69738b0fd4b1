"""Solution of many points, in this process or by an executor. Results can be kept in a store."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor, as_completed
from contextlib import ExitStack, contextmanager
from copy import copy
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from multiprocessing.connection import wait
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
from solve.errors import MissingLibraryError, ValueOutOfBoundsError, WorkersError
from solve.kernel.engines import chosen_engine
from solve.methods.choice import Rule, chosen
from solve.results.contents import model_info
from solve.results.folder import digest
from solve.results.points import Kept, PointResults
from solve.single import request
from solve.system import multiplier_count
from solve.terminal import progress
from solve.terminal.command_line import INTERRUPTED

_CHUNKS, _MIN_CHUNK, _MAX_CHUNK = 32, 8, 2**14
"""Number of chunks of points; minimum and maximum number of points per chunk. Chosen by judgement."""

_PROBES = 256
"""Number of phases at which the matrices of some points are sampled, to identify the calculation in a store.
One phase between each pair of neighbouring breaks is added. Chosen by judgement."""


@dataclass(frozen=True)
class Task:
    """Family, method, request, and selection of the results that are kept. A task can be sent to other
    threads and processes."""

    family: Family
    method: Rule
    request: SolveRequest
    kept: Kept

    def batch(self, points: Array) -> Batch:
        """Batch for points (P, v), and for other points within their range."""
        return Batch(self.family, training(points), self.method, self.request)

    def solved(
        self,
        batch: Batch,
        points: Array,
        executor: Executor | None = None,
        store: str | Path | None = None,
    ) -> PointResults:
        """Solve points (P, v) in this process, or in chunks by an executor.

        Chunks that the store already contains are read. Other chunks are written when they are complete.
        Raises FileError, WorkersError, MissingLibraryError."""
        if executor is None and store is None:
            return gathered(batch, points, self.kept)
        size = min(_MAX_CHUNK, max(_MIN_CHUNK, -(-len(points) // _CHUNKS)))
        multipliers = multiplier_count(self.family.example)
        results = PointResults.blank(len(points), multipliers, self.kept)
        with ExitStack() as opening:
            opened_store = None
            if store is not None:
                columns = dict(zip(self.family.names, points.T, strict=True))
                opened_store = opening.enter_context(
                    opened(
                        store,
                        self.description(batch.region, points),
                        columns,
                        multipliers,
                        self.kept,
                        size,
                    )
                )
                size = opened_store.size
            count = opening.enter_context(progress.task(POINTS, len(points)))
            positions = np.arange(len(points))
            chunks = [positions[at : at + size] for at in range(0, len(points), size)]
            if opened_store:
                chunks = list(_missing(opened_store, chunks, results, count))
            for index, chunk_results in self._solve(batch, points, chunks, executor, count):
                if opened_store:
                    opened_store.write(index, chunk_results)
                results.insert(index, chunk_results)
            if opened_store:
                opened_store.finish()
        return results

    def _solve(
        self,
        batch: Batch,
        points: Array,
        chunks: list[Array],
        executor: Executor | None,
        count: progress.Task,
    ) -> Iterator[tuple[Array, PointResults]]:
        """Yield chunks with their results, in order of completion."""
        if executor is None:
            for index in chunks:
                with progress.subtask(POINTS, len(index)):
                    results = gathered(batch, points[index], self.kept)
                yield index, results
            return
        solve_chunk = partial(_solve_chunk, self, batch.region)
        waiting = {executor.submit(solve_chunk, points[index]): index for index in chunks}
        try:
            for future in as_completed(waiting):
                yield waiting[future], future.result()
                count.add(len(waiting[future]))
        except BrokenExecutor as error:
            raise WorkersError(
                f"the workers ended before their points were solved ({error}); one may have been "
                "killed, or the memory may be full; with a store, the same call resumes after the "
                "finished chunks"
            ) from None
        finally:
            # After a failure or an interruption, the other chunks are not required.
            for future in waiting:
                future.cancel()

    def description(self, region: Array, points: Array) -> dict[str, Any]:
        """Description of all data that determine the results. It identifies a store."""
        family, request, kept = self.family, self.request, self.kept
        example = family.example
        between = np.convolve(example.breaks, (0.5, 0.5), "valid") if len(example.breaks) > 1 else ()
        phases = np.append((np.arange(_PROBES) + 0.37) * (example.period / _PROBES), between)
        method = getattr(self.method, "__name__", None) or repr(self.method)
        return {
            **model_info(example),
            "points": digest(points),
            "matrices": digest(*(family.entries(phases, point[None]) for point in region)),
            "breaks": [*map(float, example.breaks)],
            "method": method,
            "rtol": request.rtol,
            "steps": request.steps,
            "engine": request.engine,
            "orbit": request.orbit,
            "quantities": [*kept.names],
            "spectra": [*kept.spectra],
            "harmonics": kept.harmonics,
            "version": version("parametric-vibration"),
        }


def _solve_chunk(task: Task, region: Array, points: Array) -> PointResults:
    """Solve a chunk of points, with tables computed from a selection `region` (T, v) of all points."""
    # The samplers of a model are not shared between threads.
    family = copy(task.family)
    return gathered(Batch(family, region, task.method, task.request), points, task.kept)


def task_of(
    family: Family,
    method: str | Rule,
    rtol: float,
    engine: str,
    kept: Kept | None = None,
    steps: int | None = None,
    orbit: bool = True,
) -> tuple[Task, list[str]]:
    """Return the task for the points of a family, and notes about the engine. Raises subclasses of SolveError
    for an unknown method or engine, and for an invalid tolerance."""
    used, notes = chosen_engine(engine)
    return Task(family, chosen(method), request(steps, rtol, used, orbit), kept or Kept()), notes


def _missing(
    store: Store, chunks: list[Array], results: PointResults, count: progress.Task
) -> Iterator[Array]:
    """Insert the results of stored chunks into `results`, and yield the chunks that are not stored."""
    for index in chunks:
        stored = store.read(index)
        if stored is None:
            yield index
        else:
            results.insert(index, stored)
            count.add(len(index))


_MAX_WORKERS = 1024
"""Largest number of worker processes. Chosen by judgement."""

_TIMEOUT = 10.0
"""Time in seconds within which a scheduler must answer. Chosen by judgement."""


@contextmanager
def processes(count: int) -> Iterator[Executor]:
    """Context manager with an executor for processes on this machine. They end with the block, or with this
    process. Raises ValueOutOfBoundsError."""
    if not 1 <= count <= _MAX_WORKERS:
        raise ValueOutOfBoundsError(
            f"workers is {count}; allowed: 1 … {_MAX_WORKERS}, such as the number of cores"
        )
    executor = ProcessPoolExecutor(count, multiprocessing.get_context("spawn"), _begin)
    before = set(multiprocessing.active_children())
    try:
        yield executor
        executor.shutdown()
    finally:
        executor.shutdown(wait=False, cancel_futures=True)
        for process in set(multiprocessing.active_children()) - before:
            process.terminate()


@contextmanager
def cluster(address: str) -> Iterator[Executor]:
    """Context manager with an executor for the workers of a running dask scheduler, for example
    "tcp://127.0.0.1:8786". Raises WorkersError if the scheduler does not answer, and MissingLibraryError."""
    try:
        from distributed import Client
        from distributed.comm.addressing import get_address_host
    except ImportError:
        raise MissingLibraryError.of_extra("a scheduler", "dask.distributed", "cluster") from None
    try:
        # For an invalid address, the client would print a traceback.
        get_address_host(address)
        client: Any = Client(address, timeout=_TIMEOUT, set_as_default=False)
    except (OSError, ValueError, TypeError):
        raise WorkersError(f"no scheduler answers at '{address}'; start one with: dask scheduler") from None
    with client:
        yield client.get_executor(pure=False)


def _begin() -> None:
    """Initialise a worker process. It then exits immediately after an interruption, and at the end of its
    parent process."""
    signal.signal(signal.SIGINT, lambda *_: os._exit(INTERRUPTED))
    parent = multiprocessing.parent_process()
    assert parent is not None
    threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: Any) -> None:
    """Exit when another process, represented by its sentinel, ends."""
    wait([sentinel])
    os._exit(INTERRUPTED)
