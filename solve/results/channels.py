"""Measured beside computed: how far a channel is off, and its picture."""

import math
from typing import Any, NamedTuple

import numpy as np

from solve.arrays import Array
from solve.results.lasting import lasting
from solve.units import ShownUnit


@lasting
class Channel(NamedTuple):
    """Measured and computed values (k,) of a coordinate or output at phases, or of orders, at a speed
    (rad/s); complex where orders have phase angles. position: the phase at which natural frequencies are
    those of the modes `at`, at rest."""

    speed: float
    orders: bool
    name: str
    at: Array
    measured: Array
    computed: Array
    position: float | None = None

    @property
    def record(self) -> dict[str, Any]:
        """For JSON."""
        return {"speed": self.speed, "name": self.name, "difference": self.relative}

    def where(self, unit: ShownUnit) -> str:
        """Speed in a unit, or position of what rests."""
        return unit.text(self.speed) if self.position is None else f"at {np.degrees(self.position):.6g}°"

    @property
    def axis(self) -> str:
        """What the values are functions of, as a label."""
        return "phase (°)" if self.by_phase else "order" if self.orders else "mode"

    @property
    def by_phase(self) -> bool:
        """Whether it is a curve over the phase."""
        return self.position is None and not self.orders

    @property
    def relative(self) -> float:
        """Root mean square of the difference, relative to that of what was measured."""
        size = math.sqrt(float(np.mean(np.abs(self.measured) ** 2)))
        off = math.sqrt(float(np.mean(np.abs(self.computed - self.measured) ** 2)))
        return off / size if size else math.nan
