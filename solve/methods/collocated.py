"""A collocation method as a method of a period: in compiled code where that is at hand, else in NumPy."""

import numpy as np

from solve.arrays import Array
from solve.methods import segments
from solve.methods.collocation import Collocation, discretise
from solve.methods.method import Discretisation, OneStep, Solution, no_orbit, overflow
from solve.period.curve import Curve
from solve.period.grid import Grid
from solve.period.period_map import SINGULAR, Steps, closed_condition
from solve.system import PeriodicSystem


class Collocated(OneStep):
    """What Gauss's and Radau's methods share."""

    order: int

    @property
    def follows(self) -> float:
        """Up to here a mode without damping keeps about half its amplitude, or more, over 500 rad."""
        return self.order / 2 - 1

    @property
    def samples_evenly(self) -> bool:
        return False

    @property
    def curve_order(self) -> int:
        return min(self.order, self.collocation.curve_order)

    @property
    def collocation(self) -> Collocation:
        raise NotImplementedError

    def bytes_a_step(self, n: int) -> int:
        return self.collocation.bytes_a_step(n)

    def discretise(self, system: PeriodicSystem, speed: float, grid: Grid) -> Discretisation:
        return discretise(self.collocation, system, speed, grid)

    def solution(self, system: PeriodicSystem, speed: float, grid: Grid, orbit: bool) -> Solution:
        if not grid.smooth or not segments.ready(self.collocation, system.n, grid.steps):
            return super().solution(system, speed, grid, orbit)
        found = self._in_segments(system, speed, grid)
        if not np.isfinite(found.Phi).all():
            raise overflow(self.name, grid.steps)
        steps = Steps(found.maps[..., :-1], found.maps[..., -1])
        if not orbit:
            return Solution(grid, found.Phi, steps=steps)
        condition = float(closed_condition(*found.closed))
        if not condition < 1 / SINGULAR:
            raise no_orbit()
        return Solution(grid, found.Phi, Curve(grid.nodes, found.curve), steps, condition)

    def _in_segments(self, system: PeriodicSystem, speed: float, grid: Grid) -> segments.Segments:
        method = self.collocation
        nodes = None if method.stiffly_accurate else _entries(system, grid.nodes[:-1], speed)
        stages = _entries(system, grid.stages(np.array(method.c)).ravel(), speed)
        return segments.solved(method, grid.period / grid.steps, stages, nodes)


def _entries(system: PeriodicSystem, phase: Array, speed: float) -> Array:
    """Ω²M, ΩC, K by rows and d (k, 3n² + n) at phases (k,)."""
    return np.concatenate([part.reshape(len(phase), -1) for part in system.in_phase(phase, speed)], axis=1)
