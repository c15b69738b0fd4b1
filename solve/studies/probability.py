"""Probabilities of events of standard normal variables z, with confidence intervals.

Rare events are sampled about the points of the events nearest to z = 0, which the gradient finds. Samples
about all centres are weighted with the density of the mixture (E. Veach, L. J. Guibas, SIGGRAPH 1995,
419-428), so that no weight exceeds the inverse of the fraction of samples about 0.
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
"""Type of functions that return the margin of an event at z (r,), positive where the event occurs, and its
derivatives (r,)."""

QUANTILE = 1.959963984540054
"""Quantile of the normal distribution for intervals of 95 %."""

SEARCH_SPREAD = 2.5
"""Standard deviation of the samples that search for events. Chosen by judgement: an event at a distance of
4.3, with probability 1e-5, is then found by one sample in 23."""

_PLAIN, _WIDE = 0.3, 0.2
"""Fractions of the samples of a mixture that are drawn about 0 with unit and with wide spread. Chosen by
judgement: with them, intervals for events that surround 0 in three dimensions contain the true value as often
as other intervals."""

_STEPS, _STEP_END = 12, 0.02
"""Largest number of Newton steps to the nearest point of an event, and change of z below which they end.
Chosen by judgement."""

MAX_DISTANCE = 8.0
"""Largest distance from the mean, in standard deviations, at which events are sought and gradients are
calculated. Chosen by judgement: larger values of one variable have the probability 1e-15."""

MAX_CENTRES = 8
"""Largest number of centres of a mixture, of which the nearest to 0 are kept. Chosen by judgement."""

_COVERED = 1.0
"""Distance from the tangent plane through a centre, on the side of 0, up to which events belong to this
centre. Chosen by judgement."""


class Mixture(NamedTuple):
    """Mixture of normal densities with standard deviations (k,) about centres (k, r), of which the first is
    0; counts (k,): numbers of samples."""

    centres: Array
    deviations: Array
    counts: Array

    @classmethod
    def about(cls, centres: Sequence[Array], dimensions: int, samples: int) -> "Mixture":
        """Mixture with given numbers of samples about 0, about 0 with wide spread (for regions far from all
        centres), and about the centres."""
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
        """Importance weights (P,): ratio of the standard normal density to that of the mixture."""
        density = np.zeros(len(z))
        for centre, deviation, count in zip(*self, strict=True):
            distances = (((z - centre) / deviation) ** 2).sum(axis=1)
            density += count * np.exp(((z**2).sum(axis=1) - distances) / 2) / deviation ** z.shape[1]
        return self.counts.sum() / density

    def probability(self, weights: Array, events: Array, undetermined: Array, failed: Array) -> Probability:
        """Probability of an event (P,) with Wilson's interval. Undetermined and failed samples are included
        in the upper end of the interval, but not in the lower end."""
        value, low, _ = self._interval(weights * events)
        _, _, high = self._interval(weights * (events | undetermined | failed))
        counts = (int(np.count_nonzero(each)) for each in (events, undetermined, failed))
        return Probability(value, low, high, *counts)

    def _interval(self, weighted: Array) -> tuple[float, float, float]:
        """Mean of weighted events (P,) and its interval (E. B. Wilson, J. Am. Stat. Assoc. 22 (1927)
        209-212), for the number of equally weighted samples with the same variance."""
        total = len(weighted)
        value = min(float(weighted.mean()), 1.0)
        by_centre = np.split(weighted, np.cumsum(self.counts)[:-1])
        variance = sum(len(each) * float(each.var()) for each in by_centre) / total**2
        count = value * (1 - value) / variance if variance > 0 else float(self.counts[0])
        middle, square = value + QUANTILE**2 / (2 * count), QUANTILE**2 / count
        half = QUANTILE * math.sqrt(value * (1 - value) / count + square / (4 * count))
        ends = (middle - half) / (1 + square), (middle + half) / (1 + square)
        return value, max(0.0, ends[0]) if value else 0.0, min(1.0, ends[1])


def normal_variables(cube: Array) -> Array:
    """Standard normal variables from points of the unit cube. Quasi-random points may lie on its faces."""
    from scipy.special import ndtri

    return ndtri(np.clip(cube, 1e-12, 1 - 1e-12))


def centres_of(gradient: Gradient, found: Array) -> list[Array]:
    """Points of an event nearest to z = 0, at most `MAX_CENTRES`: the one reached from 0, and one for each
    separate group of the events `found` (k, r)."""
    starts, centres = [np.zeros(found.shape[1])], []
    with suppress(SolveError):
        if gradient(starts[0])[0] > 0:
            # An event that includes 0 is frequent and needs no further centre.
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
    """Point of an event nearest to z = 0, by the iteration of A. M. Hasofer and N. C. Lind (J. Eng. Mech.
    Div. ASCE 100 (1974) 111-121) and R. Rackwitz and B. Fiessler (Comput. Struct. 9 (1978) 489-494). None
    if it does not converge."""
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
