"""Executors that parts of many points are handed to: processes of this machine, or a cluster."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.connection import wait
from typing import Any

from solve.errors import MissingLibraryError, ValueOutOfBoundsError, WorkersError

_MOST = 1024
_PATIENCE = 10.0
"""Seconds to wait for a scheduler."""

_INTERRUPTED = 130


@contextmanager
def processes(count: int) -> Iterator[Executor]:
    """So many processes of this machine, which end with the block, or with the process that asks. Raises
    ValueOutOfBoundsError."""
    if not 1 <= count <= _MOST:
        raise ValueOutOfBoundsError(f"workers is {count}; allowed: 1 … {_MOST}, such as the number of cores")
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
    """The workers of a running dask scheduler, such as "tcp://127.0.0.1:8786". Raises WorkersError where none
    answers, MissingLibraryError."""
    try:
        from distributed import Client
        from distributed.comm.addressing import get_address_host
    except ImportError:
        raise MissingLibraryError.of_extra("a scheduler", "dask.distributed", "cluster") from None
    try:
        # A client that is refused its address would end with a traceback of its own.
        get_address_host(address)
        client: Any = Client(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError):
        raise WorkersError(f"no scheduler answers at '{address}'; start one with: dask scheduler") from None
    with client:
        yield client.get_executor(pure=False)


def _begin() -> None:
    """Of a worker: an interruption ends it at once, and so does the end of the process that started it."""
    signal.signal(signal.SIGINT, lambda *_: os._exit(_INTERRUPTED))
    parent = multiprocessing.parent_process()
    assert parent is not None
    threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: Any) -> None:
    wait([sentinel])
    os._exit(_INTERRUPTED)
