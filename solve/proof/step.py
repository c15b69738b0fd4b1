"""Enclosure of the map of one step by a Taylor polynomial with a bound on its defect.

On a step of length h, τ = t/h in [0, 1], the solution Y (2n, 2n+1) with Y(0) = (I, 0) is approximated by a
polynomial Ỹ with exact coefficients. Its defects are D₁ = Ỹ₁′ − hWỸ₂ and D₂ = mỸ₂′ + hr(Ỹ, 1). The error E =
Y − Ỹ satisfies E₁′ = hWE₂ − D₁, m E₂′ + h r_y E = −D₂, E(0) = 0, and by Gronwall's inequality

    ‖E(1)‖ ≤ e^a max(1, μ) Σ_k ‖D_k‖,    a ≥ sup h‖A‖,  μ ≥ sup ‖m⁻¹‖  on the step,  A = [0 W; −m⁻¹r_y].

Cauchy's inequality bounds the coefficients of m and r beyond order J by the supremum S of their norms on the
disc |t| ≤ R: ‖r_j‖h^j ≤ S s^j with s = h/R < 1. They add at most (S s^{J+1}/(1 − s)) Σ_k ‖Z_k‖ to the defect,
with Z = (Ỹ, 1) for r and Z = Ỹ₂′ for m."""

import math
from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.proof.balls import Ball, Matrix, acb, arb, arb_mat, interval, largest, norm, precision, widened
from solve.proof.equation import Equation
from solve.proof.instructions import Outcomes, UndecidedError

_RATIOS = 16, 8, 4, 2
"""Candidates for R/h. A larger ratio requires fewer terms of the coefficients, but the bounds S increase with
the disc."""

_PARTS, _SHORTEST_PART = 4, 2.0**-6
"""Number of intervals of a step on which ‖A‖ and ‖m⁻¹‖ are bounded, and length of an interval, as a fraction
of the step, below which the interval is not halved. Chosen by judgement."""

_MOST_TERMS = 8
"""Largest ratio of the number of terms of the solution to the number of terms of the coefficients. Chosen by
judgement: convergent Taylor series of solutions require a ratio of up to three."""

BOUNDS = 64
"""Working precision in bits for bounds. Chosen by judgement."""


class StepTooLongError(Exception):
    """Raised if a step is too long for an enclosure of the required accuracy."""


@dataclass(frozen=True)
class Step:
    """Enclosure of the solution on a step.

    map: matrix (2n+1, 2n+1) that maps y and the unit load at the start of the step to their values at its
    end. terms: exact coefficients (2n, 2n+1) of τ^k. error: bound on the error of the polynomial at every τ.
    advance: bound on h‖A‖. inverse: bound on max(1, ‖m⁻¹‖). load: for each row of h r_d, the coefficients of
    the powers of τ and an error bound; r_d is the last column of r."""

    map: Matrix
    terms: list[Matrix]
    error: Ball
    advance: Ball
    inverse: Ball
    load: list[tuple[list[Ball], Ball]]


def step(
    equation: Equation, start: Ball, length: Ball, bits: int, most: float, allowed: float | None = None
) -> Step:
    """Enclose the solution on a step, so that h‖A‖ is below `most`, the error is below `allowed` (by default
    2^-bits), and the truncation error is below 2^-bits.

    Raises StepTooLongError if these limits are not met, or if the outcome of a piecewise operation changes.
    """
    n = equation.n
    try:
        outcomes = equation.outcomes(start, start + length)
        P = equation.at(start, outcomes)[0].mid().inv().mid()
    except (UndecidedError, ZeroDivisionError):
        raise StepTooLongError from None
    with precision(BOUNDS):
        advance, inverse = _bounds_on_step(equation, start, length, outcomes, P, most)
        amplified = advance.exp() * inverse
        aim = arb(2) ** -bits / amplified / 4
        order, tail = _truncation(equation, start, length, outcomes, P, aim / amplified)
        if order > bits:
            raise StepTooLongError
    with precision(bits + math.ceil(3 * float(advance)) + 40, order + 1):
        m, r = equation.series(start, outcomes, P, order + 1)
        terms, defect = _polynomial(n, arb_mat(_diagonal(equation.frequencies)) * length, length, m, r, aim)
        with precision(BOUNDS):
            sizes = [norm(term) for term in terms]
            rates = [k * size for k, size in enumerate(sizes)]
            defect += tail[1] * (sum(sizes, arb(1))) + tail[0] * sum(rates, arb(0))
            error = (defect * amplified).upper()
        if not error < (arb(2) ** -bits if allowed is None else allowed):
            raise StepTooLongError
        end = sum(terms[1:], terms[0])
        rows = [*widened(end, error).table(), [arb(0)] * (2 * n) + [arb(1)]]
        load = [([r_j[i, 2 * n] * length ** (j + 1) for j, r_j in enumerate(r)], tail[1]) for i in range(n)]
        return Step(arb_mat(rows), terms, error, advance, inverse, load)


def _bounds_on_step(
    equation: Equation, start: Ball, length: Ball, outcomes: Outcomes, P: Matrix, most: float
) -> tuple[Ball, Ball]:
    """Upper bounds on h‖A‖ and max(1, ‖m⁻¹‖) on the step. Raises StepTooLongError if m may be singular or
    h‖A‖ is too large."""
    n, frequency = equation.n, float(equation.frequencies.max())
    rates, inverses = [arb(frequency) * length], [arb(1)]
    pending = [(part / _PARTS, (part + 1) / _PARTS) for part in range(_PARTS)]
    while pending:
        first, second = pending.pop()
        m, r = equation.at(interval(start + length * first, start + length * second), outcomes, P)
        rate, size = _rate(n, m, r * length)
        if rate < most:
            rates.append(rate)
            inverses.append(size)
        elif second - first < _SHORTEST_PART:
            raise StepTooLongError
        else:
            middle = (first + second) / 2
            pending += [(first, middle), (middle, second)]
    return largest(rates), largest(inverses)


def _rate(n: int, m: Matrix, r: Matrix) -> tuple[Ball, Ball]:
    """Upper bounds on ‖m⁻¹r_y‖ and ‖m⁻¹‖; infinite if m may be singular."""
    try:
        inverse = m.inv()
    except ZeroDivisionError:
        return arb.pos_inf(), arb.pos_inf()
    return norm(inverse * arb_mat([row[: 2 * n] for row in r.table()])), norm(inverse)


def _truncation(
    equation: Equation, start: Ball, length: Ball, outcomes: Outcomes, P: Matrix, aim: Ball
) -> tuple[int, tuple[Ball, Ball]]:
    """Return the order J for which the sums Σ_{j>J} ‖m_j‖h^j and Σ_{j>J} ‖r_j‖h^{j+1} are below the aim, and
    bounds on the sums.

    Raises StepTooLongError if the coefficients are not analytic on a disc twice as large as the step."""
    h, best = length.upper(), None
    for ratio in _RATIOS:
        radius = h * ratio
        m, r = equation.at(acb(arb(start, radius), arb(0, radius)), outcomes, P)
        size = largest((norm(m), h * norm(r)))
        if not size.is_finite():
            continue
        order = max(1, math.ceil(float((size / aim).log() / math.log(ratio))))
        if best is None or order < best[0]:
            part = arb(ratio) ** -(order + 1) / (1 - arb(1) / ratio)
            best = order, (part * norm(m), part * h * norm(r))
    if best is None:
        raise StepTooLongError
    return best


def _polynomial(
    n: int, W: Matrix, h: Ball, m: list[Matrix], r: list[Matrix], aim: Ball
) -> tuple[list[Matrix], Ball]:
    """Return the coefficients of Ỹ, computed until they are below the aim, and Σ_k ‖D_k‖."""
    order = len(m) - 1
    rows, loads = [], []
    power = h
    for j in range(order + 1):
        inertia = m[j + 1] * power if j < order else arb_mat(n, n)
        scaled = r[j] * power
        rows.append(
            arb_mat(
                [[scaled[i, k] for k in range(2 * n)] + [inertia[i, k] for k in range(n)] for i in range(n)]
            )
        )
        loads.append([scaled[i, 2 * n] for i in range(n)])
        power *= h
    terms = [arb_mat([[int(i == j) for j in range(2 * n + 1)] for i in range(2 * n)])]
    stacked = [_stacked(n, 0, terms[0])]
    defect, k, last = arb(0), 0, math.inf
    while k <= last + order:
        if len(terms) > _MOST_TERMS * (order + 1):
            raise StepTooLongError
        inertial = _forces(n, k, rows, loads, stacked)
        position_rates = W * _half(n, terms[k]) if k <= last else arb_mat(n, 2 * n + 1)
        if k < last:
            term = _joined(position_rates.mid(), (-inertial).mid(), k + 1)
            small = _below(term, aim) and _below(terms[k], aim)
            terms.append(term)
            stacked.append(_stacked(n, k + 1, term))
            if small:
                last = k + 1
            exact = term * (k + 1)
            inertial = inertial + m[0] * _half(n, exact)
            position_rates = _first(n, exact) - position_rates
        with precision(BOUNDS):
            defect += largest((norm(position_rates), norm(inertial)))
        k += 1
    return terms, defect


def _forces(n: int, k: int, rows: list[Matrix], loads: list[list[Ball]], stacked: list[Matrix]) -> Matrix:
    """Coefficient of τ^k in m Ỹ₂′ + h r (Ỹ, 1), without the term m_0 (k + 1) Y_{2,k+1}."""
    total = arb_mat(n, 2 * n + 1)
    for j in range(max(0, k - len(stacked) + 1), min(k, len(rows) - 1) + 1):
        total += rows[j] * stacked[k - j]
    if k < len(loads):
        load = arb_mat(n, 2 * n + 1)
        for i in range(n):
            load[i, 2 * n] = loads[k][i]
        total += load
    return total


def _stacked(n: int, k: int, term: Matrix) -> Matrix:
    """Column with Y_k above k Y_{2,k}."""
    entries = term.entries()
    rates = [k * entry for entry in entries[n * (2 * n + 1) :]]
    return arb_mat(3 * n, 2 * n + 1, entries + rates)


def _joined(first: Matrix, second: Matrix, divisor: int) -> Matrix:
    """Stack the first matrix above the second, divide by an integer, and return the midpoints as an exact
    matrix."""
    stacked = arb_mat(2 * first.nrows(), first.ncols(), first.entries() + second.entries())
    return (stacked / divisor).mid()


def _first(n: int, term: Matrix) -> Matrix:
    return arb_mat(n, 2 * n + 1, term.entries()[: n * (2 * n + 1)])


def _half(n: int, term: Matrix) -> Matrix:
    return arb_mat(n, 2 * n + 1, term.entries()[n * (2 * n + 1) :])


def _below(term: Matrix, limit: Ball) -> bool:
    with precision(BOUNDS):
        return bool(norm(term) < limit)


def _diagonal(values: Array) -> list[list[float]]:
    return np.diag(values).tolist()
