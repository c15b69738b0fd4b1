"""A model at many points at once."""

import math
from collections.abc import Sequence
from contextlib import suppress
from functools import cached_property

import numpy as np

from solve.arrays import Array
from solve.contracts import Formulas
from solve.errors import ValueOutOfBoundsError
from solve.model.bounds import clauses, holds
from solve.model.damping import damped
from solve.model.domain import Domain
from solve.model.sampling import Sampler
from solve.model.setup import Setup

_TOGETHER = 4096
"""Sets of parameters whose conditions are looked at together."""


class ModelPoints:
    """A model at many points at once, each with its speed and with values (v,) of its own for some of the
    parameters."""

    def __init__(self, setup: Setup, n: int, names: Sequence[str]):
        self._setup, self._n, self._names = setup, n, names

    @property
    def formulas(self) -> Formulas | None:
        return self._formulas

    @cached_property
    def _formulas(self) -> Formulas | None:
        return self._setup.formulas("linearised", self._names)

    def entries(self, phase: Array, speeds: Array, values: Array, by_time: Array | None = None) -> Array:
        P, k, n = len(speeds), len(phase), self._n
        phases, given = np.tile(phase, P), np.repeat(values, k, axis=0)
        if by_time is None:
            by_time = self._matrices(phases, np.repeat(speeds, k), given)
        entries = by_time.reshape(P * k, 3 * n**2 + n)
        if self._setup.ratios is not None:
            still = self._matrices(phases, np.zeros(P * k), given)
            entries[:, n**2 : 2 * n**2] += damped(still, n, self._ratios(given)).reshape(P * k, n**2)
        entries = by_the_phase(entries.reshape(P, k, 3 * n**2 + n), speeds, n)
        if self._names:
            entries[~self._admitted(values)] = np.nan
        entries[~self.exist(speeds, values)] = np.nan
        return entries

    def exist(self, speeds: Array, values: Array) -> Array:
        return (
            np.ones(len(speeds), dtype=bool) if self._domain is None else self._domain.holds(speeds, values)
        )

    def breaks(self, values: Array) -> list[tuple[float, ...] | None]:
        p = np.tile(self._setup.p, (len(values), 1))
        order = list(self._setup.case.parameters)
        p[:, [order.index(name) for name in self._names]] = values
        found: list[tuple[float, ...] | None] = [None] * len(values)
        for at in np.flatnonzero(self._admitted(values)).tolist():
            with suppress(ValueOutOfBoundsError):
                found[at] = self._setup.breaks_with(p[at])
        return found

    def outputs(self, phase: Array, speeds: Array, values: Array, q: Array, qd: Array, qdd: Array) -> Array:
        P, n, k = q.shape
        states = (np.swapaxes(part, 1, 2).reshape(P * k, n) for part in (q, qd, qdd))
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
        """Whether bounds and conditions hold (P,) with the parameters at values (P, v)."""
        admitted = np.asarray(np.isfinite(values).all(axis=1))
        bounds = {name: bound for name, _, _, bound in self._setup.module.PARAMETERS}
        for name, column in zip(self._names, values.T, strict=True):
            for clause in clauses(bounds[name]):
                admitted &= holds(clause, column)
        if any(not set(self._names).isdisjoint(concerned) for *_, concerned in self._setup.conditions):
            admitted[admitted] = self._conditions_hold(values[admitted])
        return admitted

    def _conditions_hold(self, values: Array) -> Array:
        """Whether the conditions hold all over the period (P,)."""
        phase = self._setup.condition_phases
        different, group = np.unique(values, axis=0, return_inverse=True)
        hold = np.zeros(len(different), dtype=bool)
        for at in np.array_split(np.arange(len(different)), math.ceil(len(different) / _TOGETHER)):
            margins = self._margins(np.tile(phase, len(at)), np.repeat(different[at], len(phase), axis=0))
            hold[at] = (margins > 0).reshape(len(at), -1).all(axis=1)
        return hold[group.ravel()]


def by_the_phase(entries: Array, speeds: Array, n: int) -> Array:
    """Entries (P, k, 3n² + n) of derivatives by time as those of derivatives by the phase, in place."""
    entries[:, :, : n**2] *= (speeds**2)[:, None, None]
    entries[:, :, n**2 : 2 * n**2] *= speeds[:, None, None]
    return entries
