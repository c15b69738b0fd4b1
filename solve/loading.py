"""From the name of a model, the path of its mechanism, or the mechanism itself to a periodic system."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType, ModuleType
from typing import Any, Protocol

from solve.errors import ModelFileError, ValueOutOfBoundsError
from solve.model.bounds import checked_parameters
from solve.model.cases import Case, chosen_case
from solve.model.files import model_files
from solve.model.generated import EQUATIONS, kind_of, model_module, module_of
from solve.model.model import Model
from solve.model.options import REDUCE
from solve.model.rigid import RigidModel
from solve.model.setup import Setup


class Derivable(Protocol):
    """What gives the code generated for it, as a `derive.Mechanism` does."""

    def code(self) -> str: ...


def load(
    model: str | Derivable | Callable[[], Derivable],
    case: str | int | None = None,
    options: Mapping[str, Any] | None = None,
    reduce: int | None = None,
    **parameters: Any,
) -> Model:
    """System of a model and a case.

    model: a name; the path of a mechanism file; or, without files, a `derive.Mechanism` or a function that
    returns one, which is derived in memory, once per mechanism. Parameters override the values of the case,
    in the units of the model or as texts with unit such as "30 mm"; options may be given among them by name.
    The first case is the default. reduce: number of modes retained per link of a beam structure; results then
    state the error of the reduction. Raises UnknownNameError, ModelFileError (missing or stale generated
    code), CaseFileError, MissingValueError, UnitError, ValueOutOfBoundsError, and exceptions of the
    mechanism.
    """
    module, file = _found(model)
    named = {name: value for name, value in parameters.items() if name in _options_of(module)}
    numbers = {name: value for name, value in parameters.items() if name not in named}
    if reduce is not None:
        named[REDUCE] = reduce
    for name in named.keys() & (options or {}).keys():
        raise ValueOutOfBoundsError(f"option {name} is given twice; give it once")
    chosen = chosen_case(module, file, None if case is None else str(case), numbers, required=False)
    return model_of(Setup.checked(module, chosen, {**(options or {}), **named}))


def setup_of(
    model: str,
    case: str | None,
    cases: str | None,
    options: Mapping[str, Any],
    parameters: Mapping[str, float | str],
    otherwise: Mapping[str, float | str] = MappingProxyType({}),
) -> Setup:
    """What the model is made from: its generated module, the case and the options; `cases` is another case
    file to use, `otherwise` has numbers for parameters that are given nowhere else. Raises as `load` does."""
    module, chosen = _chosen(model, case, cases, parameters, otherwise)
    return Setup.checked(module, chosen, options)


def model_of(setup: Setup) -> Model:
    """The model of the setup, of the kind that its module states."""
    if kind_of(setup.module) == EQUATIONS:
        return Model.of(setup) if setup.module.COORDINATES else RigidModel.of(setup)
    from solve.beams.reduced_structure import ReducedStructure
    from solve.beams.structure import StructureModel

    return (ReducedStructure if REDUCE in setup.options else StructureModel).of(setup)


def _found(model: str | Derivable | Callable[[], Derivable]) -> tuple[ModuleType, Path | None]:
    """The generated module of a model, and its case file if it has one."""
    if isinstance(model, str):
        files = model_files(model)
        return model_module(files.generated), files.cases
    stated: Any = model if hasattr(model, "code") or not callable(model) else model()
    if not hasattr(stated, "code"):
        raise ModelFileError(
            f"a model is given as {type(stated).__name__}; give a name, the path of a mechanism file, a "
            "derive.Mechanism, or a function that returns one"
        )
    return module_of(stated.code()), None


def _options_of(module: ModuleType) -> set[str]:
    kinds = ("OPTIONS", "LINK_OPTIONS", "MOTION_OPTIONS")
    return {name for kind in kinds for name, *_ in getattr(module, kind, ())}


def case_numbers(
    model: str,
    case: str | None = None,
    cases: str | None = None,
    parameters: Mapping[str, float | str] | None = None,
) -> Case:
    """The numbers of a model's case in SI units, each within its bounds, some of them replaced; whether they
    fit together is not looked at. Raises as `load` does."""
    module, chosen = _chosen(model, case, cases, parameters or {})
    return replace(chosen, parameters=checked_parameters(module, chosen.parameters))


def missing_parameters(
    model: str, case: str | None, cases: str | None, parameters: Mapping[str, float | str]
) -> list[str]:
    """Parameters of a model to which neither its case nor `parameters` gives a value. Raises as `load`
    does."""
    unset = dict.fromkeys(parameter_units(model), math.nan)
    _, chosen = _chosen(model, case, cases, parameters, unset)
    return [name for name in unset if chosen.parameters[name] is math.nan]


def parameter_units(model: str) -> dict[str, str]:
    """Units of the parameters that a model declares. Raises as `load` does."""
    module, _ = _found(model)
    return {name: unit for name, unit, *_ in module.PARAMETERS}


def _chosen(
    model: str,
    case: str | None,
    cases: str | None,
    parameters: Mapping[str, float | str],
    otherwise: Mapping[str, float | str] = MappingProxyType({}),
) -> tuple[ModuleType, Case]:
    """The generated module of a model, and the case with its numbers."""
    module, file = _found(model)
    if cases:
        file = Path(cases)
    return module, chosen_case(module, file, case, parameters, cases is not None, otherwise)
