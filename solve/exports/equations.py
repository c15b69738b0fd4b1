"""A model whose equations are formulas of phase, speed, states and parameters, which other tools can take."""

import re
from typing import NamedTuple

from solve.errors import LinearModelError
from solve.model.model import Model, ModelAlong
from solve.system import PeriodicSystem


class Quantity(NamedTuple):
    """A parameter, coordinate or output, with unit and meaning."""

    name: str
    unit: str
    meaning: str


def require_formulas(system: PeriodicSystem, what: str) -> Model:
    """The system as a model with formulas. Raises NoMotionError, LinearModelError."""
    system.require_motion()
    along = isinstance(system, ModelAlong)
    if not isinstance(system, Model) or along or system.assembled or not system.nonlinear:
        raise LinearModelError(
            f"{what} takes the formulas of a mechanism; the matrices of {system.name} are numbers at each "
            "phase: write them to a .mat file"
        )
    return system


def parameters_of(model: Model) -> list[Quantity]:
    """In the order of p."""
    return [Quantity(name, *model.parameter_labels[name]) for name in model.parameters]


def quantities_of(model: Model, names: tuple[str, ...]) -> list[Quantity]:
    """Coordinates or outputs of these names."""
    return [Quantity(name, model.units.get(name, ""), model.meanings.get(name, "")) for name in names]


def identifier(model: Model) -> str:
    """The model's name as one of C."""
    name = re.sub(r"\W", "_", model.name, flags=re.ASCII)
    return name if name[:1].isalpha() else f"model_{name}"
