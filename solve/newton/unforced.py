"""Undamped nonlinear modes: periodic orbits of the equations without load or damping, as functions of their
frequency.

At a given frequency, such orbits are not isolated solutions, because each shift of the phase gives another
orbit, and because energy is conserved. A term ε Ω M q̇ is therefore added. Its factor ε is a second
parameter, which is zero on every orbit. With this term, the orbits are regular solutions of as many equations
as unknowns (F. J. Muñoz-Almaraz, E. Freire, J. Galán, E. Doedel, A. Vanderbauwhede, Physica D 181 (2003) 1).
If both parameters are free, the solutions form a surface. It has two tangents: one along the branch, and one
that shifts the phase."""

from dataclasses import replace
from functools import partial

import numpy as np

from solve.arrays import EPS, Array
from solve.certify.coefficients import compared_phases
from solve.contracts import Motion
from solve.equations import nonlinear_of, roundoff_of
from solve.errors import NoOrbitError, SolveError, ValueOutOfBoundsError
from solve.newton.arclength import follow_branch
from solve.newton.branch_points import DAMPING, ContinuationParameters, Point, Unknowns
from solve.newton.branch_store import BranchStore
from solve.newton.iteration import Task, zero_motion
from solve.newton.manifold import Manifold
from solve.newton.switching import Followed
from solve.period.curve import Curve
from solve.period.grid import Grid
from solve.system import PeriodicSystem, in_phase

_STEPS = 64
"""Number of steps per period of the first orbit. Chosen by judgement: the grid is refined later."""

_LEAST, _MOST, _GROWTH = 1e-9, 1e6, 2.0
"""Smallest and largest amplitude, in the units of the coordinates, at which the first orbit is sought, and
ratio of successive trial amplitudes. Chosen by judgement."""

_DETUNED, _FAR = 1e-3, 0.05
"""Smallest and largest difference between the frequency of the first orbit and the frequency of small
vibrations, relative to the length of the range. Chosen by judgement."""

_ACCURATE = 1e-6
"""Largest error of the first orbit. Chosen by judgement: a thousandth of `_DETUNED`. Otherwise, the error of
an orbit that just touches a hard stop could count as detuning."""

_NARROWEST = 1e-4
"""The search for the first orbit ends if the relative distance between an amplitude with an orbit and an
amplitude without an orbit is below this value. Chosen by judgement."""

_IS_ZERO = 1e-9
"""Size of damping terms, and of variations of the coefficients, that counts as zero, relative to the
stiffness. Chosen by judgement: above round-off, and too small to affect the modes."""

_SHIFT = 5**0.5 - 2
"""Shift of a reversed motion, as a fraction of the period. It is irrational, because coefficients that are
symmetric about a phase do not change by a reversal about this phase."""

_VARYING = "damping, or terms that vary with the phase"

_PANELS = 512
"""Number of panels in the quadrature of the elastic force along a straight line. Chosen by judgement: if the
force has kinks, the error is about 1e-6 of the energy."""


def follow_modes_of(task: Task, ends: Array, most: int, store: BranchStore) -> list[Followed]:
    """Return the branches of the undamped modes whose frequency of small vibrations lies between the two
    speeds `ends` (2,). Raises ValueOutOfBoundsError if the equations have load or damping, or if there is no
    such mode."""
    frequencies, shapes = _small_vibrations(task)
    low, high = sorted(ends.tolist())
    inside = np.flatnonzero((frequencies >= low) & (frequencies <= high)).tolist()
    if not inside:
        given = ", ".join(task.speed_text(float(frequency)) for frequency in frequencies)
        raise ValueOutOfBoundsError(
            f"the speeds contain no frequency of small vibrations; give a range that contains one of: {given}"
        )
    followed = list[Followed]()
    for mode in inside:
        ranges = np.array([[low, high], [0.0, 1.0]])
        parameters = ContinuationParameters(task, ("speed", DAMPING), ranges)
        start = partial(_first, parameters, float(frequencies[mode]), shapes[:, mode])
        points, ended = follow_branch(parameters, start, most, partial(_is_forced, task), store.next())
        if not ended and low < points[-1].value < high and points[-1].value != points[0].value:
            ended = f"beyond the last orbit, the equations contain {_VARYING}"
        followed.append((parameters, [_without_trivial(point) for point in points], ended))
    return followed


def energy(system: PeriodicSystem, curve: Curve, speed: float) -> float:
    """Return the energy of an orbit of conservative equations, relative to rest: the kinetic energy at phase
    0, plus the work against the elastic forces along a straight line from rest to the coordinates at phase 0.
    """
    zero = np.zeros(1)
    q, v = curve(zero)[:, 0], speed * curve(zero, 1)[:, 0]
    equations = nonlinear_of(system)
    M = equations.along(curve).at(zero, speed)[0][0]
    nodes, weights = np.polynomial.legendre.leggauss(2)
    fractions = ((np.arange(_PANELS)[:, None] + (nodes + 1) / 2) / _PANELS).ravel()
    line = _Line(q, system.period)
    _, _, K, d = equations.along(line).at(fractions * system.period, speed)
    forces = np.einsum("kij,kj->ki", K, fractions[:, None] * q) - d
    return float(v @ M @ v / 2 + np.tile(weights / 2 / _PANELS, _PANELS) @ forces @ q)


class _Line:
    """Motion in which the coordinates grow linearly from zero to q over a period, while velocity and
    acceleration are set to zero."""

    def __init__(self, q: Array, period: float):
        self._q, self.nodes = q, np.array([0.0, period])

    def __call__(self, phase: Array, derivative: int = 0) -> Array:
        grown = self._q[:, None] * (phase / self.nodes[-1])
        return grown if derivative == 0 else np.zeros_like(grown)


def _small_vibrations(task: Task) -> tuple[Array, Array]:
    """Return the frequencies (n,), in rad/s, and the mode shapes (n, n) of small vibrations about rest.
    Raises ValueOutOfBoundsError for equations with load, damping or varying coefficients."""
    system = task.system
    along = nonlinear_of(system).along(zero_motion(system.n, Grid.uniform(1, system.period)))
    phase = compared_phases(system.period, system.breaks)
    M, C, K, d = along.at(phase, task.speed)
    limit = _IS_ZERO * np.abs(K).max() + np.zeros(1)
    loads = EPS * roundoff_of(along, phase, task.speed)
    found = [
        (np.abs(d) > 64 * loads, "a load or an acceleration of the reference motion"),
        (task.speed * np.abs(C) > limit, "damping or gyroscopic terms"),
        (np.ptp(K, axis=0) > limit, "coefficients that vary with the phase"),
        (np.ptp(M, axis=0) * task.speed**2 > limit, "coefficients that vary with the phase"),
    ]
    for present, words in found:
        if present.any():
            raise _forced_error(task, "at rest", words)
    from scipy.linalg import eigh

    squares, shapes = eigh((K[0] + K[0].T) / 2, M[0])
    return np.sqrt(np.maximum(squares, 0.0)), shapes / np.abs(shapes).max(axis=0)


def _forced_error(task: Task, where: str, words: str) -> ValueOutOfBoundsError:
    return ValueOutOfBoundsError(
        f"the equations of {task.system.labels.name} {where} contain {words}; unforced orbits require "
        "constant equations without load and damping: set the parameters of these terms to zero, such as "
        "--set c=0"
    )


def _is_forced(task: Task, point: Point) -> bool:
    """Whether the equations contain loads, damping or coefficients that act along the orbit of a point but
    not at rest. The residual of equations without such terms does not change if the motion is reversed and
    shifted in phase."""
    period, curve = task.period, point.unknowns.curve
    phase = compared_phases(period, task.breaks)
    one, size = _residual(task, curve, phase, point.value)
    other, _ = _residual(task, _Reversed(curve), _SHIFT * period - phase, point.value)
    return bool((np.abs(one - other) > _IS_ZERO * size).any())


def _residual(task: Task, motion: Motion, phase: Array, speed: float) -> tuple[Array, float]:
    """Return the residual (k, n) of the equations along a motion, and the size of its terms."""
    M, C, K, d = in_phase(nonlinear_of(task.system).along(motion), phase, speed)
    states = (motion(phase, derivative).T[..., None] for derivative in (2, 1, 0))
    terms = [(matrix @ state)[..., 0] for matrix, state in zip((M, C, K), states, strict=True)]
    return sum(terms) - d, max(float(np.abs(term).max()) for term in terms)


class _Reversed:
    """The motion `curve`, reversed in time about the phase `_SHIFT`/2 of the period."""

    def __init__(self, curve: Curve):
        self._curve, self.nodes = curve, curve.nodes

    def __call__(self, phase: Array, derivative: int = 0) -> Array:
        return (-1) ** derivative * self._curve(_SHIFT * self.nodes[-1] - phase, derivative)


def _first(parameters: ContinuationParameters, frequency: float, shape: Array) -> Point:
    """Return the first orbit of a mode. Raises ValueOutOfBoundsError if the equations contain loads, damping
    or varying coefficients along this orbit."""
    point = _detuned(parameters, frequency, shape)
    if _is_forced(parameters.task, point):
        raise _forced_error(parameters.task, "along vibrations", _VARYING)
    return point


def _detuned(parameters: ContinuationParameters, frequency: float, shape: Array) -> Point:
    """Return the orbit of a mode at the smallest trial amplitude at which its frequency clearly differs from
    the frequency of small vibrations. If no accurate orbit is found beyond some amplitude, as beyond the
    clearance of a hard stop, return the orbit at this amplitude."""
    grid, manifold = parameters.task.grid(_STEPS), Manifold(parameters)
    growing, shifting = (_harmonic(parameters.task, grid, shape, way) for way in (np.cos, np.sin))
    ways, span, below, amplitude = [growing, shifting], parameters.spans[0], 0.0, _LEAST
    largest, last = _MOST, None
    while amplitude < largest:
        unknowns = Unknowns(growing.times(amplitude).curve, np.array([frequency, 0.0]))
        try:
            point = manifold.held(unknowns, ways, grid)
            if point.orbit.errors[0] > _ACCURATE:
                raise NoOrbitError("the orbit is inaccurate")
        except SolveError:
            if last is None:
                break
            if amplitude < (1 + _NARROWEST) * below:
                return last
            largest, amplitude = amplitude, (below + amplitude) / 2
            continue
        detuned = abs(point.value - frequency) / span
        if _DETUNED < detuned < _FAR or (detuned > _FAR and amplitude < (1 + _DETUNED) * below):
            return point
        if detuned > _FAR:
            largest, amplitude = amplitude, (below + amplitude) / 2
        else:
            last, below, amplitude = point, amplitude, min(_GROWTH * amplitude, (amplitude + largest) / 2)
    raise NoOrbitError(
        f"no nonlinear mode was found near {parameters.task.speed_text(frequency)}: its frequency does not "
        f"change up to an amplitude of {amplitude:.1e}, in units of the coordinates"
    )


def _harmonic(task: Task, grid: Grid, shape: Array, function: np.ufunc) -> Unknowns:
    """Return, in the form of unknowns, a harmonic vibration with the mode shape `shape` (n,). It serves as
    the direction of a branch. function: np.cos or np.sin of the phase."""
    rates = {np.cos: (np.cos, lambda x: -np.sin(x)), np.sin: (np.sin, np.cos)}[function]
    values = [shape[:, None] * rate(grid.nodes) for rate in rates]
    q, v, a = values[0].T, values[1].T, -values[0].T
    return Unknowns(Curve.quintic(grid.nodes, q, v, a[:-1], a[1:]), np.zeros(2))


def _without_trivial(point: Point) -> Point:
    """Return a copy of a point in which the two multipliers nearest to +1, which are due to phase shift and
    energy, are set to exactly +1. The spectral radius is that of the other multipliers, but at least 1."""
    rho = point.orbit.multipliers.copy()
    order = np.argsort(np.abs(rho - 1))
    rho[order[:2]] = 1.0
    others = np.abs(rho[order[2:]])
    orbit = replace(point.orbit, multipliers=rho, radius=float(others.max(initial=1.0)))
    return replace(point, orbit=orbit)
