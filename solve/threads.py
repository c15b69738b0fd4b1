"""BLAS in one thread while small matrices are solved, for which its threads wait longer than they work."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

from solve.sizes import SMALL

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
        _within.append(None if _within else _libraries().limit(limits=1))
    try:
        yield
    finally:
        with _lock:
            limiter = _within[0]
            _within.pop()
            if not _within:
                limiter.restore_original_limits()


@cache
def _libraries() -> Any:
    """Those of BLAS that this process has loaded, SciPy's among them."""
    import scipy.linalg  # noqa: F401
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController().select(user_api="blas")
