"""Bounds on the transition matrices of a linear system over a period.

Ψ(t, s) maps a state at s to the state at t ≥ s, Y(t) = Ψ(t, 0). Wanted are

    κ ≥ sup_t ‖Y(t)‖,    τ ≥ sup_t ∫_0^t ‖Ψ(t, s)‖ ds.

A step is divided into cells with ∫‖A‖ ≤ a on each, so that ‖Ψ‖ ≤ e^a within a cell. Between the ends of cells
c ≤ d of a step with the polynomial Ỹ, Ψ = Ỹ(τ_d) Ỹ(τ_c)⁻¹ in balls. Between steps Ψ is a product of maps:

    ‖Ψ(t, s)‖ ≤ ‖Ψ(t, t_i)‖ ‖Ψ(t_i, t_{j+1})‖ ‖Ψ(t_{j+1}, s)‖,    s in step j, t in step i > j.
"""

import math
from dataclasses import dataclass

from solve.errors import StepsError
from solve.proof.balls import Ball, Matrix, arb, arb_mat, largest, norm, widened
from solve.proof.step import Step
from solve.proof.turn import Turn

_CELL = 0.5
"""Largest ∫‖A‖ of a cell: bounds are then too large by at most e^0.5 for each end of Ψ."""


@dataclass(frozen=True)
class StepBounds:
    """Upper bounds on a step from t_i to t_{i+1}.

    growth : sup_t ‖Ψ(t, t_i)‖
    to_end : ∫ ‖Ψ(t_{i+1}, s)‖ ds
    inside : sup_t ∫_{t_i}^t ‖Ψ(t, s)‖ ds
    """

    growth: Ball
    to_end: Ball
    inside: Ball


@dataclass(frozen=True)
class Transitions:
    """κ and τ of a period, and the bounds on its steps."""

    kappa: Ball
    tau: Ball
    steps: tuple[StepBounds, ...]


def transitions(turn: Turn) -> Transitions:
    """Bounds on the transition matrices of a period."""
    steps = tuple(_on_step(*each) for each in zip(turn.steps, turn.lengths, strict=True))
    products: list[Matrix] = []
    kappas, taus = [], []
    start: Matrix | None = None
    for i, on_step in enumerate((*steps, StepBounds(arb(1), arb(0), arb(0)))):
        # products[j] leads from the end of step j to the start of step i.
        before = sum((norm(P) * steps[j].to_end for j, P in enumerate(products)), arb(0))
        kappas.append(on_step.growth * (arb(1) if start is None else norm(start)))
        taus.append(on_step.growth * before + on_step.inside)
        if i == len(steps):
            break
        map = _homogeneous(turn.steps[i].map)
        start = map if start is None else map * start
        identity = arb_mat([[int(a == b) for b in range(map.ncols())] for a in range(map.nrows())])
        products = [map * P for P in products] + [identity]
    return Transitions(largest(kappas), largest(taus), steps)


def _homogeneous(map: Matrix) -> Matrix:
    """The map of the state without the load."""
    return arb_mat([row[:-1] for row in map.table()[:-1]])


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
