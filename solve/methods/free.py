"""Solution of free machines. A method solves the anchored system; the motion of the machine follows from its
solution."""

from dataclasses import replace

import numpy as np

from solve.arrays import Array, across
from solve.errors import MatricesError, UnbalancedLoadError
from solve.methods.method import Method, OneStep, Solutions
from solve.period.anchored import Anchored
from solve.period.curve import PeriodicCurve
from solve.period.frozen import FrozenModes, frozen
from solve.period.grid import Grid
from solve.period.period_map import Steps, monodromy, periodic_states
from solve.period.points import Points, matrices
from solve.period.rigid_body import (
    Free,
    RigidBodyModes,
    conserved_momentum,
    rigid_body_modes,
    still_rigid,
    with_unit_states,
)

_IN_A_PIECE = 8
"""Number of further phases at which K is tested in each interval between two jumps."""

_FURTHER = 509
"""Number of further phases of the period at which K is tested. Their spacing follows the golden section, so
that features longer than 1/200 of the period are detected."""

_SECTION = 0.6180339887498949
"""Golden section. The most uniform sequence of phases consists of its multiples modulo 1."""

_PANELS, _PLACES = 256, 4
"""Number of intervals of the period, and of Gauss points per interval, for the mean of a load. Harmonics up
to 200 are integrated with an error of 1e-9 of their amplitude."""

_MOST_SHOWN = 8
"""Largest number of components of a rigid-body mode that a message lists."""


def free(points: Points, modes: FrozenModes | None = None) -> Free | None:
    """Rigid-body modes and mean masses of the points; None if no point has a rigid-body mode. modes: frozen
    modes of the points, if available."""
    if modes is None:
        M, C, K, _ = matrices(points, np.array([0.3]) * points.period)
        if not rigid_body_modes(K, C, M).any.any():
            return None
        modes = frozen(points)
    found = modes.rigid_body_modes
    if found is None:
        return None
    some = np.flatnonzero(found.any)
    M, C, K, _ = matrices(points[some], _further(points))
    lost = some[~still_rigid(K, C, M, found[some])]
    if len(lost):
        vectors = found.vectors.copy()
        vectors[lost] = 0.0
        found = replace(found, vectors=vectors)
    if not found.any.any():
        return None
    if not (points.breaks or points.first_order) and (found.damped & found.present).any():
        M, C, K = modes.matrices
        found = replace(found, momentum=conserved_momentum(M, C, K, found, points.period))
    return Free(found, with_unit_states(modes.mean_mass, points.first_order))


def _further(points: Points) -> Array:
    even = np.mod(np.arange(_FURTHER) * _SECTION, 1.0) * points.period
    if not points.breaks:
        return even
    pieces = Grid.uniform(len(points.breaks), points.period, points.breaks)
    return np.concatenate((even, pieces.stages((np.arange(_IN_A_PIECE) + 0.5) / _IN_A_PIECE).ravel()))


def solutions_on(
    method: Method, points: Points, grid: Grid, orbit: bool, engine: str, held: Free | None
) -> Solutions:
    """Solve points, some of which may have rigid-body modes, by a method on a grid.

    For points with rigid-body modes, the monodromy matrices describe the motion relative to the modes (see
    `Anchored.quotient`). The orbits have zero mean along the modes."""
    method.require_order(points)
    if held is None:
        return method.solutions(points, grid, orbit, engine)
    anchored = anchored_for(method, points, held)
    if orbit and held.modes.conserving.any():
        return _conserving(method, anchored, grid, held)
    with np.errstate(all="ignore"):
        found = method.solutions(anchored, grid, orbit, engine)
        if found.curve is not None and (held.modes.damped & held.modes.present).any():
            # A drift may be far larger than the vibration, and would reduce the accuracy of the vibration.
            drift = anchored.motion(found.curve, held.mass)[0].drift
            anchored = anchored.drifting(drift)
            found = found if drift is None else method.solutions(anchored, grid, orbit, engine)
        curve, secular, driven = found.curve, None, np.zeros(len(points))
        if curve is not None:
            driven = _acceleration_scale(curve, held.modes)
            curve, secular = anchored.motion(curve, held.mass)
            accelerations = np.where(held.modes.damped, 0.0, np.abs(secular))
            driven = (accelerations / np.maximum(driven, np.finfo(float).tiny)).max(axis=1)
        Phi = np.where(np.isfinite(found.Phi), anchored.quotient(found.Phi), found.Phi)
        steps = None if found.steps is None else Steps(anchored.steps(found.steps.A), found.steps.b)
    return replace(
        found, Phi=Phi, curve=curve, steps=steps, units=None, free=held, secular=secular, driven=driven
    )


def anchored_for(method: Method, points: Points, held: Free) -> Anchored:
    """Points with anchored rigid-body modes. If the method requires symmetric matrices, the anchored matrices
    are symmetric."""
    weights = held.modes.weighted(held.mass) if method.symmetric else None
    return Anchored(points, held.modes, weights=weights)


def _conserving(method: Method, anchored: Anchored, grid: Grid, held: Free) -> Solutions:
    """Orbits of points that conserve a momentum μ although C e ≠ 0. One multiplier of the anchored points is
    then +1.

    If the momentum may jump at phase 0, there are two periodic solutions: with μ = 0 and with μ = 1 after the
    jump. The orbit is the combination of these solutions that has no drift."""
    if not isinstance(method, OneStep):
        raise MatricesError(
            f"{method.name} cannot solve a machine that rotates freely if inertia or gyroscopic forces "
            "vary along its rigid-body mode; use radau or gauss"
        )
    modes, mass, n = held.modes, held.mass, anchored.n
    with np.errstate(all="ignore"):
        chain = method.discretise(anchored, grid)
        rows, units = anchored.momentum()
        states, condition, gained = _by_momentum(chain.steps, rows, units)
        first, second = states[..., 0], states[..., 1]
        # These are velocities along the mode. The combination of the two solutions must have velocity 0.
        without, along = (
            anchored.motion(chain.curve(x), mass)[1].sum(axis=1) for x in (first, first + second)
        )
        curve = chain.curve(first - (without / (along - without))[:, None, None] * second)
        scale = _acceleration_scale(curve, modes).max(axis=1)
        curve = replace(anchored.motion(curve, mass)[0], drift=None)
        reference = np.take_along_axis(modes.references, modes.present.argmax(axis=1)[:, None], axis=1)
        acceleration = gained * np.take_along_axis(units, n + reference, axis=1)[:, 0] / grid.period
        driven = np.abs(acceleration) / np.maximum(scale, np.finfo(float).tiny)
        Phi = monodromy(chain.steps)
        Phi = np.where(np.isfinite(Phi), anchored.quotient(Phi), Phi)
        steps = Steps(anchored.steps(chain.steps.A), chain.steps.b)
        found = method.sound(anchored, grid, Phi, curve, condition, steps)
    return replace(found, free=held, secular=np.zeros(modes.references.shape), driven=driven)


def _by_momentum(steps: Steps, rows: Array, units: Array) -> tuple[Array, Array, Array]:
    """Return states, condition numbers and gained momenta of solutions that a jump of the momentum at phase 0
    makes periodic.

    The states (P, m+1, N, 2) belong to two solutions. After the jump, the momentum is 0 in the first solution
    (with loads) and 1 in the second (without loads). The gained momentum (P,) is the gain of the first
    solution per period. rows, units (P, N): see `Anchored.momentum`."""
    A, loads = steps.A.copy(), np.stack((steps.b, np.zeros(steps.b.shape)), axis=-1)
    loads[:, 0, :, 1] = np.squeeze(A[:, 0] @ units[..., None], -1)
    kept = np.eye(A.shape[-1]) - units[..., None] * rows[:, None]
    A[:, 0] = A[:, 0] @ kept
    states, condition = periodic_states(Steps(A, loads))
    gained = np.einsum("pi,pi->p", rows, states[:, 0, :, 0])
    states[:, 0] = kept @ states[:, 0]
    states[:, 0, :, 1] += units
    return states, condition, gained


def _acceleration_scale(curve: PeriodicCurve, modes: RigidBodyModes) -> Array:
    """Return the scale (P, r) of the acceleration along each mode, with respect to the phase. For each
    coordinate that the mode moves, the largest acceleration is divided by the component of this coordinate in
    the mode; the scale is the largest of these ratios."""
    rate = 1.0 / float(curve.nodes[-1])
    sizes = np.abs(curve.sampled(2, 2)).max(axis=-1) + rate**2 * np.abs(curve.sampled(2)).max(axis=-1)
    along = np.abs(modes.vectors)
    by_mode = np.where(along > 0, sizes[..., None] / np.where(along > 0, along, 1.0), 0.0)
    return across(np.maximum, np.moveaxis(by_mode, 1, -1))


def mean_loads(point: Points, modes: RigidBodyModes) -> Array:
    """Mean (r,) over the period of the generalised force gᵀd along each rigid-body mode of one point, with
    gᵀK = 0. If K is symmetric, g = e."""
    grid = Grid.uniform(max(_PANELS, len(point.breaks)), point.period, point.breaks)
    nodes, weights = np.polynomial.legendre.leggauss(_PLACES)
    M, C, K, d = matrices(point, grid.stages((nodes + 1) / 2).ravel())
    left = rigid_body_modes(np.swapaxes(K, -1, -2), 0 * C, M)
    vectors = modes.vectors[0]
    if left.vectors[0].shape == vectors.shape:
        at = modes.references[0]
        vectors = left.vectors[0] @ np.linalg.inv(left.vectors[0][at]) @ vectors[at]
    loads = d[0].reshape(grid.steps, _PLACES, -1)
    return np.einsum("msj,m,s->j", loads, grid.h, weights) @ vectors / (2 * point.period)


def driven_freely(point: Points, modes: RigidBodyModes) -> UnbalancedLoadError:
    """Exception for a point without periodic vibration, because its load drives a rigid-body mode."""
    loads = mean_loads(point, modes)
    loads = np.where(modes.present[0] & ~modes.dragged[0], loads, 0.0)
    at = int(np.abs(loads).argmax())
    components = [f"{component:.6g}" for component in modes.vectors[0, :, at]]
    more = ", …" if len(components) > _MOST_SHOWN else ""
    return UnbalancedLoadError(
        f"the load drives the rigid-body mode ({', '.join(components[:_MOST_SHOWN])}{more}), which has "
        f"no restoring force: its mean torque (or force) along the mode is {loads[at]:.6g} N m (N), so the "
        "speed would grow without bound; balance it by a constant load, or add drag or a spring to ground"
    )


def mean_weights(point: Points, modes: RigidBodyModes) -> Array:
    """Weights (r, n) of the coordinates in the mean motion along each rigid-body mode of one point. The modes
    have the same reference coordinates as `modes`."""
    found = free(point)
    if found is None:
        return np.zeros((modes.references.shape[1], point.n))
    vectors, mass = found.modes.vectors[0], found.mass[0]
    reference_rows = vectors[modes.references[0]]
    vectors = vectors @ np.linalg.inv(reference_rows) @ modes.vectors[0][modes.references[0]]
    return replace(found.modes, vectors=vectors[None]).weighted(mass[None])[0]
