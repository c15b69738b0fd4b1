"""Results of one periodic solution of the elastic four-bar."""

from dataclasses import dataclass
from typing import Any

from solve.results.orbit import Orbit
from solve.results.result import Result
from solve.results.serialization import stored_property
from solve.system import PeriodicSystem


@dataclass(frozen=True)
class AtOneSpeed(Result):
    """Of an orbit, whose speed, accuracy and warnings it has."""

    orbit: Orbit

    @property
    def system(self) -> PeriodicSystem:  # type: ignore[override]
        return self.orbit.system

    @stored_property
    def warnings(self) -> list[str]:
        return self.orbit.warnings

    @property
    def summary_values(self) -> dict[str, Any]:
        names = "speed", "method", "steps", "error_estimate"
        return {name: getattr(self.orbit, name) for name in names}
