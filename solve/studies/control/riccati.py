"""Periodic solution of a Riccati equation to a tolerance, as a continuous curve with its error estimate."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from solve.arrays import EPS, Array, midpoint_phases, symmetric_of
from solve.errors import ControlError
from solve.period.curve import Curve
from solve.period.eigenvalues import balance_matrices, roundoff_growth
from solve.period.grid import Grid
from solve.studies.control.maps import (
    FIRST_RTOL,
    FROZEN_PHASES,
    Maps,
    Stages,
    periodic_solution,
    step_maps,
    summed,
    sums_over_steps,
    transposed,
)

_ORDER = 16
"""Order of the Gauss method. It is the highest one available, because solutions are as smooth as the
coefficients."""

_ADVANCE = 7.0
"""Phase advance per step of the fastest frozen mode, on the first grid, for the tolerance `FIRST_RTOL`.
Chosen by judgement. With 4.2, the error of this mode would meet the tolerance: the error constant of order 16
is 2.2e-19, and 2.2e-19 times 4.2^17 is 9e-9. A larger value is possible because grids are refined if
needed."""

_ROUNDOFF = 1e-5
"""The solution of the difference equation is corrected if its relative residual exceeds this fraction of
rtol. Chosen by judgement."""

_MARGIN, _GROWTH = 1.1, 2.0
"""Safety factor on the number of steps, which is predicted from the order 12 of the interpolant; and largest
ratio of the numbers of steps of successive grids. With the safety factor, the error is reduced at least to
1.1^-12 = 0.32 of the tolerance if the order is attained. Both numbers are chosen by judgement."""

_RESOLVED = 1e-7
"""Error below which a solution counts as resolved; if the error of a resolved solution no longer decreases,
this error is round-off. Larger errors can stagnate for another reason: with inputs of the harmonics 60 to 192
that have a small effect on X, errors of 4e-5 to 1e-6 were measured on grids that are too coarse for these
harmonics."""

_LEAST, _MOST = 24, 6000
"""Smallest and largest number of steps. Chosen by judgement: with 12 states, 6000 steps take several
seconds."""

_TOO_FAST, _COARSE = 10.0, 2.0
"""Modes of the closed loop count as too fast if two conditions hold. They exceed the fastest mode of the
system by the first factor. They also exceed, by the second factor, the fastest mode that the largest number
of steps resolves. Chosen by judgement."""

_SAFETY = 1.5
"""Safety factor on the estimated error, which is needed because the residual is evaluated only at the stages.
For a hundred random systems with 2 to 20 states, the true error is 0.32 to 1.20 times the estimate without
this factor."""

_STENCIL = 6
"""Number of nodes whose values and slopes are interpolated on each step. The interpolant is a polynomial of
degree 11 and order 12. Chosen by judgement."""

_POINTS = 9
"""Number of points per step for curves of the gain. The error of these curves is proportional to the ninth
power of the step. Chosen by judgement."""

_BETWEEN = 0.0, (1 - np.cos(4 * np.pi / _POINTS)) / 2
"""Fractions of a step at which curves of the gain are compared with the gain: two extrema of the polynomial
that vanishes at the Chebyshev points. With the second fraction alone, an error of 3e-8 was missed at the
tolerance 1e-8, for inputs of the harmonic 192."""

_SMALL = 1e-6
"""The error of an entry of the gain is relative to the entry. For entries below this fraction of the largest
entry, it is relative to this fraction of the largest entry, because small entries can be round-off. Chosen by
judgement."""


@dataclass(frozen=True)
class Riccati:
    """Riccati equation −dX/dt = AᵀX + XA − XGX + Q of a regulator, with G = sign E Eᵀ.

    `coefficients` is a function of phases (k,) that returns A (k, N, N), E (k, N, r) and Q (k, N, N); in the
    equation, derivatives are with respect to time. `rtol` is the relative tolerance of the solution.
    `filters` is True if the equation is that of a filter, which is the regulator of the dual system in
    reversed phase."""

    coefficients: Callable[[Array], tuple[Array, Array, Array]]
    speed: float
    period: float
    breaks: tuple[float, ...]
    sign: float = 1.0
    rtol: float = 1e-8
    filters: bool = False

    def slope(self, phase: Array, X: Array) -> Array:
        """Return the derivative dX/dφ (k, N, N) at phases (k,), from X (k, N, N)."""
        A, G, Q = self._squared(phase)
        return (_feedback_term(A, G, X) + Q) * (-1.0 / self.speed)

    def first_steps(self) -> int:
        """Return the number of steps of the first grid, from the frozen modes of the Hamiltonian matrix.

        Raises ControlError if the feedback makes modes too fast for any grid."""
        A, G, Q = self._sampled
        hamiltonian = np.concatenate(
            (np.concatenate((A, -G), axis=-1), np.concatenate((-Q, -transposed(A)), axis=-1)), axis=-2
        )
        fastest = np.abs(np.linalg.eigvals(hamiltonian)).max()
        self._require_resolvable(fastest, np.abs(np.linalg.eigvals(A)).max())
        advance = _ADVANCE * (self.rtol / FIRST_RTOL) ** (1 / _ORDER)
        return int(np.clip(np.ceil(fastest * self.period / self.speed / advance), _LEAST, _MOST))

    def _require_resolvable(self, fastest: float, without: float) -> None:
        """Raise ControlError if the fastest mode of the closed loop is far faster than `without`, the fastest
        mode of the system without feedback."""
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

    def solved(self, steps: int) -> "Solved":
        """Return the solution on a grid of about `steps` steps, with its error.

        Raises ControlError if there is no stabilising solution."""
        grid = Grid.uniform(steps, self.period, self.breaks)
        (maps, stages), (unit, size) = self.maps(grid), self._scales
        X = periodic_solution(maps, _ROUNDOFF * self.rtol)
        if X is None or not np.isfinite(X).all():
            raise ControlError(self._reason)
        factor = size / unit / unit[:, None]
        curve = self._curve(grid, X * factor)
        return Solved(curve, *_errors(grid, curve, maps, stages, X, factor), grid)

    def maps(self, grid: Grid) -> tuple[Maps, Stages]:
        """Return the maps of the steps of a grid, and their stages, for states in units that balance the
        equation."""
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
        """Units (N,) of the states, which are powers of 2 and balance A; and a scale of X that balances G and
        Q.

        Without balancing, elimination would lose digits if the magnitudes of the states differ by many powers
        of ten."""
        A, G, Q = self._sampled
        unit = balance_matrices(np.abs(A).mean(axis=0))[1]
        above, below = np.abs(Q * unit * unit[:, None]).max(), np.abs(G / unit / unit[:, None]).max()
        return unit, float(2.0 ** np.round(np.log2(above / below) / 2)) if above and below else 1.0

    @cached_property
    def _sampled(self) -> tuple[Array, Array, Array]:
        """Samples of A, G and Q (k, N, N) over the period."""
        return self._squared(midpoint_phases(FROZEN_PHASES, self.period))

    def _squared(self, phase: Array) -> tuple[Array, Array, Array]:
        """Return A, G and Q (k, N, N) at phases (k,)."""
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

    def _curve(self, grid: Grid, X: Array) -> Curve:
        """Return the curve of the upper triangle of X over the period, from X (m+1, N, N) at the nodes."""
        rows = np.triu_indices(X.shape[-1])
        start, stop = grid.stages(np.array([0.0, 1.0])).T
        starts = self.slope(start, X[:-1])
        stops = np.roll(starts, -1, axis=0) if grid.smooth else self.slope(stop, X[1:])
        return interpolated(grid, X[:, *rows], starts[:, *rows], stops[:, *rows])


class Solved(NamedTuple):
    """Curve of the upper triangle of X, the error of X_ij relative to √(X_ii X_jj), the residual of the
    Riccati equation relative to the largest term of the equation, and the grid."""

    curve: Curve
    error: float
    residual: float
    grid: Grid

    @property
    def mirrored(self) -> "Solved":
        """Solution with reversed phase. The reversal converts the solution for the dual system to the
        solution for a filter."""
        nodes = self.grid.period - self.grid.nodes[::-1]
        coefficients = self.curve.coefficients[:, ::-1] @ _reversal(self.curve.coefficients.shape[-1])
        grid = Grid(nodes, np.roll(self.grid.at_break[::-1], 1))
        return self._replace(curve=Curve(nodes, coefficients), grid=grid)


def solve_riccati(equation: Riccati) -> Solved:
    """Return the periodic solution, on a grid that is refined until the error is below the tolerance or no
    longer decreases."""
    steps, previous, rtol = equation.first_steps(), np.inf, equation.rtol
    while True:
        found = equation.solved(steps)
        error = found.error
        stagnant = previous / 2 < error < _RESOLVED
        if error <= rtol or stagnant or steps >= _MOST:
            return found
        growth = _MARGIN * (error / rtol) ** (1 / (2 * _STENCIL))
        steps, previous = int(np.ceil(min(growth, _GROWTH) * steps)), error


def _errors(
    grid: Grid, curve: Curve, maps: Maps, stages: Stages, X: Array, factor: Array
) -> tuple[float, float]:
    """Return the error of a curve relative to √(X_ii X_jj), and the residual of the curve. `X` (m+1, N, N)
    are the values of the curve at the nodes; `factor` (N, N) are the units of X.

    The error e of a curve with the residual R satisfies e′ + (A − GX)ᵀe + e(A − GX) = R, up to terms of
    second order in e. Its values at the nodes are sums of ∫ΦᵀRΦ over the steps, where Φ are the states of the
    closed loop at the stages. Within a step, the integral of R is added."""
    (m, s, N, _), method = stages.A.shape, stages.method
    phase = grid.stages(np.array(method.c)).ravel()
    values, slopes = (
        symmetric_of(each / factor[np.triu_indices(N)][:, None]).reshape(m, s, N, N)
        for each in curve.states(phase, (0, 1))
    )
    unit = _units(values.reshape(m * s, N, N))
    unit = unit * unit[:, None]
    changed = _feedback_term(stages.A, stages.G, values)
    residual = slopes * grid.h[:, None, None, None] + changed + stages.Q
    closed = maps.closed(X[1:])
    inside = stages.closed(X[1:], closed)
    weighted = (method.b[:, None, None] * residual @ inside).reshape(m, s * N, N)
    with np.errstate(all="ignore"):
        at_nodes = sums_over_steps(closed, transposed(inside.reshape(m, s * N, N)) @ weighted)
    error = np.inf
    if at_nodes is not None:
        between = summed(method.A, residual.reshape(m, s * N, N), N)
        error = _SAFETY * (_largest(at_nodes, unit) + _largest(between, unit))
    largest = max(_largest(each, unit) for each in (changed, stages.Q))
    return (
        max(error, EPS * roundoff_growth(m)) if error < np.inf else np.inf,
        _largest(residual, unit) / largest if largest else 0.0,
    )


def _largest(matrices: Array, unit: Array) -> float:
    """Return the largest modulus of the entries of `matrices` (…, N, N), multiplied by `unit` (N, N)."""
    every = matrices.reshape(-1, *unit.shape)
    return float((np.maximum(every.max(axis=0), -every.min(axis=0)) * unit).max())


def _feedback_term(A: Array, G: Array, X: Array) -> Array:
    """Return the terms AᵀX + XA − XGX (…, N, N) of −dX/dt."""
    half = X @ (A - G @ X / 2)
    return half + transposed(half)


def _units(X: Array) -> Array:
    """Return factors 1/√X_ii (N,), where X_ii are the maxima of the diagonal entries over the period; 0 for
    entries that vanish."""
    largest = np.einsum("kii->ki", X).max(axis=0)
    return np.divide(1.0, np.sqrt(np.abs(largest)), out=np.zeros_like(largest), where=largest > 0)


@cache
def _reversal(powers: int) -> Array:
    """Return the matrix that maps coefficients of powers of 1 − θ to coefficients of powers of θ."""
    rows = [np.poly1d([-1.0, 1.0]) ** k for k in range(powers)]
    return np.array([np.pad(row.coeffs[::-1], (0, powers - len(row.coeffs))) for row in rows])


def interpolated(grid: Grid, values: Array, starts: Array, ends: Array) -> Curve:
    """Return the Hermite interpolant of `count` functions. `values` (m+1, count) are the values at the nodes;
    `starts` and `ends` (m, count) are the slopes at the two ends of each step. The nearest nodes that are not
    separated by a jump are used."""
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
    """Return the matrix (2 count, 2 count) that maps values and slopes at `count` successive integers, from
    `first`, to coefficients of powers of θ.

    The matrix is computed from products of integers, which are exact; the inverse of a Vandermonde matrix
    would lose digits."""
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


def through_points(function: Callable[[Array], Array], grid: Grid, rtol: float) -> Curve:
    """Return the curve of `function`, whose values at phases (k,) are (k, r), through Chebyshev points of
    every step.

    Steps are halved until the curve agrees with the function between the points. The grid of X can be too
    coarse, because harmonics of inputs and weights are attenuated in X but not in the gain."""
    theta = (1 - np.cos((np.arange(_POINTS) + 0.5) * np.pi / _POINTS)) / 2
    previous = np.inf
    while True:
        values = function(grid.stages(theta).ravel()).reshape(grid.steps, _POINTS, -1)
        curve = Curve.from_steps(grid.nodes, np.swapaxes(values, 1, 2), _lagrange_powers(tuple(theta)))
        between = grid.stages(np.array(_BETWEEN)).ravel()
        largest = np.abs(values).max(axis=(0, 1))
        largest = np.maximum(largest, _SMALL * largest.max(initial=0.0))
        error = np.abs(curve(between).T - function(between).reshape(len(between), -1)).max(axis=0)
        relative = np.divide(error, largest, out=np.zeros_like(error), where=largest > 0).max()
        if relative <= rtol or previous / 2 < relative < _RESOLVED or 2 * grid.steps > _MOST:
            return curve
        grid, previous = grid.halved, relative


@cache
def _lagrange_powers(theta: tuple[float, ...]) -> Array:
    """Return the matrix that maps values at the fractions `theta` of a step to coefficients of powers of
    θ."""
    nodes = np.array(theta)
    columns = []
    for at, node in enumerate(nodes):
        others = np.delete(nodes, at)
        columns.append(np.poly(others)[::-1] / np.prod(node - others))
    return np.stack(columns, axis=1)
