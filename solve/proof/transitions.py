"""Bounds on the transition matrices of a linear system over a period.

Ψ(t, s) maps a state at s to the state at t ≥ s, and Y(t) = Ψ(t, 0). The bounds are

    κ ≥ sup_t ‖Y(t)‖,    τ ≥ sup_t ∫_0^t ‖Ψ(t, s)‖ ds.

A step is divided into cells with ∫‖A‖ ≤ a on each, so that ‖Ψ‖ ≤ e^a within a cell. Between the ends c ≤ d of
cells of one step with the polynomial Ỹ, Ψ = Ỹ(τ_d) Ỹ(τ_c)⁻¹, evaluated with balls. Between different steps, Ψ
is a product of maps:

    ‖Ψ(t, s)‖ ≤ ‖Ψ(t, t_i)‖ ‖Ψ(t_i, t_{j+1})‖ ‖Ψ(t_{j+1}, s)‖,    s in step j, t in step i > j."""

import math
from dataclasses import dataclass

from solve.errors import StepsError
from solve.proof.balls import Ball, Matrix, arb, arb_mat, largest, norm, precision, widened
from solve.proof.step import BOUNDS, Step
from solve.proof.turn import Turn, homogeneous

_CELL = 0.5
"""Largest ∫‖A‖ over a cell. Chosen by judgement: the part of a cell at each end of Ψ increases the bounds by
at most a factor of e^0.5."""


@dataclass(frozen=True)
class StepBounds:
    """Upper bounds for a step from t_i to t_{i+1}.

    growth: sup_t ‖Ψ(t, t_i)‖. to_end: ∫ ‖Ψ(t_{i+1}, s)‖ ds. inside: sup_t ∫_{t_i}^t ‖Ψ(t, s)‖ ds."""

    growth: Ball
    to_end: Ball
    inside: Ball


@dataclass(frozen=True)
class Transitions:
    """Bounds κ and τ for a period, and the bounds for each of its steps."""

    kappa: Ball
    tau: Ball
    steps: tuple[StepBounds, ...]


def transitions(turn: Turn) -> Transitions:
    """Bounds on the transition matrices of a period."""
    steps = tuple(_on_step(*each) for each in zip(turn.steps, turn.lengths, strict=True))
    norms = _norms([homogeneous(step.map) for step in turn.steps])
    kappas, taus = [], []
    for i, on_step in enumerate((*steps, StepBounds(arb(1), arb(0), arb(0)))):
        before = sum((norms[j + 1, i] * steps[j].to_end for j in range(i)), arb(0))
        kappas.append(on_step.growth * norms[0, i])
        taus.append(on_step.growth * before + on_step.inside)
    return Transitions(largest(kappas), largest(taus), steps)


def _norms(maps: list[Matrix]) -> dict[tuple[int, int], Ball]:
    """Norms of the products of the maps j, …, i−1, with keys (j, i). Products are formed by repeated halving,
    so that radii grow with log₂ of the number of maps instead of exponentially with this number."""
    found = {(i, i): arb(1) for i in range(len(maps) + 1)}

    def fill(first: int, last: int) -> None:
        if last - first < 2:
            found[first, last] = norm(maps[first])
            return
        middle = (first + last) // 2
        to_middle = dict(enumerate(_to_end(maps[first:middle]), first))
        from_middle = dict(enumerate(_from_start(maps[middle:last]), middle + 1))
        for j, before in to_middle.items():
            for i, after in from_middle.items():
                found[j, i] = norm(after * before)
        fill(first, middle)
        fill(middle, last)

    with precision(BOUNDS):
        fill(0, len(maps))
    return found


def _from_start(maps: list[Matrix]) -> list[Matrix]:
    """Products of the first map, of the first two maps, and so on, formed by repeated halving."""
    if len(maps) < 2:
        return maps
    first, second = (_from_start(half) for half in (maps[: len(maps) // 2], maps[len(maps) // 2 :]))
    return [*first, *(map * first[-1] for map in second)]


def _to_end(maps: list[Matrix]) -> list[Matrix]:
    """Products of all maps, of all maps except the first, and so on to the last map alone. Products are
    formed by repeated halving."""
    if len(maps) < 2:
        return maps
    first, second = (_to_end(half) for half in (maps[: len(maps) // 2], maps[len(maps) // 2 :]))
    return [*(second[0] * map for map in first), *second]


def _on_step(step: Step, length: Ball) -> StepBounds:
    cells = max(1, math.ceil(float(step.advance) / _CELL))
    within, width = (step.advance / cells).exp(), (length / cells).upper()
    at = [_value(step, arb(c) / cells) for c in range(cells + 1)]
    growth = within * largest(norm(Y) for Y in at[:-1])
    if cells == 1:
        return StepBounds(growth.upper(), (within * width).upper(), (within * width).upper())
    try:
        inverses = [Y.inv() for Y in at]
    except ZeroDivisionError:
        raise StepsError(
            "no bound on the transition matrices: a step is too long for the number of digits"
        ) from None
    sums = [
        sum((norm(at[d] * inverses[c + 1]) for c in range(d)), arb(0)) * within * width
        for d in range(cells + 1)
    ]
    inside = within * largest(sums[:-1]) + within * width
    return StepBounds(growth.upper(), sums[-1].upper(), inside.upper())


def _value(step: Step, at: Ball) -> Matrix:
    """Enclosure of Y at a fraction of the step, without the load."""
    total = step.terms[-1]
    for term in reversed(step.terms[:-1]):
        total = total * at + term
    return arb_mat([row[:-1] for row in widened(total, step.error).table()])
