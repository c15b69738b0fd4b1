"""Derivatives of figures of coordinates and outputs: extrema, means, root mean squares, harmonics.

An extremum changes as the quantity does at its phase, which may be held: the derivative by the phase is zero
there (envelope theorem). In a corner of an output, at a jump of the matrices, it goes with the jump.
"""

from collections.abc import Callable, Sequence
from functools import cache, cached_property, partial
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.derivatives.sums import OrbitOnGrid, Sums
from solve.errors import NoDerivativeError
from solve.period.curve import without_drift
from solve.period.named import HARMONIC, PHASE, Named
from solve.period.quantities import enough_samples

_SAME, _ALIKE = 1e-9, 1e-6
"""Relative difference of two extrema up to which either may be the largest; and difference of their
derivatives, relative to the derivative over the period, up to which it does not matter which of them is."""

_OTHERS = np.array([0.118, 0.382, 0.618, 0.882])
"""Further phases, in periods after an extremum, at which the size of the derivative over the period is
sampled: at fractions by the golden section, no common multiples of low harmonics."""

_PROMISING = 1e-3
"""Part of the range of a quantity by which other maxima of samples may be lower and be the largest."""

_NEWTON, _MOST = 3, 64
"""Steps by which an extremum's phase is brought to where the derivative is zero; most extrema looked at."""

_NEAR = 0.03
"""Part of the distance of two samples by which values about an extremum are apart."""

_FIRST, _SECOND = np.array([1, -8, 0, 8, -1]) / 12, np.array([-1, 16, -30, 16, -1]) / 12
"""Weights of five values whose sums are their first and second derivative, by their distance."""

_ASIDE = np.array([[3, -3, 1], [-5 / 2, 4, -3 / 2]])
"""Weights of the values at one, two and three distances from a place whose sums are value and
derivative there, by the distance."""

_BEHIND = 2e-12
"""Part of the period behind or before a jump of the matrices at which its sides are taken."""

_WAYS = {"max": (1.0,), "min": (-1.0,), "max_abs": (1.0, -1.0)}
"""Signs of the values of which the largest is looked for."""

Starts = dict[tuple[str, str], tuple[Array, Array]]


class _Even(NamedTuple):
    """Phases (k,) at the same fractions of every step, and their weights (k,) in a mean over the period."""

    phases: Array
    weights: Array
    fractions: Array


class Figures:
    """Figures of an orbit as sums. starts: phases near which its extrema are, and their signs, by name and
    figure, known from another grid, or filled in. nodes (m, r): how far the starts of steps move with the
    quantities by which figures are differentiated."""

    def __init__(self, orbit: OrbitOnGrid, starts: Starts, nodes: Array):
        self.orbit, self._starts, self._nodes = orbit, starts, nodes
        self._settled: dict[tuple[str, str], tuple[Array, Array, Array]] = {}

    @cached_property
    def _even(self) -> _Even:
        return self._quadrature(self.orbit.samples)

    @cached_property
    def _sampled(self) -> Callable[[str], Array]:
        return cache(partial(self._of_even, self._even))

    def sums(self, asked: Named) -> Sums:
        """Of a figure. Raises NoDerivativeError."""
        name, figure = asked.subject, asked.figure
        self.settle([asked])
        if not ((name, figure) in self._settled if figure in _WAYS else self._finite(name)):
            raise NoDerivativeError(f"{name} is no finite number at some phases: it has no derivatives")
        if figure in _WAYS:
            return self._of_extremum(asked)
        if figure.endswith("_phase"):
            raise NoDerivativeError(f"{asked.text}: derivatives of phases of extrema are not calculated")
        if figure in (HARMONIC, PHASE):
            value, sums = self.harmonic(name, asked.number)
            return sums._replace(weights=_of_harmonic(asked, value, sums.weights)[:, None], made=_first)
        phases, weights, fractions = self._even
        if figure == "rms":
            values = self._sampled(name)
            weights = _over(values * weights, float(np.sqrt(values**2 @ weights)), asked)
        return Sums(name, phases, weights[:, None], _first, fractions)

    def harmonic(self, name: str, number: int) -> tuple[complex, Sums]:
        """Complex amplitude A exp(iψ) of an order of a coordinate or output, the mean for order 0."""
        period, count = self.orbit.system.period, enough_samples(self.orbit.samples, number)
        known = count == self.orbit.samples
        even = self._even if known else self._quadrature(count)
        values = self._sampled(name) if known else self._of_even(even, name)
        phases, weights, fractions = even
        wave = np.exp(-2j * np.pi / period * number * phases) * ((2 if number else 1) * weights)
        both = np.stack((np.real(wave), np.imag(wave)), axis=1)
        return complex(wave @ values), Sums(name, phases, both, _complex, fractions)

    def _of_even(self, even: _Even, name: str) -> Array:
        """Values (k,) of a coordinate or output."""
        if name not in self.orbit.system.coordinates:
            return self.orbit.signal(name)(even.phases)
        row = self.orbit.system.coordinates.index(name)
        coefficients = self.orbit.turn.curve.coefficients[row]
        return (coefficients @ even.fractions ** np.arange(coefficients.shape[-1])[:, None]).ravel()

    def _quadrature(self, count: int) -> _Even:
        """For means over the period from so many samples or more: evenly, which is exact but for orders
        beyond them, or by Gauss's rule within each step, where jumps leave kinks between."""
        period, nodes = self.orbit.system.period, self.orbit.turn.grid.nodes
        a_step = -(-count // (len(nodes) - 1))
        if self.orbit.system.breaks:
            places, weights = np.polynomial.legendre.leggauss(a_step)
            fractions, weights = (places + 1) / 2, weights / 2
        else:
            fractions, weights = np.arange(a_step) / a_step, np.full(a_step, 1 / a_step)
        width = np.diff(nodes)[:, None]
        return _Even(
            (nodes[:-1, None] + width * fractions).ravel(), (width * weights / period).ravel(), fractions
        )

    def _finite(self, name: str) -> bool:
        return bool(np.isfinite(self._sampled(name)).all())

    def settle(self, asked: Sequence[Named]) -> None:
        """Find the extrema that are asked for, all together."""
        wanted = dict.fromkeys((each.subject, each.figure) for each in asked if each.figure in _WAYS)
        new = [pair for pair in wanted if pair not in self._settled]
        pairs = [pair for pair in new if pair in self._starts or self._finite(pair[0])]
        if not pairs:
            return
        known = [self._starts.get(pair) or self._promising(*pair) for pair in pairs]
        counts = [len(phases) for phases, _ in known]
        names = np.repeat([name for name, _ in pairs], counts)
        phases, signs = (np.concatenate(part) for part in zip(*known, strict=True))
        width, curve = self.orbit.system.period / self.orbit.samples, without_drift(self.orbit.turn.curve)
        coordinates = list(self.orbit.system.coordinates)
        own = np.flatnonzero(np.isin(names, coordinates))
        rows = [coordinates.index(name) for name in names[own]]
        for _ in range(1 if pairs[0] in self._starts else _NEWTON):
            around = self._each(names, phases[:, None] + _NEAR * width * np.arange(-2, 3))
            first, second = around @ _FIRST, around @ _SECOND
            for order, part in ((1, first), (2, second)):
                part[own] = (_NEAR * width) ** order * curve(phases[own], order)[rows, np.arange(len(rows))]
            with np.errstate(divide="ignore", invalid="ignore"):
                moved = -_NEAR * first / second
            phases = phases + np.where(np.abs(moved) < 1, moved, 0.0) * width
        phases = self._in_corners(names, phases, signs)
        values = signs * self._each(names, phases[:, None])[:, 0]
        parts = (np.split(part, np.cumsum(counts)[:-1]) for part in (phases, signs, values))
        for pair, found in zip(pairs, zip(*parts, strict=True), strict=True):
            self._settled[pair] = found
            self._starts.setdefault(pair, found[:2])

    def _in_corners(self, names: Array, phases: Array, signs: Array) -> Array:
        """Phases (k,) of extrema, those of outputs with a corner or their largest limit at a jump of the
        matrices brought to it."""
        at, apart = self._nearest_break(phases)
        width = self.orbit.system.period / self.orbit.samples
        near = np.flatnonzero((np.abs(apart) < width) & ~np.isin(names, self.orbit.system.coordinates))
        if not len(near):
            return phases
        corner = self.orbit.turn.grid.nodes[at[near]]
        (before, rise), (after, fall) = (
            signs[near] * self._beside(names[near], corner, side) for side in (-1, 1)
        )
        jump = after - before
        whole = np.abs(jump) <= _ALIKE * np.maximum(np.abs(before), np.abs(after))
        ahead, behind = (rise > 0) & (whole | (jump < 0)), (fall < 0) & (whole | (jump > 0))
        side = np.where(whole, ahead & behind, behind.astype(int) - ahead)
        found = phases.copy()
        found[near] = np.where(side == 0, phases[near], corner + side * _BEHIND * self.orbit.system.period)
        return found

    def _nearest_break(self, phases: Array) -> tuple[Array, Array]:
        """The steps that begin at the jumps of the matrices nearest to phases (k,), and how far these are
        behind the jumps, infinite without any."""
        grid, period = self.orbit.turn.grid, self.orbit.system.period
        steps = np.flatnonzero(grid.at_break)
        if not len(steps):
            return np.zeros(len(phases), dtype=int), np.full(len(phases), np.inf)
        apart = (phases[:, None] - grid.nodes[steps] + period / 2) % period - period / 2
        nearest = np.abs(apart).argmin(axis=1)
        return steps[nearest], apart[np.arange(len(phases)), nearest]

    def _beside(self, names: Array, phases: Array, side: int) -> Array:
        """Values and derivatives by the phase (2, k) of quantities (k,) before (-1) or behind (1) phases."""
        distance = side * _NEAR * self.orbit.system.period / self.orbit.samples
        values = self._each(names, phases[:, None] + distance * np.arange(1, 4))
        return _ASIDE @ values.T / np.array([[1.0], [distance]])

    def _carried(self, name: str, phases: Array) -> Array:
        """How much an output changes at phases (k,) as these go with the jumps just before them, (r, k)."""
        at, apart = self._nearest_break(phases)
        moved = (apart > 0) & (apart < 2 * _BEHIND * self.orbit.system.period)
        if name in self.orbit.system.coordinates or not self._nodes[at][moved].any():
            return np.zeros((self._nodes.shape[1], len(phases)))
        slope = self._beside(np.full(len(phases), name), self.orbit.turn.grid.nodes[at], 1)[1]
        return self._nodes[at].T * (moved * slope)

    def _each(self, names: Array, phases: Array) -> Array:
        """Values (k, j) of quantities (k,) at phases (k, j) of each."""
        made, coordinates = np.empty(phases.shape), self.orbit.system.coordinates
        every = self.orbit.turn.curve(phases.ravel()).reshape(-1, *phases.shape)
        for name in dict.fromkeys(names.tolist()):
            at = names == name
            if name in coordinates:
                made[at] = every[coordinates.index(name), at]
            else:
                made[at] = self.orbit.signal(name)(phases[at].ravel()).reshape(-1, phases.shape[1])
        return made

    def _promising(self, name: str, figure: str) -> tuple[Array, Array]:
        """Phases (k,) of samples about which the extremum may be, and signs (k,) of the values there."""
        values, ways = self._sampled(name), _WAYS[figure]
        tops = [_tops(way * values) for way in ways]
        return self._even.phases[np.concatenate(tops)], np.repeat(ways, [len(each) for each in tops])

    def _of_extremum(self, asked: Named) -> Sums:
        """Of an extremum, whose derivatives are NaN where equally large extrema change differently. Its
        phase is where the derivative by it is zero: of values that hardly differ, the largest tells its phase
        to half of their digits only."""
        name, figure = asked.subject, asked.figure
        phases, signs, values = self._settled[name, figure]
        largest = values >= values.max() - _SAME * np.abs(values).max()
        phases, signs = phases[largest], signs[largest]
        sign, carried = -1.0 if figure == "min" else 1.0, signs * self._carried(name, phases)

        # At a maximum of a harmonic the derivative of the quadrature part is zero.
        others = phases[0] + _OTHERS * self.orbit.system.period if len(phases) > 1 else phases[:0]
        weights = np.append(signs, np.ones(len(others)))

        def made(held: Array) -> Array:
            every = held[:, : len(signs)] + carried
            alike = np.ptp(every, axis=1) <= _ALIKE * np.abs(held).max(axis=1)
            return np.where(alike, sign * every[:, 0], np.nan)

        return Sums(name, np.append(phases, others), np.diag(weights), made)


def _tops(values: Array) -> Array:
    """Places (k,) of maxima that may be the largest between samples."""
    level = values.max() - _PROMISING * np.ptp(values)
    tops = (values >= level) & (values >= np.roll(values, 1)) & (values > np.roll(values, -1))
    return np.flatnonzero(tops if tops.any() else values == values.max())[:_MOST]


def _complex(slopes: Array) -> Array:
    return slopes @ np.array([1, 1j])


def _first(slopes: Array) -> Array:
    return slopes[:, 0]


def _of_harmonic(asked: Named, value: complex, weights: Array) -> Array:
    """Weights (k,) in the derivative of amplitude or phase angle of an order, of those (k, 2) of real and
    imaginary part of its complex amplitude `value`. Raises NoDerivativeError."""
    if asked.number == 0:
        return weights[:, 0] * (asked.figure == HARMONIC)
    along = _over(np.array([value.real, value.imag]), abs(value), asked)
    if asked.figure == HARMONIC:
        return weights @ along
    return weights @ np.array([-along[1], along[0]]) / abs(value)


def _over(slopes: Array, size: float, asked: Named) -> Array:
    if size == 0:
        raise NoDerivativeError(f"{asked.text} is 0, where a modulus has a kink; ask for other quantities")
    return slopes / size
