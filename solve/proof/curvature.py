"""Bounds on the second derivatives of nonlinear equations in a tube around a motion.

Let v = (u, u̇, ü) be the deviation from the motion, and s_a the largest modulus of component a for |(y, z)| ≤
1 in the norm of `solve.proof.existence`. With moduli of the matrix entries and a column 1 of ones, s is λ|T|1
for u, λΩ|TW|1 for u̇, and λΩ²κ₂|TW|1 for ü. For all deviations of norm ≤ ρ and all phases

    Λ ≥ max_i Σ_j |(M T W)⁻¹|_ij Σ_ab |∂²r_j/∂v_a∂v_b| s_a s_b / (Ω² λ),

where the divisor Ω² λ is due to the scaling of the equations."""

from collections.abc import Sequence
from dataclasses import dataclass

from solve.errors import StepsError
from solve.proof.balls import Ball, Matrix, arb, interval, largest
from solve.proof.equation import Equation
from solve.proof.instructions import Instructions, UndecidedError
from solve.proof.turn import Turn

_CELLS = 4
"""Number of intervals of a step on which M⁻¹ is bounded. An interval is halved as long as its bound is
infinite. Chosen by judgement."""

_SHORTEST = 2.0**-12
"""Length of an interval, as a fraction of the step, below which the interval is not halved. Chosen by
judgement."""


@dataclass(frozen=True)
class Cell:
    """Data of an interval of phases: inputs of the equations, and moduli (n, n) of the entries of (M T
    W)⁻¹."""

    inputs: list[Sequence[Ball]]
    inverse: list[list[Ball]]


@dataclass(frozen=True)
class Curvature:
    """Bounds Λ in tubes around the motion of an equation. The cells cover the period.

    second: function that returns the second derivatives of the residual, and the residual. sizes: s (3n,)."""

    equation: Equation
    second: Instructions
    sizes: list[Ball]
    cells: list[Cell]

    @classmethod
    def from_equation(cls, equation: Equation, second: Instructions, turn: Turn, rate: Ball) -> "Curvature":
        """Prepare the bounds for the motion of an equation. rate: κ₂.

        Raises StepsError if, at some phase, M may be singular or the branch of a piecewise operation is
        undecided."""
        cells = []
        for start, h in zip(turn.starts, turn.lengths, strict=True):
            for k in range(_CELLS):
                phase = interval(start + h * k / _CELLS, start + h * (k + 1) / _CELLS)
                cells += _cells(equation, phase, float(phase.rad()) * _SHORTEST)
        return cls(equation, second, sizes_of(equation, rate), cells)

    def over(self, radius: Ball) -> Ball:
        """Bound Λ for deviations of norm ≤ radius.

        Λ is infinite if no bound exists. Λ is also infinite if the residual may have a kink or a jump in the
        tube, because second derivatives then do not bound the remainder N."""
        tube = [arb(0, (radius * size).upper()) for size in self.sizes]
        return largest(self._on(cell, tube) for cell in self.cells)

    def _on(self, cell: Cell, tube: list[Ball]) -> Ball:
        n, sizes = self.equation.n, self.sizes
        phase, speed, *states, p = cell.inputs
        moved = [[x + tube[order * n + i] for i, x in enumerate(row)] for order, row in enumerate(states)]
        try:
            (entries, values), _ = self.second([phase, speed, *moved, p])
        except UndecidedError:
            return arb.pos_inf()
        if not all(value.is_finite() for *_, value in values):
            return arb.pos_inf()
        curvature = [arb(0)] * n
        for row, column, value in entries:
            a, i = divmod(row, n)
            curvature[i] += abs(value) * sizes[a] * sizes[column]
        rows = [sum((x * c for x, c in zip(row, curvature, strict=True)), arb(0)) for row in cell.inverse]
        return largest(rows) / (abs(self.equation.speed) ** 2 * arb(self.equation.load))


def sizes_of(equation: Equation, rate: Ball) -> list[Ball]:
    """Scales s (3n,) of q, q̇ and q̈."""
    T, W = equation.modes.tolist(), equation.frequencies.tolist()
    positions = [sum((abs(arb(x)) for x in row), arb(0)) for row in T]
    rates = [sum((abs(arb(x) * arb(w)) for x, w in zip(row, W, strict=True)), arb(0)) for row in T]
    load, speed = arb(equation.load), abs(equation.speed)
    scaled = ((load, positions), (load * speed, rates), (load * speed**2 * rate, rates))
    return [factor * size for factor, row in scaled for size in row]


def _cells(equation: Equation, phase: Ball, shortest: float) -> list[Cell]:
    inverse = _inverse(equation, phase)
    if inverse is not None:
        rows = [[entry.abs_upper() for entry in row] for row in inverse.table()]
        return [Cell(equation.inputs(phase), rows)]
    if float(phase.rad()) < shortest:
        raise StepsError(
            f"no bound on the equations was found near phase {float(phase.mid()):.9g}: M may be "
            "singular there, or the equations have a kink"
        )
    halves = interval(phase.lower(), phase.mid()), interval(phase.mid(), phase.upper())
    return [cell for half in halves for cell in _cells(equation, half, shortest)]


def _inverse(equation: Equation, phase: Ball) -> Matrix | None:
    try:
        outcomes = equation.outcomes(phase.lower(), phase.upper(), 0)
        inverse = equation.at(phase, outcomes)[0].inv()
    except (UndecidedError, ZeroDivisionError):
        return None
    return inverse if all(entry.is_finite() for entry in inverse.entries()) else None
