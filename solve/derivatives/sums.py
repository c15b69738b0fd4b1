"""Derivatives of sums over an orbit's values: from those of the whole orbit, or by an adjoint problem."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.contracts import Dependence
from solve.derivatives.turn import Motions, TurnOnGrid
from solve.period.quantities import Signal
from solve.results.orbit import Turn
from solve.system import PeriodicSystem

_DRAWS = 2
"""Sums with random signs by which the size of terms is estimated."""


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
    """Forward derivatives of the orbit with respect to r quantities θ, for many figures. nodes (m, r): shift
    of the starts of steps with θ; where q″ jumps by a, the derivative of q′ jumps by -a times this shift.
    level: derivatives of the means along rigid-body modes, see `TurnOnGrid.under`."""

    orbit: OrbitOnGrid
    dependence: Dependence
    nodes: Array
    level: Array | None = None

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
        return turn.under(-found.reshape(turn.grid.steps, -1, n, self.count), jumps, self.level)

    @cached_property
    def _data(self) -> Array:
        return self.orbit.turn.data(self.moved)

    def signal(self, name: str, phase: Array) -> Array:
        """Derivatives of a coordinate or output (r, k) at phases (k,)."""
        turn, system = self.orbit.turn, self.orbit.system
        if name in system.coordinates:
            return turn.at(self._data[:, :, system.coordinates.index(name)], phase).T
        moved = np.stack([turn.at(self._data, phase, order) for order in (2, 1, 0)], axis=1)
        if self.moved.drift is not None:
            moved[:, 1] += self.moved.drift
        return self.dependence.output_with_states(
            name, phase, self.orbit.speed, self.orbit.states(phase), moved
        ).T

    def of(self, figures: Sequence[Sums], sizes: bool = False) -> list[Array]:
        """Derivatives (r,) of figures, or the sizes of the terms of which they are sums."""
        alone = not self.dependence.partial_outputs or self.moved.drift is not None
        own = [each.name in self.orbit.system.outputs and alone for each in figures]
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
        along = partial(self.dependence.weighted_residual, *self.orbit.loaded)
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
