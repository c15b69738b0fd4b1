"""Derivatives of statistics of coordinates and outputs: extrema, means, root mean squares, harmonics.

The derivative of an extremum equals the derivative of the quantity at fixed phase, because the derivative
with respect to the phase is zero at the extremum (envelope theorem). An extremum at a corner of an output,
which is due to a jump of the matrices, moves with the jump."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, cached_property, partial
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.derivatives.orbit_sums import GridOrbit, WeightedSums
from solve.errors import NoDerivativeError
from solve.period.named import HARMONIC, PHASE, Named
from solve.period.signals import enough_samples

EQUAL, _SAME_DERIVATIVE = 1e-9, 1e-6
"""Relative difference up to which two extrema count as equally large; and difference up to which their
derivatives count as equal, relative to the largest derivative over the period. Chosen by judgement."""

_OTHERS = np.array([0.118, 0.382, 0.618, 0.882])
"""Further phases at which the size of the derivative is sampled, as fractions of a period after an extremum.
They are related to the golden section, and thus avoid zeros of low harmonics."""

_CANDIDATE_RANGE = 1e-3
"""Distance below the largest sample, relative to the range of the quantity, within which other local maxima
of the samples may be near the global maximum. Chosen by judgement."""

_NEWTON_STEPS, _MAX_EXTREMA = 3, 64
"""Number of Newton steps that refine the phase of an extremum, and largest number of candidates for extrema.
Chosen by judgement."""

_SPACING = 0.03
"""Spacing of the phases near an extremum at which values are computed, relative to the spacing of the
samples. Chosen by judgement: both truncation and round-off of the second difference are small."""

DIFFERENCE_STEP = 1e-4
"""Relative step of finite differences of results. It is near the fourth root of `EPS`, which balances the
errors of second differences. The truncation error of a central first difference is of the order of 1e-8."""

FIRST_DIFFERENCE, SECOND_DIFFERENCE = np.array([1, -8, 0, 8, -1]) / 12, np.array([-1, 16, -30, 16, -1]) / 12
"""Weights of five values in the fourth-order differences for the first and the second derivative."""

_EXTRAPOLATION = np.array([[3, -3, 1], [-5 / 2, 4, -3 / 2]])
"""Weights for quadratic extrapolation of a value and a derivative to a point, from the values at distances of
one, two and three spacings."""

_SIDE = 2e-12
"""Distance from a jump of the matrices, relative to the period, at which quantities on its two sides are
evaluated. Chosen by judgement: far above the round-off of the phase."""

_SIGNS = {"max": (1.0,), "min": (-1.0,), "max_abs": (1.0, -1.0)}
"""Mapping from statistics to the signs by which the quantity is multiplied, so that the extremum is a
maximum."""

Starts = dict[tuple[str, str], tuple[Array, Array]]


class _Quadrature(NamedTuple):
    """Quadrature for means over the period: phases (k,) and their weights (k,). The phases are at the same
    `fractions` of every step."""

    phases: Array
    weights: Array
    fractions: Array


class Figures:
    """Statistics of an orbit, expressed as weighted sums.

    starts: mapping from names and statistics to approximate phases of extrema and their signs, from this or
    another grid. nodes (m, r): derivatives of the starts of steps with respect to the quantities θ."""

    def __init__(self, orbit: GridOrbit, starts: Starts, nodes: Array):
        self.orbit, self._starts, self._nodes = orbit, starts, nodes
        self._extrema: dict[tuple[str, str], tuple[Array, Array, Array]] = {}

    @cached_property
    def _even(self) -> _Quadrature:
        return self._quadrature(self.orbit.samples)

    @cached_property
    def _largest_spacing(self) -> float:
        """Largest distance between neighbouring samples. It exceeds the mean distance in long steps, and
        between the points of Gauss's rule."""
        return float(np.diff(self._even.phases).max())

    @cached_property
    def _sampled(self) -> Callable[[str], Array]:
        return cache(partial(self._of_even, self._even))

    def sums(self, quantity: Named) -> WeightedSums:
        """Weighted sums from which a statistic follows. Raises NoDerivativeError."""
        name, figure = quantity.subject, quantity.figure
        self.find_extrema([quantity])
        if not ((name, figure) in self._extrema if figure in _SIGNS else self._finite(name)):
            raise NoDerivativeError(f"{name} is not finite at some phases, so it has no derivatives")
        if figure in _SIGNS:
            return self._of_extremum(quantity)
        if figure.endswith("_phase"):
            raise NoDerivativeError(f"{quantity.text}: derivatives of phases of extrema are not calculated")
        if figure in (HARMONIC, PHASE):
            value, sums = self.harmonic(name, quantity.number)
            return sums._replace(weights=_of_harmonic(quantity, value, sums.weights)[:, None], combine=_first)
        phases, weights, fractions = self._even
        if figure == "rms":
            values = self._sampled(name)
            weights = _over(values * weights, float(np.sqrt(values**2 @ weights)), quantity)
        return WeightedSums(name, phases, weights[:, None], _first, fractions)

    def harmonic(self, name: str, number: int) -> tuple[complex, WeightedSums]:
        """Return the complex amplitude A exp(iψ) of a harmonic of a coordinate or output, and its weighted
        sums. For number 0, the amplitude is the mean."""
        period, count = self.orbit.system.period, enough_samples(self.orbit.samples, number)
        is_sampled = count == self.orbit.samples
        even = self._even if is_sampled else self._quadrature(count)
        values = self._sampled(name) if is_sampled else self._of_even(even, name)
        phases, weights, fractions = even
        wave = np.exp(-2j * np.pi / period * number * phases) * ((2 if number else 1) * weights)
        both = np.stack((np.real(wave), np.imag(wave)), axis=1)
        return complex(wave @ values), WeightedSums(name, phases, both, _complex, fractions)

    def _of_even(self, even: _Quadrature, name: str) -> Array:
        """Values (k,) of a coordinate or output at the k phases of a quadrature."""
        if name not in self.orbit.system.coordinates:
            return self.orbit.signal(name)(even.phases)
        row = self.orbit.system.coordinates.index(name)
        coefficients = self.orbit.problem.curve.coefficients[row]
        return (coefficients @ even.fractions ** np.arange(coefficients.shape[-1])[:, None]).ravel()

    def _quadrature(self, count: int) -> _Quadrature:
        """Quadrature for means over the period with at least `count` samples.

        The samples are evenly spaced, so that means are exact up to the Nyquist harmonic. If jumps cause
        kinks, Gauss's rule is used within each step instead."""
        period, nodes = self.orbit.system.period, self.orbit.problem.grid.nodes
        a_step = -(-count // (len(nodes) - 1))
        if self.orbit.system.breaks:
            in_step, weights = np.polynomial.legendre.leggauss(a_step)
            fractions, weights = (in_step + 1) / 2, weights / 2
        else:
            fractions, weights = np.arange(a_step) / a_step, np.full(a_step, 1 / a_step)
        width = np.diff(nodes)[:, None]
        return _Quadrature(
            (nodes[:-1, None] + width * fractions).ravel(), (width * weights / period).ravel(), fractions
        )

    def _finite(self, name: str) -> bool:
        return bool(np.isfinite(self._sampled(name)).all())

    def find_extrema(self, quantities: Sequence[Named]) -> None:
        """Find all extrema among the statistics in one computation."""
        wanted = dict.fromkeys(
            (quantity.subject, quantity.figure) for quantity in quantities if quantity.figure in _SIGNS
        )
        new = [pair for pair in wanted if pair not in self._extrema]
        pairs = [pair for pair in new if pair in self._starts or self._finite(pair[0])]
        if not pairs:
            return
        known = [self._starts.get(pair) or self._candidates(*pair) for pair in pairs]
        counts = [len(phases) for phases, _ in known]
        names = np.repeat([name for name, _ in pairs], counts)
        phases, signs = (np.concatenate(part) for part in zip(*known, strict=True))
        width = self.orbit.system.period / self.orbit.samples
        curve = replace(self.orbit.problem.curve, drift=None)
        coordinates = list(self.orbit.system.coordinates)
        is_coordinate = np.flatnonzero(np.isin(names, coordinates))
        rows = [coordinates.index(name) for name in names[is_coordinate]]
        for _ in range(1 if pairs[0] in self._starts else _NEWTON_STEPS):
            around = self._values_at(names, phases[:, None] + _SPACING * width * np.arange(-2, 3))
            first, second = around @ FIRST_DIFFERENCE, around @ SECOND_DIFFERENCE
            for order, part in ((1, first), (2, second)):
                part[is_coordinate] = (_SPACING * width) ** order * curve(phases[is_coordinate], order)[
                    rows, np.arange(len(rows))
                ]
            with np.errstate(divide="ignore", invalid="ignore"):
                moved = -_SPACING * width * first / second
            phases = phases + np.where(np.abs(moved) < self._largest_spacing, moved, 0.0)
        phases = self._in_corners(names, phases, signs)
        values = signs * self._values_at(names, phases[:, None])[:, 0]
        parts = (np.split(part, np.cumsum(counts)[:-1]) for part in (phases, signs, values))
        for pair, found in zip(pairs, zip(*parts, strict=True), strict=True):
            self._extrema[pair] = found
            self._starts.setdefault(pair, found[:2])

    def _in_corners(self, names: Array, phases: Array, signs: Array) -> Array:
        """Phases (k,) of extrema, moved to the jumps of the matrices if necessary.

        A phase near a jump is moved to one side of the jump if the output has a corner or a one-sided
        extremum there."""
        breaks, distance = self._nearest_break(phases)
        width = self.orbit.system.period / self.orbit.samples
        near = np.flatnonzero((np.abs(distance) < width) & ~np.isin(names, self.orbit.system.coordinates))
        if not len(near):
            return phases
        corner = self.orbit.problem.grid.nodes[breaks[near]]
        (before, rise), (after, fall) = (
            signs[near] * self._beside(names[near], corner, side) for side in (-1, 1)
        )
        jump = after - before
        whole = np.abs(jump) <= _SAME_DERIVATIVE * np.maximum(np.abs(before), np.abs(after))
        ahead, behind = (rise > 0) & (whole | (jump < 0)), (fall < 0) & (whole | (jump > 0))
        side = np.where(whole, ahead & behind, behind.astype(int) - ahead)
        found = phases.copy()
        found[near] = np.where(side == 0, phases[near], corner + side * _SIDE * self.orbit.system.period)
        return found

    def _nearest_break(self, phases: Array) -> tuple[Array, Array]:
        """For each phase (k,), return the step that starts at the nearest jump, and the phase minus that of
        the jump. The differences are infinite if there are no jumps."""
        grid, period = self.orbit.problem.grid, self.orbit.system.period
        steps = np.flatnonzero(grid.at_break)
        if not len(steps):
            return np.zeros(len(phases), dtype=int), np.full(len(phases), np.inf)
        distance = (phases[:, None] - grid.nodes[steps] + period / 2) % period - period / 2
        nearest = np.abs(distance).argmin(axis=1)
        return steps[nearest], distance[np.arange(len(phases)), nearest]

    def _beside(self, names: Array, phases: Array, side: int) -> Array:
        """Values of k quantities and their derivatives with respect to the phase, as an array (2, k). They
        are one-sided limits at the phases: from the left (side -1) or from the right (side 1)."""
        distance = side * _SPACING * self.orbit.system.period / self.orbit.samples
        values = self._values_at(names, phases[:, None] + distance * np.arange(1, 4))
        return _EXTRAPOLATION @ values.T / np.array([[1.0], [distance]])

    def _carried(self, name: str, phases: Array) -> Array:
        """Derivatives (r, k) of an output with respect to θ at k phases, due to the shift of the jump just
        before each phase."""
        breaks, distance = self._nearest_break(phases)
        moved = (distance > 0) & (distance < 2 * _SIDE * self.orbit.system.period)
        if name in self.orbit.system.coordinates or not self._nodes[breaks][moved].any():
            return np.zeros((self._nodes.shape[1], len(phases)))
        slope = self._beside(np.full(len(phases), name), self.orbit.problem.grid.nodes[breaks], 1)[1]
        return self._nodes[breaks].T * (moved * slope)

    def _values_at(self, names: Array, phases: Array) -> Array:
        """Values (k, j) of k quantities, each at its own j phases. `phases` is (k, j)."""
        values, coordinates = np.empty(phases.shape), self.orbit.system.coordinates
        coordinate_values = self.orbit.problem.curve(phases.ravel()).reshape(-1, *phases.shape)
        for name in dict.fromkeys(names.tolist()):
            rows = names == name
            if name in coordinates:
                values[rows] = coordinate_values[coordinates.index(name), rows]
            else:
                values[rows] = self.orbit.signal(name)(phases[rows].ravel()).reshape(-1, phases.shape[1])
        return values

    def _candidates(self, name: str, figure: str) -> tuple[Array, Array]:
        """Return phases (k,) of samples near which the extremum may lie, and signs (k,) by which the values
        are multiplied there."""
        values, signs = self._sampled(name), _SIGNS[figure]
        maxima = [_candidate_maxima(sign * values) for sign in signs]
        counts = [len(positions) for positions in maxima]
        return self._even.phases[np.concatenate(maxima)], np.repeat(signs, counts)

    def _of_extremum(self, quantity: Named) -> WeightedSums:
        """Weighted sums for an extremum. The derivatives are NaN if equally large extrema have different
        derivatives.

        The phase of the extremum is computed as a zero of the slope. A search for the largest value would
        determine only half of the digits of the phase."""
        name, figure = quantity.subject, quantity.figure
        phases, signs, values = self._extrema[name, figure]
        largest = values >= values.max() - EQUAL * np.abs(values).max()
        phases, signs = phases[largest], signs[largest]
        sign, carried = -1.0 if figure == "min" else 1.0, signs * self._carried(name, phases)

        # The derivative may be zero at the extremum. Its size is therefore computed at other phases.
        others = phases[0] + _OTHERS * self.orbit.system.period if len(phases) > 1 else phases[:0]
        weights = np.append(signs, np.ones(len(others)))

        def combine(held: Array) -> Array:
            every = held[:, : len(signs)] + carried
            alike = np.ptp(every, axis=1) <= _SAME_DERIVATIVE * np.abs(held).max(axis=1)
            return np.where(alike, sign * every[:, 0], np.nan)

        return WeightedSums(name, np.append(phases, others), np.diag(weights), combine)


def _candidate_maxima(values: Array) -> Array:
    """Indices (k,) of local maxima of samples near which the global maximum may lie."""
    level = values.max() - _CANDIDATE_RANGE * np.ptp(values)
    tops = (values >= level) & (values >= np.roll(values, 1)) & (values > np.roll(values, -1))
    return np.flatnonzero(tops if tops.any() else values == values.max())[:_MAX_EXTREMA]


def _complex(slopes: Array) -> Array:
    return slopes @ np.array([1, 1j])


def _first(slopes: Array) -> Array:
    return slopes[:, 0]


def _of_harmonic(quantity: Named, value: complex, weights: Array) -> Array:
    """Weights (k,) for the derivative of the amplitude or the phase angle of a harmonic. Raises
    NoDerivativeError.

    value: complex amplitude. weights (k, 2): weights for the derivatives of its real and its imaginary part.
    """
    if quantity.number == 0:
        return weights[:, 0] * (quantity.figure == HARMONIC)
    along = _over(np.array([value.real, value.imag]), abs(value), quantity)
    if quantity.figure == HARMONIC:
        return weights @ along
    return weights @ np.array([-along[1], along[0]]) / abs(value)


def _over(slopes: Array, size: float, quantity: Named) -> Array:
    if size == 0:
        raise NoDerivativeError(
            f"{quantity.text} is 0, where its derivative does not exist; request other quantities"
        )
    return slopes / size
