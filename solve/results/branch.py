"""Branch of nonlinear orbits versus speed or a parameter."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from solve.arguments import matches_annotations, require_index
from solve.arrays import Array
from solve.contracts import Statistics
from solve.equations import limits_of, warnings_of
from solve.labels import SPEED, unit_of
from solve.period.curve import FourierCurve
from solve.period.multipliers import radius_verdicts
from solve.period.signals import FIGURES
from solve.results.branch_jumps import (
    BRANCHING,
    DOUBLING,
    FOLD,
    GRAZING,
    KINDS,
    REGULAR,
    STABLE,
    TORUS,
    UNDETERMINED,
    UNSTABLE,
    is_closed,
    jumps_of,
    relative_change,
)
from solve.results.contents import (
    MOST_SHOWN,
    Column,
    Columns,
    columns_by_name,
    digits,
    peak_column,
    varied_column,
)
from solve.results.formatting import greek, headed, prefixed
from solve.results.result import ResultOver
from solve.results.serialization import stored_property
from solve.system import PeriodicSystem

_NARROW = 1e-3
"""If the relative range of the values is smaller, tables show ten digits, because seven digits do not
distinguish the values."""

_SHORT = {STABLE: "stable", UNSTABLE: "unstable", UNDETERMINED: "open"}


@dataclass(frozen=True)
class BranchPoints(ResultOver):
    """Nonlinear orbits at P points of a branch.

    Attributes
    ----------
    speeds : (P,) array
        Speeds in rad/s.
    figures : (P, q, 7) array
        Statistics of each coordinate and output: the fields of `solve.contracts.Statistics`.
    figure_errors : (P, q) array
        Estimated errors of the extrema, relative to the largest absolute value of the quantity. For a
        coordinate on which the forces cancel, the error is relative to the scale of the coordinate.
    multipliers : (P, 2n) array
        Floquet multipliers, largest modulus first.
    radius : (P,) array
        Spectral radii.
    errors : (P, 2) array
        Estimated relative errors of the orbits and absolute errors of the spectral radii.
    kinds : (P,) array of int
        Kinds of the points, as positions in `KINDS`.
    numbers, counts : (P,) array of int
        Number of the branch to which each point belongs, from 0; and number of model periods per period of
        the orbit.
    repeats : (P,) array of bool
        Whether an orbit computed over several periods repeats after a single period.
    rtol : float
        Relative tolerance of the orbits.
    ended : str
        Reason why the branch ends within its range; empty if it does not.
    notes : sequence of str
        Notes on the selection of the engine.
    periods : int
        Number of model periods per period of the orbits on the first branch.
    parameters : mapping of str to (P,) array
        Values of the parameter that varies instead of the speed.
    curves : (P, n, k) array
        Coordinates at k uniform phases of the period of each orbit, before the last correction; see `curve`.
    energies : (P,) array
        Energies of unforced orbits, relative to the state of rest, in J if the coordinates are in m or rad;
        empty for forced orbits.
    """

    system: PeriodicSystem
    speeds: Array
    figures: Array
    figure_errors: Array
    multipliers: Array
    radius: Array
    errors: Array
    kinds: Array
    numbers: Array
    counts: Array
    repeats: Array
    rtol: float
    ended: str
    notes: Sequence[str] = ()
    periods: int = 1
    parameters: Mapping[str, Array] = field(default_factory=dict)
    curves: Array = field(default_factory=lambda: np.zeros((0, 0, 0)))
    energies: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names (q,) of the coordinates and outputs."""
        return *self.system.coordinates, *self.system.outputs

    @property
    def peaks(self) -> Array:
        """Largest absolute values (P, n) of the coordinates."""
        return self.figures[:, : self.system.n, FIGURES.index("max_abs")]

    @property
    def verdicts(self) -> list[str]:
        """Verdicts (P,), with the margins of `solve.period.multipliers.verdicts`; "undetermined" where the
        spectral radius equals 1 within its error."""
        return radius_verdicts(self.radius, self.errors[:, 1])


@dataclass(frozen=True)
class Branch(BranchPoints):
    """Branch of P nonlinear orbits, from `solve.branch`, with the attributes of `BranchPoints`.

    Attributes
    ----------
    turning : array
        Values of the varied quantity at turning points.
    folds, doublings, tori, grazing, branchings : list of dict
        Special points of each kind: see the properties of these names.
    closed : list of int
        Numbers of the closed branches.
    jumps : list of dict
        Jumps of the response while the varied quantity changes slowly.
    """

    _rows: ClassVar[str] = "points"
    _recorded: ClassVar[str] = "turning folds doublings tori grazing branchings closed jumps rtol periods"

    @matches_annotations
    def curve(self, point: int) -> FourierCurve:
        """Curve of the orbit at the point with index `point`, before its last correction. Pass the curve to
        `solve.nonlinear` as `start` to compute the orbit to a tolerance. `errors` does not apply to the
        curve.

        Examples
        --------
        >>> import solve
        >>> branch = solve.branch(solve.load("cam"), "300:310 rpm", points=3)
        >>> orbit = solve.nonlinear(branch.system, branch.speeds[1], start=branch.curve(1))
        >>> orbit.iterations < 10
        True
        """
        require_index("point", point, len(self.curves))
        q = self.curves[point].T
        nodes = np.linspace(0.0, self.system.period * int(self.counts[point]), len(q) + 1)
        return FourierCurve.through(nodes, q)

    @property
    def turning(self) -> Array:
        """Values of the varied quantity at turning points, in the order of the branch."""
        return self.values[self.turns]

    @property
    def turns(self) -> Array:
        """Mask (P,) of the turning points."""
        return self.kinds == KINDS.index(FOLD)

    @property
    def folds(self) -> list[dict[str, Any]]:
        """Folds of all branches, in the order of the branches."""
        return self._special(FOLD)

    @property
    def doublings(self) -> list[dict[str, Any]]:
        """Period doublings, at which a multiplier is -1."""
        return self._special(DOUBLING)

    @property
    def tori(self) -> list[dict[str, Any]]:
        """Neimark–Sacker points, at which a pair of complex multipliers passes through the unit circle."""
        return self._special(TORUS)

    @property
    def grazing(self) -> list[dict[str, Any]]:
        """Orbits that graze a switch of the equations, beyond which the multipliers change abruptly."""
        points = self._special(GRAZING)
        return [{key: value for key, value in point.items() if key != "multiplier"} for point in points]

    @property
    def branchings(self) -> list[dict[str, Any]]:
        """Branching points, at which a multiplier is +1 and another branch of orbits with the same period
        crosses this one. Symmetric orbits, for example, lose their symmetry at such points. Points at which
        two multipliers are +1 at once are not listed."""
        return self._special(BRANCHING)

    def _special(self, kind: str) -> list[dict[str, Any]]:
        """Special points of one kind. Each has the value of the varied quantity, the spectral radius, the
        multiplier on the unit circle, the index of the branch, the number of periods after which the orbit
        repeats, and the error of the orbit."""
        points = []
        for at in np.flatnonzero(self.kinds == KINDS.index(kind)).tolist():
            rho = self.multipliers[at]
            points.append(
                {
                    self.over: float(self.values[at]),
                    "spectral_radius": float(self.radius[at]),
                    "multiplier": complex(rho[np.abs(_distance(kind, rho)).argmin()]),
                    "branch": int(self.numbers[at]),
                    "periods": int(self.counts[at]),
                    "error": float(self.errors[at, 0]),
                }
            )
        return points

    @property
    def jumps(self) -> list[dict[str, Any]]:
        """Jumps of the response while the varied quantity changes slowly along the first branch. Each has the
        direction of the change, the value of the varied quantity, the coordinate whose relative change is
        largest, and the largest absolute value of this coordinate before the jump ("from") and after it
        ("to"). "to" is None if the branch has no stable orbit to jump to."""
        first = np.flatnonzero(self.numbers == 0)
        values, peaks = self.values[first], self.peaks[first]
        verdicts = np.array(self.verdicts)[first].tolist()
        records = []
        kinds = [KINDS[kind] for kind in self.kinds[first]]
        for jump in jumps_of(values, peaks, self.radius[first], kinds, verdicts):
            before, after = peaks[jump.at], jump.after
            most = 0 if after is None else int(relative_change(before, after).argmax())
            records.append(
                {
                    "direction": jump.direction,
                    self.over: float(values[jump.at]),
                    "coordinate": self.system.coordinates[most],
                    "from": float(before[most]),
                    "to": None if after is None else float(after[most]),
                }
            )
        return records

    @stored_property
    def warnings(self) -> list[str]:
        """Warnings about the result, one sentence each."""
        sentences, worst = [*self.notes, *filter(None, [self.ended])], float(self.errors[:, 0].max())
        sentences += warnings_of(self.system, float(self.speeds.max()), linear=False)
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
        """Sentences on the violated limits of the model, each with the first violation."""
        sentences = []
        for limit in limits_of(self.system, self.quantities, linear=False):
            figures = self.figures[:, self.quantities.index(limit.quantity)]
            left = np.asarray(limit.exceeded(Statistics(*figures.T)))
            if left.any():
                first = Statistics(*figures[int(left.argmax())].tolist())
                sentences.append(f"{limit.message(first)}{self._where(left)}")
        return sentences

    def _where(self, which: Array) -> str:
        """Text that states the first of the points selected by the mask `which` (P,), and the number of
        selected points."""
        first = unit_of(self.system, self.over).text(float(self.values[int(which.argmax())]), self._digits)
        return f" (at {first}; {int(which.sum())} of {len(which)} points)"

    @property
    def _digits(self) -> str:
        """Number format with enough digits to distinguish neighbouring values."""
        return ".7g" if np.ptp(self.values) > _NARROW * np.abs(self.values).max() else ".10g"

    @property
    def energy_unit(self) -> str:
        """Unit of the energies; empty if the unit of a coordinate is not an SI unit of length or angle."""
        units = {self.system.labels.units.get(name) for name in self.system.coordinates}
        return "J" if units <= {"m", "rad"} else ""

    @property
    def columns(self) -> Columns:
        """Columns of the table, with one row per point."""
        system = self.system
        columns = [("speed", varied_column(system, SPEED, self.speeds, self._digits))]
        columns += [(name, varied_column(system, name, values)) for name, values in self.parameters.items()]
        for number, name in enumerate(self.quantities):
            columns += self._columns_of(name, number)
        if len(self.energies):
            unit = self.energy_unit
            heading = headed("energy", unit)
            columns.append(
                ("energy", Column(self.energies, unit, "energy from rest", heading, digits(".5g")))
            )
        meaning, several = "estimated error of the spectral radius", "periods" * bool(np.ptp(self.counts))
        columns += [
            ("spectral_radius", Column(self.radius, "1", "spectral radius", "radius", digits(".5g"))),
            ("verdict", Column(np.array(self.verdicts), "", "stability", "verdict", _SHORT.__getitem__)),
            ("kind", Column(np.array(KINDS)[self.kinds], "", "kind of the point", "kind", _shown)),
            ("turns", Column(self.turns, "", "whether the branch turns back")),
            ("branch", Column(self.numbers, "", "number of the branch, 0 for the first")),
            ("periods", Column(self.counts, "", "periods of the model per period of the orbit", several)),
            ("error", Column(self.errors[:, 0], "1", "estimated relative error of the orbit")),
            ("radius_error", Column(self.errors[:, 1], "1", meaning)),
        ]
        return columns_by_name(columns)

    def _columns_of(self, name: str, number: int) -> list[tuple[str, Column]]:
        """Columns of the statistics of the quantity with index `number`. Tables show only the largest
        absolute values of the first coordinates."""
        unit, meaning = self.system.labels.units.get(name, ""), self.system.labels.meanings.get(name, name)
        columns = []
        for figure in ("max", "min", "max_abs", "mean", "rms"):
            values = self.figures[:, number, FIGURES.index(figure)]
            column = Column(values, unit, f"{figure} of {meaning}")
            if figure == "max_abs":
                column = peak_column(self.system, name, values, number < min(self.system.n, MOST_SHOWN - 1))
            columns.append((f"{name}_{figure}", column))
        error = f"estimated relative error of the extrema of {meaning}"
        return [*columns, (f"{name}_error", Column(self.figure_errors[:, number], "1", error))]

    @property
    def closed(self) -> list[int]:
        """Numbers of the closed branches. The last orbit of a closed branch equals the first one."""
        parts = [self.numbers == number for number in range(self._count)]
        return [
            number for number, part in enumerate(parts) if is_closed(self.values[part], self.figures[part])
        ]

    @property
    def _count(self) -> int:
        return int(self.numbers.max(initial=-1)) + 1

    @property
    def summary(self) -> str:
        """Sentences on the range, the special points and the jumps."""
        unit = unit_of(self.system, self.over)
        sentences = [self._range_text(number) for number in range(self._count)]
        special = (self.doublings, "The period doubles"), (self.tori, "Orbits become tori")
        special += ((self.branchings, "Another branch crosses this one"),)
        for points, words in (*special, (self.grazing, "Orbits graze a switch of the equations")):
            if points:
                sentences.append(f"{words} at {self._values_text(points)}.")
        for jump in self.jumps:
            sentences.append(self._jump_text(jump, self._named + unit.text(jump[self.over], ".6g")))
        return " ".join(sentences)

    def _range_text(self, number: int) -> str:
        """Sentence on the range and the folds of the branch with this number."""
        unit, values = unit_of(self.system, self.over), self.values[self.numbers == number]
        folds = [point for point in self.folds if point["branch"] == number]
        named = self._named
        subject = "The mode" if len(self.energies) else "The branch"
        subject = f"Branch {number + 1}" if number else subject
        if number in self.closed:
            return (
                f"{subject} is closed and extends from {self._named}{unit.span(values.min(), values.max())}."
            )
        turns = f" and turns back at {self._values_text(folds)}" if folds else ""
        return f"{subject} goes from {named}{unit.span(values[0], values[-1])}{turns}."

    def _values_text(self, points: Sequence[dict[str, Any]]) -> str:
        unit = unit_of(self.system, self.over)
        return self._named + ", ".join(unit.text(point[self.over], ".6g") for point in points)

    @property
    def _named(self) -> str:
        """Prefix of values of the varied quantity: "NAME = " for a parameter, empty for the speed."""
        return "" if self.over == SPEED else f"{self.over} = "

    def _jump_text(self, jump: Mapping[str, Any], at: str) -> str:
        name, ends = jump["coordinate"], [jump["from"], jump["to"]]
        factor, shown = prefixed(self.system.labels.units.get(name, ""), max(end or 0.0 for end in ends))
        before, after = (None if end is None else f"{end * factor:.4g} {shown}".strip() for end in ends)
        where = "to no stable orbit of this branch" if after is None else f"to {after}"
        return f"A slow sweep {jump['direction']} jumps at {at}: max|{greek(name)}| from {before} {where}."


def _distance(kind: str, multipliers: Array) -> Array:
    """Return the differences between the multipliers and the value that defines a kind of special point: 1 at
    folds and branching points, -1 at period doublings. For tori, return the moduli minus 1."""
    if kind == TORUS:
        return np.where(np.imag(multipliers) > 0, np.abs(multipliers) - 1, np.inf)
    return multipliers - (-1 if kind == DOUBLING else 1)


def _shown(kind: str) -> str:
    return "" if kind == REGULAR else kind
