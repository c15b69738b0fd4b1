"""Rigid-body modes as they appear in results."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.period.rigid_body import RigidBodyModes
from solve.results.contents import MOST_SHOWN
from solve.results.serialization import serializable


@serializable
class RigidBodyMode(NamedTuple):
    """Rigid-body mode e. vector (n,): components of e; damped: whether C e ≠ 0; error: largest |K e| over the
    period, relative to Σ|K_ij e_j|; drift: steady velocity w (per unit of time) of a damped mode, with q =
    w e t + p(t) and periodic p; None without an orbit."""

    vector: tuple[float, ...]
    damped: bool
    error: float
    drift: float | None = None

    def ratio(self, coordinates: Sequence[str]) -> str:
        """Text with the ratio of the coordinates that move.

        >>> RigidBodyMode((1.0, -0.5, 0.0), False, 0.0).ratio(("motor", "gear", "case"))
        'motor : gear = 1 : -0.5'
        """
        moving = [(name, part) for name, part in zip(coordinates, self.vector, strict=True) if part]
        shown = moving[:MOST_SHOWN]
        names, parts = " : ".join(name for name, _ in shown), " : ".join(f"{part:.4g}" for _, part in shown)
        more = len(moving) - len(shown)
        return f"{names} = {parts}" + (f" and {more} more" if more else "")


def rigid_body_modes_of(
    modes: RigidBodyModes, secular: Array | None = None, speed: float = 0.0
) -> list[RigidBodyMode]:
    """Rigid-body modes at the first point. secular (P, r): steady velocities with respect to the phase.
    speed: in rad/s."""
    rigid_modes = []
    for at in np.flatnonzero(modes.present[0]).tolist():
        damped = bool(modes.dragged[0, at])
        drift = None if secular is None or not damped else speed * float(secular[0, at])
        vector = tuple(modes.vectors[0, :, at].tolist())
        rigid_modes.append(RigidBodyMode(vector, damped, float(modes.errors[0, at]), drift))
    return rigid_modes


def steady_part(differences: Array, nodes: Array, modes: Sequence[RigidBodyMode], speed: float) -> Array:
    """Part of the differences (turns, n, k) from an orbit that is a steady motion along rigid-body modes: an
    offset and the drift or, for an undamped mode, an offset and any constant velocity. nodes (k,): phases.
    speed: in rad/s."""
    steady = np.zeros_like(differences)
    if not modes:
        return steady
    vectors = np.array([mode.vector for mode in modes]).T
    shares = np.linalg.pinv(vectors) @ differences
    for at, mode in enumerate(modes):
        share = shares[:, at]
        velocity = np.full(len(share), (mode.drift or 0.0) / speed)
        if not mode.damped:
            velocity, _ = np.polyfit(nodes, share.T, 1)
        moved = velocity[:, None] * nodes
        level = (share - moved).mean(axis=1, keepdims=True)
        steady += vectors[:, at, None] * (level + moved)[:, None]
    return steady
