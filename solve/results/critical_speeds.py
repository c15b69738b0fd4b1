"""Critical speeds by three criteria: maxima of response and multipliers, and resonances."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from solve.arguments import matches_annotations
from solve.arrays import Array, runs
from solve.equations import warnings_of
from solve.errors import counted, require_name
from solve.results.contents import Column, Columns, HeaderRows, digits, rows_of, sized, speeds_of
from solve.results.formatting import measured, named, prefixed
from solve.results.result import Figure, Result
from solve.results.serialization import serializable, stored_property
from solve.system import PeriodicSystem


@serializable
@dataclass(frozen=True)
class Combination:
    """Combination resonance (ω̄i + sign · ω̄j)/order at a speed in rad/s, with modes i and j counted from 1.
    If i = j, the resonance is a parametric resonance of one mode; for order 1, it is the principal parametric
    resonance."""

    speed: float
    modes: tuple[int, int]
    sign: int
    order: int

    @property
    def is_division(self) -> bool:
        """Whether the speed is a division ω̄/k of one mean frequency, with k = order/2."""
        return self.modes[0] == self.modes[1] and self.order % 2 == 0

    def same(self, other: "Combination | None") -> bool:
        """Whether both objects describe the same resonance, regardless of their speeds."""
        return other is not None and self == replace(other, speed=self.speed)


@serializable
@dataclass(frozen=True)
class Maximum:
    """Local maximum: its speed (rad/s) and its height, which is infinite if the response is unbounded."""

    speed: float
    height: float


@serializable
@dataclass(frozen=True)
class Critical:
    """Critical speed by three criteria; None for a criterion without a maximum at this speed.

    Attributes
    ----------
    response, multiplier, radius : Maximum or None
        Maxima of the response, of the real part of the dominant multiplier, and of the spectral radius.
    division, mode, order : float, int, int or None
        Division ω̄/k, in rad/s, of a mean frequency near this critical speed; the number of the mode, from 1;
        and the order k.
    at_rest : float or None
        Division ω̄/k, in rad/s, of the mean frequency of the same mode at rest.
    ratios : sequence of float
        Ratios of the mean frequencies to the speed of the row, in ascending order.
    combination : Combination or None
        Combination resonance that explains the maximum if no division explains it.
    candidates : sequence of Combination
        Combinations that explain the maximum equally well.
    """

    response: Maximum | None = None
    multiplier: Maximum | None = None
    division: float | None = None
    mode: int | None = None
    order: int | None = None
    at_rest: float | None = None
    ratios: Sequence[float] = ()
    combination: Combination | None = None
    radius: Maximum | None = None
    candidates: Sequence[Combination] = ()

    @property
    def explained(self) -> tuple[str, str]:
        """Texts for tables: the modes and the order of the resonance to which the row is attributed."""
        if self.candidates:
            orders = {candidate.order for candidate in self.candidates}
            return "?", str(*orders) if len(orders) == 1 else "?"
        if self.combination is None:
            return str(self.mode or "–"), str(self.order or "–")
        (high, low), sign = self.combination.modes, "+" if self.combination.sign > 0 else "−"
        return f"{high}{sign}{low}", str(self.combination.order)

    @property
    def unbounded(self) -> bool:
        """Whether the response is unbounded at this critical speed."""
        return self.response is not None and math.isinf(self.response.height)

    @property
    def speed(self) -> float:
        """Speed in rad/s of the first criterion that has a maximum; if no criterion has a maximum, the
        division."""
        maxima = [way.speed for way in (self.response, self.multiplier, self.radius) if way]
        return maxima[0] if maxima else float(self.division or np.nan)


MOST_DECADES = 1e3
"""Ratio of the largest to the smallest response above which the axis is logarithmic: on a linear axis the
smallest response would be invisible. Chosen by judgement."""


_OF_RECORDS = "ratios", "combination", "candidates"
_NOWHERE = Maximum(math.nan, math.nan)


@dataclass(frozen=True)
class SolvedSpeeds(Result):
    """Response, dominant multiplier and natural frequencies at P speeds.

    Attributes
    ----------
    speeds : (P,) array
        Solved speeds in rad/s, ascending.
    response, real_part, radius : (P,) array
        Response, and real part and modulus of the dominant multiplier.
    unstable, imaginary : (P,) array of bool
        Whether the motion is unstable, and whether a frequency is imaginary or complex at some position.
    frequencies : (P, n) array
        Mean natural frequencies in rad/s.
    """

    system: PeriodicSystem
    speeds: Array
    response: Array
    real_part: Array
    radius: Array
    unstable: Array
    imaginary: Array
    frequencies: Array

    @property
    def decimals(self) -> str:
        """Number format of speeds: three decimals, or fewer for large speeds, because speeds are accurate to
        seven digits."""
        before = math.floor(math.log10(self.system.labels.speed_unit.from_si(float(self.speeds[-1]))))
        return f".{min(3, max(0, 6 - before))}f"

    @property
    def unstable_ranges(self) -> list[tuple[float, float, float]]:
        """Ranges of unstable speeds: first and last speed (rad/s), and largest |ρ|."""
        return [
            (*self.speeds[[first, last]].tolist(), float(self.radius[first : last + 1].max()))
            for first, last in runs(self.unstable)
        ]


@dataclass(frozen=True)
class CriticalSpeeds(SolvedSpeeds):
    """Critical speeds in a range of speeds, from `solve.critical_speeds`.

    Attributes
    ----------
    quantity, figure : str
        Coordinate or output, and the statistic of it that defines the response.
    rows : sequence of Critical
        Critical speeds in descending order of speed.
    combinations : sequence of Combination
        Combination resonances (ω̄i ± ω̄j)/k.
    orders : int
        Highest order k of divisions and combinations.
    notes : sequence of str
        Notes on the search.
    constant_matrices : bool
        Whether M, C and K are constant over the period, so that there are no combination resonances.
    """

    quantity: str
    figure: str
    rows: Sequence[Critical]
    combinations: Sequence[Combination]
    orders: int
    notes: Sequence[str] = ()
    constant_matrices: bool = False

    @stored_property
    def warnings(self) -> list[str]:
        """Warnings about the equations, and about unstable ranges, unbounded responses and undefined
        frequencies, one sentence each."""
        sentences, unit = warnings_of(self.system, float(self.speeds[-1])), self.system.labels.speed_unit
        if self.unstable_ranges:
            ranges = unit.spans((low, high) for low, high, _ in self.unstable_ranges)
            sentences.append(
                f"the motion is unstable {ranges}: the periodic response does not persist there; "
                "`bands` finds the edges"
            )
        if not np.nan_to_num(self.response).any():
            sentences.append(
                f"{named(self.figure, self.quantity)} is zero at every speed because no load acts on it: "
                "critical speeds are determined from multipliers and frequencies only"
            )
        if self.unbounded:
            speeds = unit.spans(zip(self.unbounded, self.unbounded, strict=True))
            sentences.append(
                f"the response is unbounded {speeds}: a multiplier is +1 there, as at an undamped "
                "resonance or at the edge of an unstable range; the height of such a maximum is ∞ (null "
                "in JSON)"
            )
        if self.imaginary.any():
            speeds = self.speeds[self.imaginary]
            sentences.append(
                "with the matrices frozen at some position, a natural frequency is imaginary or complex at "
                f"{len(speeds)} of {len(self.speeds)} speeds, "
                f"{unit.spans([(speeds[0], speeds[-1])])}: mean frequencies and their integer fractions are "
                "meaningless there"
            )
        return sentences

    @property
    def summary(self) -> str:
        """Sentence on the highest maximum of the response."""
        unit = self.system.labels.speed_unit
        between = f"between {unit.span(self.speeds[0], self.speeds[-1], word='and')}"
        maxima = self.maxima("response")
        response = named(self.figure, self.quantity)
        if not maxima:
            return f"{response} has no maximum {between}."
        count = counted(len(maxima), "maximum", "maxima")
        if self.unbounded:
            where = unit.spans(zip(self.unbounded, self.unbounded, strict=True))
            return f"{response} has {count} {between}, unbounded {where}."
        speed, height = max(maxima, key=lambda maximum: maximum[1])
        size = measured(height, self.system.labels.units.get(self.quantity, ""))
        return f"{response} has {count} {between}, the highest, {size}, at {unit.text(speed)}."

    @property
    def unbounded(self) -> list[float]:
        """Speeds (rad/s) at which the response is unbounded."""
        return sorted(row.response.speed for row in self.rows if row.response and row.unbounded)

    @matches_annotations
    def maxima(self, way: str) -> list[tuple[float, float]]:
        """Speeds and heights of the maxima of the "response", "multiplier" or "radius"."""
        require_name("maxima", way, ("response", "multiplier", "radius"))
        maxima = (getattr(row, way) for row in self.rows)
        return [(maximum.speed, maximum.height) for maximum in maxima if maximum is not None]

    @property
    def divided(self) -> list[tuple[float, int, int]]:
        """Divisions ω̄/k of mean frequencies (rad/s), with their modes and orders k."""
        return [(row.division, row.mode or 0, row.order or 0) for row in self.rows if row.division]

    @matches_annotations
    def plot(self, *, campbell: bool = False) -> Figure:
        """Figure of the response, the dominant multiplier and the Campbell diagram. If `campbell` is True,
        the multiplier is omitted."""
        return super().plot(campbell=campbell)

    _rows: ClassVar[str] = "rows"

    @property
    def summary_values(self) -> dict[str, Any]:
        return {
            "range": [self.speeds[0], self.speeds[-1]],
            "quantity": self.quantity,
            "figure": self.figure,
            "combinations": self.combinations,
            "unstable": rows_of(self.unstable_columns),
            "notes": self.notes,
            "constant_matrices": self.constant_matrices,
        }

    @property
    def unstable_columns(self) -> Columns:
        """Columns of the table, with one row per unstable range."""
        low, high, radius = np.reshape(self.unstable_ranges, (-1, 3)).T
        return {
            "from": speeds_of(self.system, low, "", "from", self.decimals),
            "to": speeds_of(self.system, high, "", "to", self.decimals),
            "spectral_radius": Column(radius, heading="largest |ρ|", text=digits(".6g")),
        }

    @property
    def columns(self) -> Columns:
        """Columns of the table, with one row per critical speed."""
        speed = self._speeds([row.speed for row in self.rows], "of this row")
        return {"speed": speed, **self._of_maxima, **self._of_divisions}

    @property
    def _of_maxima(self) -> Columns:
        def values(way: str, name: str) -> list[float | None]:
            maxima = (getattr(row, way) for row in self.rows)
            return [maximum and getattr(maximum, name) for maximum in maxima]

        rows, unit = self.rows, self.system.labels.units.get(self.quantity, "")
        raised = any(row.radius for row in rows)
        # Tables show the maximum of |ρ| if there is none of Re ρ.
        either = [(row.multiplier or row.radius or _NOWHERE).speed for row in rows]
        real_part, height = "maximum of the dominant multiplier's real part", "its height"
        return {
            "response": self._speeds(values("response", "speed"), "maximum of the response", "response"),
            "response_height": _height(
                values("response", "height"), unit, f"{self.figure} of {self.quantity}"
            ),
            "unbounded": Column([row.unbounded for row in rows], "", "whether the response is unbounded"),
            "multiplier": self._speeds(values("multiplier", "speed"), real_part, "multiplier", either),
            "multiplier_real_part": Column(
                values("multiplier", "height"), "1", height, "Re ρ", digits(".2e")
            ),
            "radius": self._speeds(values("radius", "speed"), "maximum of the spectral radius"),
            "radius_height": Column(values("radius", "height"), "1", height, "|ρ|" * raised, digits(".3f")),
        }

    @property
    def _of_divisions(self) -> Columns:
        """Columns that describe integer divisions and other resonances."""
        rows, mean = self.rows, "integer division of the mean natural frequency at this speed"
        # Tables show the combination if there is no division.
        either = [row.division or (row.combination or _NOWHERE).speed for row in rows]
        modes, orders = ([row.explained[part] for row in rows] for part in (0, 1))
        resonances = ["" if row.explained[0] == "–" else ", k = ".join(row.explained) for row in rows]
        return {
            "division": self._speeds([row.division for row in rows], mean, "ω̄/k", either),
            "division_at_rest": self._speeds(
                [row.at_rest for row in rows],
                "integer division of the mean natural frequency at rest",
                "at rest",
            ),
            "mode": Column([row.mode for row in rows], "", "of the division", "mode", modes),
            "order": Column([row.order for row in rows], "", "of the division", "k", orders),
            "explained_by": Column(resonances, "", "modes and order of the resonance; ? where unsure"),
            **{name: Column([getattr(row, name) for row in rows], axes=()) for name in _OF_RECORDS},
        }

    def _speeds(
        self,
        values: Sequence[float | None],
        meaning: str,
        heading: str = "",
        shown: Sequence[float | None] | None = None,
    ) -> Column:
        """Column of speeds. `shown` are the values in tables, if they differ from the values in records."""
        column = speeds_of(self.system, values, meaning, heading, self.decimals)
        return column if shown is None else column._replace(text=column._replace(values=shown).texts)

    def header_rows(self) -> HeaderRows:
        span = self.system.labels.speed_unit.span(self.speeds[0], self.speeds[-1], "and")
        return [("between", span), *[("M, C, K", "constant over the period")] * self.constant_matrices]


def _height(values: list[float | None], unit: str, meaning: str) -> Column:
    """Return a column of heights of maxima, in exponential format if the ratio of the largest to the smallest
    height is large."""
    heights = [abs(value) for value in values if value and math.isfinite(value)]
    column = sized(values, unit, meaning, "height", 5, max(heights, default=0.0))
    if heights and max(heights) > MOST_DECADES * min(heights):
        column = column._replace(text=digits(".4e", prefixed(unit, max(heights))[0]))
    texts = ["∞" if value == math.inf else text for value, text in zip(values, column.texts, strict=True)]
    return column._replace(text=texts)
