"""Rigid-body modes as results name them."""

from collections.abc import Sequence
from typing import NamedTuple

from solve.period.rigid_body import RigidBodyModes
from solve.results.lasting import lasting

_MOST_MOVING = 6
"""Coordinates of a rigid-body mode that a sentence names."""


@lasting
class RigidBodyMode(NamedTuple):
    """vector (n,): components of e; damped: whether C e ≠ 0; error: largest |K e| over the period, relative
    to Σ|K_ij e_j|; drift: steady velocity w by time of a damped mode, q = w e t + p(t), or None."""

    vector: tuple[float, ...]
    damped: bool
    error: float
    drift: float | None = None

    def ratio(self, coordinates: Sequence[str]) -> str:
        """The coordinates that move, and by how much relative to each other.

        >>> RigidBodyMode((1.0, -0.5, 0.0), False, 0.0).ratio(("motor", "gear", "case"))
        'motor : gear = 1 : -0.5'
        """
        moving = [(name, part) for name, part in zip(coordinates, self.vector, strict=True) if part]
        shown = moving[:_MOST_MOVING]
        names, parts = " : ".join(name for name, _ in shown), " : ".join(f"{part:.4g}" for _, part in shown)
        more = len(moving) - len(shown)
        return f"{names} = {parts}" + (f" and {more} more" if more else "")


def rigid_body_modes_of(modes: RigidBodyModes, point: int) -> list[RigidBodyMode]:
    """Those of one point."""
    return [
        RigidBodyMode(
            tuple(modes.vectors[point, :, at].tolist()),
            bool(modes.damped[point, at]),
            float(modes.errors[point, at]),
        )
        for at in modes.present[point].nonzero()[0].tolist()
    ]
