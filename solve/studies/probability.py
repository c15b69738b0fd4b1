"""Probabilities of events of standard normal variables z, with confidence intervals.

Rare events are sampled about centres: the points nearest to z = 0 at which the events occur, which a gradient
search finds. All samples are weighted with the density of the mixture of all centres (E. Veach, L. J. Guibas,
SIGGRAPH 1995, 419-428), so that no weight exceeds the inverse of the fraction of samples about 0.
"""

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.errors import SolveError
from solve.results.tolerances import Probability

Gradient = Callable[[Array], tuple[float, Array]]
"""Type of functions of z (r,). Such a function returns the margin of an event, which is positive where the
event occurs, and the derivatives (r,) of the margin."""

QUANTILE = 1.959963984540054
"""Quantile of the normal distribution for 95 % intervals."""

SEARCH_SPREAD = 2.5
"""Standard deviation of the samples used to search for events. Chosen by judgement: an event at a distance of
4.3 standard deviations, with probability 1e-5, is then found by one sample in 23."""

_PLAIN, _WIDE = 0.3, 0.2
"""Two fractions of the samples of a mixture, which are drawn about 0: the first with unit standard deviation,
the second with the larger `SEARCH_SPREAD`. Chosen by judgement: with these fractions, intervals for events
that surround 0 in three dimensions contain the true value as often as other intervals."""

_FEW = 10
"""Effective number of events, (Σw)²/Σw² of their weights w (L. Kish, Survey Sampling, 1965), below which the
events may lie at the margin of a region that the samples miss. The upper end of the interval is then at least
as large as it would be without events. Measured: of 60 intervals for two narrow ranges of instability, 14 did
not contain the true value; with this limit, 4 do not."""

_STEPS, _STEP_END = 12, 0.02
"""Maximum number of Newton steps to the nearest point of an event, and change of z below which the iteration
ends. Chosen by judgement."""

MAX_DISTANCE = 8.0
"""Largest distance from the mean, in standard deviations, at which events are sought and gradients are
computed. Chosen by judgement: the probability that a single variable is farther from its mean is 1e-15."""

MAX_CENTRES = 8
"""Maximum number of centres of a mixture; those nearest to 0 are kept. Chosen by judgement."""

_COVERED = 1.0
"""An event belongs to a centre if it lies beyond the tangent plane through the centre, or on the other side,
where 0 lies, within this distance of the plane. Chosen by judgement."""


class Mixture(NamedTuple):
    """Mixture of normal densities about `centres` (k, r), of which the first is 0, with standard deviations
    `deviations` (k,) and numbers of samples `counts` (k,)."""

    centres: Array
    deviations: Array
    counts: Array

    @classmethod
    def about(cls, centres: Sequence[Array], dimensions: int, samples: int) -> "Mixture":
        """Mixture for a total number of samples. Some are drawn about 0, some about 0 with a larger spread
        (for regions far from all centres), and the others about the centres."""
        origin = np.zeros(dimensions)
        if not len(centres):
            return cls(origin[None], np.ones(1), np.array([samples]))
        wide, each = int(samples * _WIDE), int(samples * (1 - _PLAIN - _WIDE)) // len(centres)
        counts = [samples - wide - each * len(centres), wide, *[each] * len(centres)]
        deviations = np.ones(len(counts))
        deviations[1] = SEARCH_SPREAD
        return cls(np.vstack((origin, origin, *centres)), deviations, np.array(counts))

    def samples(self, rng: np.random.Generator) -> Array:
        """Samples (P, r), ordered by the centre from which they are drawn."""
        centres = np.repeat(self.centres, self.counts, axis=0)
        deviations = np.repeat(self.deviations, self.counts)
        return centres + deviations[:, None] * rng.standard_normal(centres.shape)

    def weights(self, z: Array) -> Array:
        """Importance weights (P,) of samples z (P, r): ratio of the standard normal density to the density of
        the mixture."""
        density = np.zeros(len(z))
        for centre, deviation, count in zip(*self, strict=True):
            distances = (((z - centre) / deviation) ** 2).sum(axis=1)
            density += count * np.exp(((z**2).sum(axis=1) - distances) / 2) / deviation ** z.shape[1]
        return self.counts.sum() / density

    def probability(self, weights: Array, events: Array, undetermined: Array, failed: Array) -> Probability:
        """Probability of an event that occurs at the samples `events` (P,), with Wilson's interval.
        Undetermined and failed samples count as events for the upper end of the interval, but not for the
        lower end."""
        is_possible = events | undetermined | failed
        value, low, _ = self._interval(weights, events)
        _, _, high = self._interval(weights, is_possible)
        possible = weights * is_possible
        if possible.sum() ** 2 < _FEW * (possible**2).sum():
            high = max(high, self._interval(weights, np.zeros_like(events))[2])
        counts = (int(np.count_nonzero(each)) for each in (events, undetermined, failed))
        return Probability(value, low, high, *counts)

    def _interval(self, weights: Array, events: Array) -> tuple[float, float, float]:
        """Probability of events (P,) and the ends of its interval (E. B. Wilson, J. Am. Stat. Assoc. 22
        (1927) 209-212). The interval is computed for the number of equally weighted samples that has the same
        variance. For a frequent event, the probability of the opposite event is computed and subtracted from
        1. This reduces the variance, because the mean of the weights differs from 1."""
        weighted = weights * events
        opposite = weights - weighted
        if opposite.sum() < weighted.sum():
            value, low, high = self._ends(opposite)
            return 1 - value, 1 - high, 1 - low
        return self._ends(weighted)

    def _ends(self, weighted: Array) -> tuple[float, float, float]:
        """Mean of weighted events (P,), and the ends of its interval."""
        value = min(float(weighted.mean()), 1.0)
        by_centre = np.split(weighted, np.cumsum(self.counts)[:-1])
        variance = sum(len(each) * float(each.var()) for each in by_centre) / len(weighted) ** 2
        count = value * (1 - value) / variance if variance > 0 and value < 1 else float(self.counts[0])
        middle, square = value + QUANTILE**2 / (2 * count), QUANTILE**2 / count
        half = QUANTILE * math.sqrt(value * (1 - value) / count + square / (4 * count))
        ends = (middle - half) / (1 + square), (middle + half) / (1 + square)
        # At 0 the lower end is exact apart from round-off.
        return value, max(0.0, ends[0]) if value else 0.0, min(1.0, ends[1])


def normal_variables(cube: Array) -> Array:
    """Return standard normal variables that correspond to points of the unit cube. Points on its faces, as in
    quasi-random sequences, are permitted."""
    from scipy.special import ndtri

    return ndtri(np.clip(cube, 1e-12, 1 - 1e-12))


def centres_of(gradient: Gradient, found: Array) -> list[Array]:
    """Return at most `MAX_CENTRES` points of an event that are nearest to z = 0: the point that the search
    reaches from z = 0, and one point for each separate group of samples. `found` (k, r) are the samples at
    which the event occurs."""
    starts, centres = [np.zeros(found.shape[1])], []
    with suppress(SolveError):
        if gradient(starts[0])[0] > 0:
            # An event that occurs at 0 is frequent and needs no further centre.
            return []
    left = found[np.argsort((found**2).sum(axis=1))]
    while starts and len(centres) < MAX_CENTRES:
        centre = _nearest(gradient, start := starts.pop())
        if centre is None and start.any():
            centre = start
        if centre is not None:
            centres.append(centre)
            size = float(np.linalg.norm(centre))
            left = left[left @ centre < size * (size - _COVERED)]
        # The next search starts from an event that no centre covers.
        starts, left = list(left[:1]), left[1:]
    return centres


def _nearest(gradient: Gradient, z: Array) -> Array | None:
    """Return the point nearest to z = 0 at which an event occurs; None if the iteration does not converge.
    The iteration starts from `z`; it is that of A. M. Hasofer and N. C. Lind (J. Eng. Mech. Div. ASCE 100
    (1974) 111-121) and R. Rackwitz and B. Fiessler (Comput. Struct. 9 (1978) 489-494)."""
    for _ in range(_STEPS):
        try:
            margin, slopes = gradient(z)
        except SolveError:
            break
        size = float(np.linalg.norm(slopes))
        if not 0 < size < math.inf:
            break
        moved = slopes * float(slopes @ z - margin) / size**2
        if not np.linalg.norm(moved) < MAX_DISTANCE:
            break
        change, z = np.linalg.norm(moved - z), moved
        if change < _STEP_END:
            return z
    return None
