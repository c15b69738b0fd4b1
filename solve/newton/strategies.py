"""Strategies that lead Newton's iteration to an orbit: continuation in load or speed, and transients."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from solve.arrays import Array
from solve.capabilities import Capabilities, Nonlinear
from solve.certify.correction import corrected
from solve.contracts import Columns, Matrices, Motion
from solve.equations import nonlinear_of
from solve.errors import NoOrbitError, SolveError
from solve.newton.iteration import Converged, Task, interpolate, iterate, joined, without_zeros
from solve.period.curve import Curve
from solve.period.grid import Grid
from solve.system import PeriodicSystem
from solve.terminal import progress

_MAX_CORRECTIONS = 10
"""Maximum number of corrections per continuation step. A choice: a shorter step costs less than more."""

_FIRST_STEP, _MIN_STEP, _GROWTH = 0.1, 4e-3, 2.0
"""Fractions of the way: first step, and least step; factor by which steps grow after a success and shrink
after a failure. Choices."""

_SPEED_HALVINGS = 6
"""Number of halvings of the speed in search of one where the linear orbit is near. A choice."""

_MAX_PERIODS = 80
"""Periods of the system after which a transient ends. A choice."""

_FIRST_TRIAL = 16
"""Number of periods after which Newton's iteration is first tried on a transient that still changes; the
number doubles after each trial. A choice."""

_RTOL = 1e-6
"""Relative tolerance of the transient. A choice: far below the change that counts as settled."""

_SETTLED = 1e-3
"""Change per period, relative to the sizes of the coordinates, below which a transient has settled; Newton's
iteration corrects the rest. A choice."""

_PERTURBATION = 1e-3
"""Initial displacement, relative to the sizes of the coordinates: a transient exactly from rest would remain
on an unstable rest. A choice."""


class PartiallyLoadedSystem(PeriodicSystem, Nonlinear):
    """System on which only a fraction of the residual at rest acts: r - (1 - fraction) r(φ, Ω, 0, 0, 0)."""

    def __init__(self, system: PeriodicSystem, fraction: float, rest: Motion):
        super().__init__(system.at, system.coordinates, system.period, system.breaks)
        self._system, self._fraction, self._rest = system, fraction, rest

    @property
    def capabilities(self) -> Capabilities:
        return super().capabilities._replace(nonlinear=self)

    def along(self, motion: Motion, compiled: Columns | None = None) -> PeriodicSystem:
        # Both are linearised in the same way, so that without load rest is an orbit to the last digit.
        tangent, at_rest = (
            nonlinear_of(self._system).along(curve, compiled) for curve in (motion, self._rest)
        )

        def matrices(phase: Array, speed: float) -> Matrices:
            M, C, K, d = tangent.at(phase, speed)
            return M, C, K, d - (1 - self._fraction) * at_rest.at(phase, speed)[3]

        return PeriodicSystem(matrices, tangent.coordinates, tangent.period, tangent.breaks)


def by_speed(task: Task, grid: Grid) -> Converged:
    """Orbit by continuation from half the speed, a quarter and so on, where the iteration from the linear
    orbit converges. Raises NoOrbitError, which states the progress."""
    for slow in task.speed / 2.0 ** np.arange(1, _SPEED_HALVINGS + 1):
        try:
            start = iterate(replace(task, speed=float(slow)), task.rest(grid), grid)
        except NoOrbitError:
            continue
        return _continue(
            lambda speed: replace(task, speed=speed), float(slow), task.speed, start, grid, task.speed_text
        )
    slowest = task.speed_text(task.speed / 2**_SPEED_HALVINGS)
    raise NoOrbitError(f"at speeds down to {slowest}, the iteration does not converge from the linear orbit")


def by_load(task: Task, grid: Grid) -> Converged:
    """Orbit by continuation from rest without load. Raises NoOrbitError, which states the progress."""
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
    """Orbit at the last value of a parameter, in steps from the first, each started on the secant through the
    two orbits before."""
    length, step, at = last - first, _FIRST_STEP, 0.0
    previous, current, corrections = None, start, start.iterations
    with progress.task("% of the way", 100) as count:
        while at < 1:
            target = min(1.0, at + step)
            guess = _secant(previous, (at, current.curve), target)
            value = last if target == 1 else first + target * length
            try:
                reached = iterate(task_at(value), guess, grid, _MAX_CORRECTIONS)
            except NoOrbitError:
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
    """Curve extrapolated to a target from two orbits, or the current one if it is the first."""
    (at, curve) = current
    if previous is None:
        return curve
    return interpolate(previous[1], curve, (target - previous[0]) / (at - previous[0]))


def by_transient(task: Task, grid: Grid) -> tuple[Converged, bool]:
    """Orbit from a transient that starts near rest, and whether it has settled. The transient ends if
    successive periods differ little, or if Newton's iteration converges from one of them to an orbit that is
    not unstable. If the motion does not settle on another orbit, an unstable orbit to which the iteration
    converged is returned. Raises NoOrbitError, which states the progress."""
    change, next_trial, unstable = np.inf, _FIRST_TRIAL, None
    with progress.task("turns at most", _MAX_PERIODS) as count:
        for turns, motion, change in _march(task, grid):
            count.add(turns - count.done)
            settled = change < _SETTLED
            if not (settled or turns >= next_trial):
                continue
            next_trial = 2 * turns
            try:
                orbit = iterate(task, motion, grid)
            except NoOrbitError:
                continue
            if settled or orbit.solutions.multipliers.spectral_radius[0] <= 1:
                return orbit, settled
            unstable = unstable or orbit
    if unstable is not None:
        return unstable, False
    raise NoOrbitError(
        f"after {_MAX_PERIODS} periods from rest, the motion still changes by {change:.0%} per period"
    )


def _march(task: Task, grid: Grid) -> Iterator[tuple[int, Curve, float]]:
    """Number of periods of the system, the motion over the last period of the orbit, and its relative change
    within that, without rigid-body motion."""
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


def linear_sizes(task: Task, grid: Grid) -> Array:
    """Sizes (n,) of the coordinates on the linear orbit; 1 if it does not exist."""
    try:
        orbit = corrected(task.system, task.rest(grid), task.speed, task.method, grid, task.engine)
    except SolveError:
        return np.ones(task.system.n)
    assert orbit.curve is not None
    return without_zeros(np.abs(orbit.curve(orbit.grid.nodes)[0]).max(axis=1))
