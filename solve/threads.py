"""Control of threads: number of BLAS threads for small matrices, interruptible calls, and symbolic
operations."""

import atexit
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from contextvars import copy_context
from functools import cache, wraps
from typing import Any, ParamSpec, TypeVar

from solve.arguments import SMALL

Value = TypeVar("Value")
Arguments = ParamSpec("Arguments")

_lock = threading.Lock()
_active_calls: list[Any] = []
"""Active calls of `one_thread`: the thread limiter of the first call, and None for each further call."""


@contextmanager
def one_thread(coordinates: int) -> Iterator[None]:
    """Context manager in which BLAS uses one thread if a system with this number of coordinates is small.

    For small matrices, BLAS threads spend more time waiting than computing. If calls overlap, the previous
    number of threads is restored when the last call ends."""
    if coordinates > SMALL:
        yield
        return
    with _lock:
        libraries = _libraries("scipy.linalg" in sys.modules, "ctrlsys" in sys.modules)
        limited = bool(_active_calls) or any(
            library.num_threads != 1 for library in libraries.lib_controllers
        )
        if limited:
            _active_calls.append(None if _active_calls else libraries.limit(limits=1))
    if not limited:
        yield
        return
    try:
        yield
    finally:
        with _lock:
            limiter = _active_calls[0]
            _active_calls.pop()
            if not _active_calls:
                limiter.restore_original_limits()


@cache
def _libraries(has_scipy: bool, has_slicot: bool) -> Any:
    """BLAS libraries loaded by this process: the library of NumPy and, if these packages are imported, the
    libraries of SciPy and ctrlsys."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController().select(user_api="blas")


def interruptible(work: Callable[[], Value]) -> Value:
    """Return the result of `work`. It runs in a separate thread while the current thread waits, so that an
    interruption takes effect before a long LAPACK call returns.

    After an interruption, the call continues in the background. A regular exit of the process waits for the
    end of this call, because the libraries in use must not be unloaded earlier."""
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


_building = threading.RLock()
_results: list[Any] = []
"""Results of the functions decorated by `symbolic`, and the contents of deleted function owners."""

_UNUSED = 2
"""Reference count of an object to which only `_results` refers: by the list and by the argument of
`sys.getrefcount`."""


def symbolic(function: Callable[Arguments, Value]) -> Callable[Arguments, Value]:
    """Decorator for functions that build CasADi expressions. It permits only one thread at a time to run
    these functions, and to release the memory of their results.

    CasADi releases Python's global lock, but its symbolic operations are not thread-safe (measured with
    versions 3.7.0 and 3.8.2). With two threads, they crashed the process within 20 s. The release of a
    function is not thread-safe either: equal constants share their memory, and a constant may be released
    while another thread requests the same value. Without `_results`, four of six runs of 8 s crashed. The
    evaluation of CasADi functions is thread-safe."""

    @wraps(function)
    def alone(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Value:
        with _building:
            for index in reversed(range(len(_results))):
                if sys.getrefcount(_results[index]) == _UNUSED:
                    del _results[index]
            result = function(*args, **kwargs)
            if result is not None and all(result is not each for each in _results):
                _results.append(result)
            return result

    return alone


class FunctionOwner:
    """Base class of objects that own CasADi functions. The memory of these functions is released at the next
    call of a function decorated by `symbolic`.

    The finaliser waits for no lock and uses no variable of a module, because these may be None when the
    interpreter exits."""

    _release = staticmethod(_results.append)

    def __del__(self) -> None:
        self._release(vars(self))
