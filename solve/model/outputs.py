"""Outputs of a model, from the functions of its generated module."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from solve.arrays import Array
from solve.capabilities import Outputs
from solve.contracts import Formulas
from solve.model.setup import Setup

if TYPE_CHECKING:
    import casadi


class ModelOutputs(Outputs):
    """Outputs of a model as functions of phase, speed and state."""

    def __init__(self, setup: Setup):
        self._setup = setup
        self._names = tuple(name for name, *_ in setup.module.OUTPUTS)
        self._formulas: dict[tuple[str, ...], Formulas | None] = {}

    @cached_property
    def _values(self) -> "casadi.Function":
        return self._setup.function("outputs")

    @cached_property
    def _values_varying(self) -> "casadi.Function":
        return self._setup.function("outputs_varying")

    def output_values(
        self, phase: Array, speed: Array | float, q: Array, qd: Array, qdd: Array, acceleration: float = 0.0
    ) -> Mapping[str, Array]:
        drive, state = (phase[None], np.atleast_2d(speed)), (q, qd, qdd, self._setup.p)
        if acceleration == 0:
            values = self._values.call([*drive, *state])
        else:
            values = self._values_varying.call([*drive, acceleration, *state])
        return {name: value.full()[0] for name, value in zip(self._names, values, strict=True)}

    def output_formulas(self, varied: Sequence[str] = ()) -> Formulas | None:
        names = tuple(sorted(varied))
        if names not in self._formulas:
            generated = hasattr(self._setup.module, "outputs")
            self._formulas[names] = self._setup.formulas("outputs", names) if generated else None
        return self._formulas[names]
