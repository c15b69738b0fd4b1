"""Result on the linearisation error over speed."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from solve.arrays import Array
from solve.errors import NoResultError
from solve.results.contents import MOST_SHOWN, Column, Columns, digits, speeds_of, to_json
from solve.results.result import Result
from solve.results.serialization import stored_property
from solve.system import PeriodicSystem


@dataclass(frozen=True)
class Validity(Result):
    """Linearisation error over speed, from `solve.validity`.

    Attributes
    ----------
    speeds : (P,) array
        Speeds in rad/s, ascending.
    errors : (P, n) array
        Relative linearisation error of each coordinate; NaN where the speed failed.
    allowed : float
        Error up to which the linear model is valid.
    failures : mapping of int to str
        Reasons of failures by index of the speed.
    """

    system: PeriodicSystem
    speeds: Array
    errors: Array
    allowed: float
    failures: Mapping[int, str]

    @property
    def trusted_to(self) -> float | None:
        """Highest speed (rad/s) up to which all errors are allowed; None if the errors at the lowest speed
        are not."""
        within = [*(row.max() <= self.allowed for row in self.errors), False]
        count = within.index(False)
        return float(self.speeds[count - 1]) if count else None

    @stored_property
    def warnings(self) -> list[str]:
        """Reasons why speeds have no result, one sentence per reason."""
        unit, speeds = self.system.speed_unit, dict[str, list[float]]()
        for index, reason in self.failures.items():
            speeds.setdefault(reason, []).append(float(self.speeds[index]))
        return [
            f"no result {unit.spans((speed, speed) for speed in failed)}: {reason}"
            for reason, failed in speeds.items()
        ]

    def require_any(self) -> None:
        """Raise NoResultError if no speed has a result."""
        if len(self.failures) == len(self.speeds):
            reason = next(iter(self.failures.values()))
            raise NoResultError(f"none of the {len(self.speeds)} speeds has a result: {reason}")

    @property
    def summary_values(self) -> dict[str, Any]:
        return {"at": self.allowed, "trusted_to": self.trusted_to}

    @property
    def columns(self) -> Columns:
        """Columns of the table, with one row per speed."""
        columns = {"speed": speeds_of(self.system, self.speeds, heading="{}", axes=("speed",))}
        for number, (name, row) in enumerate(zip(self.system.coordinates, self.errors.T, strict=True)):
            meaning = f"error of the linear orbit in {name}, relative"
            heading = name if number < MOST_SHOWN else ""
            columns[f"{name}_error"] = Column(row, "1", meaning, heading, digits(".3g", 100), ("speed",))
        return columns

    def record(self) -> dict[str, Any]:
        """JSON object of `solve validity --json`."""
        names = self.system.coordinates
        points = [
            {"speed": speed, "error": self.failures[index]}
            if index in self.failures
            else {"speed": speed, "linearisation_error": dict(zip(names, row, strict=True))}
            for index, (speed, row) in enumerate(zip(self.speeds, self.errors, strict=True))
        ]
        return {**super().record(), "points": to_json(points)}

    @property
    def limit(self) -> str:
        """Text on the speed up to which the linear model is valid."""
        limit, highest = f"{100 * self.allowed:g} %", self.trusted_to
        if highest is None:
            return f"errors exceed {limit} from the lowest of these speeds on"
        return f"errors of all coordinates are at most {limit} up to {self.system.speed_unit.text(highest)}"

    @property
    def summary(self) -> str:
        """Sentence on the speed up to which the linear model is valid."""
        return f"Linear equations compared with the nonlinear ones: {self.limit}."
