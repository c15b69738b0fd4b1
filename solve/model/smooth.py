"""The parameters by which a model has derivatives, and how far its breaks move with them."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from solve.arrays import Array
from solve.differences import slope
from solve.errors import NoDerivativeError, ValueOutOfBoundsError, require_name
from solve.labels import SPEED
from solve.model.bounds import clauses
from solve.model.setup import Setup, followed

_NUDGE = 1e-2
"""Part of a parameter by which it is changed to see how far it moves the breaks."""


class SmoothParameters:
    """Those of a setup. assembled: whether no formulas give its matrices, so that these are differenced."""

    def __init__(self, setup: Setup, assembled: bool):
        self._setup, self._assembled = setup, assembled
        self._moved: dict[str, Array | None] = {}

    @cached_property
    def names(self) -> tuple[str, ...]:
        whole = {name for name, _, _, bound in self._setup.module.PARAMETERS if "integer" in clauses(bound)}
        return tuple(
            name
            for name, value in self._setup.case.parameters.items()
            if name not in whole and (value or not self._assembled) and self._followed(name)
        )

    def require(self, names: Sequence[str]) -> None:
        """Raise UnknownNameError or NoDerivativeError unless there are derivatives by parameters, or
        "speed", of these names."""
        parameters, smooth = self._setup.case.parameters, {SPEED, *self.names}
        for name in names:
            require_name(f"quantity of {self._setup.module.NAME}", name, [SPEED, *parameters])
            if self._assembled and parameters.get(name) == 0:
                raise NoDerivativeError(
                    f"{name} is 0; matrices that are assembled, or damped by modes, are differentiated by "
                    f"small parts of a parameter: give a small number, such as --set {name}=1e-6"
                )
            if name not in smooth:
                raise NoDerivativeError(
                    f"{name} is a whole number, or moves a jump that meets another, or a jump beside damping "
                    "ratios: derivatives by it are not calculated; leave it out"
                )

    def break_slopes(self, names: Sequence[str]) -> Array:
        """Derivatives (b, r) of the phases of the breaks by parameters, or the speed."""
        still = np.zeros(len(self._setup.breaks))
        moved = [None if name == SPEED else self._break_slopes(name) for name in names]
        return np.array([still if each is None else each for each in moved]).reshape(len(names), -1).T

    def _followed(self, name: str) -> bool:
        """Whether it is known how far breaks move with a parameter, and what follows from that."""
        moved = self._break_slopes(name)
        return moved is not None and not (self._assembled and moved.any())

    def _break_slopes(self, name: str) -> Array | None:
        """Derivatives (b,) of the phases of the breaks by a parameter; None where some meet or part."""
        if name not in self._moved:
            self._moved[name] = self._differenced(name)
        return self._moved[name]

    def _differenced(self, name: str) -> Array | None:
        setup, breaks = self._setup, np.array(self._setup.breaks)
        if not setup.moves_breaks:
            return np.zeros(len(breaks))
        at, p, of = setup.case.parameters[name], setup.p, list(setup.case.parameters).index(name)

        def moved(value: float) -> Array:
            changed = np.where(np.arange(len(p)) == of, value, p)
            return followed(breaks, np.array(setup.breaks_with(changed)), setup.module.PERIOD)

        try:
            return slope(moved, at, _NUDGE * (abs(at) or 1.0))
        except ValueOutOfBoundsError:
            return None
