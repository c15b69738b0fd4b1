"""Vectorised evaluation of a model at many points."""

import math
from collections.abc import Sequence
from contextlib import suppress
from functools import cached_property

import numpy as np

from solve.arrays import Array
from solve.contracts import Formulas
from solve.errors import ValueOutOfBoundsError
from solve.matrices import by_the_phase
from solve.model.bounds import clauses, holds
from solve.model.domain import Domain
from solve.model.modes import damped
from solve.model.sampling import Sampler
from solve.model.setup import Setup

_CHUNK = 4096
"""Number of parameter sets for which conditions are evaluated together. Chosen by judgement."""


class ModelPoints:
    """Model at many points. Each point has its own speed and its own values (v,) of the varied parameters."""

    def __init__(self, setup: Setup, n: int, names: Sequence[str]):
        self._setup, self._n, self._names = setup, n, names

    @cached_property
    def formulas(self) -> Formulas | None:
        """C code of M, C and K in row order, and of d, for derivatives with respect to time; None if no C
        code is available. The inputs are phase, speed and all parameters, including the varied ones."""
        return self._setup.formulas("linearised", self._names)

    def entries(self, phase: Array, speeds: Array, values: Array, by_time: Array | None = None) -> Array:
        """Entries (P, k, 3n² + n) of Ω²M, ΩC and K in row order, and of d, at phases (k,).

        Entries are NaN at points where the parameters or the motion are not permitted. by_time: values of the
        formulas, if already computed; this array may be overwritten."""
        P, k, n = len(speeds), len(phase), self._n
        phases, parameters = np.tile(phase, P), np.repeat(values, k, axis=0)
        if by_time is None:
            by_time = self._matrices(phases, np.repeat(speeds, k), parameters)
        entries = by_time.reshape(P * k, 3 * n**2 + n)
        if self._setup.ratios is not None:
            still = self._matrices(phases, np.zeros(P * k), parameters)
            entries[:, n**2 : 2 * n**2] += damped(still, n, self._ratios(parameters)).reshape(P * k, n**2)
        entries = by_the_phase(entries.reshape(P, k, 3 * n**2 + n), speeds, n)
        if self._names:
            entries[~self._admitted(values)] = np.nan
        entries[~self.exist(speeds, values)] = np.nan
        return entries

    def exist(self, speeds: Array, values: Array) -> Array:
        """Mask (P,) of the points at which the fundamental motion exists."""
        return (
            np.ones(len(speeds), dtype=bool) if self._domain is None else self._domain.holds(speeds, values)
        )

    def breaks(self, values: Array) -> list[tuple[float, ...] | None]:
        """Phases of the jumps of the matrices for each point; None for points at which the parameters are not
        permitted."""
        p = np.tile(self._setup.p, (len(values), 1))
        order = list(self._setup.case.parameters)
        p[:, [order.index(name) for name in self._names]] = values
        breaks: list[tuple[float, ...] | None] = [None] * len(values)
        for point in np.flatnonzero(self._admitted(values)).tolist():
            with suppress(ValueOutOfBoundsError):
                breaks[point] = self._setup.breaks_with(p[point])
        return breaks

    def outputs(self, phase: Array, speeds: Array, values: Array, q: Array, qd: Array, qdd: Array) -> Array:
        """Outputs (P, o, k) at phases (P, k), for states q, qd, qdd (P, n, k). Derivatives are with respect
        to time."""
        P, n, k = q.shape
        states = (np.swapaxes(state, 1, 2).reshape(P * k, n) for state in (q, qd, qdd))
        outputs = self._outputs(phase.ravel(), np.repeat(speeds, k), *states, np.repeat(values, k, axis=0))
        return np.swapaxes(outputs.reshape(P, k, -1), 1, 2)

    @cached_property
    def _matrices(self) -> Sampler:
        return self._setup.sampler("linearised", self._names)

    @cached_property
    def _outputs(self) -> Sampler:
        return self._setup.sampler("outputs", self._names)

    @cached_property
    def _ratios(self) -> Sampler:
        return self._setup.sampler("damping_ratios", self._names)

    @cached_property
    def _domain(self) -> Domain | None:
        return self._setup.domain_with(self._names)

    @cached_property
    def _margins(self) -> Sampler:
        return self._setup.sampler("conditions", self._names)

    def _admitted(self, values: Array) -> Array:
        """Return a mask (P,) of the points whose parameter values (P, v) satisfy bounds and conditions."""
        admitted = np.asarray(np.isfinite(values).all(axis=1))
        bounds = {name: bound for name, _, _, bound in self._setup.module.PARAMETERS}
        for name, column in zip(self._names, values.T, strict=True):
            for clause in clauses(bounds[name]):
                admitted &= holds(clause, column)
        if any(not set(self._names).isdisjoint(concerned) for *_, concerned in self._setup.conditions):
            admitted[admitted] = self._conditions_hold(values[admitted])
        return admitted

    def _conditions_hold(self, values: Array) -> Array:
        """Return a mask (P,) of the points at which the conditions hold over the whole period."""
        phase = self._setup.condition_phases
        unique, group = np.unique(values, axis=0, return_inverse=True)
        hold = np.zeros(len(unique), dtype=bool)
        for chunk in np.array_split(np.arange(len(unique)), math.ceil(len(unique) / _CHUNK)):
            margins = self._margins(np.tile(phase, len(chunk)), np.repeat(unique[chunk], len(phase), axis=0))
            hold[chunk] = (margins > 0).reshape(len(chunk), -1).all(axis=1)
        return hold[group.ravel()]
