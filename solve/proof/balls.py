"""Balls of Arb, matrices of balls, and upper bounds on norms.

A ball is a midpoint with a radius. Every operation returns a ball that contains the exact results for all
numbers in its operands (F. Johansson, IEEE Trans. Comput. 66 (2017) 1281). Bounds are also computed with
balls, and thus include rounding errors."""

import copyreg
import math
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from solve.errors import MissingLibraryError

try:
    import flint
except ImportError:
    raise MissingLibraryError.of_extra("a proof", "python-flint", "prove") from None

Ball = Any
"""Type of a real ball, a complex ball, or a power series whose coefficients are balls."""

Matrix = Any
"""Type of a matrix of real or complex balls."""

arb, acb, arb_mat, acb_mat = flint.arb, flint.acb, flint.arb_mat, flint.acb_mat
arb_series = flint.arb_series


_LARGEST_WHOLE = 2**53
"""Integers up to this modulus are represented exactly by doubles."""


def _exact_parts(x: Ball) -> tuple[int, int]:
    mantissa, exponent = x.man_exp()
    return int(mantissa), int(exponent)


def _ball(middle: tuple[int, int], radius: tuple[int, int]) -> Ball:
    return arb(arb(middle), arb(radius))


def _reduced_ball(x: Ball) -> tuple[Any, ...]:
    if not x.is_finite():
        return arb.nan, ()
    return _ball, (_exact_parts(x.mid()), _exact_parts(x.rad()))


def _reduced_matrix(matrix: Matrix) -> tuple[Any, ...]:
    return arb_mat, (matrix.nrows(), matrix.ncols(), matrix.entries())


# Balls are pickled without rounding errors, so that they can be sent between processes.
copyreg.pickle(arb, _reduced_ball)
copyreg.pickle(arb_mat, _reduced_matrix)


@contextmanager
def precision(bits: int, terms: int = 10) -> Iterator[None]:
    """Context manager that sets the working precision in bits and the number of terms of power series."""
    before = flint.ctx.prec, flint.ctx.cap
    flint.ctx.prec, flint.ctx.cap = bits, terms
    try:
        yield
    finally:
        flint.ctx.prec, flint.ctx.cap = before


def working_bits() -> int:
    """Return the working precision in bits."""
    return flint.ctx.prec


def working_terms() -> int:
    """Return the number of terms of power series."""
    return flint.ctx.cap


def coefficient(x: Ball, term: int) -> Ball:
    """Coefficient of a power series; a constant counts as a power series."""
    if isinstance(x, arb_series):
        if x.prec <= term:
            raise RuntimeError(f"a power series has {x.prec} terms, but {term + 1} are required")
        return x[term]
    return x if term == 0 else arb(0)


def number(x: float, rounded: bool) -> Ball:
    """Convert a number to a ball.

    rounded: whether the ball contains all numbers within two units in the last place. This allows for the
    several rounding errors of unit conversions and of constants such as π."""
    whole = x.is_integer() and abs(x) < _LARGEST_WHOLE
    return arb(x, 2 * math.ulp(x)) if rounded and not whole else arb(x)


def norm(matrix: Matrix) -> Ball:
    """Upper bound on the maximum norm of a matrix, the largest sum of the moduli in a row."""
    columns = matrix.ncols()
    moduli = [entry.abs_upper() for entry in matrix.entries()]
    return largest(sum(moduli[at : at + columns], arb(0)) for at in range(0, len(moduli), columns))


def largest(values: Iterable[Ball]) -> Ball:
    """Exact upper bound on the largest of several nonnegative balls; infinite if a ball is not finite."""
    found = arb(0)
    for value in values:
        high = value.upper()
        if not high.is_finite():
            return arb.pos_inf()
        if high > found:
            found = high
    return found


def interval(low: Ball, high: Ball) -> Ball:
    """Smallest ball that contains both arguments."""
    return low.union(high)


def widened(matrix: Matrix, radius: Ball) -> Matrix:
    """Matrix of real balls, with each radius enlarged by `radius`."""
    by = arb(0, radius.upper())
    return arb_mat(matrix.nrows(), matrix.ncols(), [entry + by for entry in matrix.entries()])


def above(x: Ball) -> float:
    """Double that is an upper bound on a nonnegative ball; infinite if the ball is not finite."""
    if x.is_zero():
        return 0.0
    return math.nextafter(float(x.upper()), math.inf) if x.is_finite() else math.inf


def below(x: Ball) -> float:
    """Double that is a lower bound on a nonnegative ball, and at least 0."""
    return 0.0 if x.is_zero() else max(0.0, math.nextafter(float(x.lower()), -math.inf))
