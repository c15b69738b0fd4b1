"""BLAS in one thread while small matrices are solved, for which its threads wait longer than they work; a
thread of its own for what cannot be interrupted."""

import atexit
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from contextvars import copy_context
from functools import cache
from typing import Any, TypeVar

from solve.sizes import SMALL

Value = TypeVar("Value")

_lock = threading.Lock()
_within: list[Any] = []
"""The limiter of the first of the calls that are within, and a place for each of the others."""


@contextmanager
def one_thread(coordinates: int) -> Iterator[None]:
    """Within, BLAS takes one thread where a system of so many coordinates is small, whatever the environment
    says; the number it had before comes back with the last of the calls that overlap, from any thread."""
    if coordinates > SMALL:
        yield
        return
    with _lock:
        libraries = _libraries(tuple(name in sys.modules for name in ("scipy.linalg", "ctrlsys")))
        limited = bool(_within) or any(each.num_threads != 1 for each in libraries.lib_controllers)
        if limited:
            _within.append(None if _within else libraries.limit(limits=1))
    if not limited:
        yield
        return
    try:
        yield
    finally:
        with _lock:
            limiter = _within[0]
            _within.pop()
            if not _within:
                limiter.restore_original_limits()


@cache
def _libraries(loaded: tuple[bool, ...]) -> Any:
    """BLAS libraries loaded by this process: NumPy's, and those of SciPy and ctrlsys if these are
    imported."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController().select(user_api="blas")


def interruptible(work: Callable[[], Value]) -> Value:
    """What the work returns or raises, done in a thread while this one waits, so that an interruption need
    not wait until a long call of LAPACK returns. The work then goes on unseen, and a process that ends in
    the usual way waits for it: the libraries that it uses are taken down after that."""
    done: Future[Value] = Future()
    context = copy_context()

    def run() -> None:
        try:
            done.set_result(context.run(work))
        except BaseException as error:
            done.set_exception(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        return done.result()
    except KeyboardInterrupt:
        atexit.register(thread.join)
        raise
