"""Derivatives of weighted sums over an orbit. They are computed from the derivatives of the orbit, or by an
adjoint problem."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.contracts import Dependence
from solve.derivatives.periodic_problem import Motions, PeriodicProblem
from solve.period.signals import Signal
from solve.results.periodic_motion import PeriodicMotion
from solve.system import PeriodicSystem

_DRAWS = 2
"""Number of random choices of signs from which the size of the terms of a sum is estimated. Chosen by
judgement."""


@dataclass(frozen=True)
class GridOrbit(PeriodicMotion):
    """Orbit of a system on a grid.

    count: number of samples in sums over the period. It is proportional to the number of steps, so that
    differences between grids include the sampling error."""

    system: PeriodicSystem
    speed: float
    problem: PeriodicProblem
    count: int

    def at(self, phase: Array) -> Array:
        return self.problem.curve(phase)

    def signal(self, name: str) -> Signal:
        if name not in self.system.coordinates:
            return super().signal(name)
        row = self.system.coordinates.index(name)
        curve = self.problem.curve[row : row + 1]
        return lambda phase: curve(phase)[0]

    def state(self, phase: Array) -> tuple[Array, Array, Array]:
        q, v, a = (self.problem.curve(phase, order) for order in range(3))
        return q, self.speed * v, self.speed**2 * a

    def states(self, phase: Array) -> Array:
        """States q″, q′, q, as an array (k, 3, n), at phases (k,). Derivatives are with respect to the
        phase."""
        return np.stack([self.problem.curve(phase, order).T for order in (2, 1, 0)], axis=1)

    @property
    def samples(self) -> int:
        return self.count

    @property
    def loaded(self) -> tuple[Array, float, Array]:
        """Return the phases (k,) at which loads act, the speed, and the states (k, 3, n) at these phases."""
        problem = self.problem
        phases = problem.phases[:, problem.loaded]
        states = problem.orbit.states[:, problem.loaded]
        return phases.ravel(), self.speed, states.reshape(-1, 3, problem.point.n)


class WeightedSums(NamedTuple):
    """Statistic that is a function of c weighted sums over the values of a coordinate or output at phases
    (k,).

    weights (k, c): weights of the values. combine: function that converts the derivatives (r, c) of the sums
    to the derivatives (r,) of the statistic. fractions: positions of the phases within a step, if they are
    the same in all steps."""

    name: str
    phase: Array
    weights: Array
    combine: Callable[[Array], Array]
    fractions: Array | None = None


@dataclass(frozen=True, eq=False)
class Forward:
    """Derivatives of the orbit with respect to r quantities θ, by forward differentiation, which is efficient
    if there are many statistics.

    nodes (m, r): derivatives with respect to θ of the phases at which the steps start. If q″ jumps by a at
    such a phase, the derivative of q′ jumps by -a times the derivative of the phase. level: derivatives of
    the means along rigid-body modes, see `PeriodicProblem.solve`."""

    orbit: GridOrbit
    dependence: Dependence
    nodes: Array
    level: Array | None = None

    @property
    def count(self) -> int:
        """Number r of quantities."""
        return self.nodes.shape[1]

    @cached_property
    def motions(self) -> Motions:
        """Derivatives of the orbit."""
        problem = self.orbit.problem
        residual, n = self.dependence.residual(*self.orbit.loaded), problem.point.n
        jumps = np.zeros((problem.grid.steps, 2 * n, self.count))
        for node in np.flatnonzero(self.nodes.any(axis=1)).tolist():
            jumps[node, n:] = -problem.jump(node)[:, None] * self.nodes[node]
        return problem.solve(-residual.reshape(problem.grid.steps, -1, n, self.count), jumps, self.level)

    @cached_property
    def _data(self) -> Array:
        return self.orbit.problem.data(self.motions)

    def signal(self, name: str, phase: Array) -> Array:
        """Derivatives (r, k) of a coordinate or output at phases (k,)."""
        problem, system = self.orbit.problem, self.orbit.system
        if name in system.coordinates:
            return problem.at(self._data[:, :, system.coordinates.index(name)], phase).T
        derivatives = np.stack([problem.at(self._data, phase, order) for order in (2, 1, 0)], axis=1)
        if self.motions.drift is not None:
            derivatives[:, 1] += self.motions.drift
        return self.dependence.output_with_states(
            name, phase, self.orbit.speed, self.orbit.states(phase), derivatives
        ).T

    def derivatives_of(self, figures: Sequence[WeightedSums], sizes: bool = False) -> list[Array]:
        """Derivatives (r,) of each statistic. If `sizes` is true, return instead, for each derivative, the
        estimated size (r,) of the terms of its sum."""
        whole_outputs = not self.dependence.partial_outputs or self.motions.drift is not None
        from_signal = [whole_outputs and figure.name in self.orbit.system.outputs for figure in figures]
        rest = [each for each, direct in zip(figures, from_signal, strict=True) if not direct]
        term, data = np.abs if sizes else np.asarray, self._data
        if sizes:
            # The error of a solution is relative to the largest value of the solution.
            data = np.broadcast_to(np.abs(data).max(axis=0), data.shape)
        data = data.reshape(-1, self.count)
        direct, data_weights = _direct_and_orbit_terms(self.orbit, self.dependence, rest, term)
        rest_sums = iter(_split(direct + data.T @ term(data_weights.reshape(len(data), -1)), rest))
        sums = [
            term(self.signal(each.name, each.phase)) @ term(each.weights) if direct else next(rest_sums)
            for each, direct in zip(figures, from_signal, strict=True)
        ]
        return _combined(figures, sums, sizes)


@dataclass(frozen=True, eq=False)
class Adjoint:
    """Derivatives of statistics of the orbit, from one adjoint problem with one column per weighted sum. This
    is efficient for many parameters. The parameters must not move jumps."""

    orbit: GridOrbit
    dependence: Dependence

    def derivatives_of(self, figures: Sequence[WeightedSums], sizes: bool = False) -> list[Array]:
        """Derivatives (r,) of each statistic. If `sizes` is true, return instead, for each derivative, the
        estimated size (r,) of the terms of its sum."""
        term = np.abs if sizes else np.asarray
        direct, data_weights = _direct_and_orbit_terms(self.orbit, self.dependence, figures, term)
        gradient = self.orbit.problem.adjoint(data_weights)
        weights = gradient.reshape(-1, *gradient.shape[2:])
        along = partial(self.dependence.weighted_residual, *self.orbit.loaded)
        sums = direct + term_sizes(along, weights) if sizes else direct - along(weights)
        return _combined(figures, _split(sums, figures), sizes)


def term_sizes(summed: Callable[[Array], Array], weights: Array) -> Array:
    """Estimated sum of the moduli of the terms of sums with weights (k, …): √k times the square root of the
    sum of the squares of the k terms. The sum of the squares is estimated as the mean square of sums with
    random signs."""
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (_DRAWS, *weights.shape))
    squares = np.mean([np.abs(summed(sign * weights)) ** 2 for sign in signs], axis=0)
    return np.sqrt(len(weights) * squares)


def _combined(figures: Sequence[WeightedSums], sums: Sequence[Array], sizes: bool) -> list[Array]:
    return [
        part.max(axis=1) if sizes else each.combine(part) for each, part in zip(figures, sums, strict=True)
    ]


def _split(sums: Array, figures: Sequence[WeightedSums]) -> list[Array]:
    """Split the sums (r, …) of all statistics into the sums (r, c) of each statistic."""
    return np.split(sums, np.cumsum([figure.weights.shape[1] for figure in figures])[:-1], axis=1)


def _direct_and_orbit_terms(
    orbit: GridOrbit, dependence: Dependence, figures: Sequence[WeightedSums], term: Callable[[Array], Array]
) -> tuple[Array, Array]:
    """For c sums, return the derivatives (r, c) with respect to θ at fixed orbit, which are 0 for sums of
    coordinates. Also return the weights (m, 2 + k, n, c), in the sums, of the data that define the curve of
    the orbit.

    term: function applied to each term, the modulus or the identity."""
    problem, ends = orbit.problem, np.cumsum([0, *(figure.weights.shape[1] for figure in figures)])
    (m, k), n = problem.phases.shape, orbit.system.n
    data_weights, direct = np.zeros((m, 2 + k, n, ends[-1])), {}
    by_samples: dict[int, list[tuple[WeightedSums, slice]]] = {}
    for each, start, end in zip(figures, ends, ends[1:], strict=False):
        columns = slice(int(start), int(end))
        if each.name not in orbit.system.coordinates:
            by, by_states = dependence.output(each.name, each.phase, orbit.speed, orbit.states(each.phase))
            weights = by_states[..., None] * each.weights[:, None, None]
            data_weights[..., columns] = problem.data_weights(each.phase, weights)
            direct[columns.start, columns.stop] = term(by).T @ term(each.weights)
            continue
        # Sums over the same samples are computed in one call, and so are all extrema.
        by_samples.setdefault(0 if each.fractions is None else id(each.fractions), []).append((each, columns))
    # This import takes longer than a command that computes no solution.
    from scipy.linalg import block_diag as block_diagonal

    for group in by_samples.values():
        weights = [each.weights for each, _ in group]
        fractions = group[0][0].fractions
        if fractions is None:
            phase = np.concatenate([each.phase for each, _ in group])
            group_weights = problem.value_data_weights(
                phase, np.asarray(weights[0] if len(weights) == 1 else block_diagonal(*weights))
            )
        else:
            group_weights = problem.even_value_data_weights(fractions, np.concatenate(weights, axis=1))
        last = 0
        for each, columns in group:
            first, last = last, last + each.weights.shape[1]
            row = orbit.system.coordinates.index(each.name)
            data_weights[:, :, row, columns] = group_weights[..., first:last]
    if not direct:
        return np.zeros(()), data_weights
    by_parameters = np.zeros((len(next(iter(direct.values()))), ends[-1]))
    for (start, end), values in direct.items():
        by_parameters[:, start:end] = values
    return by_parameters, data_weights
