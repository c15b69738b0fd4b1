"""Branch of nonlinear orbits over the speed or a parameter."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from solve.arrays import Array
from solve.contracts import Statistics
from solve.labels import SPEED
from solve.period.multipliers import SURE, UNIT_CIRCLE, VERDICTS
from solve.period.quantities import FIGURES
from solve.results.contents import MOST_SHOWN, Column, Columns, digits, require_different_names, speeds_of
from solve.results.formatting import headed, prefixed
from solve.results.result import Result
from solve.results.serialization import stored_property
from solve.system import PeriodicSystem

_NARROW = 1e-3
"""Relative range of the values below which tables show ten digits, because seven do not distinguish them."""

_SHOWN = "max", "min", "max_abs", "mean", "rms"
_MAX_ABS = FIGURES.index("max_abs")

STABLE, _, UNSTABLE, UNDETERMINED = VERDICTS
_SHORT = {STABLE: "stable", UNSTABLE: "unstable", UNDETERMINED: "open"}
_YES = {True: "yes", False: ""}


@dataclass(frozen=True)
class Branch(Result):
    """Branch of P nonlinear orbits, from `solve.branch`.

    Attributes
    ----------
    speeds : (P,) array
        Speeds in rad/s.
    figures : (P, q, 7) array
        Statistics of each coordinate and output, the fields of `solve.contracts.Statistics`.
    figure_errors : (P, q) array
        Estimated errors of the extrema, relative to the largest modulus, or to the scale of a coordinate on
        which the forces cancel.
    radius : (P,) array
        Spectral radii.
    errors : (P, 2) array
        Estimated relative errors of the orbits and absolute errors of the spectral radii.
    turns, repeats : (P,) array of bool
        Whether the orbit is a turning point; whether an orbit of several periods repeats after one.
    rtol : float
        Tolerance of the orbits.
    ended : str
        Reason why the branch ends within its range, otherwise empty.
    notes : sequence of str
        Notes of the engine.
    periods : int
        Number of periods of the model per period of the orbits.
    parameters : mapping of str to (P,) array
        Values of the parameter that varies instead of the speed.
    """

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
        """Verdicts (P,), which are "undetermined" within the errors of the spectral radii, with the margins
        of `solve.period.multipliers.verdicts`."""
        errors = self.errors[:, 1]
        beyond = np.where(self.radius - SURE * errors > 1 + UNIT_CIRCLE, UNSTABLE, UNDETERMINED)
        return np.where(self.radius + errors < 1 - UNIT_CIRCLE, STABLE, beyond).tolist()

    @stored_property
    def warnings(self) -> list[str]:
        """Sentences on what is doubtful about the result."""
        sentences, worst = [*self.notes, *filter(None, [self.ended])], float(self.errors[:, 0].max())
        sentences += self.system.warnings(float(self.speeds.max()), linear=False)
        if worst > self.rtol:
            sentences.append(f"relative errors of the orbits are up to {worst:.1e}, above rtol {self.rtol:g}")
        if self.repeats.any():
            sentences.append(
                f"orbits of {self.periods} periods repeat after one period{self._where(self.repeats)}; "
                "use another start to find orbits of longer period"
            )
        return sentences + self._beyond_limits

    @property
    def _beyond_limits(self) -> list[str]:
        """Violated limits of the model, one sentence each, with the first violation."""
        sentences = []
        for limit in self.system.limits(self.quantities, linear=False):
            figures = self.figures[:, self.quantities.index(limit.quantity)]
            left = np.asarray(limit.exceeded(Statistics(*figures.T)))
            if left.any():
                first = Statistics(*figures[int(left.argmax())].tolist())
                sentences.append(f"{limit.message(first)}{self._where(left)}")
        return sentences

    def _where(self, which: Array) -> str:
        """Text that locates points (P,)."""
        first = self.system.unit_of(self.over).text(float(self.values[int(which.argmax())]), self._digits)
        return f" (at {first}; {int(which.sum())} of {len(which)} points)"

    @property
    def summary_values(self) -> dict[str, Any]:
        return {"turning": self.turning, "rtol": self.rtol, "periods": self.periods}

    @property
    def _digits(self) -> str:
        """Number format that distinguishes neighbouring values."""
        return ".7g" if np.ptp(self.values) > _NARROW * np.abs(self.values).max() else ".10g"

    @property
    def columns(self) -> Columns:
        """Row per point."""
        system, turning = self.system, self.turns.astype(bool)
        columns = [("speed", speeds_of(system, self.speeds, heading="{}", form=self._digits))]
        columns += [
            (name, Column(values, *system.parameter_labels[name], name, digits(".7g")))
            for name, values in self.parameters.items()
        ]
        for number, name in enumerate(self.quantities):
            columns += self._columns_of(name, number)
        meaning = "estimated error of the spectral radius"
        columns += [
            ("spectral_radius", Column(self.radius, "1", "spectral radius", "radius", digits(".5g"))),
            ("verdict", Column(np.array(self.verdicts), "", "stability", "verdict", _SHORT.__getitem__)),
            ("turns", Column(turning, "", "whether the branch turns back", "turns", _YES.__getitem__)),
            ("error", Column(self.errors[:, 0], "1", "estimated relative error of the orbit")),
            ("radius_error", Column(self.errors[:, 1], "1", meaning)),
        ]
        require_different_names(columns)
        return dict(columns)

    def _columns_of(self, name: str, number: int) -> list[tuple[str, Column]]:
        """Columns of the statistics of a quantity; the table shows the largest moduli of the first
        coordinates."""
        unit, meaning = self.system.units.get(name, ""), self.system.meanings.get(name, name)
        values = {figure: self.figures[:, number, FIGURES.index(figure)] for figure in _SHOWN}
        factor, shown = prefixed(unit, float(np.nanmax(np.append(values["max_abs"], 0.0))))
        title = headed(f"max|{name}|", shown) if number < min(self.system.n, MOST_SHOWN - 1) else ""
        columns = []
        for figure, numbers in values.items():
            heading = title if figure == "max_abs" else ""
            column = Column(numbers, unit, f"{figure} of {meaning}", heading, digits(".5g", factor))
            columns.append((f"{name}_{figure}", column))
        error = f"estimated relative error of the extrema of {meaning}"
        return [*columns, (f"{name}_error", Column(self.figure_errors[:, number], "1", error))]

    @property
    def summary(self) -> str:
        """Sentence on the range and the turning points."""
        unit = self.system.unit_of(self.over)
        ends = unit.span(self.values[0], self.values[-1])
        turning = ", ".join(unit.text(value, ".6g") for value in self.turning)
        return f"The branch goes from {ends}" + (f" and turns back at {turning}." if turning else ".")
