"""From the name of a model or the path of its mechanism to a periodic system."""

from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

from solve.beams.structure import StructureModel
from solve.model.bounds import checked_parameters
from solve.model.cases import Case, chosen_case
from solve.model.files import model_files
from solve.model.generated import EQUATIONS, STRUCTURE, kind_of, model_module
from solve.model.model import Model
from solve.model.setup import Setup

_MODELS = {EQUATIONS: Model, STRUCTURE: StructureModel}


def load(
    model: str,
    case: str | int | None = None,
    options: Mapping[str, Any] | None = None,
    **parameters: float | str,
) -> Model:
    """The system of a model (a name, or the path of a mechanism file) and a case.

    Parameters override the case's values, in SI units as the model declares them or as texts with unit such
    as "30 mm". The first case is the default. Raises UnknownNameError, ModelFileError (no or stale generated
    code), CaseFileError, MissingValueError, UnitError and ValueOutOfBoundsError.
    """
    return model_of(setup_of(model, None if case is None else str(case), None, options or {}, parameters))


def setup_of(
    model: str,
    case: str | None,
    cases: str | None,
    options: Mapping[str, Any],
    parameters: Mapping[str, float | str],
) -> Setup:
    """What the model is made from: its generated module, the case and the options; `cases` is another case
    file to use. Raises as `load` does."""
    module, chosen = _chosen(model, case, cases, parameters)
    return Setup.checked(module, chosen, options)


def model_of(setup: Setup) -> Model:
    """The model of the setup, of the kind that its module states."""
    return _MODELS[kind_of(setup.module)].of(setup)


def case_numbers(
    model: str,
    case: str | None = None,
    cases: str | None = None,
    parameters: Mapping[str, float | str] | None = None,
) -> Case:
    """The numbers of a model's case in SI units, each within its bounds, some of them replaced; whether they
    fit together is not looked at. Raises as `load` does."""
    module, chosen = _chosen(model, case, cases, parameters or {})
    return Case(chosen.name, chosen.speed, checked_parameters(module, chosen.parameters))


def _chosen(
    model: str, case: str | None, cases: str | None, parameters: Mapping[str, float | str]
) -> tuple[ModuleType, Case]:
    """The generated module of a model, and the case with its numbers."""
    files = model_files(model)
    module = model_module(files.generated)
    file = Path(cases) if cases else files.cases
    return module, chosen_case(module, file, case, parameters, required=cases is not None)
