"""Functions of the monodromy matrix over a box of two quantities, as polynomials with error bounds.

The entries of Φ are analytic functions of parameters and speed if the coefficients of the equations are
analytic and jumps do not move. Let x, y in [−1, 1] represent the two quantities. Let |f| ≤ S on the product
of the ellipses with foci ±1 and sums of semi-axes ρ_x and ρ_y. The polynomial of degrees p and q through the
values of f at Chebyshev's points has an error of at most

    E_x + Λ_p E_y,    E_x = 4 S ρ_x^−p / (ρ_x − 1),    Λ_p ≤ 1 + (2/π) log(p + 1)

(L. N. Trefethen, Approximation Theory and Approximation Practice, Theorem 8.2, which also holds for the zeros
of T_{p+1}, with the same aliasing of coefficients; T. J. Rivlin, The Chebyshev Polynomials, for Λ_p). The
second term bounds the error in y after interpolation in x. S is bounded by the logarithmic norm, ‖Φ‖₂ ≤ exp ∫
μ₂(A) dφ."""

import itertools
import math
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.errors import SolveError, StepsError
from solve.labels import SPEED
from solve.model.model import Model
from solve.proof.balls import Ball, Matrix, above, acb, arb, arb_mat, interval, largest, precision
from solve.proof.enclosure import equation_of, period_of
from solve.proof.equation import Equation
from solve.proof.instructions import Outcomes, UndecidedError
from solve.proof.turn import Marching, homogeneous, intervals, turn
from solve.terminal import progress

_RATIOS = 2.0, 3.0, 5.0, 8.0, 12.0, 20.0
"""Candidates for ρ. For the same S, a larger ρ permits a lower degree; but S grows with the ellipse."""

_PANELS = 48
"""Number of intervals of the period on which μ₂ is bounded. Chosen by judgement."""

_SHORTEST = 2.0**-14
"""Length of an interval, as a fraction of the period, below which the interval is not bisected, although M
may be singular in it."""

_ACCURACY = 2.0**-20
"""Allowed interpolation error. Chosen by judgement: it is far below the variation of Φ over the smallest
boxes that are decided."""

_BITS, _ADVANCE, _ALLOWED = 34, 4.0, 2.0**-30
"""Precision in bits, largest h‖A‖ of a step, and allowed error of a step, for the enclosures at the nodes.
The errors of these enclosures are far smaller than the interpolation error."""

_LARGEST = 1024
"""Binary exponent of a bound S above which no permitted number of nodes suffices."""

_MOST_NODES = 1200
"""Number of nodes above which a box is bisected. Chosen by judgement: with this number, Mathieu's equation
takes a minute."""

_TOGETHER = 16
"""Number of nodes that a worker computes at a time. Chosen by judgement: the computation takes about a
second."""


class Box(NamedTuple):
    """Ranges of two quantities. Their ends are exact doubles."""

    x: tuple[float, float]
    y: tuple[float, float]

    @property
    def area(self) -> float:
        return (self.x[1] - self.x[0]) * (self.y[1] - self.y[0])

    def halved(self, axis: int) -> tuple["Box", "Box"]:
        """Bisect the box along x (axis 0) or y (axis 1)."""
        low, high = self[axis]
        middle = (low + high) / 2
        if axis == 0:
            return Box((low, middle), self.y), Box((middle, high), self.y)
        return Box(self.x, (low, middle)), Box(self.x, (middle, high))


@dataclass(frozen=True)
class Plane:
    """Model as a function of two quantities: two parameters, or one parameter and "speed".

    speed: speed in rad/s, if it is not one of the two quantities."""

    system: Model
    names: tuple[str, str]
    speed: float | None

    def at(self, x: float, y: float) -> tuple[Model, float]:
        """Model and speed (rad/s) at the values x and y of the two quantities."""
        values = dict(zip(self.names, (x, y), strict=True))
        speed = values.pop(SPEED, self.speed)
        assert speed is not None
        return self.system.varied(values), speed

    def equation(self, box: Box) -> Equation:
        """Equation at the middle of a box. Its scales are used on the whole box."""
        return equation_of(*self.at(*(sum(side) / 2 for side in box)), rounded=False)

    def moved(self, equation: Equation, x: Ball, y: Ball) -> Equation:
        """Return `equation` for the values x and y of the two quantities, with its scales unchanged."""
        order, parameters, speed = (
            list(self.system.setup.case.parameters),
            list(equation.parameters),
            equation.speed,
        )
        for name, value in zip(self.names, (x, y), strict=True):
            if name == SPEED:
                speed = value
            else:
                parameters[order.index(name)] = value
        return replace(equation, speed=speed, parameters=tuple(parameters))


@dataclass(frozen=True)
class Polynomials:
    """Polynomials for k functions on a box: coefficients (k, p+1, q+1) of products of Chebyshev polynomials,
    and error bounds (k,).

    conservative: whether C is zero, and hence det Φ = 1."""

    coefficients: Array
    errors: Array
    conservative: bool


def require_degrees(plane: Plane, box: Box) -> None:
    """Raise StepsError if the polynomials on the box require too many nodes."""
    try:
        with precision(2 * _BITS):
            if _degrees(plane, box)[0] is not None:
                return
    except (UndecidedError, ZeroDivisionError):
        pass
    widths = " by ".join(f"{high - low:.3g}" for low, high in box)
    raise StepsError(
        f"{plane.system.labels.name} is too stiff for a proved chart: a box of {widths} requires more than "
        f"{_MOST_NODES} monodromy matrices; choose narrower ranges"
    )


def polynomials(plane: Plane, box: Box, executor: Executor | None = None) -> Polynomials | None:
    """Compute polynomials on a box. For one coordinate, the functions are the trace and the determinant of Φ;
    otherwise, they are all entries of Φ in row order.

    Return None if too many nodes are required, or if the coefficients of the equations are not analytic near
    the box."""
    try:
        with precision(2 * _BITS):
            degrees, errors, conservative = _degrees(plane, box)
            if degrees is None:
                return None
            nodes = [(i, j) for i in range(degrees[0]) for j in range(degrees[1])]
            parts = [nodes[at : at + _TOGETHER] for at in range(0, len(nodes), _TOGETHER)]
            work = partial(_values, plane, box, degrees)
            values = []
            with progress.task("monodromy matrices", len(nodes)) as count:
                for part in map(work, parts) if executor is None else executor.map(work, parts):
                    values += part
                    count.add(len(part))
            coefficients, further = _transformed(np.array(values), degrees)
    except (SolveError, UndecidedError, ZeroDivisionError):
        return None
    return Polynomials(coefficients, errors + further, conservative)


def _values(
    plane: Plane, box: Box, degrees: tuple[int, int], nodes: Sequence[tuple[int, int]]
) -> list[Array]:
    """Return the midpoints and radii (2, k) of the k functions at each of the Chebyshev nodes `nodes` of the
    box."""
    with precision(2 * _BITS):
        equation = plane.equation(box)
        period, breaks = period_of(plane.system), plane.system.breaks
        found = []
        for at in nodes:
            x, y = (
                (low + high) / arb(2) + (arb(high) - low) / 2 * _node(k, degree)
                for (low, high), k, degree in zip(box, at, degrees, strict=True)
            )
            steps = turn(plane.moved(equation, x, y), period, breaks, Marching(_BITS, _ADVANCE, _ALLOWED))
            Phi = homogeneous(steps.levels()[-1][0])
            balls = [Phi.trace(), Phi.det()] if Phi.nrows() == 2 else Phi.entries()
            middles = [float(ball.mid()) for ball in balls]
            radii = [above(abs(ball - middle)) for ball, middle in zip(balls, middles, strict=True)]
            found.append(np.array([middles, radii]))
    return found


def _node(k: int, count: int) -> Ball:
    """Chebyshev point cos(π(k + ½)/count)."""
    return (arb.pi() * (2 * k + 1) / (2 * count)).cos()


def _transformed(values: Array, counts: tuple[int, int]) -> tuple[Array, Array]:
    """Return Chebyshev coefficients (k, p+1, q+1), and bounds (k,) on the errors of the polynomials that are
    due to the radii and to rounding. `values` (nodes, 2, k) contains midpoints and radii."""
    across, upwards = (_analysis(count) for count in counts)
    coefficients, errors = [], []
    for middles, radii in zip(values[:, 0].T, values[:, 1].T, strict=True):
        balls = [arb(middle, radius) for middle, radius in zip(middles.tolist(), radii.tolist(), strict=True)]
        exact = across * arb_mat(*counts, balls) * upwards.transpose()
        rounded = [float(entry.mid()) for entry in exact.entries()]
        apart = (abs(entry - value).upper() for entry, value in zip(exact.entries(), rounded, strict=True))
        coefficients.append(np.reshape(rounded, counts))
        errors.append(above(sum(apart, arb(0))))
    return np.array(coefficients), np.array(errors)


def _analysis(count: int) -> Matrix:
    """Matrix (count, count) that maps values at the Chebyshev points to Chebyshev coefficients."""
    return arb_mat(
        [
            [
                (1 if j == 0 else 2) * (arb.pi() * (j * (2 * k + 1)) / (2 * count)).cos() / count
                for k in range(count)
            ]
            for j in range(count)
        ]
    )


def _degrees(plane: Plane, box: Box) -> tuple[tuple[int, int] | None, Array, bool]:
    """Return the numbers of nodes along x and y, or None if too many nodes are required; bounds (k,) on the
    interpolation errors; and whether C is zero on the box.

    First, equal ellipse ratios ρ are tried along x and y, then neighbours of the best pair."""
    equation = plane.equation(box)
    real = plane.moved(equation, *(interval(arb(low), arb(high)) for low, high in box))
    period = period_of(plane.system)
    found: dict[tuple[int, int], tuple[tuple[int, int], Array]] = {}
    sizes: list[Ball] = []

    def examine(i: int, j: int) -> None:
        ratios = _RATIOS[i], _RATIOS[j]
        ellipses = (_rectangle(side, ratio) for side, ratio in zip(box, ratios, strict=True))
        bounds = _bounds(real, plane.moved(equation, *ellipses), period, plane.system.breaks)
        size = largest(bounds)
        if size < arb(2) ** _LARGEST:
            sizes.append(size)
            counts = _count(size, ratios[0]), _count(size, ratios[1])
            found[i, j] = counts, np.array([above(_error(bound, ratios, counts)) for bound in bounds])

    def best() -> tuple[int, int]:
        return min(found, key=lambda at: math.prod(found[at][0]))

    examine(0, 0)
    # S grows with the ellipses. If the smallest S requires too many nodes even with the largest ρ, every
    # other pair also requires too many.
    if not found or math.prod(_count(sizes[0], _RATIOS[-1]) for _ in box) > _MOST_NODES:
        return None, np.zeros(0), False
    for k in range(1, len(_RATIOS)):
        examine(k, k)
    k = best()[0]
    for i, j in ((k - 1, k), (k + 1, k), (k, k - 1), (k, k + 1)):
        if min(i, j) >= 0 and max(i, j) < len(_RATIOS):
            examine(i, j)
    counts, errors = found[best()]
    return (counts if math.prod(counts) <= _MOST_NODES else None), errors, real.vanishes(period)[0]


def axis_to_halve(plane: Plane, box: Box, widths: Sequence[float]) -> int:
    """Axis along which to bisect a box, x (0) or y (1).

    It is the axis for which one of the halves has the smallest bound S or, if the bounds are equal, the axis
    with the larger width. If the equations are not analytic near a value of one quantity, bisection along the
    other axis does not reduce S."""
    x, y = (min(_size(plane, half) for half in box.halved(axis)) for axis in (0, 1))
    return int(widths[1] > widths[0] if x == y else y < x)


def _size(plane: Plane, box: Box) -> float:
    """Logarithm of S, the bound on the moduli of the functions for complex values in the smallest ellipses
    that enclose a box. Infinite if the equations are not analytic in these ellipses."""
    try:
        with precision(2 * _BITS):
            equation = plane.equation(box)
            real = plane.moved(equation, *(interval(arb(low), arb(high)) for low, high in box))
            ellipse = plane.moved(equation, *(_rectangle(side, _RATIOS[0]) for side in box))
            bounds = _bounds(real, ellipse, period_of(plane.system), plane.system.breaks)
            return float(largest(bounds).log())
    except (SolveError, UndecidedError, ZeroDivisionError):
        return math.inf


def _count(size: Ball, ratio: float) -> int:
    """Number of nodes for which the interpolation error is below half of the allowed error, if Λ ≤ 4."""
    return max(2, math.ceil(float((32 * size / _ACCURACY / (ratio - 1)).log()) / math.log(ratio)) + 1)


def _error(size: Ball, ratios: Sequence[float], counts: Sequence[int]) -> Ball:
    """Bound E_x + Λ_p E_y on the interpolation error of a function of two quantities."""
    across, upwards = (
        4 * size * arb(ratio) ** -(count - 1) / (ratio - 1)
        for ratio, count in zip(ratios, counts, strict=True)
    )
    return across + (1 + 2 / arb.pi() * arb(counts[0]).log()) * upwards


def _rectangle(side: tuple[float, float], ratio: float) -> Ball:
    """Complex ball that contains the ellipse around an interval; `ratio` is the sum of the semi-axes of the
    ellipse, relative to half of the interval."""
    low, high = map(arb, side)
    half, inverse = (high - low) / 2, 1 / arb(ratio)
    along, across = (half * (ratio + inverse) / 2).upper(), (half * (ratio - inverse) / 2).upper()
    middle = (low + high) / 2
    return acb(middle + arb(0, along), arb(0, across))


def _bounds(real: Equation, ellipse: Equation, period: Ball, breaks: Sequence[float]) -> list[Ball]:
    """Bounds on the moduli of the functions for complex values of the two quantities. For one coordinate, the
    functions are the trace and the determinant of Φ; otherwise, they are the entries of Φ."""
    size = 2 * real.n
    growth, trace, pending = arb(0), arb(0), list(_panels(real, period, breaks))
    while pending:
        start, end, outcomes = pending.pop()
        length = end - start
        try:
            rates = _rates(ellipse, acb(interval(start, end)), outcomes)
        except ZeroDivisionError:
            if length < _SHORTEST * period:
                raise
            middle = ((start + end) / 2).mid()
            pending += [(start, middle, outcomes), (middle, end, outcomes)]
            continue
        growth, trace = growth + rates[0] * length, trace + rates[1] * length
    entry = growth.exp()
    return [size * entry, trace.exp()] if real.n == 1 else [entry] * size**2


def _rates(equation: Equation, phase: Ball, outcomes: Outcomes | None) -> tuple[Ball, Ball]:
    """Bounds on μ₂(A) and Re tr A over an interval of phases. In a window around a jump, where piecewise
    operations may take any branch, both bounds follow from a norm of A."""
    if outcomes is not None:
        return equation.growth(phase, outcomes)
    rate = equation.largest_rate(phase)
    # ‖A‖₂ ≤ (2n)^½ ‖A‖∞ bounds every eigenvalue of (A + A*)/2, and |tr A| ≤ 2n ‖A‖∞.
    size = arb(2 * equation.n)
    return size.sqrt() * rate, size * rate


def _panels(
    real: Equation, period: Ball, breaks: Sequence[float]
) -> Iterator[tuple[Ball, Ball, Outcomes | None]]:
    """Intervals of the period with the branches of the piecewise operations. In windows around jumps, the
    branches are None."""
    for start, end, window in intervals(real, period, breaks):
        if window:
            yield start, end, None
            continue
        count = math.ceil(_PANELS * float((end - start) / period))
        points = [start + (end - start) * k / count for k in range(count)] + [end]
        for first, second in itertools.pairwise(points):
            yield first, second, real.outcomes(first, second)
