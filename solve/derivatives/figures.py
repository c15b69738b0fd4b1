"""Derivatives of figures of coordinates and outputs: extrema, means, root mean squares, harmonics.

An extremum changes as the quantity does at its phase, which may be held: the derivative by the phase is zero
there (envelope theorem).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, partial
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.contracts import Dependence
from solve.derivatives.turn import Motions, TurnOnGrid
from solve.errors import NoDerivativeError
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

_DRAWS = 2
"""Sums with random signs by which the size of terms is estimated."""

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
    coordinate or output at phases (k,). fractions: of every step at which these are, if they are the same."""

    name: str
    phase: Array
    weights: Array
    made: Callable[[Array], Array]
    fractions: Array | None = None


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
        return turn.under(-found.reshape(turn.grid.steps, -1, n, self.count), jumps)

    @cached_property
    def _data(self) -> Array:
        return self.orbit.turn.data(self.moved)

    def signal(self, name: str, phase: Array) -> Array:
        """Derivatives of a coordinate or output (r, k) at phases (k,)."""
        turn, system = self.orbit.turn, self.orbit.system
        if name in system.coordinates:
            return turn.at(self._data[:, :, system.coordinates.index(name)], phase).T
        moved = np.stack([turn.at(self._data, phase, order) for order in (2, 1, 0)], axis=1)
        return self.dependence.output_along(name, phase, self.orbit.speed, self.orbit.states(phase), moved).T

    def of(self, figures: Sequence[Sums], sizes: bool = False) -> list[Array]:
        """Derivatives (r,) of figures, or the sizes of the terms of which they are sums."""
        own = [each.name in self.orbit.system.outputs and not self.dependence.parted for each in figures]
        rest = [each for each, alone in zip(figures, own, strict=True) if not alone]
        term, data = np.abs if sizes else np.asarray, self._data
        if sizes:
            # A solution is off by a part of its largest.
            data = np.broadcast_to(np.abs(data).max(axis=0), data.shape)
        data = data.reshape(-1, self.count)
        direct, of_data = _parted(self.orbit, self.dependence, rest, term)
        parts = iter(_split(direct + data.T @ term(of_data.reshape(len(data), -1)), rest))
        sums = [
            term(self.signal(each.name, each.phase)) @ term(each.weights) if alone else next(parts)
            for each, alone in zip(figures, own, strict=True)
        ]
        return _made(figures, sums, sizes)


@dataclass(frozen=True, eq=False)
class Adjoint:
    """From one adjoint problem, with a column a sum: for many parameters, none of which moves a jump."""

    orbit: OrbitOnGrid
    dependence: Dependence

    def of(self, figures: Sequence[Sums], sizes: bool = False) -> list[Array]:
        """Derivatives (r,) of figures, or the sizes of the terms of which they are sums."""
        direct, of_data = _parted(self.orbit, self.dependence, figures, np.abs if sizes else np.asarray)
        pulled = self.orbit.turn.pulled(of_data)
        weights = pulled.reshape(-1, *pulled.shape[2:])
        along = partial(self.dependence.residual_along, *self.orbit.loaded)
        found = direct + scattered(along, weights) if sizes else direct - along(weights)
        return _made(figures, _split(found, figures), sizes)


def scattered(summed: Callable[[Array], Array], weights: Array) -> Array:
    """Sum of the sizes of the terms of sums with weights (k, …), about or more, from the root of the sum of
    their squares, which sums with random signs tell."""
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (_DRAWS, *weights.shape))
    squares = np.mean([np.abs(summed(each * weights)) ** 2 for each in signs], axis=0)
    return np.sqrt(len(weights) * squares)


def _made(figures: Sequence[Sums], sums: Sequence[Array], sizes: bool) -> list[Array]:
    return [part.max(axis=1) if sizes else each.made(part) for each, part in zip(figures, sums, strict=True)]


def _split(sums: Array, figures: Sequence[Sums]) -> list[Array]:
    """Those (r, c) of each figure, of all sums (r, …)."""
    return np.split(sums, np.cumsum([each.weights.shape[1] for each in figures])[:-1], axis=1)


def _parted(
    orbit: OrbitOnGrid, dependence: Dependence, figures: Sequence[Sums], term: Callable[[Array], Array]
) -> tuple[Array, Array]:
    """The derivatives of all sums by θ (r, c) with the orbit held, of terms as `term` gives them, or 0, and
    the weights (m, 2 + k, n, c) of the data of the orbit's curve."""
    turn, ends = orbit.turn, np.cumsum([0, *(each.weights.shape[1] for each in figures)])
    (m, k), n = turn.phases.shape, orbit.system.n
    of_data, direct = np.zeros((m, 2 + k, n, ends[-1])), {}
    alone: dict[int, list[tuple[Sums, slice]]] = {}
    for each, start, end in zip(figures, ends, ends[1:], strict=False):
        columns = slice(int(start), int(end))
        if each.name not in orbit.system.coordinates:
            by, by_states = dependence.output(each.name, each.phase, orbit.speed, orbit.states(each.phase))
            weights = by_states[..., None] * each.weights[:, None, None]
            of_data[..., columns] = turn.of_data(each.phase, weights)
            direct[columns.start, columns.stop] = term(by).T @ term(each.weights)
            continue
        # Those with the same samples, and all extrema, go together.
        alone.setdefault(0 if each.fractions is None else id(each.fractions), []).append((each, columns))
    # Read late: it takes longer than all that a command without solutions does.
    from scipy.linalg import block_diag as block_diagonal

    for group in alone.values():
        weights = [each.weights for each, _ in group]
        fractions = group[0][0].fractions
        if fractions is None:
            phase = np.concatenate([each.phase for each, _ in group])
            made = turn.of_values(
                phase, np.asarray(weights[0] if len(weights) == 1 else block_diagonal(*weights))
            )
        else:
            made = turn.of_even_values(fractions, np.concatenate(weights, axis=1))
        last = 0
        for each, columns in group:
            first, last = last, last + each.weights.shape[1]
            of_data[:, :, orbit.system.coordinates.index(each.name), columns] = made[..., first:last]
    if not direct:
        return np.zeros(()), of_data
    by_parameters = np.zeros((len(next(iter(direct.values()))), ends[-1]))
    for (start, end), values in direct.items():
        by_parameters[:, start:end] = values
    return by_parameters, of_data


class _Even(NamedTuple):
    """Phases (k,) at the same fractions of every step, and their weights (k,) in a mean over the period."""

    phases: Array
    weights: Array
    fractions: Array


class Figures:
    """Figures of an orbit as sums. starts: phases near which its extrema are, and their signs, by name and
    figure, known from another grid, or filled in."""

    def __init__(self, orbit: OrbitOnGrid, starts: Starts):
        self.orbit, self._starts = orbit, starts
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
        width, curve = self.orbit.system.period / self.orbit.samples, self.orbit.turn.curve
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
        values = signs * self._each(names, phases[:, None])[:, 0]
        parts = (np.split(part, np.cumsum(counts)[:-1]) for part in (phases, signs, values))
        for pair, found in zip(pairs, zip(*parts, strict=True), strict=True):
            self._settled[pair] = found
            self._starts.setdefault(pair, found[:2])

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
        sign = -1.0 if figure == "min" else 1.0

        def made(every: Array) -> Array:
            alike = np.ptp(every, axis=1) <= _ALIKE * np.abs(every).max(axis=1)
            return np.where(alike, sign * every[:, 0], np.nan)

        return Sums(name, phases, np.diag(signs), made)


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
