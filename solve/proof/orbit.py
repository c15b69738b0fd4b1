"""Enclosures of the states of the periodic solution and of the extrema of its coordinates."""

import heapq
import math
from collections.abc import Callable, Sequence
from functools import partial

from solve.errors import ResonanceError
from solve.proof.balls import Ball, Matrix, above, arb, arb_mat, largest
from solve.proof.turn import Turn

_WIDTH = 1e-12
"""Difference between the bounds on a maximum, relative to their size, at which the search ends. Chosen by
judgement."""

_SHORTEST = 2.0**-30
"""Length of an interval, as a fraction of the step, at which halving ends: the enclosure of the solution is
then wider than its variation over the interval."""

_CELLS = 20_000
"""Largest number of intervals that are examined for a maximum. Chosen by judgement."""


def states(turn: Turn, n: int, Phi: Matrix) -> list[Matrix]:
    """States (2n+1, 1) of the periodic solution at the start of each step. Raises ResonanceError if 1 − Φ may
    be singular."""
    size = 2 * n
    difference = arb_mat([[int(i == j) - Phi[i, j] for j in range(size)] for i in range(size)])
    forced = arb_mat([[Phi[i, size]] for i in range(size)])
    try:
        start = difference.solve(forced)
    except ZeroDivisionError:
        raise ResonanceError(
            "1 − Φ may be singular, so that no periodic solution is proved; more digits may decide, unless "
            "the speed is at a resonance"
        ) from None
    return turn.states(arb_mat([*start.table(), [arb(1)]]))


def position_and_rate(state: Matrix) -> Matrix:
    """Return the scaled state y (2n, 1): `state` without its last entry, which is the unit load."""
    return arb_mat(state.table()[:-1])


def polynomials(turn: Turn, states: list[Matrix], row: Matrix) -> list[tuple[list[Ball], Ball]]:
    """Return, for each step, a polynomial that approximates a linear combination of the state: its
    coefficients of the powers of τ, and a bound on its error. `row` (1, 2n) contains the factors of the
    combination."""
    weight = sum((entry.abs_upper() for entry in row.entries()), arb(0))
    found = []
    for step, state in zip(turn.steps, states, strict=True):
        size = largest(entry.abs_upper() for entry in state.entries())
        coefficients = [(row * (term * state))[0, 0] for term in step.terms]
        found.append((coefficients, (weight * size * step.error).upper()))
    return found


def largest_modulus(pieces: list[tuple[list[Ball], Ball]], width: float = _WIDTH) -> tuple[Ball, Ball]:
    """Return a lower and an upper bound on the maximum of |p(τ)| over 0 ≤ τ ≤ 1 and over all polynomials
    p."""
    return maximum([partial(_on, piece) for piece in pieces], width, _CELLS)


def maximum(
    bounds: Sequence[Callable[[float, float], tuple[Ball, Ball]]], width: float, cells: int
) -> tuple[Ball, Ball]:
    """Return a lower and an upper bound on the maximum of several functions of τ over 0 ≤ τ ≤ 1.

    bounds: for each function, a callable that returns a lower and an upper bound on the maximum of the
    function over an interval of τ. The interval with the largest upper bound is halved until this bound is
    close to the largest lower bound, or until `cells` intervals have been halved. Bounds are rounded up to
    doubles, so that they can be sorted exactly."""
    low, heap = arb(0), [(-math.inf, at, 0.0, 1.0) for at in range(len(bounds))]
    for _ in range(cells):
        bound, at, start, end = heap[0]
        if (low > 0 and arb(-bound) - low < width * low) or end - start < _SHORTEST:
            break
        heapq.heappop(heap)
        middle = (start + end) / 2
        for first, second in ((start, middle), (middle, end)):
            least, most = bounds[at](first, second)
            low = least if least > low else low
            heapq.heappush(heap, (-above(most), at, first, second))
    return low, arb(-heap[0][0])


def _on(piece: tuple[list[Ball], Ball], start: float, end: float) -> tuple[Ball, Ball]:
    """Return a lower bound on |p| at the middle of an interval, and an upper bound on |p| over the interval.
    The upper bound is computed by the second-order mean-value form."""
    coefficients, error = piece
    middle, half = (arb(start) + arb(end)) / 2, (arb(end) - arb(start)) / 2
    value, slope, curvature = derivatives_on(coefficients, middle, arb(start).union(arb(end)))
    low = (abs(value) - error).lower()
    high = (abs(value) + abs(slope) * half + curvature * half**2 / 2 + error).upper()
    return low, high


def derivatives_on(coefficients: list[Ball], middle: Ball, cell: Ball) -> tuple[Ball, Ball, Ball]:
    """Return the values of p and p′ at the middle, and a bound on |p″| over the cell, all computed by
    Horner's scheme."""
    value, slope, second = arb(0), arb(0), arb(0)
    first_on, value_on = arb(0), arb(0)
    for c in reversed(coefficients):
        slope = slope * middle + value
        value = value * middle + c
        second = second * cell + 2 * first_on
        first_on = first_on * cell + value_on
        value_on = value_on * cell + c
    return value, slope, second.abs_upper()
