"""Systems that are defined by a file of Python code."""

import inspect
import math
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from solve.errors import MissingValueError, ModelFileError, SolveError, ValueOutOfBoundsError, require_name
from solve.system import PeriodicSystem, built_by, relabelled


def read_python(file: Path, parameters: Mapping[str, float | str] | None = None) -> PeriodicSystem:
    """Execute a file and return the system that it defines. The name `system` in the file is a system, or a
    function that returns one.

    The arguments of the function become the parameters of the system, with the defaults as values. Raises
    ModelFileError if the code fails or defines no system; raises UnknownNameError, MissingValueError,
    ValueOutOfBoundsError for parameters that are not allowed.
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
    """System that `function` returns for the values of its arguments. The arguments become parameters of the
    system."""
    system = _called(file, partial(function, **values))
    if not isinstance(system, PeriodicSystem):
        raise ModelFileError(f"system() of '{file}' returns {type(system).__name__}; {_ALLOWED}")
    system = built_by(system, partial(_built, file, function), values)
    return _labelled(system, file)


def _labelled(system: PeriodicSystem, file: Path) -> PeriodicSystem:
    """Name the system after its file, unless it already has a name."""
    is_labelled = system.labels.name != PeriodicSystem.labels.name
    return system if is_labelled else relabelled(system, name=file.stem)


def _values(file: Path, function: Callable[..., Any], given: Mapping[str, float | str]) -> dict[str, float]:
    """Values of all arguments of a function: those in `given` and, for the others, the defaults."""
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
    """Call a function of the file and return its result. Raises ModelFileError with the line at which it
    fails."""
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
