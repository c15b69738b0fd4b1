"""Newton's iteration for a nonlinear orbit (Newton–Kantorovich): every correction is a linear periodic
problem along the last curve (U. Ascher, R. Mattheij, R. Russell, Numerical Solution of Boundary Value
Problems, 2.3.4), damped until corrections fall (P. Deuflhard, Newton Methods for Nonlinear Problems, 3.3)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from solve.arrays import Array
from solve.certify.correction import CoordinateScale, corrected, correction
from solve.contracts import Motion
from solve.errors import LinearModelError, NoOrbitError, SolveError, StepsError
from solve.kernel.formulas import columns_by
from solve.methods.collocation import Collocated, Collocation
from solve.methods.free import free
from solve.methods.method import Method, Solutions, one_by_one
from solve.period.curve import Curve
from solve.period.frozen import FrozenModes
from solve.period.grid import Grid
from solve.period.points import Multiplied, OnePoint, Points
from solve.period.rigid_body import RigidBodyModes
from solve.system import PeriodicSystem
from solve.terminal import progress
from solve.threads import one_thread

_MOST = 40
"""Corrections after which an iteration is given up."""

_LEAST_PART = 1 / 64
"""Part of a correction below which none is tried."""

_STALLED = 1e-6
"""Size below which corrections that fall no more are rounding."""

_PART_OF_RTOL = 0.01
"""What the last correction may be of the tolerance of the orbit."""

_COARSE = 256
"""Steps from which on a grid is not to blame where the iteration does not converge."""


@dataclass(frozen=True)
class Task:
    """The orbit to find: of a system at a speed (rad/s), over so many of its periods, by a method on grids
    whose corrections end at rtol; factors (1, n): by which equations in far units are multiplied."""

    system: PeriodicSystem
    speed: float
    periods: int
    method: Collocated
    engine: str
    rtol: float
    factors: Array | None = None

    def in_words(self, speed: float) -> str:
        """A speed (rad/s)."""
        return self.system.speed_unit.text(speed, ".4g")

    @property
    def period(self) -> float:
        """In phase."""
        return self.periods * self.system.period

    def grid(self, steps: int) -> Grid:
        """About `steps` steps over the orbit's period."""
        turns = np.arange(self.periods) * self.system.period
        breaks = tuple(float(b) for phase in self.system.breaks for b in phase + turns)
        return Grid.uniform(steps, self.period, breaks)

    @cached_property
    def rigid(self) -> RigidBodyModes | None:
        return rigid_at_rest(self.system, self.speed)

    def rest(self, grid: Grid) -> Curve:
        """Fundamental motion, q = 0; the next iterate is the linear orbit."""
        return at_rest(self.system.n, grid)


@dataclass(frozen=True)
class Converged:
    """The last iterate, the corrections that led there, and the size of the last one."""

    solutions: Solutions
    iterations: int
    last: float

    @property
    def curve(self) -> Curve:
        curve = self.solutions.curve
        assert isinstance(curve, Curve)
        return curve[0]


def at_rest(n: int, grid: Grid) -> Curve:
    """q = 0 of n coordinates on a grid."""
    return Curve(grid.nodes, np.zeros((n, grid.steps, 1)))


def rigid_at_rest(system: PeriodicSystem, speed: float) -> RigidBodyModes | None:
    """Rigid-body modes of a system linearised about the desired motion, None where it has none."""
    found = free(OnePoint(system.along(at_rest(system.n, Grid.uniform(1, system.period))), speed))
    return None if found is None else found.modes


def without_zeros(sizes: Array) -> Array:
    """Sizes (n,) of coordinates, those that are 0 as large as the largest, or 1 where all are."""
    return np.where(sizes > 0, sizes, sizes.max() or 1.0)


def iterated(task: Task, start: Motion, grid: Grid, most: int = _MOST) -> Converged:
    """Newton's iteration on a grid from a motion. Raises NoOrbitError, which says how far it came."""
    with one_thread(task.system.n), progress.task(f"Newton's iteration on {grid.steps} steps"):
        return _iterated(task, start, grid, most)


def _iterated(task: Task, start: Motion, grid: Grid, most: int) -> Converged:
    measure, curve = _Measure(task, grid), on(grid, start)
    found = _corrected(task, curve, grid)
    size, part, smallest, count = measure(curve, found), 1.0, math.inf, 0
    while count < most:
        count += 1
        smallest = min(smallest, size)
        if size <= _PART_OF_RTOL * task.rtol:
            return measure.converged(curve, found, count)
        trial = between(curve, Converged(found, count, size).curve, part)
        try:
            after = _corrected(task, trial, grid)
        except LinearModelError:
            raise
        except SolveError:
            after = None
        then = math.inf if after is None else measure(trial, after)
        if not then <= (1 - part / 4) * size and measure.refined(curve, found):
            size = measure(curve, found)
            then = math.inf if after is None else measure(trial, after)
        if size < _STALLED and then > size / 2:
            return measure.converged(curve, found, count)
        if after is not None and then <= (1 - part / 4) * size:
            curve, found, size, part = trial, after, then, min(1.0, 2 * part)
        elif part <= _LEAST_PART:
            break
        else:
            part /= 2
    raise NoOrbitError(f"after {count} corrections the least was {smallest:.1e} of the orbit")


class _Measure:
    """Norm of corrections: relative to max|q| of each coordinate or, once these no longer decrease, to scales
    that do not vanish with the coordinates; 0 for corrections within round-off."""

    def __init__(self, task: Task, grid: Grid):
        self._task, self._grid = task, grid
        self._floor, self._roundoff = np.zeros((2, task.system.n))
        self._curve: Curve | None = None

    def __call__(self, curve: Curve, found: Solutions) -> float:
        """Norm of the correction to a curve: the largest over the coordinates."""
        change, largest = correction(curve, found)
        return self._relative(np.where(change > self._roundoff, change, 0.0), largest)

    def _relative(self, change: Array, largest: Array) -> float:
        scale = np.maximum(largest, self._floor)
        return float((change / np.where(scale > 0, scale, 1.0)).max())

    def refined(self, curve: Curve, found: Solutions) -> bool:
        """Compute the scales along a curve; False if they are already known."""
        if curve is self._curve:
            return False
        task, self._curve = self._task, curve
        along = task.system.along(curve, columns_by(task.engine))
        scale = CoordinateScale(along, curve, task.speed, self._grid.steps)
        change, largest = correction(curve, found)
        self._floor, self._roundoff = scale.of(largest), np.zeros_like(largest)
        if self._relative(change, largest) > _STALLED:
            self._floor, self._roundoff = scale.of(largest, roundoff=True), scale.roundoff
        return True

    def converged(self, curve: Curve, found: Solutions, count: int) -> Converged:
        """Converged result; coordinates that are zero within round-off are set to zero."""
        size, reached = self._relative(*correction(curve, found)), Converged(found, count, 0.0).curve
        zero = np.abs(reached.sampled(1)).max(axis=1) <= self._roundoff
        if zero.any():
            moving = np.where(zero[:, None, None], 0.0, reached.coefficients)[None]
            found = replace(found, curve=Curve(reached.nodes, moving))
        return Converged(found, count, size)


def between(one: Curve, other: Curve, part: float) -> Curve:
    """The curve that lies a part of the way from one to the other, or beyond; both on the same nodes."""
    return other if part == 1 else summed(one, part, summed(other, -1.0, one))


def summed(one: Curve, part: float, other: Curve) -> Curve:
    """One curve and a part of another, both on the same nodes."""
    powers = max(each.coefficients.shape[-1] for each in (one, other))
    made = np.zeros((*one.coefficients.shape[:-1], powers))
    made[..., : one.coefficients.shape[-1]] = one.coefficients
    made[..., : other.coefficients.shape[-1]] += part * other.coefficients
    return Curve(one.nodes, made, drift=_drift(one, part, other))


def _drift(one: Curve, part: float, other: Curve) -> Array | None:
    if one.drift is None and other.drift is None:
        return None
    first, second = (np.zeros(curve.n) if curve.drift is None else curve.drift for curve in (one, other))
    return first + part * second


def joined(turns: Sequence[Array], period: float, rigid: RigidBodyModes | None) -> Curve:
    """Curve over the whole period from motions (3, n, k) over successive revolutions, without mean and steady
    velocity along rigid-body modes; a velocity determined by drag is the drift of the curve."""
    q, v, a = np.concatenate([*(turn[..., :-1] for turn in turns), turns[-1][..., -1:]], axis=-1)
    nodes, drift = np.linspace(0.0, period, q.shape[-1]), None
    if rigid is not None:
        vectors = rigid.vectors[0]
        shares = np.linalg.pinv(vectors) @ q
        velocities = (shares[:, -1] - shares[:, 0]) / period
        steady = vectors @ velocities
        q = q - vectors @ shares.mean(axis=1, keepdims=True) - steady[:, None] * (nodes - period / 2)
        v = v - steady[:, None]
        drift = vectors @ np.where(rigid.dragged[0], velocities, 0.0)
    return replace(Curve.quintic(nodes, q.T, v.T, a.T[:-1], a.T[1:]), drift=drift)


def on(grid: Grid, motion: Motion) -> Curve:
    """A motion on the nodes of a grid."""
    if isinstance(motion, Curve) and np.array_equal(motion.nodes, grid.nodes):
        return motion
    ends = grid.stages(np.array([0.0, 1.0]))
    q, v = (motion(grid.nodes, derivative).T for derivative in range(2))
    drift = getattr(motion, "drift", None)
    v = v if drift is None else v - drift
    curve = Curve.quintic(grid.nodes, q, v, motion(ends[:, 0], 2).T, motion(ends[:, 1], 2).T)
    return curve if drift is None else replace(curve, drift=drift)


def _corrected(task: Task, curve: Curve, grid: Grid) -> Solutions:
    return corrected(task.system, curve, task.speed, task.method, grid, task.engine, task.factors)


class Newton(Method):
    """The converged iteration on each grid as a method of one point, for `certified` to compare grids: each
    starts from the last curve of the finest. found: the iteration on the first grid, where it has converged
    by the task's own method."""

    def __init__(self, task: Task, start: Motion, steps: int = 0, found: Converged | None = None):
        method = task.method
        self.task, self.start, self.first, self.finest, self.found = task, start, steps, steps, found
        # The curve enters the next linearisation, whose solution is no more exact than it.
        self._set(name=method.name, l_stable=method.l_stable, follows=method.follows, samples_evenly=False)
        self._set(order=method.curve_order, curve_order=method.curve_order)

    @property
    def linear(self) -> bool:
        return False

    @property
    def with_another_stage(self) -> "Newton":
        """Iteration with the method with one more stage."""
        return Newton(replace(self.task, method=self.task.method.with_another_stage), self.start, self.first)

    @property
    def stages(self) -> Collocation:
        return self.task.method.stages

    @property
    def error_constant(self) -> float:
        return self.task.method.error_constant

    def linearised(self, points: Points, solutions: Solutions) -> Points:
        """Equations along the solution of the only point."""
        assert isinstance(solutions.curve, Curve)
        return OnePoint(self.task.system.along(solutions.curve[0]), self.task.speed)

    @property
    def corrector(self) -> Collocated:
        return self.task.method

    def least_steps(self, modes: FrozenModes) -> Array:
        """Coarser grids than that of the first start may have no orbit near it."""
        return np.full(len(modes), int(self.first / 1.2))

    def bytes_a_step(self, n: int, orbit: bool = True, engine: str = "numpy") -> int:
        return self.task.method.bytes_a_step(n, orbit, engine)

    def most_steps(self, n: int) -> int:
        return self.task.method.most_steps(n)

    def solutions(self, points: Points, grid: Grid, orbit: bool, engine: str = "numpy") -> Solutions:
        return one_by_one(points, lambda point: self._converged(point, grid))

    def _converged(self, point: Points, grid: Grid) -> Solutions:
        found, task = self.found, self.task
        if isinstance(point, Multiplied):
            found, task = None, replace(task, factors=point.factors)
        try:
            if found is None or not np.array_equal(found.solutions.grid.nodes, grid.nodes):
                found = iterated(task, self.start, grid)
        except NoOrbitError as reason:
            if grid.steps < _COARSE:
                raise StepsError(str(reason)) from None
            raise
        if grid.steps >= self.finest:
            self.start, self.finest = found.curve, grid.steps
        return replace(found.solutions, defect=np.array([found.last]))

    def point(self) -> OnePoint:
        """The system linearised along the curve from which the iteration starts."""
        return OnePoint(self.task.system.along(self.start), self.task.speed)
