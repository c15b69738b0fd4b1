"""Arguments of public functions: what they cannot be is refused in words, not by an attribute that it lacks;
several names may be one text."""

import inspect
import reprlib
from collections.abc import Callable, Iterable
from functools import wraps
from typing import Any, ParamSpec, TypeVar

import numpy as np

from solve.errors import SolveError, StepsError, ValueOutOfBoundsError

Given = ParamSpec("Given")
Result = TypeVar("Result")


def first_is(
    *kinds: type, such_as: str, demand: Callable[[Any], None] | None = None
) -> Callable[[Callable[Given, Result]], Callable[Given, Result]]:
    """Decorator that raises ValueOutOfBoundsError unless the first argument is of one of the kinds. such_as:
    example of a valid argument. demand: further check, which raises for unsuitable arguments."""

    def checking(work: Callable[Given, Result]) -> Callable[Given, Result]:
        name = next(iter(inspect.signature(work).parameters))

        @wraps(work)
        def checked(*args: Given.args, **kwargs: Given.kwargs) -> Result:
            given = args[:1] or [value for key, value in kwargs.items() if key == name]
            if given and not isinstance(given[0], kinds):
                allowed = " or ".join(kind.__name__ for kind in kinds)
                raise ValueOutOfBoundsError(
                    f"{name} is {reprlib.repr(given[0])}; allowed: {allowed}, such as {such_as}"
                )
            if given and demand is not None:
                demand(given[0])
            return work(*args, **kwargs)

        return checked

    return checking


def listed(names: str | Iterable[str]) -> tuple[str, ...]:
    """Names, each once; a text is one name."""
    return tuple(dict.fromkeys((names,) if isinstance(names, str) else names))


def require_whole(
    name: str, given: object, least: int = 1, hint: str = "", error: type[SolveError] = ValueOutOfBoundsError
) -> None:
    """Raise the error unless it is a whole number, at least so large; hint: what else to say."""
    if isinstance(given, bool) or not (isinstance(given, int | np.integer) and given >= least):
        raise error(f"{name} is {given!r}; allowed: whole numbers of at least {least}{hint}")


def require_steps(steps: object, least: int = 1) -> None:
    """Raise StepsError unless it is a number of steps, at least so many."""
    require_whole("steps", steps, least, "; leave steps out to have their number chosen", StepsError)
