"""Derivatives of figures of coordinates and outputs: extrema, means, root mean squares, harmonics.

An extremum changes as the quantity does at its phase, which may be held: the derivative by the phase is zero
there (envelope theorem).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.contracts import Dependence
from solve.derivatives.turn import Motions, TurnOnGrid
from solve.errors import NoDerivativeError
from solve.period.curve import Curve
from solve.period.named import HARMONIC, PHASE, Named
from solve.period.quantities import Signal, enough_samples
from solve.results.orbit import Turn
from solve.system import PeriodicSystem

_SAME, _ALIKE = 1e-9, 1e-6
"""Relative difference of two extrema up to which either may be the largest, and of their derivatives up to
which it does not matter which of them is."""

_PROMISING = 1e-3
"""Part of the range of a quantity by which other maxima of samples may be lower and be the largest."""

_NEWTON, _MOST = 3, 64
"""Steps by which an extremum's phase is brought to where the derivative is zero; most extrema looked at."""

_NEAR = 0.03
"""Part of the distance of two samples by which values about an extremum are apart."""

_FIRST, _SECOND = np.array([1, -8, 0, 8, -1]) / 12, np.array([-1, 16, -30, 16, -1]) / 12
"""Weights of five values whose sums are their first and second derivative, by their distance."""


_WAYS = {"max": (1.0,), "min": (-1.0,), "max_abs": (1.0, -1.0)}
"""Signs of the values of which the largest is looked for."""

Starts = dict[tuple[str, str], tuple[Array, Array]]


@dataclass(frozen=True)
class OrbitOnGrid(Turn):
    """The orbit of a system on a grid, with so many samples in the sums over the period: in proportion to the
    steps, so that grids differ by what samples leave too."""

    system: PeriodicSystem
    speed: float
    turn: TurnOnGrid
    count: int

    def at(self, phase: Array) -> Array:
        return self.turn.curve(phase)

    def signal(self, name: str) -> Signal:
        if name not in self.system.coordinates:
            return super().signal(name)
        row = self.system.coordinates.index(name)
        alone = self.turn.curve[row : row + 1]
        return lambda phase: alone(phase)[0]

    def state(self, phase: Array) -> tuple[Array, Array, Array]:
        q, v, a = (self.turn.curve(phase, order) for order in range(3))
        return q, self.speed * v, self.speed**2 * a

    def states(self, phase: Array) -> Array:
        """q″, q′, q (k, 3, n) by the phase."""
        return np.stack([self.turn.curve(phase, order).T for order in (2, 1, 0)], axis=1)

    @property
    def samples(self) -> int:
        return self.count

    @property
    def loaded(self) -> tuple[Array, float, Array]:
        """Phases at which loads act, the speed, and the states there, (k,) and (k, 3, n)."""
        turn = self.turn
        phases, states = turn.phases[:, turn.loaded], turn.orbit.states[:, turn.loaded]
        return phases.ravel(), self.speed, states.reshape(-1, 3, turn.point.n)


class Sums(NamedTuple):
    """A figure whose derivatives are made of those (r, c) of sums over weights (k, c) times the values of a
    coordinate or output at phases (k,)."""

    name: str
    phase: Array
    weights: Array
    made: Callable[[Array], Array]


@dataclass(frozen=True, eq=False)
class Forward:
    """From the derivatives of the whole orbit by r quantities θ: for many figures. nodes (m, r): how far the
    starts of steps move with θ; where q″ jumps by a, the derivative of q′ jumps by -a times as much."""

    orbit: OrbitOnGrid
    dependence: Dependence
    nodes: Array

    @property
    def count(self) -> int:
        return self.nodes.shape[1]

    @cached_property
    def moved(self) -> Motions:
        """Derivatives of the orbit."""
        turn = self.orbit.turn
        found, n = self.dependence.residual(*self.orbit.loaded), turn.point.n
        jumps = np.zeros((turn.grid.steps, 2 * n, self.count))
        for node in np.flatnonzero(self.nodes.any(axis=1)).tolist():
            jumps[node, n:] = -turn.jump(node)[:, None] * self.nodes[node]
        return turn.under(-found.reshape(*turn.d.shape, self.count), jumps)

    @cached_property
    def _curves(self) -> Curve:
        return self.orbit.turn.curves(self.moved)

    def signal(self, name: str, phase: Array) -> Array:
        """Derivatives of a coordinate or output (r, k) at phases (k,)."""
        system = self.orbit.system
        if name in system.coordinates:
            row = system.coordinates.index(name)
            return self._curves[:, row : row + 1](phase)[:, 0]
        moved = np.stack([self._curves(phase, order) for order in (2, 1, 0)]).transpose(3, 0, 2, 1)
        return self.dependence.output_along(name, phase, self.orbit.speed, self.orbit.states(phase), moved).T

    @cached_property
    def _data(self) -> Array:
        return self.orbit.turn.data(self.moved).reshape(-1, self.count)

    def of(self, figures: Sequence[Sums]) -> list[Array]:
        """Derivatives (r,) of figures."""
        return [each.made(self._of(each)) for each in figures]

    def _of(self, figure: Sums) -> Array:
        if figure.name in self.orbit.system.outputs and not self.dependence.parted:
            return self.signal(figure.name, figure.phase) @ figure.weights
        direct, of_data = _parted(self.orbit, self.dependence, figure)
        return direct + self._data.T @ of_data.reshape(len(self._data), -1)


@dataclass(frozen=True, eq=False)
class Adjoint:
    """From one adjoint problem, with a column a sum: for many parameters, none of which moves a jump."""

    orbit: OrbitOnGrid
    dependence: Dependence

    def of(self, figures: Sequence[Sums]) -> list[Array]:
        """Derivatives (r,) of figures."""
        direct, of_data = zip(*(_parted(self.orbit, self.dependence, each) for each in figures), strict=True)
        pulled = self.orbit.turn.pulled(np.concatenate(of_data, axis=-1))
        weights = pulled.reshape(-1, *pulled.shape[2:])
        found = self.dependence.residual_along(*self.orbit.loaded, weights)
        ends = np.cumsum([each.weights.shape[1] for each in figures])
        parts = zip(figures, direct, np.split(found, ends[:-1], axis=1), strict=True)
        return [each.made(held - along) for each, held, along in parts]


def _parted(orbit: OrbitOnGrid, dependence: Dependence, figure: Sums) -> tuple[Array, Array]:
    """The derivatives of the sums by θ (r, c) with the orbit held, or 0, and the weights (m, 2 + k, n, c) of
    the data of the orbit's curve."""
    name, phase, weights, _ = figure
    if name in orbit.system.coordinates:
        own = np.zeros((len(phase), 3, 1, weights.shape[1]))
        own[:, 2, 0] = weights
        found = orbit.turn.of_data(phase, own)
        of_data = np.zeros((*found.shape[:2], orbit.system.n, found.shape[-1]))
        of_data[:, :, orbit.system.coordinates.index(name)] = found[:, :, 0]
        return np.zeros(()), of_data
    by_parameters, by_states = dependence.output(name, phase, orbit.speed, orbit.states(phase))
    of_data = orbit.turn.of_data(phase, by_states[..., None] * weights[:, None, None])
    return by_parameters.T @ weights, of_data


class Figures:
    """Figures of an orbit as sums. starts: phases near which its extrema are, and their signs, by name and
    figure, where another grid has told them; they are filled in."""

    def __init__(self, orbit: OrbitOnGrid, starts: Starts):
        self.orbit, self._starts = orbit, starts
        self._phases, self._weights = self._quadrature(orbit.samples)
        self._sampled = cache(lambda name: orbit.signal(name)(self._phases))

    def sums(self, asked: Named) -> Sums:
        """Of a figure. Raises NoDerivativeError."""
        name, figure = asked.subject, asked.figure
        if figure in _WAYS:
            return self._of_extremum(name, figure)
        if figure.endswith("_phase"):
            raise NoDerivativeError(f"{asked.text}: derivatives of phases of extrema are not calculated")
        if figure in (HARMONIC, PHASE):
            value, sums = self.harmonic(name, asked.number)
            return sums._replace(made=lambda slopes: _of_harmonic(asked, value, sums.made(slopes)))
        weights = self._weights
        if figure == "rms":
            values = self._sampled(name)
            weights = _over(values * weights, float(np.sqrt(values**2 @ weights)), asked)
        return Sums(name, self._phases, weights[:, None], _first)

    def harmonic(self, name: str, number: int) -> tuple[complex, Sums]:
        """Complex amplitude A exp(iψ) of an order of a coordinate or output, the mean for order 0."""
        period, count = self.orbit.system.period, enough_samples(self.orbit.samples, number)
        known = count == self.orbit.samples
        phases, weights = (self._phases, self._weights) if known else self._quadrature(count)
        values = self._sampled(name) if known else self.orbit.signal(name)(phases)
        wave = np.exp(-2j * np.pi / period * number * phases) * ((2 if number else 1) * weights)
        both = np.stack((np.real(wave), np.imag(wave)), axis=1)
        return complex(wave @ values), Sums(name, phases, both, lambda slopes: slopes @ np.array([1, 1j]))

    def _quadrature(self, count: int) -> tuple[Array, Array]:
        """Phases and weights (k,) of a mean over the period from so many samples or more: evenly, which is
        exact but for orders beyond them, or Gauss's within each step, where jumps leave kinks between."""
        period, nodes = self.orbit.system.period, self.orbit.turn.grid.nodes
        if not self.orbit.system.breaks:
            return np.arange(count) * (period / count), np.full(count, 1 / count)
        places, weights = np.polynomial.legendre.leggauss(-(-count // (len(nodes) - 1)))
        width = np.diff(nodes)[:, None]
        return (nodes[:-1, None] + width * (places + 1) / 2).ravel(), (width * weights / 2 / period).ravel()

    def _of_extremum(self, name: str, figure: str) -> Sums:
        """Of an extremum, whose derivatives are NaN where equally large extrema change differently."""
        phases, signs = self._extrema(name, figure)
        values = signs * self.orbit.signal(name)(phases)
        largest = values >= values.max() - _SAME * np.abs(values).max()
        phases, signs = phases[largest], signs[largest]
        sign = -1.0 if figure == "min" else 1.0

        def made(every: Array) -> Array:
            alike = np.ptp(every, axis=1) <= _ALIKE * np.abs(every).max(axis=1)
            return np.where(alike, sign * every[:, 0], np.nan)

        return Sums(name, phases, np.diag(signs), made)

    def _extrema(self, name: str, figure: str) -> tuple[Array, Array]:
        """Phases (k,) of a quantity's extrema that may be the largest, and their signs (k,). Its derivative
        is brought to zero there: of values that hardly differ, the largest tells its phase to half of their
        digits only."""
        signal, width = self.orbit.signal(name), self.orbit.system.period / self.orbit.samples
        known = self._starts.get((name, figure))
        if known is None:
            values, ways = self._sampled(name), _WAYS[figure]
            tops = [_tops(way * values) for way in ways]
            known = self._phases[np.concatenate(tops)], np.repeat(ways, [len(each) for each in tops])
        phases, signs = known
        for _ in range(_NEWTON if (name, figure) not in self._starts else 1):
            around = signal((phases[:, None] + _NEAR * width * np.arange(-2, 3)).ravel()).reshape(-1, 5)
            first, second = around @ _FIRST, around @ _SECOND
            with np.errstate(divide="ignore", invalid="ignore"):
                moved = -_NEAR * first / second
            phases = phases + np.where(np.abs(moved) < 1, moved, 0.0) * width
        self._starts.setdefault((name, figure), (phases, signs))
        return phases, signs


def _tops(values: Array) -> Array:
    """Places (k,) of maxima that may be the largest between samples."""
    level = values.max() - _PROMISING * np.ptp(values)
    tops = (values >= level) & (values >= np.roll(values, 1)) & (values > np.roll(values, -1))
    return np.flatnonzero(tops if tops.any() else values == values.max())[:_MOST]


def _first(slopes: Array) -> Array:
    return slopes[:, 0]


def _of_harmonic(asked: Named, value: complex, slopes: Array) -> Array:
    """Of amplitude or phase angle of an order, whose complex amplitude is `value` and has these derivatives
    (r,)."""
    if asked.number == 0:
        return np.real(slopes) if asked.figure == HARMONIC else np.zeros(len(slopes))
    turned = _over(slopes * np.conj(value), abs(value), asked)
    assert asked.figure in (HARMONIC, PHASE)
    return np.real(turned) if asked.figure == HARMONIC else np.imag(turned) / abs(value)


def _over(slopes: Array, size: float, asked: Named) -> Array:
    if size == 0:
        raise NoDerivativeError(f"{asked.text} is 0, where a modulus has a kink; ask for other quantities")
    return slopes / size
