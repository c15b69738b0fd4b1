"""Enclosures of the extrema of outputs along the periodic solution. Outputs are functions of phase, q, q̇ and
q̈.

On a step, y = Ỹx + E with the exact polynomial Ỹ and ‖E‖ ≤ ε‖x‖ for the state x at its start. Since m E₂′ =
−h r_y E − D₂, and ε contains the factor max(1, ‖m⁻¹‖) Σ‖D_k‖, also ‖E₂′‖ ≤ (h‖A‖ + 1) ε‖x‖ for the derivative
with respect to τ. Hence q, q̇ and q̈ are polynomials with bounded errors. On an interval of τ, the
second-order mean value form encloses them in balls, for which the generated function is evaluated."""

from dataclasses import dataclass, field
from functools import partial

from solve.errors import LinearModelError
from solve.model.model import Model
from solve.proof.balls import Ball, Matrix, arb, arb_mat, largest, number
from solve.proof.equation import Equation
from solve.proof.instructions import Instructions, UndecidedError
from solve.proof.orbit import derivatives_on, maximum
from solve.proof.turn import Turn
from solve.system import PeriodicSystem

_WIDTH = 1e-3
"""Difference between the bounds on a maximum, relative to their size, at which the search ends. Chosen by
judgement: it is not smaller because the radii of the outputs decrease only linearly with the length of the
interval."""

_CELLS = 600
"""Largest number of intervals that are examined for an output. Chosen by judgement."""

Polynomial = tuple[list[Ball], Ball]
"""Type of a polynomial: coefficients of the powers of τ, and a bound on the error."""


@dataclass(frozen=True)
class Outputs:
    """Outputs along the periodic solution of an equation, for steps without jumps of the matrices.

    states: states (2n+1, 1) at the start of each step."""

    instructions: Instructions
    equation: Equation
    turn: Turn
    states: list[Matrix]
    _motions: dict[int, list[list[Polynomial]]] = field(default_factory=dict)
    _found: dict[tuple[int, float, float], list[Ball]] = field(default_factory=dict)

    @classmethod
    def from_system(
        cls, system: PeriodicSystem, equation: Equation, turn: Turn, states: list[Matrix], rounded: bool
    ) -> "Outputs | None":
        """Outputs of a model. None if the model has no outputs, if its matrices jump, or if an output
        contains an operation without an enclosure rule."""
        if not isinstance(system, Model) or not system.outputs or not all(step.load for step in turn.steps):
            return None
        try:
            instructions = Instructions.from_function(
                system.setup.function("outputs"), partial(number, rounded=rounded)
            )
        except LinearModelError:
            return None
        return cls(instructions, equation, turn, states)

    def largest_modulus(self, number: int) -> tuple[Ball, Ball]:
        """Return a lower and an upper bound on the maximum modulus of an output. The upper bound is infinite
        if the branch of a piecewise operation is undecided."""
        steps = range(len(self.turn.steps))
        return maximum([partial(self._bounds, number, at) for at in steps], _WIDTH, _CELLS)

    def _bounds(self, number: int, at: int, start: float, end: float) -> tuple[Ball, Ball]:
        """Return a lower and an upper bound on the maximum modulus of an output on an interval of a step."""
        center = (start + end) / 2
        low, high = self._on(at, center, center)[number], self._on(at, start, end)[number]
        return low.abs_lower(), high.abs_upper()

    def _on(self, at: int, start: float, end: float) -> list[Ball]:
        """Balls that contain the outputs on an interval of the step with index `at`."""
        key = at, start, end
        if key not in self._found:
            self._found[key] = self._evaluated(at, arb(start), arb(end))
        return self._found[key]

    def _evaluated(self, at: int, start: Ball, end: Ball) -> list[Ball]:
        if at not in self._motions:
            self._motions[at] = self._motion(at)
        phase = (self.turn.starts[at] + self.turn.lengths[at] * start).union(
            self.turn.starts[at] + self.turn.lengths[at] * end
        )
        states = [[_range(each, start, end) for each in row] for row in self._motions[at]]
        count = len(self.instructions.entries)
        try:
            values, _ = self.instructions([[phase], [self.equation.speed], *states, self.equation.parameters])
        except UndecidedError:
            return [arb.pos_inf()] * count
        return [entries[0][2] if entries else arb(0) for entries in values]

    def _motion(self, at: int) -> list[list[Polynomial]]:
        """Polynomials of q, q̇ and q̈ on the step with index `at`."""
        equation, n, state = self.equation, self.equation.n, self.states[at]
        step, h = self.turn.steps[at], self.turn.lengths[at]
        T = arb_mat(equation.modes.tolist()) * arb(equation.load)
        TW = arb_mat((equation.modes * equation.frequencies).tolist()) * arb(equation.load)
        size = step.error * largest(entry.abs_upper() for entry in state.entries())
        terms = [(term * state).entries() for term in step.terms]
        position = [arb_mat(n, 1, y[:n]) for y in terms]
        rate = [arb_mat(n, 1, y[n:]) for y in terms]
        change = [y * (k / h) for k, y in enumerate(rate)][1:] or [arb_mat(n, 1)]
        speed = equation.speed
        return [
            _polynomials(T, position, size),
            _polynomials(TW * speed, rate, size),
            _polynomials(TW * speed**2, change, (step.advance + 1) * size / h),
        ]


def _polynomials(matrix: Matrix, terms: list[Matrix], error: Ball) -> list[Polynomial]:
    """Return the product of each row of `matrix` with the vector polynomial whose coefficients are `terms`,
    together with error bounds. `error` bounds the error of each component of the polynomial."""
    products = [(matrix * term).entries() for term in terms]
    errors = [sum((abs(x) for x in row), arb(0)) * error for row in matrix.table()]
    return [([product[i] for product in products], each.upper()) for i, each in enumerate(errors)]


def _range(polynomial: Polynomial, start: Ball, end: Ball) -> Ball:
    coefficients, error = polynomial
    middle, half = (start + end) / 2, (end - start) / 2
    value, slope, curvature = derivatives_on(coefficients, middle, start.union(end))
    return value + arb(0, (abs(slope) * half + curvature * half**2 / 2 + error).upper())
