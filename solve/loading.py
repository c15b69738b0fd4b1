"""Loading of models by name, by path or from a mechanism in memory, and of systems from other files."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType, ModuleType
from typing import Any, Protocol, Self, overload, runtime_checkable

import numpy as np

from solve.arguments import matches_annotations
from solve.arrays import Array
from solve.contracts import Matrices
from solve.equations import require_desired_motion
from solve.errors import ModelFileError, ValueOutOfBoundsError
from solve.model.bounds import REDUCE, checked_parameters
from solve.model.cases import Case, chosen_case
from solve.model.generated import EQUATIONS, kind_of, model_files, model_module, module_of
from solve.model.model import Model
from solve.model.setup import Setup
from solve.readers.files import is_system_file
from solve.system import PeriodicSystem, shown_in


@runtime_checkable
class Derivable(Protocol):
    """Protocol of objects that generate their own code, such as a `derive.Mechanism`."""

    def code(self) -> str: ...


class RigidModel(Model):
    """Mechanism without coordinates. Its motion is prescribed, and its outputs are functions of phase and
    speed."""

    _FEWEST = 0

    @classmethod
    def from_setup(cls, setup: Setup) -> Self:
        model = cls(setup, _no_matrices, ())
        reason = (
            f"{setup.module.NAME} has no coordinates, so that nothing vibrates; use periodic, sweep or "
            "animate for its outputs over a revolution"
        )
        model.labels = replace(model.labels, vibrates=False, no_motion=reason)
        return model

    @property
    def assembled(self) -> bool:
        return False

    def _check(self, speed: float) -> None:
        require_desired_motion(shown_in(self, speed), np.array([speed]))


def _no_matrices(phase: Array, speed: float) -> Matrices:
    none = np.zeros((len(phase), 0, 0))
    return none, none, none, np.zeros((len(phase), 0))


@overload
def load(
    model: Derivable | Callable[[], Derivable],
    case: str | int | None = None,
    options: Mapping[str, Any] | None = None,
    reduce: int | None = None,
    **parameters: Any,
) -> Model: ...


# For the name of a model, the result is a Model; for a file of matrices, it is another system. With Any in
# the union, callers require no cast.
@overload
def load(
    model: str | Path,
    case: str | int | None = None,
    options: Mapping[str, Any] | None = None,
    reduce: int | None = None,
    **parameters: Any,
) -> Model | Any: ...


@matches_annotations
def load(
    model: str | Path | Derivable | Callable[[], Derivable],
    case: str | int | None = None,
    options: Mapping[str, Any] | None = None,
    reduce: int | None = None,
    **parameters: Any,
) -> Model | PeriodicSystem:
    """Load the system of a model and a case, or of a file.

    Parameters
    ----------
    model : str, Path, Mechanism or callable
        Name of a model, or path of a mechanism file. Also a `derive.Mechanism`, or a function that returns
        one; its equations are derived once. Also the path or pattern of files of matrices, of an FMU, or of a
        Python file that defines a system with the name `system`. The code of FMUs and of Python files is
        executed.
    case : str or int, optional
        Name of a case in the case file; by default, the first case.
    options : mapping of str to value, optional
        Options of the model, which may also be given as keyword arguments. Files `.lin` and `.fmu` have the
        option "exclude", whose value is the names of states. FMUs also have the option "drive"; see
        `read_fmu`.
    reduce : int, optional
        Number of modes retained per link of a beam structure. Results then state the error of the reduction.
    **parameters : float or str
        Values that override the values of the case. A value is a number in the unit of the model, or a string
        such as "30 mm".

    Returns
    -------
    Model or PeriodicSystem
        Model with values of its parameters; or the system read from a file, a `PeriodicSystem` or
        `FirstOrderSystem`.

    Raises
    ------
    FileError
        If a file of matrices or an FMU cannot be read.
    UnknownNameError, CaseFileError, MissingValueError, UnitError, ValueOutOfBoundsError
        If names, files or values are invalid.
    ModelFileError
        If the generated code is missing or out of date.

    Examples
    --------
    >>> load("mathieu", delta=1.5).parameters["delta"]
    1.5
    """
    model = str(model) if isinstance(model, Path) else model
    if isinstance(model, str) and is_system_file(model):
        from solve.readers.paths import read

        return read(model, options or {}, parameters, case=case, reduce=reduce)
    module, file = _module_and_cases(model)
    declared = _options_of(module)
    chosen_options = {name: value for name, value in parameters.items() if name in declared}
    numbers = {name: value for name, value in parameters.items() if name not in declared}
    if reduce is not None:
        chosen_options[REDUCE] = reduce
    for name in chosen_options.keys() & (options or {}).keys():
        raise ValueOutOfBoundsError(f"option {name} is given twice; give it once")
    chosen = chosen_case(module, file, None if case is None else str(case), numbers, required=False)
    return model_of(Setup.checked(module, chosen, {**(options or {}), **chosen_options}))


def setup_of(
    model: str,
    case: str | None,
    cases: str | None,
    options: Mapping[str, Any],
    parameters: Mapping[str, float | str],
    otherwise: Mapping[str, float | str] = MappingProxyType({}),
) -> Setup:
    """Create the setup of a model: generated module, case and options.

    cases: path of another case file. otherwise: default values of parameters. Raises the exceptions of
    `load`."""
    module, chosen = _module_and_case(model, case, cases, parameters, otherwise)
    return Setup.checked(module, chosen, options)


def model_of(setup: Setup) -> Model:
    """Create the model of a setup. Its class depends on the kind of the generated module."""
    if kind_of(setup.module) == EQUATIONS:
        return Model.from_setup(setup) if setup.module.COORDINATES else RigidModel.from_setup(setup)
    from solve.beams.reduced import ReducedStructure
    from solve.beams.structure import StructureModel

    return (ReducedStructure if REDUCE in setup.options else StructureModel).from_setup(setup)


def _module_and_cases(model: str | Derivable | Callable[[], Derivable]) -> tuple[ModuleType, Path | None]:
    """Return the generated module of a model, and the path of its case file; None if there is no case
    file."""
    if isinstance(model, str):
        files = model_files(model)
        return model_module(files.generated), files.cases
    mechanism: Any = model if hasattr(model, "code") or not callable(model) else model()
    if not hasattr(mechanism, "code"):
        raise ModelFileError(
            f"a model is given as {type(mechanism).__name__}; give a name, the path of a mechanism file, a "
            "derive.Mechanism, or a function that returns one"
        )
    return module_of(mechanism.code()), None


def _options_of(module: ModuleType) -> set[str]:
    kinds = ("OPTIONS", "LINK_OPTIONS", "MOTION_OPTIONS")
    return {name for kind in kinds for name, *_ in getattr(module, kind, ())}


@matches_annotations
def case_numbers(
    model: str,
    case: str | int | None = None,
    cases: str | Path | None = None,
    parameters: Mapping[str, float | str] | None = None,
) -> Case:
    """Read the parameter values of a case of a model.

    Parameters
    ----------
    model : str
        Name, or path of a mechanism file.
    case : str or int, optional
        Name of a case in the case file; by default, the first case.
    cases : str or Path, optional
        Path of another case file.
    parameters : mapping of str to float or str, optional
        Values that replace the values of the case.

    Returns
    -------
    Case
        Parameters in the units of the model, each within its bounds. Conditions that involve several
        parameters are not checked.

    Raises
    ------
    SolveError
        As `solve.load`.
    """
    name = None if case is None else str(case)
    module, chosen = _module_and_case(model, name, cases, parameters or {})
    return replace(chosen, parameters=checked_parameters(module, chosen.parameters))


def missing_parameters(
    model: str, case: str | None, cases: str | None, parameters: Mapping[str, float | str]
) -> list[str]:
    """Names of parameters of a model that have a value neither in the case nor in `parameters`. Raises the
    exceptions of `load`."""
    unset = dict.fromkeys(parameter_units(model), math.nan)
    _, chosen = _module_and_case(model, case, cases, parameters, unset)
    return [name for name in unset if chosen.parameters[name] is math.nan]


def parameter_units(model: str) -> dict[str, str]:
    """Mapping from the parameters of a model to their declared units. Raises the exceptions of `load`."""
    module, _ = _module_and_cases(model)
    return {name: unit for name, unit, *_ in module.PARAMETERS}


def _module_and_case(
    model: str,
    case: str | None,
    cases: str | Path | None,
    parameters: Mapping[str, float | str],
    otherwise: Mapping[str, float | str] = MappingProxyType({}),
) -> tuple[ModuleType, Case]:
    """Return the generated module of a model, and the chosen case."""
    module, file = _module_and_cases(model)
    if cases:
        file = Path(cases)
    return module, chosen_case(module, file, case, parameters, cases is not None, otherwise)
