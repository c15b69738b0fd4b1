"""Following an orbit from where Newton's iteration converges: in the speed, or in the load."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from solve.arrays import Array
from solve.contracts import Columns, Matrices, Motion
from solve.errors import NoOrbitError
from solve.newton.iteration import Converged, Task, between, iterated
from solve.period.curve import Curve
from solve.period.grid import Grid
from solve.system import PeriodicSystem
from solve.terminal import progress

_MOST = 10
"""Corrections of a step of the continuation."""

_FIRST, _LEAST, _GROWTH = 0.1, 4e-3, 2.0
"""Parts of the way that the first step and the least take, and by how much a step grows after another."""

_SLOWEST = 6
"""Times that the speed is halved to find one where the linear orbit is near."""


class PartlyLoaded(PeriodicSystem):
    """A system whose rest, r(φ, Ω, 0, 0, 0), acts in part only: r - (1 - share) r(φ, Ω, 0, 0, 0)."""

    def __init__(self, system: PeriodicSystem, share: float, rest: Motion):
        super().__init__(system.at, system.coordinates, system.period, system.breaks)
        self._system, self._share, self._rest = system, share, rest

    def along(self, motion: Motion, compiled: Columns | None = None) -> PeriodicSystem:
        # Both alike, so that without load rest is an orbit to the last digit.
        tangent, still = (self._system.along(each, compiled) for each in (motion, self._rest))

        def matrices(phase: Array, speed: float) -> Matrices:
            M, C, K, d = tangent.at(phase, speed)
            return M, C, K, d - (1 - self._share) * still.at(phase, speed)[3]

        return PeriodicSystem(matrices, tangent.coordinates, tangent.period, tangent.breaks)


def by_speed(task: Task, grid: Grid) -> Converged:
    """From half the speed, a quarter and so on, where the iteration from the linear orbit converges. Raises
    NoOrbitError, which says how far it came."""
    for slow in task.speed / 2.0 ** np.arange(1, _SLOWEST + 1):
        try:
            start = iterated(replace(task, speed=float(slow)), task.rest(grid), grid)
        except NoOrbitError:
            continue
        return _followed(
            lambda speed: replace(task, speed=speed), float(slow), task.speed, start, grid, task.in_words
        )
    slowest = task.in_words(task.speed / 2**_SLOWEST)
    raise NoOrbitError(f"down to {slowest} the iteration does not converge from the linear orbit")


def by_load(task: Task, grid: Grid) -> Converged:
    """From rest without load. Raises NoOrbitError, which says how far it came."""
    rest = task.rest(grid)

    def loaded(share: float) -> Task:
        return task if share == 1 else replace(task, system=PartlyLoaded(task.system, share, rest))

    start = iterated(loaded(0.0), rest, grid)
    return _followed(loaded, 0.0, 1.0, start, grid, lambda share: f"{100 * share:.3g} % of the load")


def _followed(
    task_at: Callable[[float], Task],
    first: float,
    last: float,
    start: Converged,
    grid: Grid,
    in_words: Callable[[float], str],
) -> Converged:
    """Steps from the first value to the last, each begun on the secant through the two before."""
    length, step, at = last - first, _FIRST, 0.0
    before, found, steps = None, start, start.iterations
    with progress.task("% of the way", 100) as count:
        while at < 1:
            to = min(1.0, at + step)
            guess = _secant(before, (at, found.curve), to)
            try:
                reached = iterated(task_at(last if to == 1 else first + to * length), guess, grid, _MOST)
            except NoOrbitError:
                step /= _GROWTH
                if step < _LEAST:
                    ends = (in_words(first + part * length) for part in (0, at, at + _GROWTH * step))
                    raise NoOrbitError(
                        "followed from {} on, the orbit turns back or ends between {} and {}".format(*ends)
                    ) from None
                continue
            before, at, found, step = (at, found.curve), to, reached, _GROWTH * step
            steps += found.iterations
            count.add(100 * at - count.done)
    return replace(found, iterations=steps)


def _secant(before: tuple[float, Curve] | None, last: tuple[float, Curve], to: float) -> Curve:
    (at, curve) = last
    if before is None:
        return curve
    return between(before[1], curve, (to - before[0]) / (at - before[0]))
