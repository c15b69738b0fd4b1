"""Rigid-body modes in results."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.period.rigid_body import RigidBodyModes
from solve.results.contents import MOST_SHOWN
from solve.results.serialization import serializable


@serializable
class RigidBodyMode(NamedTuple):
    """Rigid-body mode e. `vector` (n,) contains the components of e, and `damped` is True if C e ≠ 0. `error`
    is the largest |K e| over the period, relative to Σ|K_ij e_j|. `drift` is the steady velocity w of a
    damped mode in q = w e t + p(t), where t is the time and p is periodic; None without an orbit."""

    vector: tuple[float, ...]
    damped: bool
    error: float
    drift: float | None = None

    def ratio(self, coordinates: Sequence[str]) -> str:
        """Text that states the ratio of the coordinates that move.

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
    """Return the rigid-body modes at the first of P points. `secular` (P, r) are steady velocities with
    respect to the phase; `speed` is in rad/s."""
    rigid_modes = []
    for at in np.flatnonzero(modes.present[0]).tolist():
        damped = bool(modes.dragged[0, at])
        drift = None if secular is None or not damped else speed * float(secular[0, at])
        vector = tuple(modes.vectors[0, :, at].tolist())
        rigid_modes.append(RigidBodyMode(vector, damped, float(modes.errors[0, at]), drift))
    return rigid_modes


def steady_part(differences: Array, nodes: Array, modes: Sequence[RigidBodyMode], speed: float) -> Array:
    """Return the steady motion (turns, n, k) along rigid-body modes that is contained in `differences`
    (turns, n, k), the differences from an orbit. The steady motion of a damped mode is an offset plus the
    drift; the steady motion of an undamped mode is an offset plus any constant velocity. `nodes` (k,) are
    phases; `speed` is in rad/s."""
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
