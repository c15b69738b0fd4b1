"""Conversion of commands for Typer: from functions whose parameters are groups of flags, to functions with
one parameter per flag."""

import inspect
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass
from typing import Annotated, Any, get_args, get_type_hints

from solve.arguments import MOST, limited
from solve.commands.groups import Problem
from solve.commands.parse import Flag
from solve.errors import DesiredMotionError, MatricesError


@dataclass(frozen=True)
class Common:
    """Flags that every command has."""

    limit: Annotated[float | None, Flag(f"Maximum number of values in memory; by default {MOST}.", "N")] = (
        None
    )
    debug: Annotated[bool, Flag("Show the traceback of an internal error.")] = False


def flattened(command: Callable[..., None]) -> Callable[..., None]:
    """Convert a command to a function for Typer, whose parameters are the fields of the command's groups and
    of `Common`."""
    hints = get_type_hints(command, include_extras=True)
    groups = {name: hint for name, hint in hints.items() if isinstance(hint, type) and is_dataclass(hint)}
    parameters, common = [], inspect.signature(Common).parameters
    for name, parameter in inspect.signature(command).parameters.items():
        single = [parameter.replace(annotation=hints[name])]
        group = inspect.signature(groups[name]).parameters.values() if name in groups else single
        parameters += map(_for_typer, group)
    parameters += map(_for_typer, common.values())

    def flat(**values: Any) -> None:
        shared = Common(**{name: values.pop(name) for name in common})
        for name, group in groups.items():
            values[name] = group(**{field.name: values.pop(field.name) for field in fields(group)})
        with limited(shared.limit), _naming_set_numbers(values.values()):
            command(**values)

    flat.__doc__ = command.__doc__
    flat.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    flat.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return flat


@contextmanager
def _naming_set_numbers(groups: Iterable[Any]) -> Iterator[None]:
    """Context manager that adds the values of --set to the messages of exceptions that name no parameter."""
    try:
        yield
    except (MatricesError, DesiredMotionError) as error:
        numbers = next((group.numbers_set() for group in groups if isinstance(group, Problem)), "")
        raise type(error)(f"{error}; values set: {numbers}" if numbers else str(error)) from None


def _for_typer(parameter: inspect.Parameter) -> inspect.Parameter:
    """Return a copy of a command's parameter whose annotation contains the Typer option instead of the
    `Flag`."""
    kind, flag = get_args(parameter.annotation)
    option = flag.option(parameter.name, kind) if isinstance(flag, Flag) else flag
    return parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY, annotation=Annotated[kind, option])
