"""Critical speeds three ways, side by side."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from solve.arrays import Array, runs
from solve.results.contents import Column, Columns, HeaderRows, digits, rows_of, sized, speeds_of
from solve.results.formatting import measured, named, prefixed
from solve.results.result import Figure, Result
from solve.results.serialization import serializable, stored_property
from solve.system import PeriodicSystem


@serializable
@dataclass(frozen=True)
class Combination:
    """A combination resonance (ω̄i + sign · ω̄j)/order, modes counted from 1, at a speed in rad/s; with i = j
    the parametric resonance of one mode, principal at order 1."""

    speed: float
    modes: tuple[int, int]
    sign: int
    order: int

    @property
    def is_division(self) -> bool:
        """Whether this is an integer division of one frequency, of half its order."""
        return self.modes[0] == self.modes[1] and self.order % 2 == 0

    def same(self, other: "Combination | None") -> bool:
        """Whether both name the same resonance, wherever the frequencies were taken."""
        return other is not None and self == replace(other, speed=self.speed)


@serializable
@dataclass(frozen=True)
class Maximum:
    """A speed (rad/s) at which something has a local maximum, and its height there, infinite where it grows
    beyond all bounds."""

    speed: float
    height: float


@serializable
@dataclass(frozen=True)
class Critical:
    """One critical speed in three ways (rad/s), None where a way does not show it.

    mode (from 1) and order: of the integer division, with the frequencies' means at this speed; at_rest:
    the same division with those at rest. ratios: the means over the row's speed, from the lowest mode on.
    combination: what explains the maximum where no division does, None where nothing does. radius: the
    maximum of the spectral radius. candidates: combinations of which each explains the maximum as well.
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
        """Modes and order of what explains the row, in few characters."""
        if self.candidates:
            orders = {one.order for one in self.candidates}
            return "?", str(*orders) if len(orders) == 1 else "?"
        if self.combination is None:
            return str(self.mode or "–"), str(self.order or "–")
        (high, low), sign = self.combination.modes, "+" if self.combination.sign > 0 else "−"
        return f"{high}{sign}{low}", str(self.combination.order)

    @property
    def unbounded(self) -> bool:
        """Whether the response grows beyond all bounds here."""
        return self.response is not None and math.isinf(self.response.height)

    @property
    def speed(self) -> float:
        """The first that there is."""
        ways = [way.speed for way in (self.response, self.multiplier, self.radius) if way]
        return ways[0] if ways else float(self.division or np.nan)


MOST_DECADES = 1e3
"""Ratio of a response over speed from which its axis is logarithmic."""


_OF_RECORDS = "ratios", "combination", "candidates"
_NOWHERE = Maximum(math.nan, math.nan)


@dataclass(frozen=True)
class CriticalSpeeds(Result):
    """Critical speeds. rows: critical speeds, in descending order; combinations: (ω̄i ± ω̄j)/k. Over speeds
    (P,) in ascending order: response, real part and modulus of the dominant multiplier (P,), unstable (P,),
    mean frequencies (P, n), and imaginary (P,): whether a frequency is imaginary or complex at some position.
    constant_matrices: whether M, C and K are constant over the period, so that no combination resonance is
    excited."""

    system: PeriodicSystem
    quantity: str
    figure: str
    rows: Sequence[Critical]
    combinations: Sequence[Combination]
    speeds: Array
    response: Array
    real_part: Array
    radius: Array
    unstable: Array
    frequencies: Array
    orders: int
    imaginary: Array
    notes: Sequence[str] = ()
    constant_matrices: bool = False

    @stored_property
    def warnings(self) -> list[str]:
        """About the equations themselves at the highest speed, unstable ranges, and frozen frequencies that
        mean nothing."""
        found, unit = self.system.warnings(float(self.speeds[-1])), self.system.speed_unit
        if self.unstable_ranges:
            ranges = unit.spans((low, high) for low, high, _ in self.unstable_ranges)
            found.append(
                f"the motion is unstable {ranges}: the response there is never reached; "
                "`bands` finds the edges"
            )
        if not np.nan_to_num(self.response).any():
            found.append(
                f"{named(self.figure, self.quantity)} is zero at every speed, as no load acts on it: "
                "multipliers and frequencies alone tell critical speeds"
            )
        if self.unbounded:
            speeds = unit.spans(zip(self.unbounded, self.unbounded, strict=True))
            found.append(
                f"the response grows beyond all bounds {speeds}: a multiplier is +1 there, as where nothing "
                "damps a resonance and where an unstable range begins; it has no height (∞, null in JSON)"
            )
        if self.imaginary.any():
            speeds = self.speeds[self.imaginary]
            found.append(
                "with matrices frozen somewhere in the turn a frequency is imaginary or complex at "
                f"{len(speeds)} of {len(self.speeds)} speeds, "
                f"{unit.spans([(speeds[0], speeds[-1])])}: means and divisions mean nothing there"
            )
        return found

    @property
    def decimals(self) -> str:
        """Of speeds: three, and seven digits at most, as speeds are no better known."""
        before = math.floor(math.log10(self.system.speed_unit.of(float(self.speeds[-1]))))
        return f".{min(3, max(0, 6 - before))}f"

    @property
    def unstable_ranges(self) -> list[tuple[float, float, float]]:
        """Runs of unstable ones among the speeds: the first and the last (rad/s), the largest |ρ|."""
        return [
            (*self.speeds[[first, last]].tolist(), float(self.radius[first : last + 1].max()))
            for first, last in runs(self.unstable)
        ]

    @property
    def summary(self) -> str:
        """Where the response is largest among its maxima."""
        unit = self.system.speed_unit
        between = f"between {unit.span(self.speeds[0], self.speeds[-1], word='and')}"
        found = self.maxima("response")
        of = named(self.figure, self.quantity)
        if not found:
            return f"{of} has no maximum {between}."
        maxima = "1 maximum" if len(found) == 1 else f"{len(found)} maxima"
        if self.unbounded:
            where = unit.spans(zip(self.unbounded, self.unbounded, strict=True))
            return f"{of} has {maxima} {between}, beyond all bounds {where}."
        speed, height = max(found, key=lambda each: each[1])
        size = measured(height, self.system.units.get(self.quantity, ""))
        return f"{of} has {maxima} {between}, the highest, {size}, at {unit.text(speed)}."

    @property
    def unbounded(self) -> list[float]:
        """Speeds (rad/s) at which the response grows beyond all bounds."""
        return sorted(row.response.speed for row in self.rows if row.response and row.unbounded)

    def maxima(self, way: str) -> list[tuple[float, float]]:
        """Speeds and heights of the maxima of the "response", of the "multiplier" or of the "radius"."""
        found = (getattr(row, way) for row in self.rows)
        return [(maximum.speed, maximum.height) for maximum in found if maximum is not None]

    @property
    def divided(self) -> list[tuple[float, int, int]]:
        """Speed, mode and order of the integer divisions."""
        return [(row.division, row.mode or 0, row.order or 0) for row in self.rows if row.division]

    def plot(self, *, campbell: bool = False) -> Figure:
        """Response, dominant multiplier and Campbell diagram over speed, or this below the response alone."""
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
        """A row an unstable range."""
        low, high, radius = np.reshape(self.unstable_ranges, (-1, 3)).T
        return {
            "from": speeds_of(self.system, low, "", "from", self.decimals),
            "to": speeds_of(self.system, high, "", "to", self.decimals),
            "spectral_radius": Column(radius, heading="largest |ρ|", text=digits(".6g")),
        }

    @property
    def columns(self) -> Columns:
        """A row a critical speed."""
        speed = self._speeds([row.speed for row in self.rows], "of this row")
        return {"speed": speed, **self._of_maxima, **self._of_divisions}

    @property
    def _of_maxima(self) -> Columns:
        def of(way: str, name: str) -> list[float | None]:
            found = (getattr(row, way) for row in self.rows)
            return [maximum and getattr(maximum, name) for maximum in found]

        rows, unit = self.rows, self.system.units.get(self.quantity, "")
        raised = any(row.radius for row in rows)
        # In tables a maximum of |ρ| alone stands where others have that of Re ρ.
        either = [(row.multiplier or row.radius or _NOWHERE).speed for row in rows]
        real_part, height = "maximum of the dominant multiplier's real part", "its height"
        return {
            "response": self._speeds(of("response", "speed"), "maximum of the response", "response"),
            "response_height": _height(of("response", "height"), unit, f"{self.figure} of {self.quantity}"),
            "unbounded": Column(
                [row.unbounded for row in rows], "", "whether the response grows beyond all bounds"
            ),
            "multiplier": self._speeds(of("multiplier", "speed"), real_part, "multiplier", either),
            "multiplier_real_part": Column(of("multiplier", "height"), "1", height, "Re ρ", digits(".2e")),
            "radius": self._speeds(of("radius", "speed"), "maximum of the spectral radius"),
            "radius_height": Column(of("radius", "height"), "1", height, "|ρ|" * raised, digits(".3f")),
        }

    @property
    def _of_divisions(self) -> Columns:
        """Divisions, and what else explains a row."""
        rows, mean = self.rows, "integer division of the mean natural frequency at this speed"
        # In tables a combination stands where others have a division.
        either = [row.division or (row.combination or _NOWHERE).speed for row in rows]
        modes, orders = ([row.explained[at] for row in rows] for at in (0, 1))
        words = ["" if row.explained[0] == "–" else ", k = ".join(row.explained) for row in rows]
        return {
            "division": self._speeds([row.division for row in rows], mean, "ω̄/k", either),
            "division_at_rest": self._speeds(
                [row.at_rest for row in rows], "that of the frequency at rest", "at rest"
            ),
            "mode": Column([row.mode for row in rows], "", "of the division", "mode", modes),
            "order": Column([row.order for row in rows], "", "of the division", "k", orders),
            "explained_by": Column(words, "", "modes and order of the resonance; ? where unsure"),
            **{name: Column([getattr(row, name) for row in rows], axes=()) for name in _OF_RECORDS},
        }

    def _speeds(
        self,
        values: Sequence[float | None],
        meaning: str,
        heading: str = "",
        shown: Sequence[float | None] | None = None,
    ) -> Column:
        """shown: what stands in tables instead of the values."""
        column = speeds_of(self.system, values, meaning, heading, self.decimals)
        return column if shown is None else column._replace(text=column._replace(values=shown).texts)

    def header_rows(self) -> HeaderRows:
        span = self.system.speed_unit.span(self.speeds[0], self.speeds[-1], "and")
        return [("between", span), *[("M, C, K", "constant over the period")] * self.constant_matrices]


def _height(values: list[float | None], unit: str, meaning: str) -> Column:
    """Heights of maxima; where one is many times another, each has its own digits."""
    heights = [abs(value) for value in values if value and math.isfinite(value)]
    column = sized(values, unit, meaning, "height", 5, max(heights, default=0.0))
    if heights and max(heights) > MOST_DECADES * min(heights):
        column = column._replace(text=digits(".4e", prefixed(unit, max(heights))[0]))
    texts = ["∞" if value == math.inf else text for value, text in zip(values, column.texts, strict=True)]
    return column._replace(text=texts)
