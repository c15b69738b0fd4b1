"""Strategies that supply an initial guess for Newton's iteration: continuation in load or speed, and
transients."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from solve.arrays import Array
from solve.capabilities import Capabilities, Nonlinear
from solve.certify.correction import corrected
from solve.contracts import Columns, Matrices, Motion
from solve.equations import nonlinear_of
from solve.errors import ChatterError, NoOrbitError, ResonanceError, SolveError
from solve.newton.iteration import Converged, Task, interpolate, iterate, joined, without_zeros
from solve.period.curve import Curve
from solve.period.grid import Grid
from solve.system import PeriodicSystem
from solve.terminal import progress

_MAX_CORRECTIONS = 10
"""Maximum number of corrections per continuation step. Chosen by judgement: a shorter step costs less than
further corrections."""

_FIRST_STEP, _MIN_STEP, _GROWTH = 0.1, 4e-3, 2.0
"""First step and smallest step, as fractions of the range of the continuation, and factor by which steps grow
after a success and shrink after a failure. Chosen by judgement."""

_SPEED_HALVINGS = 6
"""Maximum number of times that the speed is halved in the search for a speed at which the iteration from the
linear orbit converges. Chosen by judgement."""

_MAX_PERIODS = 80
"""Largest number of periods of the system over which a transient is integrated. Chosen by judgement."""

_TRIAL_INTERVAL = 5
"""Number of periods between trials of Newton's iteration from a transient that has not settled. Measured for
gears that rattle, at 30 speeds: with 5 periods, a stable orbit is found at 17 speeds; with 16 periods, at 13
speeds. With 5 periods, the search takes 1.5 times as long as with 16."""

_RTOL = 1e-6
"""Relative tolerance of the transient. Chosen by judgement: far below the change that counts as settled."""

_FULLY_SETTLED, _FINE_RTOL = 1e-5, 1e-8
"""Change per period below which the transient ends, even if Newton's iteration has not converged; and
relative tolerance of the motion from which the iteration then starts on finer grids. Chosen by judgement."""

_SETTLED = 1e-3
"""Change per period, relative to the sizes of the coordinates, below which a transient has settled. Chosen by
judgement: Newton's iteration removes the remaining difference."""

_REFINEMENTS = 4, 16, 64
"""Factors on the number of steps of the grids that are tried after a transient has settled. Chosen by
judgement: the finest grid resolves contacts that last a thousandth of the period."""

_PERTURBATION = 1e-3
"""Initial displacement of a transient, relative to the sizes of the coordinates. From zero displacement, the
transient would remain at an unstable equilibrium. Chosen by judgement."""


class PartiallyLoadedSystem(PeriodicSystem, Nonlinear):
    """System on which only a fraction of the load acts. If r(φ, Ω, q, q̇, q̈) is the residual of the full
    system, the residual of this system is r - (1 - fraction) r(φ, Ω, 0, 0, 0)."""

    def __init__(self, system: PeriodicSystem, fraction: float, rest: Motion):
        super().__init__(system.at, system.coordinates, system.period, system.breaks)
        self._system, self._fraction, self._rest = system, fraction, rest

    @property
    def capabilities(self) -> Capabilities:
        return super().capabilities._replace(nonlinear=self)

    def along(self, motion: Motion, compiled: Columns | None = None) -> PeriodicSystem:
        # Both residuals are linearised in the same way, so that rest is exactly an orbit if there is no load.
        tangent, rest_tangent = (
            nonlinear_of(self._system).along(curve, compiled) for curve in (motion, self._rest)
        )

        def matrices(phase: Array, speed: float) -> Matrices:
            M, C, K, d = tangent.at(phase, speed)
            return M, C, K, d - (1 - self._fraction) * rest_tangent.at(phase, speed)[3]

        return PeriodicSystem(matrices, tangent.coordinates, tangent.period, tangent.breaks)


def by_speed(task: Task, grid: Grid) -> Converged:
    """Return the orbit by continuation from a lower speed (a half, a quarter, …) at which the iteration from
    the linear orbit converges. Raises NoOrbitError, whose message states how far the continuation came."""
    for slow in task.speed / 2.0 ** np.arange(1, _SPEED_HALVINGS + 1):
        try:
            start = iterate(replace(task, speed=float(slow)), task.rest(grid), grid)
        except (NoOrbitError, ResonanceError):
            continue
        return _continue(
            lambda speed: replace(task, speed=speed), float(slow), task.speed, start, grid, task.speed_text
        )
    slowest = task.speed_text(task.speed / 2**_SPEED_HALVINGS)
    raise NoOrbitError(f"at speeds down to {slowest}, the iteration does not converge from the linear orbit")


def by_load(task: Task, grid: Grid) -> Converged:
    """Return the orbit by continuation in the load, which begins at rest without load. Raises NoOrbitError,
    whose message states how far the continuation came."""
    rest = task.rest(grid)

    def task_at(fraction: float) -> Task:
        if fraction == 1:
            return task
        return replace(task, system=PartiallyLoadedSystem(task.system, fraction, rest))

    start = iterate(task_at(0.0), rest, grid)
    return _continue(task_at, 0.0, 1.0, start, grid, lambda fraction: f"{100 * fraction:.3g} % of the load")


def _continue(
    task_at: Callable[[float], Task],
    first: float,
    last: float,
    start: Converged,
    grid: Grid,
    text: Callable[[float], str],
) -> Converged:
    """Return the orbit at the value `last` of a parameter, by steps from the value `first`. In each step,
    Newton's iteration starts from the extrapolation of the previous two orbits."""
    length, step, at = last - first, _FIRST_STEP, 0.0
    previous, current, corrections = None, start, start.iterations
    with progress.task("% of the way", 100) as count:
        while at < 1:
            target = min(1.0, at + step)
            guess = _secant(previous, (at, current.curve), target)
            value = last if target == 1 else first + target * length
            try:
                reached = iterate(task_at(value), guess, grid, _MAX_CORRECTIONS)
            except (NoOrbitError, ResonanceError):
                step /= _GROWTH
                if step < _MIN_STEP:
                    ends = (text(first + part * length) for part in (0, at, at + _GROWTH * step))
                    raise NoOrbitError(
                        "the branch that begins at {} turns back or ends between {} and {}".format(*ends)
                    ) from None
                continue
            previous, at, current, step = (at, current.curve), target, reached, _GROWTH * step
            corrections += current.iterations
            count.add(100 * at - count.done)
    return replace(current, iterations=corrections)


def _secant(previous: tuple[float, Curve] | None, current: tuple[float, Curve], target: float) -> Curve:
    """Return the curve at the value `target` of the parameter, extrapolated from two pairs of value and
    orbit. Without a previous orbit, return the current one."""
    (at, curve) = current
    if previous is None:
        return curve
    return interpolate(previous[1], curve, (target - previous[0]) / (at - previous[0]))


def by_transient(task: Task, grid: Grid) -> tuple[Converged, bool]:
    """Return the orbit from a transient that starts near rest, and whether the transient settles.

    The transient has settled if successive periods differ little, or if Newton's iteration from one of the
    periods converges to an orbit that is not unstable. If the transient does not settle, an unstable orbit to
    which the iteration has converged is returned. Raises NoOrbitError, whose message states the remaining
    change per period."""
    change, next_trial, unstable, motion = np.inf, _TRIAL_INTERVAL, None, task.rest(grid)
    with progress.task("periods at most", _MAX_PERIODS) as count:
        for turns, motion, change in _march(task, grid):
            count.add(turns - count.done)
            settled = change < _SETTLED
            if turns < next_trial and not (settled and next_trial < np.inf):
                if change < _FULLY_SETTLED:
                    break
                continue
            next_trial = np.inf if settled else turns + _TRIAL_INTERVAL
            try:
                orbit = iterate(task, motion, grid)
            except (NoOrbitError, ResonanceError):
                # A motion without contact may have no resistance against a shift.
                continue
            if settled or orbit.solutions.multipliers.spectral_radius[0] <= 1:
                return orbit, True
            unstable = unstable or orbit
    if change < _SETTLED:
        state = np.concatenate([motion(np.zeros(1), order)[:, 0] for order in range(2)])
        return from_state(task, state, grid), True
    if unstable is not None:
        return unstable, False
    raise NoOrbitError(
        f"after {_MAX_PERIODS} periods from rest, the motion still changes by {change:.0%} per period"
    )


def from_state(task: Task, state: Array, grid: Grid) -> Converged:
    """Return the orbit on which a motion has settled, from its state (q, q') (2n,) at phase 0. Finer grids
    are tried until Newton's iteration converges, because short contacts with stiff stops require small steps.
    Raises NoOrbitError."""
    sizes = linear_sizes(task, grid)
    for refinement in _REFINEMENTS:
        finer = task.grid(refinement * grid.steps)
        try:
            fine = motion_from(task, state, sizes, finer.steps // task.periods, _FINE_RTOL)
            return iterate(task, fine, finer, _MAX_CORRECTIONS)
        except ChatterError:
            raise
        except SolveError:
            continue
    raise NoOrbitError(
        "the motion repeats, but Newton's iteration does not converge from this motion on grids of up to "
        f"{_REFINEMENTS[-1] * grid.steps} steps"
    )


def _march(task: Task, grid: Grid) -> Iterator[tuple[int, Curve, float]]:
    """Integrate the motion from near rest. Yield the number of periods of the system so far, the motion over
    the last period of the orbit, and the relative difference between the two ends of this motion.

    The difference excludes rigid-body motion."""
    system, count = task.system, max(1, grid.steps // task.periods)
    sizes = linear_sizes(task, grid)
    march = nonlinear_of(system).marcher(sizes, count, _RTOL)
    state = np.concatenate((_PERTURBATION * sizes, 0 * sizes))
    relative = np.eye(system.n) if task.rigid is None else task.rigid.relative[0][0]
    latest: list[Array] = []
    for turn in range(_MAX_PERIODS):
        latest = [*latest, march(state, turn * system.period, task.speed)][-task.periods :]
        state = latest[-1][:2, :, -1].ravel()
        if len(latest) == task.periods and (turn + 1) % task.periods == 0:
            q = relative @ np.concatenate([motion[0] for motion in latest], axis=1)
            largest = np.maximum(np.abs(q).max(axis=1), 1e-3 * sizes)
            change = float((np.abs(q[:, -1] - q[:, 0]) / largest).max())
            yield turn + 1, joined(latest, task.period, task.rigid), change


def motion_from(task: Task, state: Array, sizes: Array, states: int, rtol: float) -> Curve:
    """Integrate the motion over the period of the orbit from the state (q, q') (2n,) at phase 0, and return
    this motion. sizes (n,): scales of the coordinates. states: number of states per period of the system.
    rtol: tolerance of the integration."""
    march, turns = nonlinear_of(task.system).marcher(sizes, states, rtol), []
    for turn in range(task.periods):
        turns.append(march(state, turn * task.system.period, task.speed))
        state = turns[-1][:2, :, -1].ravel()
    return joined(turns, task.period, task.rigid)


def linear_sizes(task: Task, grid: Grid) -> Array:
    """Return the largest modulus (n,) of each coordinate on the linear orbit; 1 if there is no linear
    orbit."""
    try:
        orbit = corrected(task.system, task.rest(grid), task.speed, task.method, grid, task.engine)
    except SolveError:
        return np.ones(task.system.n)
    assert orbit.curve is not None
    return without_zeros(np.abs(orbit.curve(orbit.grid.nodes)[0]).max(axis=1))
