"""Location of folds, period doublings, Neimark–Sacker points and branching points between two points of a
branch, as zeros of test functions (Y. A. Kuznetsov, Elements of Applied Bifurcation Theory, 10.2)."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from solve.arrays import EPS, Array
from solve.errors import NoOrbitError, SolveError
from solve.methods.collocation import lagrange
from solve.newton.branch_points import Point
from solve.newton.manifold import Manifold
from solve.period.multipliers import UNIT_CIRCLE
from solve.results.branch import BRANCHING, DOUBLING, FOLD, TORUS

_MAX_REFINEMENTS = 30
"""Maximum number of interpolations in the search for a special point. Chosen by judgement; five to eight are
usual."""

_RTOL_FRACTION, _ROUNDOFF = 1e-3, 64 * EPS
"""Change of a parameter between two interpolations below which a special point counts as located, as a
fraction of rtol; and lower limit of this change. Chosen by judgement: each interpolation takes as long as a
point of the branch."""

_ZERO = 0.01
"""Largest modulus of a function at its zero, as a fraction of its change between the ends of the interval. If
the modulus is larger, the function jumps there, as at a grazing orbit. Chosen by judgement."""

_REAL = 1e-12
"""Imaginary part, relative to the modulus, up to which a multiplier counts as real. Chosen by judgement:
NumPy returns the real eigenvalues of real matrices without imaginary part."""

_FRACTIONS = 0.08, 0.25, 0.42, 0.58, 0.75, 0.92
"""Positions, as fractions of the path, of the points between which a branching point is interpolated, in
addition to the ends of the path. Chosen by judgement: on a path of 0.01, the interpolation error is of the
order of 0.01 to the power of the number of points."""

_MIN_POINTS = 6
"""Minimum number of points between which a branching point is interpolated. Chosen by judgement."""

_DEGREE_FRACTION = 0.1
"""Largest permitted difference, as a fraction of rtol, between the parameters at zeros of polynomials of two
degrees. Chosen by judgement: the difference is the error of the polynomial of lower degree, which is far
larger than the error of the polynomial of higher degree."""

Test = Callable[[Point], float]

Path = tuple[Callable[[float], Point], float]
"""Type of paths between two points: a function that returns the point at a length along the path, and the
length of the path."""


def special_points(
    manifold: Manifold,
    before: Point,
    after: Point,
    path: Path | None = None,
    branches_cross: bool = False,
) -> tuple[list[Point], bool]:
    """Return the special points between two neighbouring points of a branch, in their order along the branch.
    Special points that cannot be located are omitted. Also return whether all special points are located.
    path: path from `before` to `after`; by default along the tangent at `before`. branches_cross: whether the
    change of the orientation between the points is due to a branching point."""
    found, tests = [], _tests(before, after, branches_cross)
    for kind, test in tests.items():
        with suppress(SolveError):
            path = path or _along_tangent(manifold, before, after)
            locate = _interpolated if kind == BRANCHING else _located
            length, point = locate(manifold, before, after, test, path)
            found.append((length, replace(point, kind=kind)))
    return [point for _, point in sorted(found, key=lambda pair: pair[0])], len(found) == len(tests)


def _tests(before: Point, after: Point, branches_cross: bool) -> dict[str, Test]:
    """Return the test functions that have a zero between two points. The keys are the kinds of the special
    points.

    A branch that turns back at a branching point, such as the branch of the orbits without symmetry, has no
    fold there."""
    tests: dict[str, Test] = {}
    if before.direction.value * after.direction.value < 0:
        tests[BRANCHING if branches_cross else FOLD] = lambda point: point.direction.value
    elif branches_cross:
        tests[BRANCHING] = _branching_test
    first, second = before.orbit.multipliers, after.orbit.multipliers
    beyond = [_count(second, test) - _count(first, test) for test in (_below_minus_one, _above_one)]
    if beyond[0] % 2:
        tests[DOUBLING] = doubling_test
    leaving = int((np.abs(second) > 1).sum() - (np.abs(first) > 1).sum())
    crossing = abs(leaving - sum(change for change in beyond if change % 2)) == 2
    if crossing and not any(map(_stays_on_circle, (before, after))):
        tests[TORUS] = _torus_test
    return tests


def _stays_on_circle(point: Point) -> bool:
    """Whether complex multipliers lie on the unit circle within their errors, as in systems without
    damping."""
    rho = point.orbit.multipliers
    moduli = np.abs(rho[np.abs(np.imag(rho)) > _REAL * np.abs(rho)])
    return bool((np.abs(moduli - 1) <= UNIT_CIRCLE + float(point.orbit.errors[1])).any())


def _count(multipliers: Array, test: Callable[[Array], Array]) -> int:
    real = np.abs(np.imag(multipliers)) <= _REAL * np.abs(multipliers)
    return int((test(np.real(multipliers)) & real).sum())


def _below_minus_one(values: Array) -> Array:
    return values < -1


def _above_one(values: Array) -> Array:
    return values > 1


def doubling_test(point: Point) -> float:
    """Test function Π (1 + ρ)/(1 + |ρ|), which changes sign where a multiplier passes through -1."""
    rho = point.orbit.multipliers
    return float(np.prod((1 + rho) / (1 + np.abs(rho))).real)


def _branching_test(point: Point) -> float:
    """Test function det(I - Φ), which changes sign where a multiplier passes through +1. It is smooth where
    real multipliers become complex."""
    return float(np.prod(1 - point.orbit.multipliers).real)


def _torus_test(point: Point) -> float:
    """Test function |ρ| - 1 of the complex pair of multipliers that is nearest to the unit circle."""
    rho = point.orbit.multipliers
    pairs = np.abs(rho[np.imag(rho) > _REAL * np.abs(rho)])
    if not len(pairs):
        raise NoOrbitError("no multipliers are complex")
    return float(pairs[np.abs(pairs - 1).argmin()] - 1)


def _along_tangent(manifold: Manifold, before: Point, after: Point) -> Path:
    """Return the path from `before` to `after` on which the length is measured along the tangent."""
    curvature = manifold.curvature(before, after)

    def at(length: float) -> Point:
        return manifold.along(before, length, curvature=curvature)[0]

    return at, manifold.component(before, after, before.direction)


def _located(manifold: Manifold, before: Point, after: Point, test: Test, path: Path) -> tuple[float, Point]:
    """Return the length along a path at which a test function is zero, and the point there. Raises SolveError
    subclasses."""
    at, length = path

    def tested(along: float) -> tuple[float, Point]:
        point = at(along)
        return test(point), point

    ends = (0.0, length), (test(before), test(after))
    return zero_between(tested, *ends, lambda one, other: is_located(manifold, one, other), before)


def _interpolated(
    manifold: Manifold, before: Point, after: Point, test: Test, path: Path
) -> tuple[float, Point]:
    """Return the length along a path at which a test function is zero, and the point there, by interpolation
    between points of the path. At a branching point, Newton's iteration is singular: the round-off of nearby
    points is inversely proportional to their distance from it. Raises SolveError subclasses."""
    at, length = path
    lengths, points = [0.0, length], [before, after]
    for fraction in _FRACTIONS:
        with suppress(SolveError):
            points.append(at(fraction * length))
            lengths.append(fraction * length)
    if len(points) < _MIN_POINTS:
        raise NoOrbitError("the point is not located")
    values = [test(point) for point in points]
    fewer, zero = (_zero(lengths[k:], values[k:], length) for k in (2, 0))
    found, other = _between(points, lengths, zero), _between(points[2:], lengths[2:], fewer)
    if not is_located(manifold, other, found, _DEGREE_FRACTION):
        raise NoOrbitError("the point is not located")
    return zero, found


def _zero(lengths: Sequence[float], values: Sequence[float], end: float) -> float:
    """Return the zero, between 0 and `end`, of the polynomial with the given values at lengths. Raises
    NoOrbitError unless there is exactly one."""
    roots = np.roots(np.polyfit(np.array(lengths) / end, values, len(lengths) - 1))
    real = roots[np.isreal(roots)].real
    (inside,) = np.nonzero((real >= 0) & (real <= 1))
    if len(inside) != 1:
        raise NoOrbitError("the point is not located")
    return end * float(real[inside[0]])


def _between(points: Sequence[Point], lengths: Sequence[float], length: float) -> Point:
    """Return the point at a length along a path by polynomial interpolation between points at `lengths`. The
    error estimates are the largest among the points. Multipliers are interpolated only between points with as
    many real multipliers as the nearest point. The multiplier nearest to +1 is then set to +1; this change is
    included in the error of the spectral radius."""

    def mean(values: Sequence[Array], chosen: Sequence[int]) -> Array:
        at = np.array(lengths)[list(chosen)]
        return np.tensordot(lagrange(at, np.array([length]))[0], [values[k] for k in chosen], 1)

    nearest = points[int(np.abs(np.array(lengths) - length).argmin())]
    unknowns = nearest.unknowns.times(0.0)
    for point, weight in zip(points, lagrange(np.array(lengths), np.array([length]))[0], strict=True):
        unknowns = point.unknowns.beside(unknowns).times(float(weight)).plus(1.0, unknowns)
    orbits, every = [point.orbit for point in points], range(len(points))
    real = [int(np.isreal(orbit.multipliers).sum()) for orbit in orbits]
    alike = [k for k in every if real[k] == int(np.isreal(nearest.orbit.multipliers).sum())]
    multipliers = mean([orbit.multipliers for orbit in orbits], alike)
    critical = int(np.abs(multipliers - 1).argmin())
    changed, multipliers[critical] = abs(multipliers[critical] - 1), 1.0
    orbit = replace(
        nearest.orbit,
        values=mean([orbit.values for orbit in orbits], every),
        figures=mean([orbit.figures for orbit in orbits], every),
        multipliers=multipliers,
        radius=float(np.abs(multipliers).max()),
        figure_errors=np.max([orbit.figure_errors for orbit in orbits], axis=0),
        errors=np.max([[0.0, changed], *(orbit.errors for orbit in orbits)], axis=0),
    )
    return replace(nearest, unknowns=unknowns, orbit=orbit)


def is_located(manifold: Manifold, one: Point, other: Point, fraction: float = _RTOL_FRACTION) -> bool:
    """Whether two successive interpolations agree, in every parameter, within a fraction of rtol."""
    spans = manifold.parameters.spans
    limit = max(fraction * manifold.parameters.task.rtol, _ROUNDOFF)
    moved = np.abs(other.orbit.values - one.orbit.values)
    return bool((moved <= limit * np.maximum(np.abs(other.orbit.values), spans)).all())


def zero_between(
    function: Callable[[float], tuple[float, Point]],
    ends: tuple[float, float],
    values: tuple[float, float],
    agree: Callable[[Point, Point], bool],
    reached: Point,
) -> tuple[float, Point]:
    """Return an argument at which `function` is zero, and the point there, by the Illinois algorithm (M.
    Dowell, P. Jarratt, BIT 11 (1971) 168).

    function: function that returns, for an argument, its value and a point. ends, values: two arguments and
    the values there, which have different signs. agree: function that returns whether two successive points
    agree. reached: point with which the first point is compared. Raises NoOrbitError."""
    (low, high), (first, second), kept = ends, values, False
    most = _ZERO * abs(second - first)
    for _ in range(_MAX_REFINEMENTS):
        argument, previous = (low * second - high * first) / (second - first), reached
        value, reached = function(argument)
        if value == 0 or (abs(value) <= most and agree(previous, reached)):
            return argument, reached
        if value * second < 0:
            low, first, kept = high, second, False
        elif kept:
            first /= 2
        else:
            kept = True
        high, second = argument, value
    raise NoOrbitError("the point is not located")
