"""A structure of beams from a generated module: a model whose matrices are assembled, not printed."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.errors import NoMotionError
from solve.load import Model
from solve.structure.beams import Beams, Properties
from solve.structure.freedoms import freedoms
from solve.structure.positions import Positions


class StructureModel(Model):
    """Links and joints of a generated module, with the elements that the options choose.

    Raises StructureError where the links cannot be assembled all the way round.
    """

    beams: Beams

    def _equations(self) -> tuple[Callable[[Array, float], Sequence[Array]], Sequence[tuple[str, str, str]]]:
        module = self.module
        chosen = freedoms(
            module.LINKS, module.JOINTS, self._of_each_link("element"), self._of_each_link("elements")
        )
        self._properties = module.properties(**self._own_options)
        self.beams = Beams(chosen, self._numbers(), self._angle)
        if module.MOVES:
            self.at_positions(np.linspace(0.0, module.PERIOD, 36, endpoint=False))
        return self._no_motion, [(name, "", "") for name in chosen.names]

    def at_positions(self, phase: Array) -> Positions:
        """The structure frozen at phases (m,)."""
        return Positions(self.beams, phase)

    def _of_each_link(self, option: str) -> tuple[Any, ...]:
        value = self.options[option]
        return value if isinstance(value, tuple) else (value,) * len(self.module.LINKS)

    def _numbers(self) -> Properties:
        values = self._properties.call({"phase": 0.0, "p": self._p})
        columns = {name: value.full().ravel() for name, value in values.items() if name != "angle"}
        return Properties(**{**columns, "damping_ratio": float(columns["damping_ratio"][0])})

    def _angle(self, phase: Array) -> Array:
        return self._properties(phase=phase[None], p=self._p)["angle"].full().T

    def _no_motion(self, phase: Array, speed: float) -> Sequence[Array]:
        raise NoMotionError(
            f"{self.name} is a structure: only its frequencies are known; run: solve frequencies {self.name}"
        )
