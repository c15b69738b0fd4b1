"""Flags shared by the commands for the elastic four-bar linkage, and the base class of results at one
speed."""

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from solve.beams.structure import StructureModel
from solve.commands.groups import Flag, Numbers
from solve.commands.parse import assignments
from solve.errors import ValueOutOfBoundsError
from solve.labels import require_motion
from solve.results.orbit import Orbit
from solve.results.result import Result
from solve.results.serialization import stored_property
from solve.system import PeriodicSystem

SpeedText = Annotated[str, Flag("Speed with unit: rpm, rad/s or Hz.", '"30 rad/s"')]
Tolerance = Annotated[float, Flag("Relative error of the solution.", "R")]
EachTolerance = Annotated[float, Flag("Relative error of each solution.", "R")]


@dataclass(frozen=True)
class FourBar(Numbers):
    """Flags that select the case, the parameters and the options of the four-bar linkage."""

    # These studies require all coordinates of the beams, so that --reduce is not available.
    reduce: ClassVar[None] = None  # type: ignore[misc]

    def loaded(self, *replaced: str) -> StructureModel:
        """Return the model of the four-bar linkage with these flags. `replaced` are options that the flags
        must not contain, because the command selects their values. Raises SolveError subclasses for bad
        input."""
        for name in assignments("--option", self.option or []):
            if name in ("reduce", *replaced):
                raise ValueOutOfBoundsError(f"--option {name} has no effect on this command; omit it")
        model = StructureModel.from_setup(self.setup("four_bar"))
        require_motion(model)
        return model


@dataclass(frozen=True)
class AtOneSpeed(Result):
    """Base class of results derived from one orbit, with its speed, accuracy and warnings."""

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
