"""A collocation method as a method of a period: in compiled code where that is wanted, else in NumPy."""

import numpy as np

from solve.kernel import collocation as kernel
from solve.kernel.engines import COMPILED, NUMPY
from solve.kernel.library import Size
from solve.methods.collocation import Collocation, discretise
from solve.methods.method import Discretisation, OneStep, Solutions
from solve.period.curve import Curve
from solve.period.grid import Grid
from solve.period.period_map import Steps, closed_condition
from solve.period.points import Points, Tables

_LARGEST = 40
"""Coordinates up to which lanes are quicker than NumPy's BLAS."""


class Collocated(OneStep):
    """What Gauss's and Radau's methods share. follows: up to here a mode without damping keeps about half
    its amplitude, or more, over 500 rad."""

    order: int
    samples_evenly = False

    def __post_init__(self) -> None:
        # The curve between the nodes has the order of the stage accelerations, s + 1, and two more.
        stages = (self.order + 1) // 2
        self._set(follows=self.order / 2 - 1, curve_order=min(self.order, stages + 3))

    @property
    def collocation(self) -> Collocation:
        raise NotImplementedError

    def bytes_a_step(self, n: int, orbit: bool = True, engine: str = NUMPY) -> int:
        if engine == COMPILED and n <= _LARGEST:
            return kernel.bytes_a_step(n, len(self.collocation.curve_powers), orbit)
        return self.collocation.bytes_a_step(n)

    def discretise(self, points: Points, grid: Grid) -> Discretisation:
        return discretise(self.collocation, points, grid)

    def solutions(self, points: Points, grid: Grid, orbit: bool, engine: str = NUMPY) -> Solutions:
        if engine != COMPILED or not grid.smooth or points.n > _LARGEST:
            return super().solutions(points, grid, orbit)
        method, n = self.collocation, points.n
        # A single point takes the library with orbits for its multipliers too: one less to compile.
        with_orbit = orbit or len(points) == 1
        size = Size(n, len(method.c), len(method.curve_nodes), method.stiffly_accurate, with_orbit)
        stages = points.tables(grid.stages(np.array(method.c)).ravel())
        nodes = None
        if with_orbit and not method.stiffly_accurate:
            nodes = _samples(points.tables(grid.nodes[:-1]))
        made = kernel.solved(size, method.weights, grid.period, _samples(stages), nodes)
        steps = None if made.maps is None else Steps(made.maps[..., :-1], made.maps[..., -1])
        if not orbit or made.curves is None or made.closed is None:
            return self.sound(points, grid, made.Phi, steps=steps)
        finite = np.asarray(np.isfinite(made.closed).all(axis=(1, 2, 3)))
        G, H = np.moveaxis(np.where(finite[:, None, None, None], made.closed, 0.0), 1, 0)
        condition = np.where(finite, closed_condition(G, H), np.inf)
        curve = Curve(grid.nodes, made.curves)
        if (np.isfinite(made.Phi).all(axis=(1, 2)) & ~(finite & curve.finite)).any():
            # Units so far apart that squares overflow in the lanes; NumPy's closing balances them.
            return super().solutions(points, grid, orbit)
        return self.sound(points, grid, made.Phi, curve, condition, steps)


def _samples(tables: Tables) -> kernel.Samples:
    return kernel.Samples(tables.table, tables.coefficients, tables.entry)
