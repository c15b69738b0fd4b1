"""Stage systems of the collocation steps of a period, and propagation of states over the steps, with compiled
code or NumPy. The systems are factorised once for all loads."""

from dataclasses import replace
from typing import Protocol

import numpy as np

from solve.arrays import Array
from solve.kernel import chain
from solve.kernel.collocation import Samples
from solve.kernel.engines import COMPILED
from solve.kernel.stages import factorised
from solve.matrices import split_entries
from solve.methods.collocation import Collocation
from solve.methods.method import no_orbit
from solve.period.frozen import FrozenModes
from solve.period.period_map import SINGULAR, Steps, periodic_states, states_from
from solve.period.points import Tables, entry_phases


class StageSystems(Protocol):
    """Interface of solvers of the stage systems; see `solve.kernel.stages.FactorisedStages`."""

    by_state: Array
    maps: Array

    def solved(self, loads: Array) -> Array: ...

    def pulled(self, weights: Array) -> Array: ...


class InvertedStageSystems:
    """Stage systems that are represented by their inverses (m, s n, s n)."""

    def __init__(self, rule: Collocation, h: Array, entries: Array, n: int):
        m, s, _ = entries.shape
        M, C, K, _ = (part[None] for part in split_entries(entries, n))
        unit = np.broadcast_to(np.eye(s * n).reshape(s, n, s * n), (1, m, s, n, s * n))
        responses = rule.stage_accelerations(h, M, C, K, unit)[0]
        self.by_state, self._inverse = np.split(responses.reshape(m, s * n, -1), [2 * n], axis=-1)
        self.maps = rule.maps(h, responses[None, ..., : 2 * n])[0]

    def solved(self, loads: Array) -> Array:
        return self._inverse @ loads

    def pulled(self, weights: Array) -> Array:
        return self._inverse.swapaxes(1, 2) @ weights


class ScaledStageSystems:
    """Stage systems whose equations are multiplied by factors (n,)."""

    def __init__(self, systems: StageSystems, factors: Array):
        self.by_state, self.maps, self._systems = systems.by_state, systems.maps, systems
        self._factors = np.tile(factors, self.by_state.shape[1] // len(factors))[:, None]

    def solved(self, loads: Array) -> Array:
        return self._systems.solved(self._factors * loads)

    def pulled(self, weights: Array) -> Array:
        return self._factors * self._systems.pulled(weights)


def stage_systems(rule: Collocation, h: Array, tables: Tables, at: slice, engine: str) -> StageSystems:
    """Factorise the stage systems of steps of lengths h (m,), from tables with k phases in each step. at:
    indices of the stages among these phases. Raises MemoryError."""
    some = tables.table[..., entry_phases(tables.table.shape[-2]), :]
    factors = FrozenModes(replace(tables, table=some), float(h.sum())).equation_factors()
    if factors is None:
        return _stage_systems(rule, h, tables, at, engine)
    return ScaledStageSystems(_stage_systems(rule, h, tables.multiplied(factors), at, engine), factors[0])


def _stage_systems(rule: Collocation, h: Array, tables: Tables, at: slice, engine: str) -> StageSystems:
    if engine == COMPILED:
        samples = Samples(tables.table, tables.coefficients, tables.entry)
        factors = factorised(rule.weights, h, samples, at, tables.n)
        if factors is not None:
            return factors
    entries = tables.entries().reshape(len(h), -1, 3 * tables.n**2 + tables.n)
    return InvertedStageSystems(rule, h, entries[:, at], tables.n)


def close_periodically(A: Array, b: Array, engine: str) -> Array:
    """Periodic states x (m+1, N, r) of x_{k+1} = A_k x_k + b_k. Raises ResonanceError."""
    compiled = chain.closed(A, b) if engine == COMPILED else None
    x, condition = periodic_states(Steps(A, b)) if compiled is None else compiled
    if not condition < 1 / SINGULAR:
        raise no_orbit()
    return x


def propagate(A: Array, start: Array, engine: str) -> Array:
    """States x (m+1, N, r) of x_{k+1} = A_k x_k, from the first states `start` (N, r)."""
    states = chain.followed(A, start) if engine == COMPILED else None
    if states is not None:
        return states
    A = np.broadcast_to(A, (start.shape[-1], *A.shape))
    return np.moveaxis(states_from(Steps(A, np.zeros(A.shape[:-1], dtype=start.dtype)), start.T), 0, -1)
