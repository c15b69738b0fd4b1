"""Values of a design over a range of speeds: local maxima over the speed, and edges of unstable bands."""

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
"""The spectral radius as a quantity."""

_TOLERANCE = 1e-10
"""Tolerance of the edge of a band, relative to its speed. Chosen by judgement: far below that of the
optimum."""

_BRACKETS = 0.25, 0.02
"""Half widths of the bracket of a predicted edge, in widths of the band at the start. Chosen by judgement:
small, so that the other edge stays outside the bracket even if the band becomes narrower."""

_SMALLEST_STEP = 1e-3
"""Change of the design within which a band counts as closed if its edge is not found again. Chosen by
judgement."""

_MAX_STEPS = 20
"""Maximum number of steps in which an edge is followed to a design. Chosen by judgement."""

_DIFFERENCE = 1e-6
"""Relative difference of the speed for the derivative of the spectral radius at an edge, near the cube root
of the round-off, which balances the errors of a central difference."""


class PeakSpeed(NamedTuple):
    """Speed of a local maximum, and its distance to the two further speeds with which it is followed."""

    speed: float
    spacing: float

    @property
    def speeds(self) -> tuple[float, float, float]:
        """The three speeds, ascending."""
        return self.speed - self.spacing, self.speed, self.speed + self.spacing


@dataclass(frozen=True)
class Peak:
    """Local maxima (k,) over the speed of values at three equidistant speeds, on the parabolas through them.

    The maximum between the speeds is a smooth function of the design, and exact if it is at the middle speed.
    Its derivatives are those of the parabola at a fixed speed (envelope theorem).
    """

    three: Sequence[Tracked]

    def values(self, x: Array) -> Array:
        values = np.stack([each.values(x) for each in self.three])
        return np.einsum("sk,sk->k", _weights(values), values)

    def slopes(self, x: Array) -> Array:
        weights = _weights(np.stack([each.values(x) for each in self.three]))
        return np.einsum("sk,skr->kr", weights, np.stack([each.slopes(x) for each in self.three]))


def _weights(values: Array) -> Array:
    """Weights (3, k) with which three values (3, k) enter the maximum of the parabola through them."""
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

    The value is the distance of the edge from an end of the range, positive if the edge is inside.

    is_lower: whether it is the lower edge, which must be above the upper end of the range. start, width:
    edge and width of the band at the design x. limit: spectral radius at the edge.
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
        """Whether the edge may leave the range within the bounds of the design: whether the derivatives at
        the start predict at least half of the required shift."""
        (distance,), (slopes,) = self.values(self.x), self.slopes(self.x)
        decrease = float(np.maximum(slopes * self.x, slopes * (self.x - 1)).sum())
        return decrease > distance / 2

    @property
    def _sign(self) -> float:
        return -1.0 if self.is_lower else 1.0

    def _found(self, x: Array) -> _Edge | None:
        """Edge at a design, followed from the nearest known one; None if the band has closed on the way.

        Raises NoResultError if it is too far away.
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
        """Edge at a design, searched near the prediction from a known edge; None if it is not found there."""
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
