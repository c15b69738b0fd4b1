"""Outputs of a mechanism without coordinates over a revolution, as an orbit without vibration."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from solve.arrays import Array
from solve.contracts import Statistics
from solve.errors import NoVibrationError
from solve.period.floquet_modes import FloquetMode
from solve.period.quantities import LEAST_SAMPLES
from solve.results.contents import Facts
from solve.results.orbit import Orbit
from solve.results.stability import ErrorEstimate
from solve.results.turn import QuasiStatic, Turn
from solve.system import PeriodicSystem

_STEPS = 256
"""Steps per revolution between the nodes that files contain; statistics are those of the continuous curve."""

_ROUNDING = 1e-14
"""Relative error of an output: about a hundred operations, each accurate to 1e-16."""


@dataclass(frozen=True)
class RigidOrbit(Orbit):
    """Prescribed motion at a speed in rad/s, without coordinates, multipliers, exponents and verdict."""

    _calculated: ClassVar[tuple[str, ...]] = ("outputs", "output_statistics", "output_samples", "warnings")

    @classmethod
    def of(cls, system: PeriodicSystem, speed: float) -> "RigidOrbit":
        """Prescribed motion at a speed. Raises DesiredMotionError if it does not exist."""
        system.checked(speed)
        nothing: Any = None
        return cls(system, speed, nothing, nothing)

    method = described = "prescribed motion"  # type: ignore[assignment]
    steps = _STEPS  # type: ignore[assignment]
    samples = LEAST_SAMPLES  # type: ignore[assignment]
    verdict = ""  # type: ignore[assignment]
    stable = None  # type: ignore[assignment]
    spectral_radius = distance_from_one = condition = liouville = np.nan  # type: ignore[assignment]
    error_estimate = ErrorEstimate(_ROUNDING, np.nan)  # type: ignore[assignment]
    residual = 0.0  # type: ignore[assignment]
    linearisation_error = reduction_error = None  # type: ignore[assignment]
    rigid_body_modes = ()  # type: ignore[assignment]
    unresolved = 0  # type: ignore[assignment]

    @property
    def multipliers(self) -> Array:  # type: ignore[override]
        return np.zeros(0, dtype=complex)

    @property
    def exponents(self) -> Array:  # type: ignore[override]
        return np.zeros(0, dtype=complex)

    @property
    def multiplier_errors(self) -> Array:  # type: ignore[override]
        return np.zeros(0)

    @property
    def modes(self) -> Sequence[FloquetMode]:  # type: ignore[override]
        return ()

    @property
    def notes(self) -> list[str]:  # type: ignore[override]
        return []

    @property
    def phase(self) -> Array:
        return np.linspace(0.0, self.system.period, _STEPS + 1)

    def state(self, phase: Array) -> tuple[Array, Array, Array]:
        none = np.zeros((0, len(phase)))
        return none, none, none

    def at(self, phase: Array) -> Array:
        return self.state(np.atleast_1d(phase))[0]

    def statistics(self, name: str) -> Statistics:
        return Turn.statistics(self, name) if self.system.solvable else self.output_statistics[name]

    @property
    def _output_figures(self) -> Array:
        return super(Orbit, self)._output_figures

    @property
    def quasi_static(self) -> QuasiStatic:
        raise NoVibrationError(f"{self.system.name} has no coordinates; omit the quasi-static solution")

    @cached_property
    def warnings(self) -> list[str]:
        system = self.system
        figures = {
            name: self.statistics(name) for name in sorted({*system.judged_quantities, *system.outputs})
        }
        return [*system.warnings(self.speed), *system.judged(figures), *self._not_periodic]

    @property
    def summary(self) -> str:
        return f"At {self.system.speed_unit.text(self.speed)} the motion is prescribed: nothing vibrates."

    @property
    def whole(self) -> dict[str, Any]:
        return {**super().whole, "verdict": None}

    def facts(self) -> Facts:
        return [("motion", "prescribed: without coordinates nothing vibrates")]
