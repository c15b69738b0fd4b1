"""Critical speeds three ways, side by side."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from solve.arrays import Array, runs
from solve.period.natural import lowest_elastic
from solve.results.contents import Column, Columns, rows_of
from solve.results.critical_marks import curve, draw_marks, growing, label_order, legend, shade
from solve.results.critical_rows import Combination, Critical, Maximum
from solve.results.plot import label_quantity, label_speeds, title_of
from solve.results.quantities import measured, named, prefixed
from solve.results.report import Facts, RenderableType, Table, digits, sized, speeds_of, table_of, text
from solve.results.result import Result
from solve.results.style import BLACK, BLUE, GREEN, GREY, LIGHT, VERMILION, Axes, Figure, page
from solve.system import PeriodicSystem

_MOST_COMBINATIONS = 20
_MOST_DECADES = 1e3
"""Ratio of a response over speed from which its axis is logarithmic."""

_HEADROOM = 1.15
_ROOM = 1.6
"""Factor on a logarithmic axis that is left above and below."""

_CAPTIONS = {
    "–": "mode –: no division of a frequency and no combination up to order {0} explains it",
    "?": "mode ?: several combinations explain it equally well",
    "+": "mode i+j: (ω̄i + ω̄j)/k",
    "−": "mode i−j: (ω̄i − ω̄j)/k",
    "|ρ|": "where |ρ| stands alone, the multiplier is that of its maximum",
}


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

    @cached_property
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
    def _decimals(self) -> str:
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
        drawn = (_draw_response, _draw_campbell) if campbell else _ALL
        title = "Campbell diagram" if campbell else "critical speeds"
        height, ratios = (5.4, (0.9, 1.3)) if campbell else (7.6, (1.1, 0.9, 1.3))
        with page(height, f"{title_of(self.system)}: {title}") as figure:
            places = figure.subplots(len(drawn), 1, sharex=True, squeeze=False, height_ratios=ratios)[:, 0]
            for axes, draw in zip(places, drawn, strict=True):
                draw(axes, self)
            label_speeds(places[-1], self.system, self.speeds)
            figure.align_ylabels()
        return figure

    _rows: ClassVar[str] = "rows"

    @property
    def whole(self) -> dict[str, Any]:
        return {
            "range": [self.speeds[0], self.speeds[-1]],
            "quantity": self.quantity,
            "figure": self.figure,
            "combinations": self.combinations,
            "unstable": rows_of(self._unstable),
            "notes": self.notes,
            "constant_matrices": self.constant_matrices,
        }

    @property
    def _unstable(self) -> Columns:
        """A row an unstable range."""
        low, high, radius = np.reshape(self.unstable_ranges, (-1, 3)).T
        return {
            "from": speeds_of(self.system, low, "", "from", self._decimals),
            "to": speeds_of(self.system, high, "", "to", self._decimals),
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
        column = speeds_of(self.system, values, meaning, heading, self._decimals)
        return column if shown is None else column._replace(text=column._replace(values=shown).texts)

    def facts(self) -> Facts:
        span = self.system.speed_unit.span(self.speeds[0], self.speeds[-1], "and")
        return [("between", span), *[("M, C, K", "constant over the period")] * self.constant_matrices]

    def tables(self) -> Sequence[RenderableType]:
        """A row a critical speed; unstable ranges and combinations below."""
        unit = self.system.speed_unit
        span = unit.span(self.speeds[0], self.speeds[-1])
        none = text(f"\nno maximum and no division up to order {self.orders} found from {span}")
        made = [self._rows_table() if self.rows else none]
        if self.unstable_ranges:
            made.append(table_of(f"Unstable among the speeds, {unit.name}", self._unstable))
        if self.combinations:
            made.append(self._combinations_table())
        return made

    def _rows_table(self) -> Table:
        columns = {**self.columns}
        heights = columns["response_height"]
        # With the unit in the title the table of all columns fits a line of 80.
        columns["response_height"] = heights._replace(heading="height")
        of = heights.heading.replace("height", named(self.figure, self.quantity))
        title = f"Critical speeds in {self.system.speed_unit.name}; height: {of}"
        caption = "ω̄: mean of a natural frequency over the cycle, at the speed and at rest"
        for sign, rule in _CAPTIONS.items():
            if any(sign in row.explained[0] or (sign == "|ρ|" and row.radius) for row in self.rows):
                caption += f"\n{rule.format(self.orders)}"
        if self.unbounded:
            caption += "\n∞: the response grows beyond all bounds"
        return table_of(title, columns, caption=caption)

    def _combinations_table(self) -> Table:
        some = self.combinations[:_MOST_COMBINATIONS]
        columns = {
            "speed": speeds_of(self.system, [one.speed for one in some], "", "speed", self._decimals),
            "i": Column([one.modes[0] for one in some], heading="i"),
            "j": Column([one.sign * one.modes[1] for one in some], heading="j", text=digits("+.0f")),
            "k": Column([one.order for one in some], heading="k"),
        }
        more = len(self.combinations) - len(some)
        parts = [f"and {more} at lower speeds"] * bool(more)
        parts += ["i = j: parametric resonances of one mode"] * any(len({*one.modes}) == 1 for one in some)
        caption = "; ".join(parts) or None
        return table_of(f"Combinations (ω̄i ± ω̄j)/k, {self.system.speed_unit.name}", columns, caption=caption)


def _height(values: list[float | None], unit: str, meaning: str) -> Column:
    """Heights of maxima; where one is many times another, each has its own digits."""
    heights = [abs(value) for value in values if value and math.isfinite(value)]
    column = sized(values, unit, meaning, "height", 5, max(heights, default=0.0))
    if heights and max(heights) > _MOST_DECADES * min(heights):
        column = column._replace(text=digits(".4e", prefixed(unit, max(heights))[0]))
    texts = ["∞" if value == math.inf else text for value, text in zip(values, column.texts, strict=True)]
    return column._replace(text=texts)


def _draw_response(axes: Axes, found: CriticalSpeeds) -> None:
    maxima = found.maxima("response")
    known = np.where(np.isfinite(found.response), np.abs(found.response), np.nan)
    factor = label_quantity(axes, found.system, found.quantity, known, found.figure)
    stable = np.where(found.unstable, np.nan, found.response)
    speeds, response = curve(found.speeds, stable, [*maxima, *growing(found.speeds, stable, found.unbounded)])
    axes.plot(found.system.speed_unit.of(speeds), response * factor, color=BLUE)
    bounded = [(speed, height) for speed, height in maxima if math.isfinite(height)]
    every = np.abs([*stable[np.isfinite(stable)], *(height for _, height in bounded)])
    largest, least = every.max(initial=0.0) * factor, every.min(initial=np.inf) * factor
    if least > 0 and (found.unbounded or largest > _MOST_DECADES * least):
        axes.set_yscale("log")
        axes.set_ylim(least / _ROOM, largest * _ROOM)
    draw_marks(axes, found.system.speed_unit, bounded, factor, BLUE, "maximum")
    for at, speed in enumerate(found.unbounded):
        style = {"color": BLUE, "linewidth": 0.9, "linestyle": ":", "marker": "^", "markevery": [1]}
        axes.axvline(found.system.speed_unit.of(speed), label="" if at else "beyond all bounds", **style)
    shade(axes, found.system.speed_unit, found.speeds, found.unstable)
    legend(axes)


def _draw_multiplier(axes: Axes, found: CriticalSpeeds) -> None:
    """Real part of the dominant multiplier on a scale of sign and root, which shows small ones too."""
    power = 0.25

    def rooted(values: Array) -> Array:
        return np.sign(values) * np.abs(values) ** power

    maxima = found.maxima("multiplier")
    # Where only orders above the highest lie it turns faster than the speeds tell.
    seen = lowest_elastic(found.frequencies) <= (found.orders + 0.5) * found.speeds
    speeds, real_part = curve(found.speeds, np.where(seen, found.real_part, np.nan), maxima)
    shown = found.system.speed_unit.of
    axes.plot(shown(speeds), rooted(real_part), color=VERMILION, linewidth=0.9, label="Re ρ")
    at, radius = curve(found.speeds, found.radius, found.maxima("radius"))
    for sign, label in ((1, "±|ρ|"), (-1, None)):
        dots = {"color": GREY, "linewidth": 0.7, "linestyle": ":", "label": label}
        axes.plot(shown(at), sign * rooted(radius), **dots)
    every = ((found.maxima("radius"), GREY, "largest |ρ|"), (maxima, VERMILION, "largest Re ρ"))
    for some, color, name in every:
        marks = [(speed, float(rooted(np.array(height)))) for speed, height in some]
        draw_marks(axes, found.system.speed_unit, marks, 1, color, name)
    reach = float(np.nanmax(found.radius, initial=1e-12))
    ticks = [size for size in 10.0 ** np.arange(-12, 4) if 1e-4 * reach < size <= 1.3 * reach][-3:]
    places = [0.0, *ticks, *(-size for size in ticks)]
    axes.set_yticks([float(rooted(np.array(place))) for place in places], [f"{place:g}" for place in places])
    axes.set_ylabel("dominant\nmultiplier")
    axes.set_title("dominant Floquet multiplier", loc="left", color=GREY)
    shade(axes, found.system.speed_unit, found.speeds, found.unstable)
    legend(axes)


def _draw_campbell(axes: Axes, found: CriticalSpeeds) -> None:
    from matplotlib.ticker import MaxNLocator

    unit, divided = found.system.speed_unit, found.divided
    speeds = unit.of(found.speeds)
    orders = sorted({order for *_, order in divided})
    shown = sorted({mode for _, mode, _ in divided}) or [1 + int(found.frequencies.any(axis=0).argmax())]
    top = _HEADROOM * float(np.nanmax(found.frequencies[:, [mode - 1 for mode in shown]])) / (2 * math.pi)
    for order in orders:
        rays = order * found.speeds / (2 * math.pi)
        axes.plot(speeds, rays, color=LIGHT if order % 5 else GREY, linewidth=0.7, zorder=1)
        if order <= 12 or order % 5 == 0:
            label_order(
                axes, unit, found.speeds, order, found.frequencies[:, [mode - 1 for mode in shown]], top
            )
    axes.plot([], [], color=GREY, linewidth=0.7, label="orders of rotation")
    for mode in shown:
        label = "mean natural frequency" if mode == shown[0] else None
        axes.plot(speeds, found.frequencies[:, mode - 1] / (2 * math.pi), color=BLACK, zorder=3, label=label)
    crossed = [(unit.of(speed), order * speed / (2 * math.pi)) for speed, _, order in divided]
    if crossed:
        axes.plot(*zip(*crossed, strict=True), "o", color=GREEN, zorder=4, label="integer division")
    axes.set_ylim(0.0, top)
    axes.yaxis.set_major_locator(MaxNLocator(6))
    axes.set_ylabel("mean natural\nfrequency (Hz)")
    axes.set_title("Campbell diagram", loc="left", color=GREY)
    legend(axes)


_ALL = _draw_response, _draw_multiplier, _draw_campbell
