"""What a transient from rest settles on."""

from collections.abc import Iterator

import numpy as np

from solve.arrays import Array
from solve.certify.correction import corrected
from solve.errors import NoOrbitError, SolveError
from solve.newton.iteration import Converged, Task, iterated, joined, without_zeros
from solve.period.curve import Curve
from solve.period.grid import Grid
from solve.terminal import progress

_TURNS = 80
"""Periods of the system after which a transient is given up."""

_TRIED = 16
"""Turns after which, and after twice as many and so on, Newton's iteration is tried unsettled."""

_RTOL = 1e-6
_SETTLED = 1e-3
"""Change from period to period, relative to the sizes of the coordinates, that Newton's iteration mends."""

_PUSH = 1e-3
"""Part of the sizes of the coordinates by which rest is missed, lest an unstable rest is kept."""


def by_transient(task: Task, grid: Grid) -> tuple[Converged, bool]:
    """Orbit from a transient that starts near rest, and whether it has settled. The transient ends if
    successive periods differ little, or if Newton's iteration converges from one of them to an orbit that is
    not unstable. If the motion does not settle on another orbit, an unstable orbit to which the iteration
    converged is returned. Raises NoOrbitError, which states the progress."""
    change, tried, unstable = np.inf, _TRIED, None
    with progress.task("turns at most", _TURNS) as count:
        for turns, motion, change in marched(task, grid):
            count.add(turns - count.done)
            settled = change < _SETTLED
            if not (settled or turns >= tried):
                continue
            tried = 2 * turns
            try:
                found = iterated(task, motion, grid)
            except NoOrbitError:
                continue
            if settled or found.solutions.multipliers.spectral_radius[0] <= 1:
                return found, settled
            unstable = unstable or found
    if unstable is not None:
        return unstable, False
    raise NoOrbitError(
        f"after {_TURNS} turns from rest the motion still changes by {change:.0%} from period to period"
    )


def marched(task: Task, grid: Grid) -> Iterator[tuple[int, Curve, float]]:
    """Turns done, the motion over the last of the orbit's periods, and its relative change within that,
    without motions along rigid-body modes."""
    system, count = task.system, max(1, grid.steps // task.periods)
    sizes = sizes_of(task, grid)
    march = system.marcher(sizes, count, _RTOL)
    state = np.concatenate((_PUSH * sizes, 0 * sizes))
    relative = np.eye(system.n) if task.rigid is None else task.rigid.relative[0][0]
    kept: list[Array] = []
    for turn in range(_TURNS):
        kept = [*kept, march(state, turn * system.period, task.speed)][-task.periods :]
        state = kept[-1][:2, :, -1].ravel()
        if len(kept) == task.periods and (turn + 1) % task.periods == 0:
            q = relative @ np.concatenate([part[0] for part in kept], axis=1)
            largest = np.maximum(np.abs(q).max(axis=1), 1e-3 * sizes)
            change = float((np.abs(q[:, -1] - q[:, 0]) / largest).max())
            yield turn + 1, joined(kept, task.period, task.rigid), change


def sizes_of(task: Task, grid: Grid) -> Array:
    """Sizes (n,) of the coordinates, of the linear orbit; 1 where it has none."""
    try:
        found = corrected(task.system, task.rest(grid), task.speed, task.method, grid, task.engine)
    except SolveError:
        return np.ones(task.system.n)
    assert found.curve is not None
    return without_zeros(np.abs(found.curve(found.grid.nodes)[0]).max(axis=1))
