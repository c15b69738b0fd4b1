"""A structure of beams from a generated module: a model whose matrices are assembled, not printed."""

from collections.abc import Callable, Sequence

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
            module.LINKS,
            module.JOINTS,
            self._of_each_link("element"),
            list(map(int, self._of_each_link("elements"))),
        )
        self._properties = module.properties(**self._own_options)
        self.beams = Beams(chosen, self._numbers(), self._angle)
        if module.MOVES:
            self.at_positions(np.linspace(0.0, module.PERIOD, 36, endpoint=False))
        return self._no_motion, [(name, "", "") for name in chosen.names]

    def at_positions(self, phase: Array) -> Positions:
        """The structure frozen at phases (m,)."""
        return Positions(self.beams, phase)

    def pinned_frequencies(self) -> dict[str, float]:
        """Lowest bending frequency (rad/s) of each link by itself, pinned at both ends: (π/L)² √(EI/µ)."""
        p = self.beams.properties
        alone = (np.pi / p.length) ** 2 * np.sqrt(p.EI / p.mu)
        return dict(zip((link.name for link in self.beams.freedoms.links), alone.tolist(), strict=True))

    def _of_each_link(self, option: str) -> list[str]:
        parts = str(self.options[option]).split(",")
        return parts if len(parts) > 1 else parts * len(self.module.LINKS)

    def _numbers(self) -> Properties:
        values = self._properties.call({"phase": 0.0, "p": self._p})
        columns = {name: value.full().ravel() for name, value in values.items() if name != "angle"}
        return Properties(**{**columns, "damping_ratio": float(columns["damping_ratio"][0])})

    def _angle(self, phase: Array) -> Array:
        return self._properties(phase=phase[None], p=self._p)["angle"].full().T

    def require_motion(self) -> None:
        raise NoMotionError(
            f"{self.name} is a structure of which only the frequencies are known; "
            f"run: python -m solve frequencies {self.name}"
        )

    def _no_motion(self, phase: Array, speed: float) -> Sequence[Array]:
        self.require_motion()
        return ()
