"""Systems from paths of files. `solve.load` and commands accept such paths in place of a model."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from solve.errors import ValueOutOfBoundsError, require_name
from solve.readers.fmu import read_fmu
from solve.readers.formats import read_mat, read_netcdf, read_npz, read_op4
from solve.readers.matrix_market import read_matrix_market
from solve.readers.openfast import read_openfast
from solve.readers.python_file import read_python
from solve.system import PeriodicSystem

READERS: dict[str, Callable[..., Any]] = {
    ".lin": read_openfast,
    ".mat": read_mat,
    ".npz": read_npz,
    ".nc": read_netcdf,
    ".mtx": read_matrix_market,
    ".op4": read_op4,
    ".fmu": read_fmu,
}
"""Mapping from the ending of a path or pattern to the reader."""

_OPTIONS: Mapping[str, Sequence[str]] = {".lin": ("exclude",), ".fmu": ("exclude", "drive")}
"""Mapping from endings to the names of options: excluded states, and the variable that is set to the
speed."""


def read(
    text: str, options: Mapping[str, Any], parameters: Mapping[str, float | str], **others: Any
) -> PeriodicSystem:
    """Read a system from a path or pattern.

    options: options of the reader. parameters: variables of an FMU or arguments of a Python function. Options
    of the reader are accepted in `parameters`, too. others: arguments that apply only to models, and must be
    None. Raises subclasses of SolveError."""
    ending = Path(text).suffix.lower()
    allowed = _OPTIONS.get(ending, ())
    options = {**options, **{name: value for name, value in parameters.items() if name in allowed}}
    parameters = {name: value for name, value in parameters.items() if name not in allowed}
    useless = [name for name, value in others.items() if value is not None]
    useless += [name for name in parameters if ending not in (".fmu", ".py")]
    useless += [name for name in options if not allowed]
    if useless:
        raise ValueOutOfBoundsError(
            f"'{text}' has no {_ABSENT.get(ending, 'parameters, cases or options')}; omit {useless[0]}"
        )
    for name in options:
        require_name(f"option of '{text}'", name, allowed)
    if ending == ".py":
        return read_python(Path(text), parameters)
    settings = dict(options)
    if isinstance(settings.get("exclude"), str):
        settings["exclude"] = [name.strip() for name in settings["exclude"].split(",")]
    if ending == ".fmu":
        settings["values"] = _numbers(text, parameters)
    return READERS[ending](text, **settings)


_ABSENT = {".lin": "parameters or cases", ".fmu": "cases", ".py": "cases or options"}
"""Mapping from endings to a string that names the arguments that do not apply. To files of matrices, neither
parameters nor cases nor options apply."""


def _numbers(text: str, parameters: Mapping[str, float | str]) -> dict[str, float]:
    """Mapping from variables of an FMU to values. Raises ValueOutOfBoundsError for strings."""
    for name, value in parameters.items():
        if isinstance(value, str):
            raise ValueOutOfBoundsError(
                f"variable {name} of '{text}' is '{value}'; allowed: numbers, in the unit of the FMU"
            )
    return {name: float(value) for name, value in parameters.items()}
