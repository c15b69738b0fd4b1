"""Figures and tables of stability at one speed: multipliers, verdict and proofs."""

import math
from collections.abc import Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.errors import counted
from solve.period.multipliers import VERDICTS
from solve.proof.result import Proof, ProvedOrbit
from solve.results.stability import Stability
from solve.units import raised
from solve.views.panels import titled
from solve.views.show import brief, figure, heading_of, tables
from solve.views.style import BLACK, BLUE, GREY, VERMILION, Axes, Figure, SubFigure, page
from solve.views.tables import RenderableType, assembled, stacked, table, text

CIRCLE_ROW = 2.45
"""Height in inches of the panels that show multipliers."""

_CLOSER = 0.4
"""If the spectral radius is below this value, multipliers are also drawn magnified. Chosen by judgement."""

_MOST_MULTIPLIERS = 8
"""Maximum number of multipliers in a table. Chosen by judgement."""

VERDICT_STYLES = dict(zip(VERDICTS, ("bold green", "bold yellow", "bold red", "bold magenta"), strict=True))
"""Styles of the verdicts."""


@figure.register(Stability)
def stability_figure(result: Stability) -> Figure:
    """Figure of the multipliers and the unit circle; small multipliers are also shown magnified."""
    with page(CIRCLE_ROW + 0.4, titled(result.system, result.speed)) as figure:
        draw_stability(figure, result)
    return figure


@tables.register(Stability)
def stability_tables(result: Stability) -> Sequence[RenderableType]:
    """Table of the multipliers, and the verdict."""
    return [_multiplier_table(result), _verdict_line(result)]


@brief.register(Stability)
def stability_in_brief(result: Stability) -> RenderableType:
    """Short form of the result, with heading and verdict."""
    return stacked(heading_of(result), _verdict_line(result))


def _multiplier_table(result: Stability) -> RenderableType:
    """Return a table of the multipliers, with growth rates and frequencies, and with one row per conjugate
    pair."""
    multipliers = zip(
        result.multipliers, result.exponents, result.modes, result.multiplier_errors, strict=True
    )
    pairs = [row[:3] for row in multipliers if not (np.imag(row[0]) < 0 or math.isnan(row[3]))]
    rows = [
        (
            f"{rho.real:.6g}",
            f"±{rho.imag:.6g}" if rho.imag else "0",
            f"{abs(rho):.6g}",
            f"{exponent.real:.5g}",
            f"{mode.folded / (2 * math.pi):.5g}",
            "–" if mode.unfolded is None else f"{mode.unfolded / (2 * math.pi):.5g}",
            "–" if mode.order is None else f"{mode.order}",
        )
        for rho, exponent, mode in pairs[:_MOST_MULTIPLIERS]
    ]
    smaller = len(pairs) - _MOST_MULTIPLIERS
    omitted = [f"{smaller} smaller"] * (smaller > 0)
    omitted += [f"{result.unresolved} not accurate to one digit"] * (result.unresolved > 0)
    return table(
        "Floquet multipliers ρ; growth in 1/s; frequency in Hz; folded: modulo 1/T",
        *("Re ρ", "Im ρ", "|ρ|", "growth", "folded", "frequency", "order"),
        left=0,
        rows=rows,
        caption="and " + ", ".join(omitted) if omitted else None,
    )


def _verdict_line(result: Stability) -> RenderableType:
    radius, error = result.spectral_radius, result.error_estimate.multipliers
    style = VERDICT_STYLES[result.verdict]
    line = ["\n", (result.verdict, style), f": spectral radius {radius:.10g} ± {error * radius:.0e}"]
    if result.reduction_error is not None:
        line.append(f", reduction ± {result.reduction_error.spectral_radius * radius:.0e}")
    return assembled(*line)


def draw_stability(place: Figure | SubFigure, result: Stability) -> None:
    """Draw panels with the multipliers, with small multipliers magnified, and with the verdict."""
    from matplotlib.patches import Circle

    rho = result.multipliers[~np.isnan(result.multipliers)]
    radius = float(np.abs(rho).max(initial=0.0))
    closer = 0.0 < radius < _CLOSER
    panels = place.subplots(1, 3 if closer else 2, width_ratios=(1, 1, 0.75) if closer else (1, 1.75))
    _draw_multipliers(panels[0], rho, max(1.0, radius))
    panels[0].add_patch(Circle((0, 0), 1.0, fill=False, color=BLACK, linewidth=0.9))
    panels[0].set_title("Floquet multipliers", loc="left", color=GREY)
    if closer:
        power = math.floor(math.log10(radius)) if radius < 0.1 else 0
        unit = f" ({raised(f'10^{power}')})" if power else ""
        _draw_multipliers(panels[1], rho / 10.0**power, radius / 10.0**power, unit)
        panels[1].add_patch(
            Circle((0, 0), radius / 10.0**power, fill=False, color=GREY, linewidth=0.8, linestyle="--")
        )
        panels[1].set_title("magnified, within the largest", loc="left", color=GREY)
    _write_summary(panels[-1], result)


def _draw_multipliers(axes: Axes, rho: Array, reach: float, unit: str = "") -> None:
    from matplotlib.ticker import MaxNLocator

    axes.axhline(0.0, color=GREY, linewidth=0.5)
    axes.axvline(0.0, color=GREY, linewidth=0.5)
    dots = {"color": BLUE, "markersize": 4.5, "markeredgecolor": "white", "markeredgewidth": 0.5}
    axes.plot(np.real(rho), np.imag(rho), "o", **dots)
    for axis, set_limits in ((axes.xaxis, axes.set_xlim), (axes.yaxis, axes.set_ylim)):
        set_limits(-1.15 * reach, 1.15 * reach)
        axis.set_major_locator(MaxNLocator(5, symmetric=True))
    axes.set_aspect("equal")
    axes.set_xlabel(f"Re ρ{unit}")
    axes.set_ylabel(f"Im ρ{unit}")


def _write_summary(axes: Axes, result: Stability) -> None:
    orbit, multipliers = result.error_estimate
    lines = [
        f"|ρ| max = {result.spectral_radius:.6g}",
        f"{result.method}, {counted(result.steps, 'step')}",
        f"error of multipliers {multipliers:.0e}",
    ]
    if not math.isnan(orbit):
        lines.append(f"error of orbit {orbit:.0e}")
    place: dict[str, Any] = {"va": "top", "transform": axes.transAxes}
    color = VERMILION if result.verdict == "unstable" else BLACK
    axes.axis("off")
    axes.text(0.0, 1.0, result.verdict, fontweight="bold", color=color, **place)
    axes.text(0.0, 0.88, "\n".join(lines), linespacing=1.6, **place)


_LONGEST = 60
"""Number of digits of a bound that fit next to its name in a line of 80 columns."""


def proof_printout(proof: Proof) -> RenderableType:
    """Texts and tables of the verdict, the discs of the multipliers, the bounds on maxima, the true errors,
    and the assumption of the proof."""
    maxima = [_maxima_table(proof)] if proof.max_abs else []
    place = [_place_table(proof, proof.orbit)] if proof.orbit else []
    return stacked(
        _proof_line(proof),
        _disc_table(proof),
        *maxima,
        *place,
        text(_errors(proof)),
        text(f"Assumed: {proof.assumed}."),
    )


def _proof_line(proof: Proof) -> RenderableType:
    low, high = proof.spectral_radius
    return assembled(
        "\nproved: " if proof.proved else "\nnot proved: ",
        (proof.verdict, VERDICT_STYLES[proof.verdict]),
        f"\nspectral radius ≥\n{low}\nspectral radius ≤\n{high}"
        if len(high) > _LONGEST
        else f"\nspectral radius ≥ {low}\n                ≤ {high}",
    )


def _disc_table(proof: Proof) -> RenderableType:
    """Return a table of the discs that contain the multipliers, with one row per conjugate pair."""
    discs = [*zip(proof.multipliers.tolist(), proof.radii.tolist(), proof.isolated.tolist(), strict=True)]
    pairs, rows = [disc for disc in discs if disc[0].imag >= 0 or not disc[2]], []
    for center, radius, isolated in pairs[:_MOST_MULTIPLIERS]:
        pair = isolated and center.imag
        imaginary = f"±{center.imag:.17g}" if pair else f"{center.imag:.17g}"
        count = "one each" if pair else "one" if isolated else "several"
        rows.append((f"{center.real:.17g}", imaginary, rounded(radius, 2, ROUND_CEILING), count))
    caption = f"and {len(pairs) - _MOST_MULTIPLIERS} smaller" if len(pairs) > _MOST_MULTIPLIERS else None
    title, headings = "Discs that contain the multipliers", ("Re ρ", "Im ρ", "radius", "multipliers")
    return table(title, *headings, left=0, rows=rows, caption=caption)


def _maxima_table(proof: Proof) -> RenderableType:
    units = proof.result.system.labels.units
    rows = [
        (name, units[name], rounded(low, 15, ROUND_FLOOR), rounded(high, 15, ROUND_CEILING))
        for name, (low, high) in proof.max_abs.items()
    ]
    return table("Bounds on max|q| over a period", "", "unit", "from", "to", left=2, rows=rows)


def _place_table(proof: Proof, place: ProvedOrbit) -> RenderableType:
    units = proof.result.system.labels.units
    rows = [
        (
            name,
            units[name],
            rounded(radius[0], 2, ROUND_CEILING),
            rounded(place.unique[name][0], 2, ROUND_FLOOR),
        )
        for name, radius in place.radius.items()
    ]
    title = "Distance of the orbit, and of all other orbits, from the Fourier series"
    return table(title, "", "unit", "at most", "at least", left=2, rows=rows)


def _errors(proof: Proof) -> str:
    errors = [f"multipliers {rounded(proof.true_error['multipliers'], 2, ROUND_CEILING)}"]
    if not math.isnan(proof.true_error["orbit"]):
        orbit = rounded(proof.true_error["orbit"], 2, ROUND_CEILING)
        errors.append(f"orbit at {proof.steps} phases {orbit}")
    return f"\nTrue relative errors of the result above are at most: {', '.join(errors)}."


def rounded(value: float, digits: int, rounding: str) -> str:
    """Round a number to `digits` digits in the direction `rounding`, and format it.

    >>> rounded(1.42e-11, 2, ROUND_CEILING)
    '1.5e-11'
    """
    if not math.isfinite(value):
        return str(value)
    number = Context(prec=digits, rounding=rounding).plus(Decimal(value))
    return f"{number.normalize():e}" if digits == 2 and value else f"{number:g}"
