"""Periodic solution of a Riccati equation to a tolerance, as a continuous curve with its error estimate."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from solve.arrays import EPS, Array, symmetric_of
from solve.errors import ControlError
from solve.period.curve import Curve
from solve.period.eigenvalues import balance_matrices, roundoff_growth
from solve.period.grid import Grid
from solve.studies.control.maps import Maps, periodic_solution, step_maps, symmetric, transposed

_ORDER = 16
"""Order of the Gauss method, the highest available: solutions are as smooth as the coefficients."""

_ADVANCE, _AT = 7.0, 1e-8
"""Phase advance per step of the fastest frozen mode on the first grid for a tolerance of 1e-8: the error
constant 2.2e-19 of order 16 times 4.2^17 is 9e-9."""

_ROUNDOFF = 1e-5
"""Relative residual of the difference equation, as a part of rtol, that is not corrected. A choice."""

_GROWTH, _FAST_GROWTH = 1.25, 2.0
"""Ratio of the steps of successive grids, and larger ratio used while the error exceeds the square root of
the tolerance. Errors of resolved solutions fall at least by the factor 1.25^-12 = 0.07."""

_RESOLVED = 1e-4
"""Error below which a solution counts as resolved. An error of a resolved solution that no longer decreases
is round-off. A choice."""

_PHASES = 48
"""Phases at which frozen modes are computed. A choice."""

_LEAST, _MOST = 24, 6000
"""Smallest and largest number of steps: choices. With 12 states, 6000 steps take several seconds."""

_TOO_FAST, _COARSE = 10.0, 2.0
"""Modes with feedback are too fast if they are faster than those of the system by the first factor, and than
those that the largest number of steps resolves by the second factor. Choices."""

_STENCIL = 6
"""Number of nodes whose values and slopes the curve of a step interpolates, with the degree 11. A choice."""

_POINTS = 9
"""Points per step of curves of the gain, whose error is the ninth power of the step. A choice."""


@dataclass(frozen=True)
class Riccati:
    """Riccati equation −dX/dt = AᵀX + XA − XGX + Q of a regulator, or dX/dt = AX + XAᵀ − XQX + G of a filter,
    with G = sign E Eᵀ.

    coefficients: function of phases (k,) that returns A (k, N, N), E (k, N, r) and Q (k, N, N), with
    derivatives by time. rtol: tolerance of the solution."""

    coefficients: Callable[[Array], tuple[Array, Array, Array]]
    speed: float
    period: float
    breaks: tuple[float, ...]
    filters: bool = False
    sign: float = 1.0
    rtol: float = 1e-8

    def terms(self, phase: Array, X: Array) -> tuple[Array, Array, Array]:
        """Linear, quadratic and constant terms (k, N, N); their sum is −dX/dt for a regulator, dX/dt for a
        filter."""
        A, G, Q = self._squared(phase)
        if self.filters:
            return 2 * symmetric(A @ X), -X @ Q @ X, G
        return 2 * symmetric(X @ A), -X @ G @ X, Q

    def slope(self, phase: Array, X: Array) -> Array:
        """Derivative dX/dφ (k, N, N)."""
        linear, quadratic, constant = self.terms(phase, X)
        return (linear + quadratic + constant) * ((1.0 if self.filters else -1.0) / self.speed)

    def first_steps(self) -> int:
        """Number of steps of the first grid, from the frozen modes of the Hamiltonian matrix.

        Raises ControlError if feedback makes modes too fast for any grid."""
        A, G, Q = self._sampled
        hamiltonian = np.concatenate(
            (np.concatenate((A, -G), axis=-1), np.concatenate((-Q, -transposed(A)), axis=-1)), axis=-2
        )
        fastest = np.abs(np.linalg.eigvals(hamiltonian)).max()
        self._require_resolvable(fastest, np.abs(np.linalg.eigvals(A)).max())
        advance = _ADVANCE * (self.rtol / _AT) ** (1 / _ORDER)
        return int(np.clip(np.ceil(fastest * self.period / self.speed / advance), _LEAST, _MOST))

    def _require_resolvable(self, fastest: float, without: float) -> None:
        """Raise ControlError for closed loops that are far faster than the system."""
        allowed = max(_TOO_FAST * without, _COARSE * _ADVANCE * _MOST * self.speed / self.period)
        if self.sign < 0 or fastest <= allowed:
            return
        what, remedy = "closed loop", "weights of the inputs, or smaller ones of the states"
        if self.filters:
            what, remedy = "filter", "noise of the measured quantities, or less process noise"
        raise ControlError(
            f"the {what} has modes of {fastest:.1e} rad/s, the system of at most {without:.1e} rad/s; "
            f"allowed: {allowed:.1e} rad/s; give larger {remedy}"
        )

    def at_nodes(self, grid: Grid) -> Array:
        """X (m+1, N, N) at the nodes. Raises ControlError if there is no stabilising solution."""
        maps, (unit, size) = self.maps(grid), self._scales
        X = periodic_solution(maps.dual if self.filters else maps, _ROUNDOFF * self.rtol)
        if X is None or not np.isfinite(X).all():
            raise ControlError(self._reason)
        if self.filters:
            return X[::-1] * (unit * unit[:, None] / size)
        return X * (size / unit / unit[:, None])

    def maps(self, grid: Grid) -> Maps:
        """Maps of the steps of a grid, for states in units that balance the equation."""
        unit, size = self._scales

        def by_phase(phase: Array) -> tuple[Array, Array, Array]:
            A, E, Q = self.coefficients(phase)
            return (
                A * (unit / unit[:, None] / self.speed),
                E * (np.sqrt(size / self.speed) / unit[:, None]),
                Q * (unit * unit[:, None] / size / self.speed),
            )

        return step_maps(by_phase, grid, _ORDER, self.sign)

    @cached_property
    def _scales(self) -> tuple[Array, float]:
        """Units (N,) of the states, powers of 2, that balance A, and a scale of X that balances G and Q.

        Elimination would lose digits of states whose units differ by many powers of ten."""
        A, G, Q = self._sampled
        unit = balance_matrices(np.abs(A).mean(axis=0))[1]
        quotient = np.abs(Q * unit * unit[:, None]).max() / np.abs(G / unit / unit[:, None]).max()
        return unit, float(2.0 ** np.round(np.log2(quotient) / 2)) if 0 < quotient < np.inf else 1.0

    @cached_property
    def _sampled(self) -> tuple[Array, Array, Array]:
        """Samples of A, G and Q over the period."""
        return self._squared((np.arange(_PHASES) + 0.5) * (self.period / _PHASES))

    def _squared(self, phase: Array) -> tuple[Array, Array, Array]:
        """A, G and Q (k, N, N) at phases (k,)."""
        A, E, Q = self.coefficients(phase)
        return A, self.sign * E @ transposed(E), Q

    @property
    def _reason(self) -> str:
        if self.filters:
            return (
                "the filter's Riccati equation has no stabilising solution: a mode that does not decay is "
                "not observable in the measured outputs, or no noise excites it; measure further outputs, "
                "or add noise in W"
            )
        return (
            "the Riccati equation has no stabilising solution: a mode that does not decay cannot be "
            "controlled by the inputs, or has no weight in Q; add inputs, or give weights to more states"
        )

    def curve(self, steps: int) -> Curve:
        """Upper triangle of X over the period, on a grid of about `steps` steps."""
        grid = Grid.uniform(steps, self.period, self.breaks)
        X = self.at_nodes(grid)
        ends = grid.stages(np.array([0.0, 1.0])).T
        rows = np.triu_indices(X.shape[-1])
        starts, stops = (self.slope(at, values) for at, values in ((ends[0], X[:-1]), (ends[1], X[1:])))
        return interpolated(grid, X[:, *rows], starts[:, *rows], stops[:, *rows])


class Solved(NamedTuple):
    """Curve of the upper triangle of X with its grid, its error relative to √(X_ii X_jj), and the residual of
    the equation relative to its largest term."""

    curve: Curve
    error: float
    residual: float
    grid: Grid


def solve_riccati(equation: Riccati) -> Solved:
    """Periodic solution on grids that are refined until two agree to the tolerance or no longer improve."""
    steps, previous, rtol = equation.first_steps(), np.inf, equation.rtol
    curve, growth = equation.curve(steps), _GROWTH
    while True:
        steps = int(np.ceil(growth * steps))
        finer = equation.curve(steps)
        error = max(_distance(curve, finer), EPS * roundoff_growth(steps))
        stagnant = previous / 2 < error < _RESOLVED
        if error <= rtol or stagnant or steps >= _MOST:
            grid = Grid.uniform(steps, equation.period, equation.breaks)
            return Solved(finer, error, _residual(equation, finer), grid)
        curve, previous = finer, error
        growth = _FAST_GROWTH if error > np.sqrt(rtol) else _GROWTH


def _distance(coarse: Curve, fine: Curve) -> float:
    """Maximum difference between two solutions at and between the nodes of the coarse grid, relative to
    √(X_ii X_jj)."""
    phase = (coarse.nodes[:-1, None] + coarse.h[:, None] * np.array([0.0, 0.5])).ravel()
    X = symmetric_of(fine(phase))
    unit = _units(X)
    return float(np.abs(unit[:, None] * (symmetric_of(coarse(phase)) - X) * unit).max())


def _units(X: Array) -> Array:
    """Factors 1/√X_ii (N,) with the maxima of the diagonal entries over the period; 0 for entries that
    vanish."""
    largest = np.einsum("kii->ki", X).max(axis=0)
    return np.divide(1.0, np.sqrt(np.abs(largest)), out=np.zeros_like(largest), where=largest > 0)


def _residual(equation: Riccati, curve: Curve) -> float:
    phase = (curve.nodes[:-1, None] + curve.h[:, None] * np.array([0.3, 0.6])).ravel()
    X = symmetric_of(curve(phase))
    unit, terms = _units(X), equation.terms(phase, X)
    sign = -1.0 if equation.filters else 1.0
    left = sum(terms) + sign * equation.speed * symmetric_of(curve(phase, 1))
    largest = max(np.abs(unit[:, None] * term * unit).max() for term in terms)
    return float(np.abs(unit[:, None] * left * unit).max() / largest) if largest else 0.0


def interpolated(grid: Grid, values: Array, starts: Array, ends: Array) -> Curve:
    """Hermite interpolant of functions from their values (m+1, count) at the nodes and their slopes
    (m, count) at both ends of each step. It uses the nearest nodes that are not separated by a jump."""
    m, D = grid.steps, 2 * _STENCIL
    coefficients = np.zeros((values.shape[1], m, D))
    bounds = [*np.flatnonzero(grid.at_break).tolist(), m]
    bounds = bounds if grid.smooth or grid.at_break[0] else [0, *bounds]
    beside = _STENCIL // 2 - 1
    for first, last in [(0, m)] if grid.smooth else pairwise(bounds):
        nodes = np.arange(first, last + 1)
        q, v = values[nodes], np.concatenate((starts[first:last], ends[last - 1 : last]))
        if grid.smooth:
            around = np.arange(-beside, m + 1 + beside) % m
            q, v = values[around], starts[around]
        width, h = min(_STENCIL, len(q)), grid.h[first:last]
        steps = np.arange(last - first) + (beside if grid.smooth else 0)
        from_ = np.clip(steps - beside, 0, len(q) - width)
        stencil = from_[:, None] + np.arange(width)
        data = np.concatenate((q[stencil], h[:, None, None] * v[stencil]), axis=1)
        for offset in np.unique(from_ - steps):
            some = np.flatnonzero(from_ - steps == offset)
            powers = np.einsum("df,sft->tsd", _hermite(int(offset), width), data[some])
            coefficients[:, first + some, : 2 * width] = powers
    return Curve(grid.nodes, coefficients)


@cache
def _hermite(first: int, count: int) -> Array:
    """Matrix (2 count, 2 count) that maps values and slopes at the integers from `first` to coefficients of
    powers of θ.

    Products of integers are exact; the inverse of a Vandermonde matrix would lose digits."""
    nodes = np.arange(first, first + count, dtype=float)
    columns = np.zeros((2 * count, 2 * count))
    for at, node in enumerate(nodes):
        others = np.delete(nodes, at)
        basis = np.poly(others) / np.prod(node - others)
        squared, slope = np.polymul(basis, basis), np.sum(1 / (node - others))
        shifted = np.array([1.0, -node])
        value = np.polymul(squared, np.polyadd([1.0], -2 * slope * shifted))
        columns[:, at] = np.pad(value[::-1], (0, 2 * count - len(value)))
        columns[:, count + at] = np.polymul(squared, shifted)[::-1]
    return columns


def through_points(function: Callable[[Array], Array], grid: Grid) -> Curve:
    """Curve of a function with values (k, r) at phases (k,), through Chebyshev points of every step."""
    theta = (1 - np.cos((np.arange(_POINTS) + 0.5) * np.pi / _POINTS)) / 2
    values = function(grid.stages(theta).ravel()).reshape(grid.steps, _POINTS, -1)
    return Curve.from_steps(grid.nodes, np.swapaxes(values, 1, 2), _lagrange_powers(tuple(theta)))


@cache
def _lagrange_powers(theta: tuple[float, ...]) -> Array:
    """Matrix that maps values at fractions of a step to coefficients of powers of θ."""
    nodes = np.array(theta)
    columns = []
    for at, node in enumerate(nodes):
        others = np.delete(nodes, at)
        columns.append(np.poly(others)[::-1] / np.prod(node - others))
    return np.stack(columns, axis=1)
