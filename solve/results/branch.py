"""A branch of nonlinear orbits over the speed."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby, pairwise
from typing import Any, ClassVar

import numpy as np

from solve.arrays import Array
from solve.period.multipliers import SURE, UNIT_CIRCLE, VERDICTS
from solve.results.contents import Column, Columns
from solve.results.plot import MOST_SHOWN, label_quantity, label_speeds, title_of
from solve.results.quantities import headed, prefixed
from solve.results.report import RenderableType, digits, speeds_of, table_of, text
from solve.results.result import Result
from solve.results.style import BLACK, BLUE, GREY, VERMILION, Axes, Figure, page
from solve.system import PeriodicSystem

_MOST_ROWS = 40
"""Of the table; of more points every k-th is shown."""

_NARROW = 1e-3
"""Range of the speeds, by the largest, below which seven digits hardly tell them apart."""

STABLE, _, UNSTABLE, UNDETERMINED = VERDICTS
_SHORT = {STABLE: "stable", UNSTABLE: "unstable", UNDETERMINED: "open"}
_YES = {True: "yes", False: ""}
_LINES = {STABLE: (BLUE, "-"), UNSTABLE: (VERMILION, "--"), UNDETERMINED: (GREY, "-")}


@dataclass(frozen=True)
class Branch(Result):
    """Points (P,) along a branch.

    speeds: in rad/s. peaks (P, n): largest moduli of the coordinates. radius: spectral radii. errors (P, 2):
    relative ones of the orbits, and those of the radii. turns: whether the branch turns back there. rtol:
    what was asked of the orbits. ended: why the branch ends within the range of speeds, or an empty text.
    notes: what the engine has to say.
    """

    _rows: ClassVar[str] = "points"

    system: PeriodicSystem
    speeds: Array
    peaks: Array
    radius: Array
    errors: Array
    turns: Array
    rtol: float
    ended: str
    notes: Sequence[str] = ()

    @property
    def turning(self) -> Array:
        """Speeds in rad/s at which the branch turns back, in its order."""
        return self.speeds[self.turns.astype(bool)]

    @property
    def verdicts(self) -> list[str]:
        """Of each point: "asymptotically stable", "unstable", or "undetermined" where the error of the
        radius leaves it open; with the margins of `solve.period.multipliers.verdicts`."""
        errors = self.errors[:, 1]
        beyond = np.where(self.radius - SURE * errors > 1 + UNIT_CIRCLE, UNSTABLE, UNDETERMINED)
        return np.where(self.radius + errors < 1 - UNIT_CIRCLE, STABLE, beyond).tolist()

    @cached_property
    def warnings(self) -> list[str]:
        """What is doubtful about this result, a sentence each."""
        found, worst = [*self.notes, *filter(None, [self.ended])], float(self.errors[:, 0].max())
        found += self.system.warnings(float(self.speeds.max()), linear=False)
        if worst > self.rtol:
            found.append(
                f"orbits are off by up to {worst:.1e} of themselves, beyond the {self.rtol:g} asked for"
            )
        return found

    @property
    def whole(self) -> dict[str, Any]:
        return {"turning": self.turning, "rtol": self.rtol}

    @property
    def _digits(self) -> str:
        """Of speeds that lie close together, enough to tell them apart."""
        return ".7g" if np.ptp(self.speeds) > _NARROW * self.speeds.max() else ".10g"

    @property
    def columns(self) -> Columns:
        """A row a point."""
        found = {"speed": speeds_of(self.system, self.speeds, heading="{}", form=self._digits)}
        for at, (name, values) in enumerate(zip(self.system.coordinates, self.peaks.T, strict=True)):
            unit, meaning = self.system.units.get(name, ""), f"largest modulus of {name}"
            factor, shown = prefixed(unit, float(values.max()))
            title = headed(f"max|{name}|", shown) if at < MOST_SHOWN - 1 else ""
            found[f"{name}_max_abs"] = Column(values, unit, meaning, title, digits(".5g", factor))
        meaning, back = "error of the orbit, relative, estimated", self.turns.astype(bool)
        return {
            **found,
            "spectral_radius": Column(self.radius, "1", "spectral radius", "radius", digits(".5g")),
            "verdict": Column(np.array(self.verdicts), "", "stability", "verdict", _SHORT.__getitem__),
            "turns": Column(back, "", "whether the branch turns back", "turns", _YES.__getitem__),
            "error": Column(self.errors[:, 0], "1", meaning),
            "radius_error": Column(self.errors[:, 1], "1", "error of the spectral radius, estimated"),
        }

    @property
    def summary(self) -> str:
        """Where it goes and turns back."""
        unit = self.system.speed_unit
        ends = unit.span(self.speeds[0], self.speeds[-1])
        back = ", ".join(unit.text(each, ".6g") for each in self.turning)
        return f"The branch goes from {ends}" + (f" and turns back at {back}." if back else ".")

    def tables(self) -> Sequence[RenderableType]:
        made = table_of("Orbits along the branch", self.columns, most=_MOST_ROWS)
        return [made, text("\n" + self.summary)]

    def plot(self) -> Figure:
        """Largest moduli and the spectral radius over speed, where the branch is unstable dashed (matplotlib
        Figure)."""
        names = self.system.coordinates[: MOST_SHOWN - 1]
        title = f"{title_of(self.system)}: branch of nonlinear orbits"
        with page(1.4 + 1.5 * (len(names) + 1), title) as figure:
            axes = figure.subplots(len(names) + 1, 1, sharex=True, squeeze=False)[:, 0]
            for place, name, values in zip(axes, names, self.peaks.T, strict=False):
                self._draw(place, label_quantity(place, self.system, name, values, "max_abs") * values)
            axes[-1].axhline(1.0, color=BLACK, linewidth=0.9)
            axes[-1].set_yscale("log")
            axes[-1].set_ylabel("spectral\nradius |ρ|")
            self._draw(axes[-1], self.radius)
            label_speeds(axes[-1], self.system, np.sort(self.speeds))
            axes[0].legend(loc="best")
            figure.align_ylabels(axes)
        return figure

    def _draw(self, axes: Axes, values: Array) -> None:
        """Pieces of one verdict after another, and the turning points."""
        speeds, back, first = self.system.speed_unit.of(self.speeds), self.turns.astype(bool), 0
        named: set[str] = set()
        for verdict, pieces in groupby(self._between):
            last = first + len([*pieces])
            color, line = _LINES[verdict]
            style = {"color": color, "linestyle": line, "marker": ".", "markersize": 4}
            style["label"] = None if verdict in named else verdict
            axes.plot(speeds[first : last + 1], values[first : last + 1], **style)
            named.add(verdict)
            first = last
        if back.any():
            axes.plot(
                speeds[back],
                values[back],
                "o",
                color=BLACK,
                markersize=4.5,
                label="turns back",
                clip_on=False,
            )

    @property
    def _between(self) -> list[str]:
        """Verdicts between one point and the next: open where theirs differ, but for points where the branch
        turns back, which are on the verge of either."""
        known = [None if turns else verdict for turns, verdict in zip(self.turns, self.verdicts, strict=True)]
        both = ({each for each in pair if each is not None} for pair in pairwise(known))
        return [each.pop() if len(each) == 1 else UNDETERMINED for each in both]
