"""How much may be asked for: what will be held is counted before anything is allocated."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from solve.errors import ValueOutOfBoundsError

MOST = 2**26
"""Numbers that may be held at once by default: half a gigabyte."""

SMALL = 40
"""Coordinates up to which compiled lanes are quicker than BLAS, points gain from each other, and threads of
BLAS only wait; tables of larger systems fill the memory."""

NUMBERS_A_POINT = 64
"""At least, with its figures, multipliers and warnings."""

_most: ContextVar[float] = ContextVar("most", default=MOST)


@contextmanager
def limited(most: float | None) -> Iterator[None]:
    """Within, so many numbers may be held at once; None leaves the limit as it is. Raises
    ValueOutOfBoundsError outside 1 … 1e15."""
    if most is not None and not 1 <= most <= 1e15:
        raise ValueOutOfBoundsError(f"limit is {most:g}; allowed: 1 … 1e15 numbers, such as {MOST}")
    token = _most.set(_most.get() if most is None else most)
    try:
        yield
    finally:
        _most.reset(token)


def most_numbers() -> float:
    """Numbers that may be held at once."""
    return _most.get()


def require_size(what: str, count: float, each: float = 1) -> None:
    """Raise ValueOutOfBoundsError where so many of something, each of which takes so many numbers, are more
    than may be held.

    >>> require_size("points", 1000, each=20)
    >>> require_size("points", 1e9, each=20)
    Traceback (most recent call last):
    solve.errors.ValueOutOfBoundsError: 1e+09 points; allowed: up to 3355443, or more with --limit 2e+10
    """
    if count * each > most_numbers():
        most, needed = int(most_numbers() / each), f"--limit {count * each:.3g}"
        allowed = f"up to {most}, or more with {needed}" if most else f"{needed} or more"
        raise ValueOutOfBoundsError(f"{count:.6g} {what}; allowed: {allowed}")
