"""Branch of nonlinear orbits over the speed or a parameter."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from solve.arrays import Array
from solve.contracts import Statistics
from solve.labels import SPEED
from solve.period.multipliers import SURE, UNIT_CIRCLE, VERDICTS
from solve.period.quantities import FIGURES
from solve.results.contents import MOST_SHOWN, Column, Columns, digits, require_different_names, speeds_of
from solve.results.quantities import headed, prefixed
from solve.results.result import Result
from solve.system import PeriodicSystem

_NARROW = 1e-3
"""Range of the values, relative to the largest, below which seven digits do not distinguish them."""

_SHOWN = "max", "min", "max_abs", "mean", "rms"
_MAX_ABS = FIGURES.index("max_abs")

STABLE, _, UNSTABLE, UNDETERMINED = VERDICTS
_SHORT = {STABLE: "stable", UNSTABLE: "unstable", UNDETERMINED: "open"}
_YES = {True: "yes", False: ""}


@dataclass(frozen=True)
class Branch(Result):
    """Orbits (P,) along a branch. speeds (P,) in rad/s. figures (P, q, 7): the fields of
    `solve.contracts.Statistics` of the continuous curve, for each coordinate and then each output.
    figure_errors (P, q): estimated errors of the extrema, relative to the largest modulus, or to the scale of
    a coordinate on which the forces cancel. radius (P,): spectral radii. errors (P, 2): estimated relative
    errors of the orbits and absolute errors of the spectral radii. turns (P,): whether the orbit is a turning
    point. repeats (P,): whether an orbit of several periods repeats after one. rtol: tolerance of the orbits.
    ended: reason why the branch ends within its range, otherwise empty. notes: of the engine. periods: number
    of model periods per period of the orbits. parameters: values (P,) by name of the parameter that varies
    instead of the speed."""

    _rows: ClassVar[str] = "points"

    system: PeriodicSystem
    speeds: Array
    figures: Array
    figure_errors: Array
    radius: Array
    errors: Array
    turns: Array
    repeats: Array
    rtol: float
    ended: str
    notes: Sequence[str] = ()
    periods: int = 1
    parameters: Mapping[str, Array] = field(default_factory=dict)

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names (q,) of the coordinates and outputs."""
        return *self.system.coordinates, *self.system.outputs

    @property
    def peaks(self) -> Array:
        """Largest moduli (P, n) of the coordinates."""
        return self.figures[:, : self.system.n, _MAX_ABS]

    @property
    def over(self) -> str:
        """Name of the continuation parameter: "speed", or a parameter."""
        return next(iter(self.parameters), SPEED)

    @property
    def values(self) -> Array:
        """Values (P,) of the continuation parameter; speeds in rad/s."""
        return self.parameters.get(self.over, self.speeds)

    @property
    def turning(self) -> Array:
        """Values of the continuation parameter at turning points, in the order of the branch."""
        return self.values[self.turns.astype(bool)]

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
            found.append(f"relative errors of the orbits are up to {worst:.1e}, above rtol {self.rtol:g}")
        if self.repeats.any():
            found.append(
                f"orbits of {self.periods} periods repeat after one period{self._where(self.repeats)}; "
                "use another start to find orbits of longer period"
            )
        return found + self._beyond_limits

    @property
    def _beyond_limits(self) -> list[str]:
        """Violated limits of the model, one sentence each, with the first violation."""
        found = []
        for limit in self.system.limits(self.quantities, linear=False):
            figures = self.figures[:, self.quantities.index(limit.quantity)]
            left = np.asarray(limit.exceeded(Statistics(*figures.T)))
            if left.any():
                first = Statistics(*figures[int(left.argmax())].tolist())
                found.append(f"{limit.message(first)}{self._where(left)}")
        return found

    def _where(self, which: Array) -> str:
        """Text that locates points (P,)."""
        first = self.system.unit_of(self.over).text(float(self.values[int(which.argmax())]), self._digits)
        return f" (at {first}; {int(which.sum())} of {len(which)} points)"

    @property
    def whole(self) -> dict[str, Any]:
        return {"turning": self.turning, "rtol": self.rtol, "periods": self.periods}

    @property
    def _digits(self) -> str:
        """Number format that distinguishes neighbouring values."""
        return ".7g" if np.ptp(self.values) > _NARROW * np.abs(self.values).max() else ".10g"

    @property
    def columns(self) -> Columns:
        """A row a point."""
        system, back = self.system, self.turns.astype(bool)
        found = [("speed", speeds_of(system, self.speeds, heading="{}", form=self._digits))]
        found += [
            (name, Column(values, *system.parameter_labels[name], name, digits(".7g")))
            for name, values in self.parameters.items()
        ]
        for at, name in enumerate(self.quantities):
            found += self._columns_of(name, at)
        meaning = "estimated error of the spectral radius"
        found += [
            ("spectral_radius", Column(self.radius, "1", "spectral radius", "radius", digits(".5g"))),
            ("verdict", Column(np.array(self.verdicts), "", "stability", "verdict", _SHORT.__getitem__)),
            ("turns", Column(back, "", "whether the branch turns back", "turns", _YES.__getitem__)),
            ("error", Column(self.errors[:, 0], "1", "estimated relative error of the orbit")),
            ("radius_error", Column(self.errors[:, 1], "1", meaning)),
        ]
        require_different_names(found)
        return dict(found)

    def _columns_of(self, name: str, at: int) -> list[tuple[str, Column]]:
        """Columns of the statistics of a quantity; the table shows the largest moduli of the first
        coordinates."""
        unit, meaning = self.system.units.get(name, ""), self.system.meanings.get(name, name)
        values = {figure: self.figures[:, at, FIGURES.index(figure)] for figure in _SHOWN}
        factor, shown = prefixed(unit, float(np.nanmax(np.append(values["max_abs"], 0.0))))
        title = headed(f"max|{name}|", shown) if at < min(self.system.n, MOST_SHOWN - 1) else ""
        found = []
        for figure, numbers in values.items():
            heading = title if figure == "max_abs" else ""
            column = Column(numbers, unit, f"{figure} of {meaning}", heading, digits(".5g", factor))
            found.append((f"{name}_{figure}", column))
        error = f"estimated relative error of the extrema of {meaning}"
        return [*found, (f"{name}_error", Column(self.figure_errors[:, at], "1", error))]

    @property
    def summary(self) -> str:
        """Where it goes and turns back."""
        unit = self.system.unit_of(self.over)
        ends = unit.span(self.values[0], self.values[-1])
        back = ", ".join(unit.text(each, ".6g") for each in self.turning)
        return f"The branch goes from {ends}" + (f" and turns back at {back}." if back else ".")
