"""Base class of the Gauss and Radau methods: periodic solutions by collocation, with compiled code or
NumPy."""

from functools import cache, cached_property
from math import factorial
from typing import Self

import numpy as np

from solve.arguments import SMALL
from solve.arrays import Array, solved
from solve.errors import ValueOutOfBoundsError
from solve.kernel import collocation as kernel
from solve.kernel.engines import COMPILED, NUMPY
from solve.kernel.library import Size, available
from solve.matrices import by_rates, leading
from solve.methods.collocation import Collocation
from solve.methods.method import Discretisation, OneStep, Solutions
from solve.period.curve import Curve
from solve.period.grid import Grid
from solve.period.period_map import Steps
from solve.period.points import Points, Tables, affine, matrices, state_size

_MEMORY = 2**24
"""Size in bytes of the stage matrices of those steps that are sampled in one call."""

_ALONE = 16
"""Number of coordinates from which compiled code solves one point after another, in segments of the period.
The stage systems of several points would exceed the cache. Measured speed, relative to solving several points
at a time (AVX-512, four-bar, 8 to 48 speeds): 0.6 to 1.2 with 9 coordinates, 0.9 to 2 with 18, and 2.2 with
27."""


def _accelerations(method: Collocation, points: Points, h: Array, phases: Array) -> Array:
    """Stage accelerations (P, m, s, n, N+1) on steps of lengths h (m,) with stages at `phases` (m, s).
    First-order coordinates have rates instead of accelerations."""
    M, C, K, d = matrices(points, phases.ravel())
    sampled = *by_rates(M, C, K, points.first_order), d
    M, C, K, d = (part.reshape(len(part), *phases.shape, *part.shape[2:]) for part in sampled)
    a = method.stage_accelerations(h, M, C, K, d)
    if not points.first_order:
        return a
    # First-order coordinates are stored with the rates. Their entries among the positions are not used.
    n, p = points.n, points.n - points.first_order
    return np.concatenate((a[..., :p], a[..., n + p : 2 * n], a[..., n : n + p], a[..., 2 * n :]), axis=-1)


def _end_accelerations(
    method: Collocation, points: Points, grid: Grid, x: Array, last: Array
) -> tuple[Array, Array]:
    """Accelerations (P, m, n) at the start and at the end of every step. last: accelerations of the last
    stages. For a stiffly accurate method, these stages are the ends of the steps."""
    ends = grid.stages(np.array([0.0, 1.0]))
    if not method.stiffly_accurate:
        starts = _acceleration(points, ends[:, 0], x[:, :-1])
        if grid.smooth:
            return starts, np.roll(starts, -1, axis=1)
        return starts, _acceleration(points, ends[:, 1], x[:, 1:])
    starts = np.roll(last, 1, axis=1)
    if not grid.smooth:
        behind = np.flatnonzero(grid.at_break)
        starts[:, behind] = _acceleration(points, ends[behind, 0], x[:, behind])
    return starts, last


def _acceleration(points: Points, phase: Array, x: Array) -> Array:
    """Highest derivatives (P, k, n) with respect to the phase at `phase` (k,), from the equations of motion,
    for states x (P, k, N)."""
    M, C, K, d = matrices(points, phase)
    q, v = x[..., : points.n, None], x[..., points.n :, None]
    highest = leading(M, C, points.first_order)
    return np.squeeze(solved(highest, d[..., None] - K @ q - C[..., : v.shape[-2]] @ v), -1)


class Collocated(OneStep):
    """Base class of the Gauss and Radau methods. The order determines the number of stages.

    orders: available orders. follows: value of ω h up to which an undamped mode retains at least about half
    of its amplitude over a phase advance of 500 rad."""

    order: int
    orders: range
    samples_evenly = False
    first_order = True

    def __post_init__(self) -> None:
        if not isinstance(self.order, int | np.integer) or self.order not in self.orders:
            usual = type(self).order
            raise ValueOutOfBoundsError(
                f"order of {self.name} is {self.order}; allowed: {', '.join(map(str, self.orders))}; "
                f"try order {usual}"
            )
        self._set(order=int(self.order))
        self._state_facts()

    def _state_facts(self) -> None:
        # Between the nodes, the stage accelerations have order s + 1. Two integrations raise the order by
        # two.
        stages = (self.order + 1) // 2
        self._set(follows=self.order / 2 - 1, curve_order=min(self.order, stages + 3))

    @cached_property
    def with_another_stage(self) -> Self:
        """Method of the same family with s + 1 stages. Its order is higher by two and need not be one of
        `orders`."""
        method = object.__new__(type(self))
        method._set(order=self.order + 2)
        method._state_facts()
        return method

    @property
    def nodes(self) -> Array:
        """Nodes (s,), as fractions of a step."""
        raise NotImplementedError

    @property
    def error_constant(self) -> float:
        """Constant c in exp(z) − R(z) = ± c z^(p + 1) + …. R is the Padé approximant of exp with s powers in
        the denominator and p − s in the numerator (E. Hairer, G. Wanner, Solving ODEs II, Eq. (IV.3.31))."""
        s, p = (self.order + 1) // 2, self.order
        return factorial(s) * factorial(p - s) / (factorial(p) * factorial(p + 1))

    @cached_property
    def stages(self) -> Collocation:
        return _collocation(self)

    def bytes_a_step(self, n: int, orbit: bool = True, engine: str = NUMPY) -> int:
        if engine == COMPILED and n <= SMALL:
            return kernel.bytes_a_step(n, len(self.stages.curve_powers), orbit)
        return self.stages.bytes_a_step(n)

    def discretise(self, points: Points, grid: Grid) -> Discretisation:
        method = self.stages
        phases = grid.stages(np.array(method.c))
        size = max(1, _MEMORY // (8 * (len(method.c) * points.n) ** 2))
        a = np.empty((len(points), grid.steps, len(method.c), points.n, state_size(points) + 1))
        for part in (slice(first, first + size) for first in range(0, grid.steps, size)):
            a[:, part] = _accelerations(method, points, grid.h[part], phases[part])

        def curve(x: Array) -> Curve:
            stages = affine(a, x[:, :-1, None])
            starts, ends = _end_accelerations(method, points, grid, x, stages[:, :, -1])
            return method.curve(grid.nodes, x, starts, stages, ends)

        return Discretisation(method.steps(grid.h, a, points.first_order), curve)

    def solutions(self, points: Points, grid: Grid, orbit: bool, engine: str = NUMPY) -> Solutions:
        if engine != COMPILED or points.n > SMALL:
            return super().solutions(points, grid, orbit)
        method, n = self.stages, points.n
        stages = points.tables(grid.stages(method.weights["c"]).ravel())
        # A single point of a batch uses the library and lanes of the batch, so that its results do not depend
        # on how the batch is divided. Other single points always use the library with orbits, even for
        # multipliers only, which saves a compilation.
        alone = (n >= _ALONE and grid.smooth) or (len(points) == 1 and (stages.per_point or points.alone))
        with_orbit = orbit or alone
        numbers = n, len(method.c), len(method.curve_nodes)
        size = Size(*numbers, method.stiffly_accurate, with_orbit, points.first_order)
        if not available(size):
            return super().solutions(points, grid, orbit)
        nodes = None
        if with_orbit and not grid.smooth:
            nodes = _samples(points.tables(grid.stages(np.array([0.0, 1.0])).T.ravel()))
        elif with_orbit and not method.stiffly_accurate:
            nodes = _samples(points.tables(grid.nodes[:-1]))
        samples = _samples(stages), nodes
        periods = kernel.solved(size, method.weights, grid.lengths, not grid.smooth, *samples, alone)
        steps = None if periods.maps is None else Steps(periods.maps[..., :-1], periods.maps[..., -1])
        if not orbit or periods.curves is None or periods.condition is None:
            return self.sound(points, grid, periods.Phi, steps=steps, units=periods.units, engine=engine)
        finite = np.isfinite(periods.condition)
        curve, lost = Curve(grid.nodes, periods.curves, known_finite=finite), ~finite
        if lost.any() and (np.isfinite(periods.Phi).all(axis=(1, 2)) & lost).any():
            # The units differ so much that squares overflow in the lanes. The solution of the cyclic system
            # in NumPy balances them.
            return super().solutions(points, grid, orbit)
        return self.sound(points, grid, periods.Phi, curve, periods.condition, steps, periods.units, engine)


@cache
def _collocation(method: Collocated) -> Collocation:
    return Collocation(tuple(map(float, method.nodes)))


def _samples(tables: Tables) -> kernel.Samples:
    return kernel.Samples(tables.table, tables.coefficients, tables.entry)
