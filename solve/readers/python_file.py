"""Systems that a file of Python code defines."""

import inspect
import math
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from solve.errors import MissingValueError, ModelFileError, SolveError, ValueOutOfBoundsError, require_name
from solve.system import PeriodicSystem, built_by, relabelled


def read_python(file: Path, parameters: Mapping[str, float | str] | None = None) -> PeriodicSystem:
    """System that a file defines by the name `system`: a system, or a function that returns one.

    The code is executed. The arguments of a function are the parameters of the system, with their defaults as
    values. Raises ModelFileError if the code fails or defines no system, and UnknownNameError,
    MissingValueError, ValueOutOfBoundsError for unsuitable parameters.
    """
    names: dict[str, Any] = {"__name__": file.stem, "__file__": str(file)}
    try:
        code = compile(file.read_bytes(), str(file), "exec")
    except (OSError, SyntaxError, ValueError) as error:
        raise ModelFileError(f"'{file}' cannot be read: {_text(error)}") from None
    _called(file, partial(exec, code, names))
    defined = names.get("system")
    if isinstance(defined, PeriodicSystem):
        for name in parameters or {}:
            require_name(f"parameter of '{file}'", name, [])
        return _labelled(defined, file)
    if not callable(defined):
        raise ModelFileError(f"system of '{file}' is {type(defined).__name__}; {_ALLOWED}")
    return _built(file, defined, _values(file, defined, parameters or {}))


_ALLOWED = "give a PeriodicSystem, FirstOrderSystem or MixedSystem, or a function that returns one"


def _built(file: Path, function: Callable[..., Any], values: Mapping[str, float]) -> PeriodicSystem:
    """System that a function returns for values of its arguments. The arguments remain parameters of the
    system."""
    system = _called(file, partial(function, **values))
    if not isinstance(system, PeriodicSystem):
        raise ModelFileError(f"system() of '{file}' returns {type(system).__name__}; {_ALLOWED}")
    system = built_by(system, partial(_built, file, function), values)
    return _labelled(system, file)


def _labelled(system: PeriodicSystem, file: Path) -> PeriodicSystem:
    """System, named after its file unless it already has a name."""
    is_labelled = system.labels.name != PeriodicSystem.labels.name
    return system if is_labelled else relabelled(system, name=file.stem)


def _values(file: Path, function: Callable[..., Any], given: Mapping[str, float | str]) -> dict[str, float]:
    """Values of all arguments of a function: the given ones, or their defaults."""
    defaults = {name: each.default for name, each in inspect.signature(function).parameters.items()}
    for name in given:
        require_name(f"parameter of '{file}'", name, defaults)
    values: dict[str, float] = {}
    for name, value in {**defaults, **given}.items():
        if value is inspect.Parameter.empty:
            raise MissingValueError(f"parameter {name} of '{file}' has no value; give one: {name}=NUMBER")
        if isinstance(value, str) or not isinstance(value, int | float) or not math.isfinite(value):
            raise ValueOutOfBoundsError(
                f"parameter {name} of '{file}' is {value!r}; allowed: finite numbers without unit"
            )
        values[name] = float(value)
    return values


def _called(file: Path, function: Callable[[], Any]) -> Any:
    """Result of a function of the file. Raises ModelFileError with the line at which it fails."""
    try:
        return function()
    except SolveError:
        raise
    except Exception as error:
        trace, line = error.__traceback__, None
        while trace is not None:
            line = trace.tb_lineno if trace.tb_frame.f_code.co_filename == str(file) else line
            trace = trace.tb_next
        where = "" if line is None else f", line {line}"
        raise ModelFileError(f"'{file}'{where}: {type(error).__name__}: {_text(error)}") from None


def _text(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
