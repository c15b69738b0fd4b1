"""Validation of arguments of public functions, and checks of the memory limit before allocation."""

import inspect
import math
import re
import reprlib
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from decimal import Decimal
from functools import cache, wraps
from numbers import Real
from types import NoneType, SimpleNamespace, UnionType
from typing import Any, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from solve.errors import SolveError, StepsError, ValueOutOfBoundsError

MOST = 2**26
"""Default limit on the number of values in memory at any time: half a gigabyte of float64. Chosen by
judgement."""

SMALL = 40
"""Largest number of coordinates of a small system. For small systems, compiled code is faster than BLAS,
points are solved in batches, and BLAS uses one thread. Tables for batches of larger systems would exceed the
memory."""

NUMBERS_A_POINT = 64
"""Estimated number of values stored per point: statistics, multipliers and warnings. Chosen by judgement."""

_numbers_limit: ContextVar[float] = ContextVar("numbers_limit", default=MOST)

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")


def first_is(
    *types: type, such_as: str, demand: Callable[[Any], None] | None = None
) -> Callable[[Callable[Parameters, Result]], Callable[Parameters, Result]]:
    """Create a decorator that checks arguments. The decorated function raises ValueOutOfBoundsError unless
    its first argument is an instance of `types` and all other arguments match their annotations.

    Wrong arguments are rejected early with a clear message instead of an AttributeError.

    Parameters
    ----------
    *types : type
        Allowed types.
    such_as : str
        Example of a valid argument, for the message.
    demand : callable, optional
        Function that checks the first argument further, and raises an exception if it is not suitable.
    """

    def decorator(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
        name = next(iter(inspect.signature(function).parameters))
        typed = matches_annotations(function)

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
            return typed(*args, **kwargs)

        return checked

    return decorator


def matches_annotations(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Decorator that raises ValueOutOfBoundsError for arguments that do not match their annotations.

    Two cases are left to the function itself: a string in place of a sequence, because it may be a single
    name or a range; and a number of any type in place of an integer.

    >>> @matches_annotations
    ... def halved(values: Sequence[float]) -> list[float]:
    ...     "values : list of numbers"
    ...     return [value / 2 for value in values]
    >>> halved([1, None])
    Traceback (most recent call last):
    solve.errors.ValueOutOfBoundsError: values is [1, None]; allowed: list of numbers; see help(solve.halved)
    """
    names = list(inspect.signature(function).parameters)

    @wraps(function)
    def checked(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Result:
        annotations = _annotations(function)
        for name, value in (*zip(names, args, strict=False), *kwargs.items()):
            if name in annotations and not conforms(value, annotations[name]):
                owner = args[0] if names[0] in ("self", "cls") else None
                raise ValueOutOfBoundsError(
                    f"{name} is {described(value)}; allowed: {_documented(function, owner, name)}; "
                    f"see help(solve.{_path(function, owner)})"
                )
        return function(*args, **kwargs)

    return checked


@cache
def _annotations(function: Callable[..., Any]) -> dict[str, Any]:
    """Mapping from parameters to their types; `*args` and `**kwargs` are omitted."""
    collecting = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    kinds = {name: each.kind for name, each in inspect.signature(function).parameters.items()}
    # The annotation of the result may name a class of a library that is not imported.
    given = SimpleNamespace(__annotations__={**function.__annotations__, "return": None})
    hints = get_type_hints(given, vars(sys.modules[function.__module__]))
    return {name: hints[name] for name, kind in kinds.items() if name in hints and kind not in collecting}


def _path(function: Callable[..., Any], owner: Any) -> str:
    """Name of a function, or of a method with the class of its first argument; for a constructor, the name of
    the class."""
    if owner is None:
        return function.__name__
    kind = owner if isinstance(owner, type) else type(owner)
    return kind.__name__ if function.__name__ == "__init__" else f"{kind.__name__}.{function.__name__}"


def _documented(function: Callable[..., Any], owner: Any, name: str) -> str:
    """Type of a parameter as stated in the docstring or, if it is not stated there, the names in its
    annotation."""
    text = owner.__doc__ if function.__name__ == "__init__" else function.__doc__
    found = re.search(rf"^ *(?:\w+, )*{name}(?:, \w+)* : (.*?)(?:, optional)?$", text or "", re.MULTILINE)
    if found and found[1] != "optional":
        return "whole numbers" if found[1] == "int" else found[1]
    annotation = _annotations(function)[name]
    kinds = get_args(annotation) if get_origin(annotation) in (Union, UnionType) else (annotation,)
    words = {int: "whole numbers", float: "numbers"}
    return " or ".join(
        words.get(each) or (get_origin(each) or each).__name__ for each in kinds if each is not NoneType
    )


def conforms(value: Any, annotation: Any) -> bool:
    """Whether a value and its entries are of the annotated type. Iterators are not consumed.

    >>> conforms({"k1": (1, 2)}, Mapping[str, tuple[float, float]]), conforms([3], Sequence[str])
    (True, False)
    """
    if type(value) in _exact_types(annotation):  # This test halves the time.
        return True
    kind, arguments = get_origin(annotation) or annotation, get_args(annotation)
    if kind in (Union, UnionType):
        return any(conforms(value, each) for each in arguments)
    if kind is Any:
        return True
    if kind in (float, int):
        is_number = isinstance(value, Real) or (kind is float and _dimensions(value) == 0)
        return is_number and not isinstance(value, bool) and _is_real(value)
    if kind is bool:
        return isinstance(value, bool | np.bool_)
    if kind is Mapping:
        key, entry = arguments
        return isinstance(value, Mapping) and all(
            conforms(each, key) and conforms(value[each], entry) for each in value
        )
    if kind is tuple:
        pair = isinstance(value, Sequence | np.ndarray) and not isinstance(value, str | bytes)
        return pair and len(value) == len(arguments) and all(map(conforms, value, arguments))
    if kind is Sequence:
        return _is_sequence(value, arguments[0])
    if kind is np.ndarray:
        is_sequence = isinstance(value, Sequence) and not isinstance(value, str | bytes)
        return (is_sequence or _dimensions(value) is not None) and _is_real(value)
    if kind is NoneType or not isinstance(kind, type):
        return value is None if kind is NoneType else True
    return callable(value) if kind is Callable else isinstance(value, kind)


@cache
def _exact_types(annotation: Any) -> frozenset[type]:
    """Types whose instances match an annotation without a further check. Integers are not among them,
    because they may exceed the range of float64."""
    kinds = get_args(annotation) if get_origin(annotation) in (Union, UnionType) else (annotation,)
    return frozenset(kind for kind in kinds if isinstance(kind, type) and kind is not int)


def _dimensions(value: Any) -> int | None:
    """Number of dimensions of a NumPy, xarray or pandas array; None for other values."""
    return getattr(value, "ndim", None)


def _is_real(value: Any) -> bool:
    """Whether a value is a real number in the range of float64, or an array of such numbers."""
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):
        return False
    if array.dtype.kind in "iuf":
        return True
    return array.dtype.kind == "O" and all(map(_is_number, array.ravel()))


def _is_number(value: Any) -> bool:
    """Whether an entry of an array of objects is a real number in the range of float64."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, Real | Decimal):
        return False
    try:
        float(value)
    except (OverflowError, ValueError):
        return False
    return True


def _is_sequence(value: Any, annotation: Any) -> bool:
    """Whether a value is a string, or a sequence whose entries are of the annotated type."""
    if isinstance(value, str):
        return conforms("", annotation)
    if not isinstance(value, Iterable) or isinstance(value, bytes | Mapping):
        return False
    if _dimensions(value) == 1 and _is_real(value):
        return conforms(1.0, annotation)
    if _dimensions(value) == 0:
        return False
    if not isinstance(value, Collection):
        return True
    if set(map(type, value)) == {float}:  # One check for all entries saves most of the time.
        return conforms(1.0, annotation)
    return all(conforms(each, annotation) for each in value)


def described(value: object) -> str:
    """Describe a wrong argument in one line. An object whose text would contain a memory address is described
    by its type.

    >>> described([1, 2]), described(object()), described(abs)
    ('[1, 2]', 'of type object', 'of type builtin_function_or_method')
    """
    if type(value).__repr__ is object.__repr__ or callable(value):
        return f"of type {type(value).__name__}"
    return " ".join(reprlib.repr(value).split())


def number_or_nan(value: Any) -> float:
    """Value as a float; NaN if it is not a number."""
    try:
        return float(value)
    except (TypeError, ValueError):
        return math.nan


def unique_names(names: str | Iterable[str]) -> tuple[str, ...]:
    """Names without repetitions, in their original order. A string counts as a single name."""
    return tuple(dict.fromkeys((names,) if isinstance(names, str) else names))


def require_integer(
    name: str, value: object, least: int = 1, hint: str = "", error: type[SolveError] = ValueOutOfBoundsError
) -> None:
    """Raise `error` unless the value is an integer >= `least`. hint: text at the end of the message."""
    if isinstance(value, bool) or not (isinstance(value, int | np.integer) and value >= least):
        raise error(f"{name} is {value!r}; allowed: whole numbers of at least {least}{hint}")


def require_index(name: str, value: object, count: int) -> None:
    """Raise ValueOutOfBoundsError unless the value is an index of a sequence of `count` items."""
    if isinstance(value, bool) or not (isinstance(value, int | np.integer) and -count <= value < count):
        raise ValueOutOfBoundsError(
            f"{name} is {value!r}; allowed: whole numbers from {-count} to {count - 1}"
        )


def require_steps(steps: object, least: int = 1) -> None:
    """Raise StepsError unless `steps` is an integer >= `least`."""
    require_integer("steps", steps, least, "; omit steps for automatic selection", StepsError)


@contextmanager
def limited(limit: float | None) -> Iterator[None]:
    """Context manager that limits the number of values in memory; None keeps the current limit. Raises
    ValueOutOfBoundsError for limits outside 1 … 1e15."""
    if limit is not None and not 1 <= limit <= 1e15:
        raise ValueOutOfBoundsError(f"limit is {limit:g}; allowed: 1 … 1e15 numbers in total, such as {MOST}")
    token = _numbers_limit.set(_numbers_limit.get() if limit is None else limit)
    try:
        yield
    finally:
        _numbers_limit.reset(token)


def most_numbers() -> float:
    """Largest permitted number of values in memory."""
    return _numbers_limit.get()


def require_size(what: str, count: float, each: float = 1) -> None:
    """Raise ValueOutOfBoundsError if `count` items, with `each` numbers per item, exceed the memory limit.

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
    if not (conforms(tolerance, float) and least <= tolerance < 1):
        raise ValueOutOfBoundsError(
            f"{name} is {tolerance}; allowed: {least:g} up to (not including) 1, such as {example}"
        )
    return float(tolerance)


def checked_rtol(rtol: float) -> float:
    """Return the relative tolerance. Raises ValueOutOfBoundsError unless it is at least 1e-14 and below 1."""
    return checked_tolerance(rtol, "rtol", 1e-14, "1e-8")
