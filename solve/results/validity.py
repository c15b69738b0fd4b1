"""How far the linear orbit is from the nonlinear one over speed."""

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
    """At speeds (P,) in rad/s, rising, the linearisation error (P, n) of each coordinate, relative, NaN
    where there is none; allowed: the error up to which the linear model is trusted; failures: why a speed
    has none, by position."""

    system: PeriodicSystem
    speeds: Array
    errors: Array
    allowed: float
    failures: Mapping[int, str]

    @property
    def trusted_to(self) -> float | None:
        """The last of the speeds, from the slowest on, up to which no coordinate is off by more than is
        allowed; None where the slowest is."""
        within = [*(row.max() <= self.allowed for row in self.errors), False]
        count = within.index(False)
        return float(self.speeds[count - 1]) if count else None

    @stored_property
    def warnings(self) -> list[str]:
        """Reasons why speeds have no result, one sentence per reason."""
        unit, speeds = self.system.speed_unit, dict[str, list[float]]()
        for at, reason in self.failures.items():
            speeds.setdefault(reason, []).append(float(self.speeds[at]))
        return [
            f"no result {unit.spans((each, each) for each in at)}: {reason}" for reason, at in speeds.items()
        ]

    def require_any(self) -> None:
        """Raise NoResultError where no speed has a result."""
        if len(self.failures) == len(self.speeds):
            reason = next(iter(self.failures.values()))
            raise NoResultError(f"none of the {len(self.speeds)} speeds has a result: {reason}")

    @property
    def summary_values(self) -> dict[str, Any]:
        return {"at": self.allowed, "trusted_to": self.trusted_to}

    @property
    def columns(self) -> Columns:
        """A row a speed."""
        columns = {"speed": speeds_of(self.system, self.speeds, heading="{}", axes=("speed",))}
        for at, (name, row) in enumerate(zip(self.system.coordinates, self.errors.T, strict=True)):
            meaning = f"error of the linear orbit in {name}, relative"
            heading = name if at < MOST_SHOWN else ""
            columns[f"{name}_error"] = Column(row, "1", meaning, heading, digits(".3g", 100), ("speed",))
        return columns

    def record(self) -> dict[str, Any]:
        """Of `solve validity --json`."""
        names = self.system.coordinates
        points = [
            {"speed": speed, "error": self.failures[at]}
            if at in self.failures
            else {"speed": speed, "linearisation_error": dict(zip(names, row, strict=True))}
            for at, (speed, row) in enumerate(zip(self.speeds, self.errors, strict=True))
        ]
        return {**super().record(), "points": to_json(points)}

    @property
    def limit(self) -> str:
        """Up to which speed it is to be trusted."""
        limit, upto = f"more than {100 * self.allowed:g} %", self.trusted_to
        if upto is None:
            return f"off by {limit} from the slowest of these speeds on"
        return f"no coordinate is off by {limit} up to {self.system.speed_unit.text(upto)}"

    @property
    def summary(self) -> str:
        """Up to which speed the linear model is to be trusted."""
        return f"The linear equations against the nonlinear ones: {self.limit}."
