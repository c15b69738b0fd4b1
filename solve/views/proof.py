"""A proof in the terminal."""

import math
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal

from solve.proof.result import Proof
from solve.views.stability import VERDICT_STYLES
from solve.views.tables import RenderableType, assembled, stacked, table, text

_MOST_DISCS = 8

_LONGEST = 60
"""Digits of a bound that fit beside its name in 80 columns."""


def proof_printout(proof: Proof) -> RenderableType:
    """Verdict, discs of the multipliers, bounds on maxima, true errors and assumption."""
    maxima = [_maxima_table(proof)] if proof.max_abs else []
    return stacked(
        _verdict_line(proof),
        _disc_table(proof),
        *maxima,
        text(_errors(proof)),
        text(f"Assumed: {proof.assumed}."),
    )


def _verdict_line(proof: Proof) -> RenderableType:
    low, high = proof.spectral_radius
    return assembled(
        "\nproved: " if proof.proved else "\nnot proved: ",
        (proof.verdict, VERDICT_STYLES[proof.verdict]),
        f"\nspectral radius ≥\n{low}\nspectral radius ≤\n{high}"
        if len(high) > _LONGEST
        else f"\nspectral radius ≥ {low}\n                ≤ {high}",
    )


def _disc_table(proof: Proof) -> RenderableType:
    made = table("Discs that contain the multipliers", "Re ρ", "Im ρ", "radius", "multipliers", left=0)
    discs = [*zip(proof.multipliers.tolist(), proof.radii.tolist(), proof.isolated.tolist(), strict=True)]
    shown = [each for each in discs if each[0].imag >= 0 or not each[2]]
    for center, radius, isolated in shown[:_MOST_DISCS]:
        pair = isolated and center.imag
        made.add_row(
            f"{center.real:.17g}",
            f"±{center.imag:.17g}" if pair else f"{center.imag:.17g}",
            rounded(radius, 2, ROUND_CEILING),
            "one each" if pair else "one" if isolated else "several",
        )
    if len(shown) > _MOST_DISCS:
        made.caption = f"and {len(shown) - _MOST_DISCS} smaller"
    return made


def _maxima_table(proof: Proof) -> RenderableType:
    units = proof.result.system.units
    made = table("Bounds on max|q| over a period", "", "unit", "from", "to", left=2)
    for name, (low, high) in proof.max_abs.items():
        made.add_row(name, units[name], rounded(low, 15, ROUND_FLOOR), rounded(high, 15, ROUND_CEILING))
    return made


def _errors(proof: Proof) -> str:
    errors = [f"multipliers {rounded(proof.true_error['multipliers'], 2, ROUND_CEILING)}"]
    if not math.isnan(proof.true_error["orbit"]):
        orbit = rounded(proof.true_error["orbit"], 2, ROUND_CEILING)
        errors.append(f"orbit at {proof.steps} phases {orbit}")
    return f"\nTrue relative errors of the result above are at most: {', '.join(errors)}."


def rounded(value: float, digits: int, rounding: str) -> str:
    """A number with some digits, rounded in a direction.

    >>> rounded(1.42e-11, 2, ROUND_CEILING)
    '1.5e-11'
    """
    if not math.isfinite(value):
        return str(value)
    number = Context(prec=digits, rounding=rounding).plus(Decimal(value))
    return f"{number.normalize():e}" if digits == 2 and value else f"{number:g}"
