"""The motion in time from a state, and how soon it reaches the periodic one."""

import json
import math
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from solve.argument import require_whole
from solve.arrays import Array
from solve.contracts import Marcher
from solve.errors import FileError, ResonanceError, SolveError, TransientError, ValueOutOfBoundsError
from solve.newton.iteration import at_rest, joined, rigid_at_rest, without_zeros
from solve.newton.orbits import nonlinear as nonlinear_orbit
from solve.newton.starts import state_of
from solve.newton.stepping import METHOD, StepMarcher
from solve.period.curve import interpolation_error, interpolation_tolerance
from solve.period.grid import Grid
from solve.results.orbit import Orbit
from solve.results.transient import Transient
from solve.single import periodic
from solve.sizes import require_size
from solve.system import PeriodicSystem, of_system
from solve.terminal import progress
from solve.units import checked_rtol, ramp_in_si, speed_in_si

REST, ORBIT = "rest", "orbit"
TURNS = "turns"

_COUNT, _MOST_STATES = 256, 2**14
"""States a turn at first, and at most."""

_WORK = 2**23
"""Entries of matrices at the states of a motion up to which a turn gets more states."""

_FINER = 1e-4
"""Tolerance of the motion by that with which it is compared."""

_FINEST = 1e-12

_SLOWER = 0.9
"""Part of a speed at resonance at which the linear orbit tells sizes."""

Start = str | Path | tuple[Array, Array]


@of_system
def transient(
    system: PeriodicSystem,
    speed: float | str | None = None,
    turns: int = 40,
    start: Start = REST,
    nonlinear: bool = False,
    rtol: float = 1e-3,
    engine: str = "auto",
    speeds: str | tuple[float | str, float | str] | None = None,
) -> Transient:
    """The motion over `turns` periods at a speed (rad/s, or a text with unit), or while the speed goes
    linearly in time from one of two speeds to the other ("0:600 rpm"), from the phase 0 on.

    start: "rest", "orbit" (the linear one), q and q̇ (n,) by time, or a file .npz of an orbit or of a
    transient, which goes on from its end. The linear motion goes by steps of Radau's method, doubled until
    they agree, the nonlinear one by CVODES; both with so many states a turn that curves through them tell
    the extrema. rtol: relative to the largest of each coordinate, within which the orbit counts as reached.
    Raises TransientError where the motion cannot be followed, LinearModelError for nonlinear
    motions of linear systems, FileError, and other SolveError subclasses for bad input.
    """
    if (speed is None) == (speeds is None):
        raise ValueOutOfBoundsError("give one speed, or two speeds between which it changes")
    rtol = checked_rtol(rtol)
    require_whole("turns", turns)
    require_size("turns", turns, 3 * system.n * _COUNT)
    given = start
    if isinstance(start, str | Path) and start not in (REST, ORBIT):
        given = _read(Path(start), system)
    if speeds is not None:
        ramp = ramp_in_si(speeds)
        return _run_up(system.shown_in(max(ramp)), ramp, int(turns), given, nonlinear, rtol, engine)
    assert speed is not None
    omega, finer = speed_in_si(speed), max(_FINER * rtol, _FINEST)
    system = system.shown_in(omega)
    linear = _linear(system, omega, min(1e-6, finer), engine, nonlinear and given != ORBIT)
    ends, follow = np.full(turns + 1, omega), _Follow(system, linear, nonlinear, rtol)
    nodes, motion, off, notes = follow.followed(_state(given, system, linear), ends)
    orbit = _settled(system, omega, motion[-1], engine) if nonlinear else linear
    notes = [] if given == ORBIT else notes
    return Transient(system, ends, nodes, motion, off, orbit, rtol, nonlinear, notes)


def _linear(system: PeriodicSystem, speed: float, rtol: float, engine: str, for_sizes: bool) -> Orbit:
    """The linear orbit; at resonance, where only the sizes of its coordinates are needed, that of a slower
    speed."""
    try:
        return periodic(system, speed, rtol=rtol, engine=engine)
    except ResonanceError:
        if not for_sizes:
            raise
        return periodic(system, _SLOWER * speed, rtol=rtol, engine=engine)


def _run_up(
    system: PeriodicSystem,
    ramp: tuple[float, float],
    turns: int,
    start: Start,
    nonlinear: bool,
    rtol: float,
    engine: str,
) -> Transient:
    """While the speed goes linearly in time, so that its square goes linearly from turn to turn."""
    system.require_motion()
    ends = np.sqrt(np.linspace(ramp[0] ** 2, ramp[1] ** 2, turns + 1))
    system.require_desired_motion(ends)
    if start == ORBIT and ramp[0] == 0:
        raise ValueOutOfBoundsError("a drive at rest has no orbit to start from; start from rest")
    first = periodic(system, ramp[0], rtol=1e-6, engine=engine) if start == ORBIT else None
    fastest = _linear(system, max(ramp), 1e-6, engine, True) if nonlinear else None
    follow = _Follow(system, fastest, nonlinear, rtol)
    nodes, motion, off, notes = follow.followed(_state(start, system, first), ends)
    notes = [] if start == ORBIT else notes
    return Transient(system, ends, nodes, motion, off, None, rtol, nonlinear, notes)


@dataclass(frozen=True)
class _Follow:
    """A motion of a system, linear or not, to an accuracy by which it can be compared to rtol; orbit: a
    linear one that tells the sizes of the coordinates."""

    system: PeriodicSystem
    orbit: Orbit | None
    nonlinear: bool
    rtol: float

    def followed(self, state: Array, ends: Array) -> tuple[Array, Array, float, list[str]]:
        """Nodes (k,), motions as `_marched` gives them, how far these or what lies between the states of a
        turn are off, and what is doubtful: so many states that the former matters little, if memory allows.

        No linear motion is refused because its vibrations are too fast for steps or states: how far it is
        off says so. Raises TransientError for nonlinear ones that CVODES cannot follow with few states."""
        count, work = _COUNT, 3 * self.system.n**2 * (len(ends) - 1)
        found, known, tolerance = None, 0.0, interpolation_tolerance(self.rtol)
        while True:
            march = self._marcher(count)
            try:
                motion = _marched(march, state, ends, self.system.period)
            except TransientError:
                if found is None:
                    raise
                return found
            before, known = known, march.off if isinstance(march, StepMarcher) else 0.0
            if found is not None and known > tolerance >= before:
                # So many states meet vibrations that no steps follow; the result says what it knows of these.
                return found
            off = max(float(interpolation_error(march.nodes, motion, bool(self.system.breaks)).max()), known)
            most = max(count, min(_MOST_STATES, 2 ** max(0, int(math.log2(_WORK / work)))))
            found = march.nodes, motion, off, _damped_out(march)
            if off <= max(tolerance, known) or count == most:
                return found
            # What is missed falls with the fourth power at least.
            more = 2 ** math.ceil(max(1.0, math.log2(off / tolerance) / 4))
            count = min(count * more, most)

    def _marcher(self, count: int) -> Marcher:
        sizes, finer = np.zeros(self.system.n), max(_FINER * self.rtol, _FINEST)
        if self.orbit is not None:
            sizes = np.abs(self.orbit.q).max(axis=1)
        if not self.nonlinear:
            return StepMarcher(self.system, sizes, count, finer)
        # A linear system says here that it is one.
        self.system.along(at_rest(self.system.n, Grid.uniform(1, self.system.period)))
        return self.system.marcher(without_zeros(sizes), count, finer)


def _damped_out(march: Marcher) -> list[str]:
    """A warning where steps do not follow the fastest modes."""
    if not isinstance(march, StepMarcher) or march.angle <= METHOD.follows:
        return []
    return [
        f"ω_max h = {march.angle:.2g}: the steps damp out the fastest modes, and with them what a start away "
        "from the orbit excites in these"
    ]


def _marched(march: Marcher, state: Array, ends: Array, period: float) -> Array:
    """Motions (turns, 3, n, k) from q and q̇ (2n,) by time, with the speeds (turns + 1,) at the ends of turns;
    derivatives as `Marcher` has them."""
    parts, n = [], len(state) // 2
    with progress.task(TURNS, len(ends) - 1) as count:
        for turn, (first, last) in enumerate(pairwise(ends.tolist())):
            scale = np.repeat([1.0, (first + last) / 2], n)
            parts.append(march(state / scale, turn * period, first, last))
            state = parts[-1][:2, :, -1].ravel() * scale
            count.add()
    return np.stack(parts)


def _state(start: Start, system: PeriodicSystem, orbit: Orbit | None) -> Array:
    """q and q̇ (2n,), where the start is that of the orbit."""
    n = system.n
    if isinstance(start, str | Path):
        return np.zeros(2 * n) if orbit is None or start == REST else np.append(orbit.q[:, 0], orbit.qd[:, 0])
    return np.concatenate(state_of(start, n, f"{REST}, {ORBIT}, a file .npz, or q and q̇ ({n},)"))


def _read(file: Path, system: PeriodicSystem) -> tuple[Array, Array]:
    """q and q̇ at the end of a saved orbit or transient. Raises FileError."""
    if file.suffix != ".npz":
        raise FileError(
            f"start '{file}' is no state; allowed: {REST}, {ORBIT}, or a file .npz saved with --save"
        )
    try:
        with np.load(file, allow_pickle=False) as held:
            names, q, qd = tuple(held["coordinates"].tolist()), held["q"][:, -1], held["qd"][:, -1]
            model = json.loads(str(held["metadata"]))["model"]
    except Exception:  # NumPy and zipfile raise whatever they meet in a damaged file.
        raise FileError(
            f"start '{file}' is no saved orbit or transient; allowed: {REST}, {ORBIT}, or a file .npz that "
            "`solve periodic` or `solve transient` wrote with --save"
        ) from None
    if names != system.coordinates:
        raise FileError(
            f"start '{file}' has coordinates {', '.join(names)}; {system.name} has "
            f"{', '.join(system.coordinates)}"
        )
    if model != system.name:
        raise FileError(f"start '{file}' is of {model}; give a state of {system.name}")
    return q, qd


def _settled(system: PeriodicSystem, speed: float, motion: Array, engine: str) -> Orbit | None:
    """The nonlinear orbit near the last turn (3, n, k); None where there is none."""
    last = joined([motion], system.period, rigid_at_rest(system, speed))
    try:
        return nonlinear_orbit(system, speed, last, rtol=1e-6, engine=engine)
    except SolveError:
        return None
