"""Mechanism without coordinates: nothing vibrates, and its outputs follow from the phase and the speed."""

from typing import Any, Self

import numpy as np

from solve.arrays import Array
from solve.contracts import Matrices
from solve.errors import NoVibrationError
from solve.model.model import Model
from solve.model.setup import Setup


class RigidModel(Model):
    """Model whose entire motion is prescribed."""

    vibrates = False

    @classmethod
    def of(cls, setup: Setup) -> Self:
        return cls(setup, _no_matrices, ())

    @property
    def assembled(self) -> bool:
        return False

    def many_points(self, names: Any) -> None:
        return None

    def checked(self, speed: float) -> None:
        self.shown_in(speed).require_desired_motion(np.array([speed]))

    def require_motion(self) -> None:
        raise NoVibrationError(
            f"{self.name} has no coordinates, so nothing vibrates; periodic, sweep and animate give its "
            "outputs over a revolution"
        )


def _no_matrices(phase: Array, speed: float) -> Matrices:
    none = np.zeros((len(phase), 0, 0))
    return none, none, none, np.zeros((len(phase), 0))
