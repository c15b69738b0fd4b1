"""Sizes of basins of attraction: the share of scattered initial states from which the motion settles on each
orbit."""

from collections.abc import Sequence

import numpy as np

from solve.arguments import checked_rtol, require_integer, require_size
from solve.arrays import Array
from solve.equations import is_nonlinear, nonlinear_of
from solve.errors import LinearModelError, SolveError, ValueOutOfBoundsError
from solve.kernel.engines import chosen_engine
from solve.labels import speed_or_usual
from solve.methods.radau import Radau
from solve.newton.iteration import Task, joined
from solve.newton.orbits import nonlinear
from solve.newton.strategies import linear_sizes
from solve.period.quantities import repeats_early
from solve.results.scatter import Scatter
from solve.results.special_orbits import NonlinearOrbit
from solve.system import PeriodicSystem, check, of_system, shown_in
from solve.terminal import progress

_TURNS = 400
"""Number of periods after which a motion counts as not settled. Chosen by judgement."""

_STATES, _RTOL = 128, 1e-7
"""Number of states per period of the integrated motions, and tolerance of the integration. Chosen by
judgement."""

_SETTLED, _SAME = 1e-4, 1e-2
"""Change of the state over the period of an orbit below which a motion has settled, and difference below
which two states belong to the same orbit. The change is relative to the largest value of the motion or of the
linear orbit; the difference is relative to the largest value of each coordinate and velocity on either orbit.
Chosen by judgement."""


@of_system
def scatter(
    system: PeriodicSystem,
    speed: float | str | None = None,
    count: int = 100,
    seed: int = 0,
    spread: float = 4.0,
    periods: int = 2,
    rtol: float = 1e-6,
    engine: str = "auto",
) -> Scatter:
    """Find the orbits on which motions from scattered initial states settle, and the share of the initial
    states that lead to each orbit.

    Parameters
    ----------
    system : Model
        Model with nonlinear equations.
    speed : float or str, optional
        Speed in rad/s, or a string with a unit; by default the speed of the case.
    count : int
        Number of initial states.
    seed : int
        Seed of the random initial states, which are distributed uniformly in a box about 0.
    spread : float
        Half the width of the box, as a multiple of the largest value of each coordinate on the linear orbit.
        For velocities, this value is multiplied by the speed.
    periods : int
        Largest number of model periods in the period of an orbit.
    rtol : float
        Tolerance of the orbits.
    engine : str
        "auto", "compiled" or "numpy".

    Returns
    -------
    Scatter
        Orbits, with the share of the initial states that lead to each.

    Raises
    ------
    LinearModelError
        For systems without nonlinear equations.
    SolveError
        Other subclasses for bad input.
    """
    for name, value in (("count", count), ("periods", periods)):
        require_integer(name, value)
    require_size("count", count, 2 * system.n)
    if not (isinstance(seed, int | np.integer) and seed >= 0):
        raise ValueOutOfBoundsError(f"seed is {seed!r}; allowed: integers of at least 0")
    if not 0 < spread < np.inf:
        raise ValueOutOfBoundsError(f"spread is {spread}; allowed: a number above 0")
    omega, (used, _) = speed_or_usual(system, speed), chosen_engine(engine)
    if not is_nonlinear(system):
        raise LinearModelError(
            f"{system.labels.name} is linear by construction; all motions lead to one orbit"
        )
    check(system, omega)
    system = shown_in(system, omega)
    task = Task(system, omega, 1, Radau(), used, checked_rtol(rtol))
    sizes = linear_sizes(task, task.grid(_STATES))
    scales = np.concatenate((sizes, omega * sizes))
    starts = np.random.default_rng(seed).uniform(-spread, spread, (count, 2 * system.n)) * scales
    return _search(task, starts, sizes, int(periods), int(seed))


def _search(task: Task, starts: Array, sizes: Array, most: int, seed: int) -> Scatter:
    """Return the orbits on which the motions from all initial states `starts` settle. most: largest number of
    model periods in the period of an orbit."""
    orbits, states, leads = list[NonlinearOrbit](), list[Array](), np.full(len(starts), -1)
    with progress.task("starts", len(starts)) as count:
        for number, start in enumerate(starts):
            motions = _settled(task, start, sizes, most)
            if motions:
                leads[number] = _orbit_index(task, motions, sizes, orbits, states)
            count.add()
    order = sorted(range(len(orbits)), key=lambda number: -int((leads == number).sum()))
    ranks = {old: new for new, old in enumerate(order)}
    leads = np.array([ranks.get(int(lead), -1) for lead in leads])
    return Scatter(task.system, task.speed, starts, leads, [orbits[k] for k in order], seed, _TURNS)


def _settled(task: Task, start: Array, sizes: Array, most: int) -> list[Array]:
    """Integrate from the state `start` until the motion settles on an orbit. Return the motions over the last
    period of the orbit, one per model period; an empty list if the motion does not settle. most: largest
    number of model periods in the period of the orbit."""
    n, system = task.system.n, task.system
    march = nonlinear_of(system).marcher(sizes, _STATES, _RTOL)
    state, motions = start / np.repeat([1.0, task.speed], n), list[Array]()
    for turn in range(_TURNS):
        try:
            motion = march(state, turn * system.period, task.speed)
        except SolveError:
            return []
        state, motions = motion[:2, :, -1].ravel(), [*motions, motion][-most:]
        limit = _SETTLED * max(float(sizes.max()), float(np.abs(motion[:2]).max()))
        for periods in range(1, len(motions) + 1):
            before = motions[-periods][:2, :, 0].ravel()
            if np.abs(state - before).max() <= limit and (turn + 1) % periods == 0:
                return motions[-periods:]
    return []


def _orbit_index(
    task: Task,
    motions: Sequence[Array],
    sizes: Array,
    orbits: list[NonlinearOrbit],
    states: list[Array],
) -> int:
    """Return the index in `orbits` of the orbit on which a motion has settled; -1 if no such orbit is found.
    A new orbit is appended to `orbits`. Its states at the starts of the model periods are appended to
    `states`. Orbits that differ only by a shift of some periods count as the same."""
    state = motions[0][:2, :, 0].ravel()
    for number, known in enumerate(states):
        limit = _SAME * np.maximum(np.tile(sizes, 2), np.abs(known).max(axis=0))
        if (np.abs(known - state) <= limit).all(axis=1).any():
            return number
    try:
        orbit = _orbit(task, motions)
        if orbit.periods > 1 and repeats_early(orbit.curve, orbit.periods):
            # With a multiplier near -1, the motion nearly repeats after two periods before it settles on an
            # orbit of one period.
            orbit = _orbit(task, motions[-1:])
    except SolveError:
        return -1
    periods = orbit.periods
    phases = np.arange(periods) * task.system.period
    orbits.append(orbit)
    states.append(np.concatenate((orbit.curve(phases), orbit.curve(phases, 1))).T)
    return len(orbits) - 1


def _orbit(task: Task, motions: Sequence[Array]) -> NonlinearOrbit:
    """Return the orbit near the motions of successive periods. Raises SolveError."""
    periods = len(motions)
    start = joined(motions, periods * task.system.period, task.rigid)
    return nonlinear(task.system, task.speed, start, periods, rtol=task.rtol, engine=task.engine)
