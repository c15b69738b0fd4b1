"""Newton's iteration for a nonlinear orbit (Newton–Kantorovich). Each correction solves the linear periodic
problem along the last curve (U. Ascher, R. Mattheij, R. Russell, Numerical Solution of Boundary Value
Problems, 2.3.4). A correction is damped if its full length would not reduce the norm of the next correction
(P. Deuflhard, Newton Methods for Nonlinear Problems, 3.3)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from solve.arguments import NUMBERS_A_POINT, require_size
from solve.arrays import Array
from solve.certify.correction import CoordinateScale, correction
from solve.contracts import Motion
from solve.equations import events_of, nonlinear_of
from solve.errors import ChatterError, LinearModelError, NoOrbitError, SolveError, counted
from solve.kernel.formulas import columns_by
from solve.methods.collocated import Collocated
from solve.methods.free import free, solutions_on
from solve.methods.method import Solutions
from solve.newton.saltation import event_jumps, solutions_with_jumps
from solve.period.curve import Curve
from solve.period.grid import Grid
from solve.period.points import ScaledEquations, SinglePoint
from solve.period.rigid_body import RigidBodyModes
from solve.system import PeriodicSystem
from solve.terminal import progress
from solve.threads import one_thread

_MAX_CORRECTIONS = 40
"""Maximum number of corrections. Chosen by judgement."""

_MIN_DAMPING = 1 / 64
"""Smallest damping factor of a correction. Chosen by judgement."""

_NEAR = 0.1
"""Norm of a correction below which the jumps at events are included. Chosen by judgement: as long as
corrections are larger, the iteration without jumps converges from more initial motions. The jumps are also
included if the iteration without jumps stops before it converges."""

_MOST_EVENTS = 128
"""Largest number of events per period of the system. Chosen by judgement: it is a quarter of the number of
phases at which switches are evaluated on a coarse grid. If a motion had more events, most of them would be
missed."""

_STALLED = 1e-6
"""Relative size below which corrections that no longer decrease count as round-off. Chosen by judgement: far
above eps times the condition number of typical systems, and far below a useful rtol."""

QUADRATIC = 1e-3
"""Norm of a correction below which the convergence counts as quadratic. Chosen by judgement: the norm of the
next correction is about the square of this norm."""

_RTOL_FRACTION = 0.01
"""Upper limit of the last correction, as a fraction of the tolerance of the orbit. Chosen by judgement: with
quadratic convergence, the remaining error is far smaller than the last correction."""


@dataclass(frozen=True)
class Task:
    """Orbit to compute.

    speed: in rad/s. periods: number of periods of the system in the period of the orbit. rtol: tolerance of
    the orbit. factors (1, n): scale factors of the equations if their magnitudes differ widely, otherwise
    None."""

    system: PeriodicSystem
    speed: float
    periods: int
    method: Collocated
    engine: str
    rtol: float
    factors: Array | None = None

    def __post_init__(self) -> None:
        require_size("periods", self.periods, NUMBERS_A_POINT)

    def with_method(self, method: Collocated) -> "Task":
        """Return the task of computing the same orbit by another method."""
        other = replace(self, method=method)
        vars(other).update(rigid=self.rigid, breaks=self.breaks)
        return other

    def along(self, curve: Motion) -> PeriodicSystem:
        """Return the system linearised along `curve`, with the events of the curve as breaks."""
        return nonlinear_of(self.system).along_events(curve, self.speed, columns_by(self.engine))

    def speed_text(self, speed: float) -> str:
        """Format a speed (rad/s) with its unit."""
        return self.system.labels.speed_unit.text(speed, ".4g")

    @property
    def last_correction(self) -> float:
        """Upper limit of the norm of the last correction."""
        return _RTOL_FRACTION * self.rtol

    @property
    def period(self) -> float:
        """Period of the orbit, as an interval of the phase."""
        return self.periods * self.system.period

    def grid(self, steps: int) -> Grid:
        """Return a grid of about `steps` steps over the period of the orbit."""
        return Grid.uniform(steps, self.period, self.breaks)

    @cached_property
    def breaks(self) -> tuple[float, ...]:
        """Phases, over the period of the orbit, at which the equations jump."""
        offsets = np.arange(self.periods) * self.system.period
        return tuple((offsets[:, None] + np.array(self.system.breaks)).ravel().tolist())

    @cached_property
    def rigid(self) -> RigidBodyModes | None:
        """Rigid-body modes of the system linearised about the fundamental motion; None without such modes."""
        return rigid_at_rest(self.system, self.speed, self.engine)

    def rest(self, grid: Grid) -> Curve:
        """Return the fundamental motion q = 0. The first Newton iterate from this motion is the linear
        orbit."""
        return zero_motion(self.system.n, grid)


@dataclass(frozen=True)
class Converged:
    """Result of Newton's iteration.

    solutions: last iterate. iterations: number of corrections. last: relative norm of the last correction."""

    solutions: Solutions
    iterations: int
    last: float

    @property
    def curve(self) -> Curve:
        """Curve of the orbit."""
        return curve_of(self.solutions)


def curve_of(solutions: Solutions) -> Curve:
    """Return the curve of the solution of a single point."""
    assert isinstance(solutions.curve, Curve)
    return solutions.curve[0]


def zero_motion(n: int, grid: Grid) -> Curve:
    """Return the motion q = 0 of n coordinates on the nodes of a grid."""
    return Curve(grid.nodes, np.zeros((n, grid.steps, 1)))


def at_rest(system: PeriodicSystem, speed: float, engine: str) -> SinglePoint:
    """Return a system linearised about the fundamental motion q = 0."""
    rest = zero_motion(system.n, Grid.uniform(1, system.period))
    return SinglePoint(nonlinear_of(system).along(rest, columns_by(engine)), speed)


def rigid_at_rest(system: PeriodicSystem, speed: float, engine: str) -> RigidBodyModes | None:
    """Return the rigid-body modes of a system linearised about the fundamental motion; None if it has
    none."""
    free_machine = free(at_rest(system, speed, engine))
    return None if free_machine is None else free_machine.modes


def without_zeros(sizes: Array) -> Array:
    """Return the sizes (n,) of the coordinates, with zeros replaced by the largest size, or by 1 if all sizes
    are zero."""
    return np.where(sizes > 0, sizes, sizes.max() or 1.0)


def iterate(
    task: Task, start: Motion, grid: Grid, most: int = _MAX_CORRECTIONS, last: float = 0.0
) -> Converged:
    """Apply Newton's iteration on a grid from the initial motion `start`. It ends when the norm of a
    correction is at most the larger of `last` and `task.last_correction`. It also ends when
    corrections within round-off no longer decrease.

    Raises NoOrbitError after `most` corrections, or if damping does not help. The message states the smallest
    correction."""
    with one_thread(task.system.n), progress.task(f"Newton's iteration on {grid.steps} steps"):
        return _iterate(task, start, grid, most, max(last, task.last_correction))


def _iterate(task: Task, start: Motion, grid: Grid, most: int, last: float) -> Converged:
    curve, norm = _initial(task, start, grid), _CorrectionNorm(task, grid)
    corrected, near = correct(task, curve, grid, False), False
    size, damping, smallest, count = norm(curve, corrected), 1.0, math.inf, 0
    while count < most:
        count += 1
        if not near and (size < _NEAR or damping < _MIN_DAMPING):
            near, damping, without_jumps = True, 1.0, corrected
            corrected = correct(task, curve, grid, True, without_jumps)
            size = size if corrected is without_jumps else norm(curve, corrected)
        smallest = min(smallest, size)
        if size <= last:
            return norm.converged(curve, corrected, count)
        trial = interpolate(curve, curve_of(corrected), damping)
        try:
            after = correct(task, trial, grid, near)
        except LinearModelError:
            raise
        except SolveError:
            after = None
        next_size = math.inf if after is None else norm(trial, after)
        # Large corrections usually need damping only. If two halvings do not suffice, the scales may be the
        # cause.
        may_vanish = damping < 1 / 2 or size < _NEAR
        if not next_size <= (1 - damping / 4) * size and may_vanish and norm.refined(curve, corrected):
            size = norm(curve, corrected)
            next_size = math.inf if after is None else norm(trial, after)
        if size < _STALLED and next_size > size / 2:
            return norm.converged(curve, corrected, count)
        if after is not None and next_size <= (1 - damping / 4) * size:
            curve, corrected, size, damping = trial, after, next_size, min(1.0, 2 * damping)
        elif damping <= _MIN_DAMPING and (near or not events_of(task.along(curve)).phases):
            break
        else:
            damping /= 2
    raise NoOrbitError(
        f"after {counted(count, 'correction')}, the smallest correction was {smallest:.1e} "
        "relative to the orbit"
    )


def _initial(task: Task, start: Motion, grid: Grid) -> Curve:
    """Return the curve of the motion from which the iteration starts. A curve with fewer steps than the grid
    is not interpolated, because interpolation would make it less accurate. A curve with more steps is
    interpolated, because its contacts may be shorter than the steps of the grid, on which the next iterate
    would miss them."""
    if isinstance(start, Curve) and len(start.h) <= grid.steps and start.nodes[-1] == task.period:
        return start
    return on(grid, start)


class _CorrectionNorm:
    """Norm of corrections, relative to max|q| of each coordinate. If the corrections stop decreasing, max|q|
    is replaced by scales that do not vanish (`CoordinateScale`). Corrections within round-off then count as
    0."""

    def __init__(self, task: Task, grid: Grid):
        self._task, self._grid = task, grid
        self._floor, self._roundoff = np.zeros((2, task.system.n))
        self._curve: Curve | None = None

    def __call__(self, curve: Curve, solutions: Solutions) -> float:
        """Return the norm of the correction from `curve` to the curve of `solutions`, as the maximum over the
        coordinates."""
        change, largest = correction(curve, solutions)
        return self._relative(np.where(change > self._roundoff, change, 0.0), largest)

    def _relative(self, change: Array, largest: Array) -> float:
        scale = np.maximum(largest, self._floor)
        return float((change / np.where(scale > 0, scale, 1.0)).max())

    def refined(self, curve: Curve, solutions: Solutions) -> bool:
        """Compute the scales that do not vanish, along `curve`. Return False if they had already been
        computed along this curve."""
        if curve is self._curve:
            return False
        task, self._curve = self._task, curve
        along = nonlinear_of(task.system).along(curve, columns_by(task.engine))
        scale = CoordinateScale(along, curve, task.speed, self._grid.steps)
        change, largest = correction(curve, solutions)
        self._floor, self._roundoff = scale.scales(largest), np.zeros_like(largest)
        if self._relative(change, largest) > _STALLED:
            self._floor, self._roundoff = scale.scales(largest, roundoff=True), scale.roundoff
        return True

    def converged(self, curve: Curve, solutions: Solutions, count: int) -> Converged:
        """Return the result of the iteration. Coordinates that are zero within round-off are set to zero."""
        size, reached = self._relative(*correction(curve, solutions)), curve_of(solutions)
        zero = np.abs(reached.sampled(1)).max(axis=1) <= self._roundoff
        return Converged(with_zeros(solutions, zero) if zero.any() else solutions, count, size)


def with_zeros(solutions: Solutions, zero: Array) -> Solutions:
    """Return the solution of a single point with those coordinates set to zero for which `zero` (n,) is
    true."""
    curve = curve_of(solutions)
    moving = np.where(zero[:, None, None], 0.0, curve.coefficients)[None]
    return replace(solutions, curve=Curve(curve.nodes, moving))


def interpolate(one: Curve, other: Curve, fraction: float) -> Curve:
    """Return the curve `one` + `fraction` · (`other` - `one`) on the nodes of `other`. A fraction above 1
    extrapolates."""
    if fraction == 1:
        return other
    if not np.array_equal(one.nodes, other.nodes):
        one = on(Grid(other.nodes, np.zeros(len(other.nodes) - 1, dtype=bool)), one)
    return add(one, fraction, add(other, -1.0, one))


def add(one: Curve, factor: float, other: Curve) -> Curve:
    """Return the curve `one` + `factor` · `other`. Both curves must have the same nodes."""
    powers = max(curve.coefficients.shape[-1] for curve in (one, other))
    total = np.zeros((*one.coefficients.shape[:-1], powers))
    total[..., : one.coefficients.shape[-1]] = one.coefficients
    total[..., : other.coefficients.shape[-1]] += factor * other.coefficients
    return Curve(one.nodes, total, drift=_drift(one, factor, other))


def _drift(one: Curve, factor: float, other: Curve) -> Array | None:
    if one.drift is None and other.drift is None:
        return None
    first, second = (np.zeros(curve.n) if curve.drift is None else curve.drift for curve in (one, other))
    return first + factor * second


def joined(turns: Sequence[Array], period: float, rigid: RigidBodyModes | None) -> Curve:
    """Join the motions q, v, a (3, n, k) of successive periods of the system into a curve over the whole
    `period`.

    The mean displacement and the steady velocity along rigid-body modes are arbitrary and are removed. If
    drag determines the steady velocity, it becomes the drift of the curve."""
    q, v, a = np.concatenate([*(turn[..., :-1] for turn in turns), turns[-1][..., -1:]], axis=-1)
    nodes, drift = np.linspace(0.0, period, q.shape[-1]), None
    if rigid is not None:
        vectors = rigid.vectors[0]
        components = np.linalg.pinv(vectors) @ q
        velocities = (components[:, -1] - components[:, 0]) / period
        steady = vectors @ velocities
        q = q - vectors @ components.mean(axis=1, keepdims=True) - steady[:, None] * (nodes - period / 2)
        v = v - steady[:, None]
        drift = vectors @ np.where(rigid.dragged[0], velocities, 0.0)
    return replace(Curve.quintic(nodes, q.T, v.T, a.T[:-1], a.T[1:]), drift=drift)


def on(grid: Grid, motion: Motion) -> Curve:
    """Return the curve of a motion on the nodes of `grid`."""
    if isinstance(motion, Curve) and np.array_equal(motion.nodes, grid.nodes):
        return motion
    if grid.smooth and isinstance(motion, Curve):
        q, v, a = (state.T for state in motion.states(grid.nodes))
        starts, ends = a[:-1], a[1:]
    else:
        q, v = (motion(grid.nodes, derivative).T for derivative in range(2))
        starts, ends = (motion(phase, 2).T for phase in grid.stages(np.array([0.0, 1.0])).T)
    drift = getattr(motion, "drift", None)
    v = v if drift is None else v - drift
    curve = Curve.quintic(grid.nodes, q, v, starts, ends)
    return curve if drift is None else replace(curve, drift=drift)


def linearised_along(task: Task, curve: Curve, grid: Grid) -> tuple[PeriodicSystem, Grid]:
    """Return the system linearised along `curve`, and a grid with the phases of events as breaks and about as
    many steps as `grid`. Raises ChatterError if there are too many events."""
    along = task.along(curve)
    if len(events_of(along).phases) > _MOST_EVENTS * task.periods:
        raise _chatter(task, np.array(events_of(along).phases))
    # Since the grid was made, a parameter may have moved the breaks of the task.
    if along.breaks != tuple(grid.nodes[:-1][grid.at_break].tolist()):
        grid = Grid.uniform(grid.steps, task.period, along.breaks)
    return along, grid


def _chatter(task: Task, phases: Array) -> ChatterError:
    densest = float(phases[np.diff(phases, append=phases[0] + task.period).argmin()])
    number = f"{len(phases)} times" + (f" in {task.periods} periods" if task.periods > 1 else " per period")
    return ChatterError(
        f"the motion crosses switches of the equations {number}, most densely near phase {densest:.4g} rad; "
        f"allowed: {_MOST_EVENTS} times per period; it may chatter: give the contact more damping or less "
        "stiffness"
    )


def correct(
    task: Task, curve: Curve, grid: Grid, through_jumps: bool, otherwise: Solutions | None = None
) -> Solutions:
    """Return the next Newton iterate from `curve`.

    through_jumps: whether to include the jumps of perturbations at events with discontinuous forces.
    otherwise: the iterate without these jumps, if already computed; it is returned if there are no jumps."""
    along, grid = linearised_along(task, curve, grid)
    jumps = event_jumps(along, curve, task.speed, grid) if through_jumps else []
    if otherwise is not None and not jumps:
        return otherwise
    point = SinglePoint(along, task.speed)
    held = None if task.rigid is None else free(point)
    if jumps:
        return solutions_with_jumps(task.method, point, grid, task.engine, held, jumps).checked()
    scaled = point if task.factors is None else ScaledEquations(point, task.factors)
    return solutions_on(task.method, scaled, grid, True, task.engine, held).checked()
