"""Values of a design in a range of speeds: local maxima versus speed, and edges of unstable bands."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.errors import NoResultError
from solve.period.named import RADIUS, Named
from solve.studies.design_points import Design, DesignPoint
from solve.studies.tracked import Tracked

SPECTRAL_RADIUS = Named(RADIUS, "1", RADIUS)
"""Spectral radius as a named quantity."""

_TOLERANCE = 1e-10
"""Tolerance of the speed at the edge of a band, relative to this speed. Chosen by judgement: it is far below
the tolerance of the optimum."""

_BRACKETS = 0.25, 0.02
"""Half-widths of the brackets around a predicted edge, relative to the initial width of the band. Chosen by
judgement: small, so that the other edge stays outside the bracket even if the band becomes narrower."""

_SMALLEST_STEP = 1e-3
"""If an edge is lost within this change of the design, the band counts as closed. Chosen by judgement."""

_MAX_STEPS = 20
"""Maximum number of steps in which an edge is followed from a known design to another. Chosen by
judgement."""

_DIFFERENCE = 1e-6
"""Relative step of the speed in the central difference for the derivative of the spectral radius at an edge.
It is near the cube root of the round-off. This step balances the two errors of a central difference."""


class PeakSpeed(NamedTuple):
    """Speed of a local maximum, and the distance to each of the two neighbouring speeds that are used to
    follow the maximum."""

    speed: float
    spacing: float

    @property
    def speeds(self) -> tuple[float, float, float]:
        """The three speeds in ascending order."""
        return self.speed - self.spacing, self.speed, self.speed + self.spacing


@dataclass(frozen=True)
class Peak:
    """Local maxima (k,) versus speed, on the parabolas through values at three equidistant speeds.

    Such a maximum is a smooth function of the design, and exact if it is at the middle speed. Its derivatives
    are those of the parabola at a fixed speed (envelope theorem).
    """

    three: Sequence[Tracked]

    def values(self, x: Array) -> Array:
        values = np.stack([each.values(x) for each in self.three])
        return np.einsum("sk,sk->k", _weights(values), values)

    def slopes(self, x: Array) -> Array:
        weights = _weights(np.stack([each.values(x) for each in self.three]))
        return np.einsum("sk,skr->kr", weights, np.stack([each.slopes(x) for each in self.three]))


def _weights(values: Array) -> Array:
    """Return weights (3, k) of `values` (3, k). The weighted sum of the three values is the maximum of the
    parabola through them."""
    low, middle, high = values
    slope, bend = (high - low) / 2, low - 2 * middle + high
    is_peak = bend < 0
    place = np.where(is_peak, np.clip(-slope / np.where(is_peak, bend, 1.0), -1.0, 1.0), np.sign(slope))
    return np.stack((place * (place - 1) / 2, 1 - place**2, place * (place + 1) / 2))


class _Edge(NamedTuple):
    """Edge of a band at a design x (r,) with its derivatives (r,)."""

    x: Array
    speed: float
    slopes: Array


@dataclass(eq=False)
class BandEdge:
    """Edge of an unstable band, which must not enter the range of speeds.

    The value is the distance of the edge from an end of the range, and is positive if the edge is inside the
    range.

    If `is_lower` is True, this is the lower edge of the band, which must lie above the upper end of the
    range; otherwise it is the upper edge, which must lie below the lower end. `end` is the speed of that end.
    `start` and `width` are the edge and the width of the band for the design x. `limit` is the spectral
    radius at the edge.
    """

    design: Design
    is_lower: bool
    end: float
    x: Array
    start: float
    width: float
    limit: float
    known: list[_Edge] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.design = replace(self.design, orbits=False)
        self.known.append(self._differentiated(self.x, self.start))

    def values(self, x: Array) -> Array:
        found = self._found(x)
        return np.array([0.0 if found is None else self._sign * (found.speed - self.end)])

    def slopes(self, x: Array) -> Array:
        found = self._found(x)
        return np.zeros((1, len(x))) if found is None else self._sign * found.slopes[None]

    @property
    def may_leave(self) -> bool:
        """Whether parameters within their bounds can move the edge out of the range. The derivatives for the
        initial design must predict at least half of the required shift."""
        (distance,), (slopes,) = self.values(self.x), self.slopes(self.x)
        decrease = float(np.maximum(slopes * self.x, slopes * (self.x - 1)).sum())
        return decrease > distance / 2

    @property
    def _sign(self) -> float:
        return -1.0 if self.is_lower else 1.0

    def _found(self, x: Array) -> _Edge | None:
        """Return the edge for the design x, followed from the nearest known edge. Return None if the band
        closes before the design x is reached.

        Raises NoResultError if the edge is too far away.
        """
        for _ in range(_MAX_STEPS):
            nearest = min(self.known, key=lambda known: float(np.abs(known.x - x).max()))
            if np.array_equal(nearest.x, x):
                return nearest
            target = x
            while (speed := self._refined(target, nearest)) is None:
                if np.abs(target - nearest.x).max() < _SMALLEST_STEP:
                    return None
                target = (target + nearest.x) / 2
            self.known.append(self._differentiated(target, speed))
        raise NoResultError("an edge of an unstable band is too far away to be followed")

    def _refined(self, x: Array, known: _Edge) -> float | None:
        """Return the edge for the design x, searched for near the prediction from a known edge. Return None
        if no edge is found there."""
        from scipy.optimize import brentq

        predicted = known.speed + float(known.slopes @ (x - known.x))
        for bracket in _BRACKETS:
            low, high = predicted - bracket * self.width, predicted + bracket * self.width
            if low > 0 and self._sign * self._growth(x, low) > 0 > self._sign * self._growth(x, high):
                found = brentq(partial(self._growth, x), low, high, xtol=_TOLERANCE * predicted)
                return float(found)  # type: ignore[arg-type]
        return None

    def _growth(self, x: Array, speed: float) -> float:
        (point,) = self.design.at(x, [float(speed)])
        return safe_radius(point) - self.limit

    def _differentiated(self, x: Array, speed: float) -> _Edge:
        (point,) = self.design.at(x, [speed])
        ends = speed * (1 - _DIFFERENCE), speed * (1 + _DIFFERENCE)
        by_speed = (self._growth(x, ends[1]) - self._growth(x, ends[0])) / (ends[1] - ends[0])
        return _Edge(x, speed, -self.design.slopes(point.slopes(SPECTRAL_RADIUS)) / by_speed)


def safe_radius(point: DesignPoint) -> float:
    """Spectral radius plus its error."""
    return point.solved.spectral_radius * (1 + point.solved.error_estimate.multipliers)
