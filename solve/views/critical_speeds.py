"""Figures and tables of critical speeds: response, dominant multiplier and Campbell diagram versus speed."""

import math
from collections.abc import Sequence

import numpy as np

from solve.arrays import Array, runs
from solve.period.natural import lowest_elastic
from solve.results.contents import Column, digits, speeds_of
from solve.results.critical_speeds import MOST_DECADES, CriticalSpeeds
from solve.results.formatting import named
from solve.units import ShownUnit
from solve.views.panels import HEADROOM, label_quantity, legend_above, panels_over, through
from solve.views.show import figure, tables
from solve.views.style import BLACK, BLUE, GREEN, GREY, LIGHT, ORANGE, VERMILION, Axes, Figure
from solve.views.tables import MOST_LISTED, RenderableType, Table, table_of, text

_CAPTIONS = {
    "–": 'mode "–": no division of a frequency and no combination up to order {0} explains the row',
    "?": 'mode "?": several combinations of modes match the speed of the row equally well',
    "+": "mode i+j: (ω̄i + ω̄j)/k",
    "−": "mode i−j: (ω̄i − ω̄j)/k",
    "|ρ|": "multiplier: speed of the maximum of Re ρ or, in rows without Re ρ, of |ρ|",
}

_ROOM = 1.6
"""Factor by which the limits of a logarithmic axis exceed the range of the curves."""

_CLEAR, _ASIDE = 0.05, 0.015
"""Vertical distance of labels from curves and from each other, as a fraction of the height; and horizontal
distance of labels from the frame, as a fraction of the width. Labels of similar height are at least twice the
horizontal distance apart."""


@figure.register(CriticalSpeeds)
def critical_speeds_figure(found: CriticalSpeeds, *, campbell: bool = False) -> Figure:
    """Figure of the response, the dominant multiplier and the Campbell diagram versus speed. If `campbell` is
    True, the multiplier is omitted."""
    drawn = [_draw_response, _draw_multiplier, _draw_campbell]
    if campbell:
        drawn.remove(_draw_multiplier)
    title = "Campbell diagram" if campbell else "critical speeds"
    height, ratios = (5.4, (0.9, 1.3)) if campbell else (7.6, (1.1, 0.9, 1.3))
    with panels_over(found.system, found.speeds, title, height, len(drawn), ratios=ratios) as (page, panels):
        for axes, draw in zip(panels, drawn, strict=True):
            draw(axes, found)
    return page


@tables.register(CriticalSpeeds)
def critical_speeds_tables(found: CriticalSpeeds) -> Sequence[RenderableType]:
    """Tables of critical speeds, of unstable ranges and of combination resonances."""
    unit = found.system.labels.speed_unit
    span = unit.span(found.speeds[0], found.speeds[-1])
    none = text(f"\nno maximum and no division up to order {found.orders} found from {span}")
    found_tables: list[RenderableType] = [_rows_table(found) if found.rows else none]
    if found.unstable_ranges:
        found_tables.append(table_of(f"Unstable among the speeds, {unit.name}", found.unstable_columns))
    if found.combinations:
        found_tables.append(_combinations_table(found))
    return found_tables


def _rows_table(found: CriticalSpeeds) -> Table:
    columns = {**found.columns}
    heights = columns["response_height"]
    # The table fits 80 columns if the unit is in the title.
    columns["response_height"] = heights._replace(heading="height")
    heading = heights.heading.replace("height", named(found.figure, found.quantity))
    title = f"Critical speeds in {found.system.labels.speed_unit.name}; height: {heading}"
    caption = "ω̄: mean of a natural frequency over the cycle, at the speed and at rest"
    for sign, rule in _CAPTIONS.items():
        if any(sign in row.explained[0] or (sign == "|ρ|" and row.radius) for row in found.rows):
            caption += f"\n{rule.format(found.orders)}"
    if found.unbounded:
        caption += "\n∞: unbounded response"
    return table_of(title, columns, caption=caption)


def _combinations_table(found: CriticalSpeeds) -> Table:
    some = found.combinations[:MOST_LISTED]
    columns = {
        "speed": speeds_of(found.system, [one.speed for one in some], "", "speed", found.decimals),
        "i": Column([one.modes[0] for one in some], heading="i"),
        "j": Column([one.sign * one.modes[1] for one in some], heading="j", text=digits("+.0f")),
        "k": Column([one.order for one in some], heading="k"),
    }
    more = len(found.combinations) - len(some)
    parts = [f"and {more} at lower speeds"] * bool(more)
    parts += ["i = j: parametric resonances of one mode"] * any(len({*one.modes}) == 1 for one in some)
    caption = "; ".join(parts) or None
    return table_of(
        f"Combinations (ω̄i ± ω̄j)/k, {found.system.labels.speed_unit.name}", columns, caption=caption
    )


def _curve(speeds: Array, values: Array, marks: Sequence[tuple[float, float]]) -> tuple[Array, Array]:
    """Return an interpolated curve through the computed points and the maxima `marks` between them."""
    return through(*np.array([*zip(speeds, values, strict=True), *marks]).T)


def _near_poles(speeds: Array, response: Array, poles: Sequence[float]) -> list[tuple[float, float]]:
    """Return points of the response curve between each pole and the neighbouring speeds in the ascending
    `speeds` (P,). A pole is a speed at which the response is unbounded. Near a pole, the `response` (P,) is
    inversely proportional to the distance from the pole."""
    points, distances = [], np.geomspace(1.0, 1e-3, 24)[1:]
    for pole in poles:
        above = int(np.searchsorted(speeds, pole))
        for k in {above - 1, above} & set(range(len(response))):
            near = (pole + (speeds[k] - pole) * distances).tolist()
            points += zip(near, (response[k] / distances).tolist(), strict=True)
    return points


def _draw_marks(
    axes: Axes, unit: ShownUnit, marks: Sequence[tuple[float, float]], factor: float, color: str, label: str
) -> None:
    """Mark maxima, which are given as pairs of a speed (rad/s) and a height."""
    if marks:
        speeds, heights = np.array(marks).T
        style = {"color": color, "markersize": 4.5, "zorder": 4, "label": label}
        axes.plot(unit.from_si(speeds), heights * factor, "v", **style)


def _shade(axes: Axes, unit: ShownUnit, speeds: Array, unstable: Array) -> None:
    """Shade an interval around each unstable speed. The interval extends halfway to the neighbouring speeds.
    `unstable` (P,) is a mask of the ascending `speeds` (P,)."""
    shown = unit.from_si(speeds)
    between = np.concatenate((shown[:1], (shown[1:] + shown[:-1]) / 2, shown[-1:]))
    style = {"color": ORANGE, "alpha": 0.3, "linewidth": 0}
    for at, (first, last) in enumerate(runs(unstable).tolist()):
        ends = between[[first, last + 1]].tolist()
        axes.axvspan(*ends, label="" if at else "unstable", **style)


def _label_order(
    axes: Axes, unit: ShownUnit, speeds: Array, order: int, frequencies: Array, top: float
) -> None:
    """Label the ray of an order where there is space: below `top` (Hz), and away from other labels and from
    the frequencies (P, k), in rad/s."""
    clear = _CLEAR * top * 2 * math.pi
    ray = order * speeds
    free = (ray < 2 * math.pi * top - clear) & (np.abs(ray[:, None] - frequencies) > clear).all(axis=1)
    span = np.ptp(speeds)
    free &= np.minimum(speeds - speeds[0], speeds[-1] - speeds) > _ASIDE * span
    for other in axes.texts:
        x, y = other.get_position()
        beside = np.abs(unit.from_si(speeds) - x) > 2 * _ASIDE * unit.from_si(span)
        free &= beside | (np.abs(ray / (2 * math.pi) - y) > _CLEAR * top)
    if free.any():
        at = speeds[free][-1]
        box = {"boxstyle": "square,pad=0.1", "fc": "white", "ec": "none"}
        place = unit.from_si(at), order * at / (2 * math.pi)
        axes.text(*place, str(order), color=GREY, fontsize=7, ha="center", va="center", bbox=box, zorder=2)


def _draw_response(axes: Axes, found: CriticalSpeeds) -> None:
    maxima = found.maxima("response")
    heights = np.where(np.isfinite(found.response), np.abs(found.response), np.nan)
    factor = label_quantity(axes, found.system, found.quantity, heights, found.figure)
    stable = np.where(found.unstable, np.nan, found.response)
    speeds, response = _curve(
        found.speeds, stable, [*maxima, *_near_poles(found.speeds, stable, found.unbounded)]
    )
    axes.plot(found.system.labels.speed_unit.from_si(speeds), response * factor, color=BLUE)
    bounded = [(speed, height) for speed, height in maxima if math.isfinite(height)]
    shown_heights = np.abs([*stable[np.isfinite(stable)], *(height for _, height in bounded)])
    largest, least = shown_heights.max(initial=0.0) * factor, shown_heights.min(initial=np.inf) * factor
    if least > 0 and (found.unbounded or largest > MOST_DECADES * least):
        axes.set_yscale("log")
        axes.set_ylim(least / _ROOM, largest * _ROOM)
    _draw_marks(axes, found.system.labels.speed_unit, bounded, factor, BLUE, "maximum")
    for at, speed in enumerate(found.unbounded):
        style = {"color": BLUE, "linewidth": 0.9, "linestyle": ":", "marker": "^", "markevery": [1]}
        axes.axvline(found.system.labels.speed_unit.from_si(speed), label="" if at else "unbounded", **style)
    _shade(axes, found.system.labels.speed_unit, found.speeds, found.unstable)
    legend_above(axes, 5)


def _draw_multiplier(axes: Axes, found: CriticalSpeeds) -> None:
    """Draw the real part of the dominant multiplier on a signed fourth-root scale, on which small values are
    visible."""
    power = 0.25

    def rooted(values: Array) -> Array:
        return np.sign(values) * np.abs(values) ** power

    maxima = found.maxima("multiplier")
    # At speeds at which only resonances of higher orders occur, the grid does not resolve the rotation of the
    # multiplier.
    seen = lowest_elastic(found.frequencies) <= (found.orders + 0.5) * found.speeds
    speeds, real_part = _curve(found.speeds, np.where(seen, found.real_part, np.nan), maxima)
    shown = found.system.labels.speed_unit.from_si
    axes.plot(shown(speeds), rooted(real_part), color=VERMILION, linewidth=0.9, label="Re ρ")
    at, radius = _curve(found.speeds, found.radius, found.maxima("radius"))
    for sign, label in ((1, "±|ρ|"), (-1, None)):
        dots = {"color": GREY, "linewidth": 0.7, "linestyle": ":", "label": label}
        axes.plot(shown(at), sign * rooted(radius), **dots)
    marked = ((found.maxima("radius"), GREY, "largest |ρ|"), (maxima, VERMILION, "largest Re ρ"))
    for some, color, name in marked:
        marks = [(speed, float(rooted(np.array(height)))) for speed, height in some]
        _draw_marks(axes, found.system.labels.speed_unit, marks, 1, color, name)
    reach = float(np.nanmax(found.radius, initial=1e-12))
    ticks = [size for size in 10.0 ** np.arange(-12, 4) if 1e-4 * reach < size <= 1.3 * reach][-3:]
    ticks_both = [0.0, *ticks, *(-size for size in ticks)]
    axes.set_yticks(
        [float(rooted(np.array(place))) for place in ticks_both], [f"{place:g}" for place in ticks_both]
    )
    axes.set_ylabel("dominant\nmultiplier")
    axes.set_title("dominant Floquet multiplier", loc="left", color=GREY)
    _shade(axes, found.system.labels.speed_unit, found.speeds, found.unstable)
    legend_above(axes, 5)


def _draw_campbell(axes: Axes, found: CriticalSpeeds) -> None:
    from matplotlib.ticker import MaxNLocator

    unit, divided = found.system.labels.speed_unit, found.divided
    speeds = unit.from_si(found.speeds)
    orders = sorted({order for *_, order in divided})
    shown = sorted({mode for _, mode, _ in divided}) or [1 + int(found.frequencies.any(axis=0).argmax())]
    top = HEADROOM * float(np.nanmax(found.frequencies[:, [mode - 1 for mode in shown]])) / (2 * math.pi)
    for order in orders:
        rays = order * found.speeds / (2 * math.pi)
        axes.plot(speeds, rays, color=LIGHT if order % 5 else GREY, linewidth=0.7, zorder=1)
        if order <= 12 or order % 5 == 0:
            _label_order(
                axes, unit, found.speeds, order, found.frequencies[:, [mode - 1 for mode in shown]], top
            )
    axes.plot([], [], color=GREY, linewidth=0.7, label="orders of rotation")
    for mode in shown:
        label = "mean natural frequency" if mode == shown[0] else None
        axes.plot(speeds, found.frequencies[:, mode - 1] / (2 * math.pi), color=BLACK, zorder=3, label=label)
    crossed = [(unit.from_si(speed), order * speed / (2 * math.pi)) for speed, _, order in divided]
    if crossed:
        axes.plot(*zip(*crossed, strict=True), "o", color=GREEN, zorder=4, label="integer division")
    axes.set_ylim(0.0, top)
    axes.yaxis.set_major_locator(MaxNLocator(6))
    axes.set_ylabel("mean natural\nfrequency (Hz)")
    axes.set_title("Campbell diagram", loc="left", color=GREY)
    legend_above(axes, 5)
