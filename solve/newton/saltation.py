"""Saltation matrices: the jump of a disturbance at an event at which the force jumps (M. di Bernardo, C.
Budd, A. R. Champneys, P. Kowalczyk, Piecewise-smooth Dynamical Systems, 2008, 2.3).

A disturbance shifts the phase of the event. With the states x = (q, q') and rates f before and after it,

    S = I + (f⁺ - f⁻) ∇gᵀ / (∂g/∂φ + ∇gᵀ f⁻)

multiplies the variation. For continuous forces S = I."""

import numpy as np

from solve.arrays import Array
from solve.equations import event_normals, events_of
from solve.methods.collocation import Collocated
from solve.methods.method import Steps
from solve.period.curve import Curve
from solve.period.grid import Grid
from solve.period.points import OnePoint
from solve.system import PeriodicSystem

_JUMP = 1e-6
"""Jump of q'' relative to its largest modulus below which forces count as continuous. A choice: above the
errors of second derivatives of curves, and too small to affect multipliers."""


def steps_with_saltation(
    along: PeriodicSystem, curve: Curve, speed: float, method: Collocated, grid: Grid
) -> Steps | None:
    """One-step maps that include the saltation matrices at the events of an orbit; None if no force jumps at
    these events. along: system linearised along the orbit; grid: has the events as nodes; speed: in rad/s."""
    if not forces_jump(along, curve):
        return None
    nodes = _nodes(along, curve)
    normals = event_normals(along, curve, speed)
    steps = method.discretise(OnePoint(along, speed), grid).steps
    A, b = steps.A.copy(), steps.b.copy()
    inertial = along.n - len(along.states)
    for node, S in zip(nodes, _matrices(curve, nodes, normals, inertial), strict=True):
        phase = curve.nodes[node : node + 1]
        state = np.concatenate((curve(phase)[:, 0], curve(phase, 1)[:inertial, 0]))
        A[0, node - 1], b[0, node - 1] = S @ A[0, node - 1], S @ b[0, node - 1] + state - S @ state
    return Steps(A, b)


def forces_jump(along: PeriodicSystem, curve: Curve) -> bool:
    """Whether forces jump at an event of an orbit, decided by jumps of its accelerations."""
    if not events_of(along).phases:
        return False
    before, after = _beside(curve, _nodes(along, curve))
    return bool(np.abs(after - before).max() > _JUMP * np.abs(curve.sampled(1, 2)).max())


def _nodes(along: PeriodicSystem, curve: Curve) -> Array:
    """Indices (k,) of the nodes at the events."""
    return np.abs(curve.nodes[:, None] - np.array(events_of(along).phases)).argmin(axis=0)


def _beside(curve: Curve, nodes: Array) -> tuple[Array, Array]:
    """Accelerations q'' (n, k) before and after each node."""
    ends = curve.within(np.array([0.0, 1.0]), 2)
    steps = ends.shape[-2]
    return ends[:, (nodes - 1) % steps, 1], ends[:, nodes % steps, 0]


def _matrices(curve: Curve, nodes: Array, normals: Array, inertial: int) -> list[Array]:
    """Saltation matrices (N, N) of the states (q, q') at nodes, with q' of the `inertial` first coordinates.
    normals (k, 1 + 2n): derivatives of the switching functions, 0 for other q'."""
    found, n = [], curve.n
    before, after = _beside(curve, nodes)
    rates = curve(curve.nodes[nodes], 1)
    for k, normal in enumerate(normals):
        rate = normal[0] + normal[1 : n + 1] @ rates[:, k] + normal[n + 1 :] @ before[:, k]
        jump = np.concatenate((np.zeros(n), (after - before)[:inertial, k]))
        found.append(np.eye(n + inertial) + np.outer(jump, normal[1 : n + inertial + 1]) / rate)
    return found
