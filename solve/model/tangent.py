"""Nonlinear equations of a generated module, and their linearisation about given states."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from solve.arrays import Array
from solve.contracts import Columns, Formulas, Integrator, Matrices
from solve.matrices import split_entries
from solve.model.sampling import Sampler, nonzero_rows, tangent
from solve.model.setup import Setup


@dataclass(frozen=True)
class Tangent:
    """Linearisation of the n nonlinear equations of a setup about given states. `damping` is a function that
    returns the matrices (k, n, n) of modal damping at phases (k,); None without modal damping."""

    setup: Setup
    n: int
    damping: Callable[[Array], Array] | None

    def varying(self, phase: Array, speed: Array, acceleration: float, q: Array, qd: Array) -> Matrices:
        """Matrices for a varying speed, linearised about states q and q̇ (m, n) with zero accelerations. At
        these states, the linearised and the nonlinear equations are equal."""
        accelerations = np.full(len(phase), acceleration)
        entries = self._varying_sampler(phase, speed, accelerations, q, qd, np.zeros_like(q))
        return self.with_damping(phase, entries)

    def with_damping(self, phase: Array, entries: Array) -> Matrices:
        """Matrices M, C, K and d from entries (k, 3n² + n) in row order at phases (k,), with modal damping
        added to C.

        In a linearisation about a motion, modal damping does not change d, because C q̇ then also appears in
        the residual."""
        M, C, K, d = split_entries(entries, self.n)
        return M, C if self.damping is None else C + self.damping(phase), K, d

    @cached_property
    def _varying_sampler(self) -> Sampler:
        return Sampler(tangent(self.setup.function("residual_varying"), self.setup.p))

    def entries(
        self, phase: Array, speeds: Array, states: Sequence[Array], compiled: Columns | None
    ) -> Array:
        """Entries (3n² + n, k) of M, C and K in row order, and of d, without modal damping, at phases (k,),
        speeds (k,) and states q, q̇, q̈ (n, k); from compiled code if it is available."""
        formulas = self._formulas if compiled else None
        if compiled and formulas:
            entries = compiled(formulas, (phase[None], speeds[None], *states))
            if entries is not None:
                return entries
        return self._sampler(phase, speeds, *(state.T for state in states)).T

    @cached_property
    def _sampler(self) -> Sampler:
        return Sampler(tangent(self.setup.function("residual"), self.setup.p))

    @cached_property
    def used_entries(self) -> Array:
        """Indices, in ascending order, of the results of `entries` that are not identically zero."""
        return nonzero_rows(tangent(self.setup.function("residual"), self.setup.p))

    @cached_property
    def _formulas(self) -> Formulas | None:
        """C code of the function of `entries`; None if C code is not available."""
        return self.setup.formulas("residual", (), tangent)

    def integrator(self, sizes: Array, count: int, rtol: float) -> Integrator:
        """Integrator of the nonlinear equations, as returned by `Nonlinear.marcher`."""
        from solve.model.integration import ModelIntegrator, damped_residual

        residual = self.setup.function("residual_varying")
        if self.damping is not None:
            residual = damped_residual(residual, self.damping, self.setup.module.PERIOD)
        return ModelIntegrator(residual, self.setup, sizes, count, rtol)
