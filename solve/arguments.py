"""Validation of arguments of public functions, and checks of the memory limit before allocation."""

import inspect
import reprlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from numbers import Real
from typing import Any, ParamSpec, TypeVar

import numpy as np

from solve.errors import SolveError, StepsError, ValueOutOfBoundsError

MOST = 2**26
"""Default limit on the number of values in memory at once: half a gigabyte of float64. A choice."""

SMALL = 40
"""Largest number of coordinates of a small system. For small systems compiled code is faster than BLAS,
points are solved in batches, and BLAS uses one thread. Tables for batches of larger systems would exceed the
memory."""

NUMBERS_A_POINT = 64
"""Estimated number of values stored per point: statistics, multipliers and warnings. A choice."""

_numbers_limit: ContextVar[float] = ContextVar("numbers_limit", default=MOST)

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")


def first_is(
    *types: type, such_as: str, demand: Callable[[Any], None] | None = None
) -> Callable[[Callable[Parameters, Result]], Callable[Parameters, Result]]:
    """Decorator that raises ValueOutOfBoundsError unless the first argument is an instance of `types`.

    Wrong arguments are rejected early with a clear message instead of an AttributeError.

    Parameters
    ----------
    *types : type
        Allowed types.
    such_as : str
        Example of a valid argument, for the message.
    demand : callable, optional
        Further check; it raises an exception for unsuitable arguments.
    """

    def decorator(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
        name = next(iter(inspect.signature(function).parameters))

        @wraps(function)
        def checked(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Result:
            first = args[:1] or [value for key, value in kwargs.items() if key == name]
            if first and not isinstance(first[0], types):
                allowed = " or ".join(kind.__name__ for kind in types)
                raise ValueOutOfBoundsError(
                    f"{name} is {described(first[0])}; allowed: {allowed}, such as {such_as}"
                )
            if first and demand is not None:
                demand(first[0])
            return function(*args, **kwargs)

        return checked

    return decorator


def described(value: object) -> str:
    """Short text of a wrong argument; the type for objects whose text would contain a memory address.

    >>> described([1, 2]), described(object()), described(abs)
    ('[1, 2]', 'of type object', 'of type builtin_function_or_method')
    """
    if type(value).__repr__ is object.__repr__ or callable(value):
        return f"of type {type(value).__name__}"
    return reprlib.repr(value)


def unique_names(names: str | Iterable[str]) -> tuple[str, ...]:
    """Names without repetitions, in the order given. A string counts as a single name."""
    return tuple(dict.fromkeys((names,) if isinstance(names, str) else names))


def require_integer(
    name: str, value: object, least: int = 1, hint: str = "", error: type[SolveError] = ValueOutOfBoundsError
) -> None:
    """Raise `error` unless the value is an integer >= `least`. hint: appended to the message."""
    if isinstance(value, bool) or not (isinstance(value, int | np.integer) and value >= least):
        raise error(f"{name} is {value!r}; allowed: whole numbers of at least {least}{hint}")


def require_steps(steps: object, least: int = 1) -> None:
    """Raise StepsError unless `steps` is an integer >= `least`."""
    require_integer("steps", steps, least, "; leave out steps for automatic selection", StepsError)


@contextmanager
def limited(limit: float | None) -> Iterator[None]:
    """Context manager that limits the number of values in memory at once; None keeps the current limit.
    Raises ValueOutOfBoundsError outside 1 … 1e15."""
    if limit is not None and not 1 <= limit <= 1e15:
        raise ValueOutOfBoundsError(f"limit is {limit:g}; allowed: 1 … 1e15 numbers, such as {MOST}")
    token = _numbers_limit.set(_numbers_limit.get() if limit is None else limit)
    try:
        yield
    finally:
        _numbers_limit.reset(token)


def most_numbers() -> float:
    """Maximum number of values in memory at once."""
    return _numbers_limit.get()


def require_size(what: str, count: float, each: float = 1) -> None:
    """Raise ValueOutOfBoundsError if `count` items with `each` numbers per item exceed the memory limit.

    >>> require_size("points", 1000, each=20)
    >>> require_size("points", 1e9, each=20)
    Traceback (most recent call last):
    solve.errors.ValueOutOfBoundsError: 1e+09 points; allowed: up to 3355443, or more with --limit 2e+10
    """
    if count * each > most_numbers():
        most, needed = int(most_numbers() / each), f"--limit {count * each:.3g}"
        allowed = f"up to {most}, or more with {needed}" if most else f"{needed} or more"
        raise ValueOutOfBoundsError(f"{count:.6g} {what}; allowed: {allowed}")


def checked_tolerance(
    tolerance: float, name: str = "tolerance", least: float = 1e-15, example: str = "1e-9"
) -> float:
    """Return the tolerance. Raises ValueOutOfBoundsError unless it is at least `least` and below 1."""
    if not (isinstance(tolerance, Real) and least <= tolerance < 1):
        raise ValueOutOfBoundsError(
            f"{name} is {tolerance}; allowed: {least:g} up to (not including) 1, such as {example}"
        )
    return float(tolerance)


def checked_rtol(rtol: float) -> float:
    """Return the relative tolerance. Raises ValueOutOfBoundsError unless it is at least 1e-14 and below 1."""
    return checked_tolerance(rtol, "rtol", 1e-14, "1e-8")
