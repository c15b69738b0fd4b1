"""Time integration from an initial state, at constant speed or during a run-up. At constant speed, the motion
is compared with the periodic orbit."""

import json
import math
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from solve.arguments import checked_rtol, require_integer, require_size
from solve.arrays import Array
from solve.contracts import Integrator
from solve.equations import nonlinear_of, require_desired_motion
from solve.errors import FileError, ResonanceError, SolveError, TransientError, ValueOutOfBoundsError
from solve.kernel.engines import NUMPY
from solve.labels import require_motion
from solve.newton.iteration import joined, rigid_at_rest, without_zeros, zero_motion
from solve.newton.orbits import nonlinear as nonlinear_orbit
from solve.newton.starts import state_of
from solve.newton.step_marcher import StepMarcher
from solve.period.curve import interpolation_error, interpolation_tolerance
from solve.period.grid import Grid
from solve.results.orbit import Orbit
from solve.results.transient import Transient
from solve.single import periodic
from solve.system import PeriodicSystem, of_system, shown_in
from solve.terminal import progress
from solve.units import ramp_in_si, speed_in_si

REST, ORBIT = "rest", "orbit"
TURNS = "turns"

_COUNT, _MOST_STATES = 256, 2**14
"""Initial and maximum number of states per period. Chosen by judgement."""

_MAX_ENTRIES = 2**23
"""Limit on the number of matrix entries for all states of a motion (64 MB). The number of states per period
is increased up to this limit only. Chosen by judgement."""

_MARCH_RTOL, _MIN_MARCH_RTOL = 1e-4, 1e-12
"""Tolerance of the integration as a fraction of rtol, and lower limit of this tolerance. Chosen by
judgement."""

_OFF_RESONANCE = 0.9
"""Factor by which a resonant speed is multiplied if the linear orbit is required only for the sizes of the
coordinates. Chosen by judgement."""

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
    """Integrate the motion over a number of periods, at constant speed or at a speed that changes linearly in
    time.

    Parameters
    ----------
    system : PeriodicSystem
        System to solve.
    speed : float or str, optional
        Constant speed in rad/s, or a string with a unit.
    turns : int
        Number of periods, from phase 0.
    start : 'rest', 'orbit', (q, q̇) or path
        Initial state: "rest", which is the default; "orbit" for the state of the linear orbit at phase 0; q
        and q̇ (n,), where q̇ is the derivative with respect to time; or the path of an .npz file of an orbit
        or a transient, whose last state is used.
    nonlinear : bool
        Whether to integrate the nonlinear equations.
    rtol : float
        Distance from the orbit, relative to the largest value of each coordinate, below which the orbit
        counts as reached.
    engine : str
        "auto", "compiled" or "numpy".
    speeds : str or (float or str, float or str), optional
        First and last speed of a run-up, such as "0:600 rpm"; replaces `speed`.

    Returns
    -------
    Transient
        Motion over all periods, and at constant speed the orbit for comparison.

    Raises
    ------
    TransientError
        If the motion cannot be integrated.
    LinearModelError
        If `nonlinear` is True and the system is linear.
    FileError
        For a file that does not contain a state of this system.
    SolveError
        Other subclasses for bad input.

    Notes
    -----
    Linear motion is integrated by Radau's method; the number of steps is doubled until two results agree.
    Nonlinear motion is integrated by CVODES (A. C. Hindmarsh et al., ACM Trans. Math. Softw. 31, 2005,
    363-396). The number of states per period is increased until the curves through the states are accurate.

    Examples
    --------
    >>> import solve
    >>> found = transient(solve.load("cam"), "300 rpm", turns=2)
    >>> found.turns
    2
    """
    if (speed is None) == (speeds is None):
        both = "neither 'speed' nor 'speeds' is" if speed is None else "'speed' and 'speeds' are both"
        raise ValueOutOfBoundsError(
            f"{both} given; give one of them: a constant speed, or the first and the last speed of a run-up"
        )
    rtol = checked_rtol(rtol)
    require_integer("turns", turns)
    require_size("turns", turns, 3 * system.n * _COUNT)
    given = start if isinstance(start, str | Path) else (start[0], start[1])
    if isinstance(given, str | Path) and given not in (REST, ORBIT):
        given = _read(Path(given), system)
    if speeds is not None:
        ramp = ramp_in_si(speeds)
        return _run_up(shown_in(system, max(ramp)), ramp, int(turns), given, nonlinear, rtol, engine)
    assert speed is not None
    omega, march_rtol = speed_in_si(speed), max(_MARCH_RTOL * rtol, _MIN_MARCH_RTOL)
    system = shown_in(system, omega)
    linear = _linear(system, omega, min(1e-6, march_rtol), engine, nonlinear and given != ORBIT)
    ends, integration = np.full(turns + 1, omega), _Integration(system, linear, nonlinear, rtol)
    nodes, motion, error, notes = integration.run(_state(given, system, linear), ends)
    orbit = _settled(system, omega, motion[-1], engine) if nonlinear else linear
    notes = [] if given == ORBIT else notes
    return Transient(system, ends, nodes, motion, error, orbit, rtol, nonlinear, notes)


def _linear(system: PeriodicSystem, speed: float, rtol: float, engine: str, for_sizes: bool) -> Orbit:
    """Return the linear orbit. for_sizes: whether only the sizes of the coordinates are required. At a
    resonance, the orbit at a lower speed is then returned."""
    try:
        return periodic(system, speed, rtol=rtol, engine=engine)
    except ResonanceError:
        if not for_sizes:
            raise
        return periodic(system, _OFF_RESONANCE * speed, rtol=rtol, engine=engine)


def _run_up(
    system: PeriodicSystem,
    ramp: tuple[float, float],
    turns: int,
    start: Start,
    nonlinear: bool,
    rtol: float,
    engine: str,
) -> Transient:
    """Integrate the motion at constant acceleration. The square of the speed then changes linearly with the
    phase."""
    require_motion(system)
    ends = np.sqrt(np.linspace(ramp[0] ** 2, ramp[1] ** 2, turns + 1))
    require_desired_motion(system, ends)
    if start == ORBIT and ramp[0] == 0:
        raise ValueOutOfBoundsError("start is 'orbit', but there is no orbit at speed 0; give start 'rest'")
    first = periodic(system, ramp[0], rtol=1e-6, engine=engine) if start == ORBIT else None
    fastest = _linear(system, max(ramp), 1e-6, engine, True) if nonlinear else None
    integration = _Integration(system, fastest, nonlinear, rtol)
    nodes, motion, error, notes = integration.run(_state(start, system, first), ends)
    notes = [] if start == ORBIT else notes
    return Transient(system, ends, nodes, motion, error, None, rtol, nonlinear, notes)


@dataclass(frozen=True)
class _Integration:
    """Integration of a linear or nonlinear system, accurate enough for a comparison with the orbit to `rtol`.

    orbit: linear orbit, whose amplitudes scale the coordinates. nonlinear: whether to integrate the nonlinear
    equations."""

    system: PeriodicSystem
    orbit: Orbit | None
    nonlinear: bool
    rtol: float

    def run(self, state: Array, ends: Array) -> tuple[Array, Array, float, list[str]]:
        """Integrate from the initial state `state` with speeds `ends` at the ends of the periods. Return
        nodes (k,), motions in the form that `_march` returns, their error including the interpolation error,
        and warnings. The number of states per period is increased until the interpolation is accurate or the
        memory limit is reached.

        Linear motion with vibrations that are too fast for the steps or states is not rejected, but its error
        is reported. Raises TransientError for nonlinear motion that CVODES cannot integrate even with few
        states."""
        count, work = _COUNT, 3 * self.system.n**2 * (len(ends) - 1)
        result, march_error, tolerance = None, 0.0, interpolation_tolerance(self.rtol)
        while True:
            march = self._marcher(count)
            try:
                motion = _march(march, state, ends, self.system.period)
            except TransientError:
                if result is None:
                    raise
                return result
            previous, march_error = march_error, march.error if isinstance(march, StepMarcher) else 0.0
            if result is not None and march_error > tolerance >= previous:
                # More states would show vibrations that no steps resolve. The error of the previous result
                # includes them.
                return result
            between = float(interpolation_error(march.nodes, motion, bool(self.system.breaks)).max())
            error = max(between, march_error)
            most = max(count, min(_MOST_STATES, 2 ** max(0, int(math.log2(_MAX_ENTRIES / work)))))
            result = march.nodes, motion, error, _damping_note(march)
            if error <= max(tolerance, march_error) or count == most:
                return result
            # The interpolation error is proportional to at least the fourth power of the step length.
            factor = 2 ** math.ceil(max(1.0, math.log2(error / tolerance) / 4))
            count = min(count * factor, most)

    def _marcher(self, count: int) -> Integrator:
        sizes, march_rtol = np.zeros(self.system.n), max(_MARCH_RTOL * self.rtol, _MIN_MARCH_RTOL)
        if self.orbit is not None:
            sizes = np.abs(self.orbit.q).max(axis=1)
        if not self.nonlinear:
            return StepMarcher(self.system, sizes, count, march_rtol)
        # Raises LinearModelError for a linear system.
        nonlinear_of(self.system).along(zero_motion(self.system.n, Grid.uniform(1, self.system.period)))
        return nonlinear_of(self.system).marcher(without_zeros(sizes), count, march_rtol)


def _damping_note(march: Integrator) -> list[str]:
    """Return a warning, in a list, if the steps do not resolve the fastest modes."""
    if not isinstance(march, StepMarcher) or not march.damps:
        return []
    return [
        f"ω_max h = {march.angle:.2g}: the steps damp out the fastest modes, so that the vibration of these "
        "modes after the start is not shown"
    ]


def _march(march: Integrator, state: Array, ends: Array, period: float) -> Array:
    """Return the motions (turns, 3, n, k) of successive periods. The derivatives are those of `Integrator`.

    state (2n,): initial q and q̇, with the derivative with respect to time. ends (turns + 1,): speeds at the
    ends of the periods."""
    motions, n = [], len(state) // 2
    with progress.task(TURNS, len(ends) - 1) as count:
        for turn, (first, last) in enumerate(pairwise(ends.tolist())):
            scale = np.repeat([1.0, (first + last) / 2], n)
            motions.append(march(state / scale, turn * period, first, last))
            state = motions[-1][:2, :, -1].ravel() * scale
            count.add()
    return np.stack(motions)


def _state(start: Start, system: PeriodicSystem, orbit: Orbit | None) -> Array:
    """Return the initial q and q̇ (2n,) from `start`, or from the orbit."""
    n = system.n
    if isinstance(start, str | Path):
        return np.zeros(2 * n) if orbit is None or start == REST else np.append(orbit.q[:, 0], orbit.qd[:, 0])
    return np.concatenate(state_of(start, n, f"{REST}, {ORBIT}, an .npz file, or q and q̇ ({n},)"))


def _read(file: Path, system: PeriodicSystem) -> tuple[Array, Array]:
    """Read q and q̇ at the end of a saved orbit or transient. Raises FileError."""
    if file.suffix != ".npz":
        raise FileError(
            f"start '{file}' is not a state; allowed: {REST}, {ORBIT}, or an .npz file saved with --save"
        )
    try:
        with np.load(file, allow_pickle=False) as file_data:
            names, q, qd = (
                tuple(file_data["coordinates"].tolist()),
                file_data["q"][:, -1],
                file_data["qd"][:, -1],
            )
            model = json.loads(str(file_data["metadata"]))["model"]
    except Exception:  # NumPy and zipfile raise various exceptions for a damaged file.
        raise FileError(
            f"start '{file}' is not a saved orbit or transient; allowed: {REST}, {ORBIT}, or an "
            ".npz file that `solve periodic` or `solve transient` wrote with --save"
        ) from None
    if names != system.coordinates:
        raise FileError(
            f"start '{file}' has coordinates {', '.join(names)}; {system.labels.name} has "
            f"{', '.join(system.coordinates)}"
        )
    if model != system.labels.name:
        raise FileError(f"start '{file}' belongs to {model}; give a state of {system.labels.name}")
    return q, qd


def _settled(system: PeriodicSystem, speed: float, motion: Array, engine: str) -> Orbit | None:
    """Return the nonlinear orbit near the last period (3, n, k) of the motion; None if there is none."""
    last = joined([motion], system.period, rigid_at_rest(system, speed, NUMPY))
    try:
        return nonlinear_orbit(system, speed, last, rtol=1e-6, engine=engine)
    except SolveError:
        return None
