"""Derivatives of a model's equations and outputs with respect to its parameters and its speed."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, partial
from itertools import pairwise
from typing import Any

import numpy as np

from solve.approximation import interpolated, slope, slopes
from solve.arrays import Array
from solve.contracts import Columns, Dependence, Formulas
from solve.equations import entries_of, output_values
from solve.labels import SPEED
from solve.model.formulas import c_text
from solve.model.sampling import Sampler, by_rows, symbol
from solve.model.setup import Setup
from solve.system import PeriodicSystem
from solve.threads import symbolic

_CHUNK = 1024
"""Number of phases for which derivatives are summed at a time. Chosen by judgement: the derivatives fit into
the processor's cache."""


@dataclass(frozen=True, eq=False)
class _Slopes:
    """Structurally nonzero derivatives of a generated function in row-major order, with their row and column
    indices.

    function: CasADi function of the inputs and the parameters (p,). It returns the derivatives as one column.
    """

    shape: tuple[int, int]
    rows: Array
    columns: Array
    function: Any

    @cached_property
    def text(self) -> str | None:
        return c_text(self.function) if len(self.rows) else None

    @cached_property
    def _sampler(self) -> Sampler:
        return Sampler(self.function, shared=1)

    def values(self, compiled: Columns | None, p: Array, inputs: Sequence[Array]) -> Array:
        """Derivatives (len(rows), k) for inputs of shape (k, …) or (k,)."""
        if not len(self.rows):
            return np.zeros((0, len(inputs[0])))
        values = self._compiled(compiled, p, inputs)
        return self._sampler(*inputs, p).T if values is None else values

    def _compiled(
        self, compiled: Columns | None, p: Array, inputs: Sequence[Array], weights: Array | None = None
    ) -> Array | None:
        if compiled is None or not self.text:
            return None
        columns = [np.atleast_2d(x.T) for x in inputs]
        by_row = None if weights is None else (self.rows, weights.transpose(1, 2, 0))
        return compiled(Formulas(self.text, len(self.rows), (), p), columns, by_row)

    def dense(self, values: Array) -> Array:
        """Derivatives as a dense array (rows, columns, k)."""
        dense = np.zeros((self.shape[0] * self.shape[1], values.shape[1]))
        dense[self.rows * self.shape[1] + self.columns] = values
        return dense.reshape(*self.shape, -1)

    def weighted(self, compiled: Columns | None, p: Array, inputs: Sequence[Array], weights: Array) -> Array:
        """Sums (columns, c) of the derivatives over the k evaluations and over the rows, with weights (k,
        rows, c)."""
        sums = np.zeros((self.shape[1], weights.shape[2]))
        compiled_sums = self._compiled(compiled, p, inputs, weights) if len(self.rows) else None
        if compiled_sums is not None:
            np.add.at(sums, self.columns, compiled_sums)
            return sums
        ends = np.searchsorted(self.rows, range(1, self.shape[0]))
        for *chunk, chunk_weights in _in_chunks(*inputs, weights):
            values = self.values(None, p, chunk)
            by_row = zip(np.split(self.columns, ends), np.split(values, ends), strict=True)
            for row, (columns, row_values) in enumerate(by_row):
                sums[columns] += row_values @ chunk_weights[:, row]
        return sums


class GeneratedSlopes:
    """Derivatives of the generated functions for any parameter values.

    They are computed by automatic differentiation in CasADi (J. A. E. Andersson et al., Math. Program.
    Comput. 11 (2019) 1-36).

    Functions are built at their first use. nonlinear: whether the nonlinear equations are differentiated.
    Otherwise, the equations linearised about the fundamental motion are differentiated."""

    def __init__(self, setup: Setup, n: int, names: Sequence[str], nonlinear: bool):
        self._setup, self._n, self.names, self.nonlinear = setup, n, tuple(names), nonlinear
        self.output = cache(self._output)

    @cached_property
    @symbolic
    def _symbols(self) -> list[Any]:
        """Phase, speed, q″, q′, q and the parameters."""
        return [symbol(f"x{at}", size) for at, size in enumerate((1, 1, *[self._n] * 3, len(self._setup.p)))]

    @cached_property
    @symbolic
    def _equations(self) -> Any:
        phase, speed, a, v, q, p = self._symbols
        if self.nonlinear:
            state = [phase, speed, q, speed * v, speed**2 * a, p]
            return self._setup.function("residual").call(state, True, False)[0]
        M, C, K, d = self._setup.function("linearised").call([phase, speed, p], True, False)
        return speed**2 * M @ a + speed * C @ v + K @ q - d

    @cached_property
    @symbolic
    def residual(self) -> _Slopes:
        """Derivatives of the residual with respect to θ."""
        return self._slopes(self._equations, [])

    @cached_property
    @symbolic
    def matrices(self) -> _Slopes:
        """Function for the derivatives of a weighted sum of the matrix entries with respect to θ and to the
        states. The weights are arguments of this function."""
        import casadi

        n, states = self._n, self._symbols[2:5]
        weights = symbol("weights", 3 * n**2)
        entries = by_rows(casadi.jacobian(self._equations, x) for x in states)
        return self._slopes(casadi.dot(weights, entries), states, weights)

    @symbolic
    def _output(self, name: str) -> _Slopes:
        """Derivatives of an output with respect to θ and to the states."""
        phase, speed, a, v, q, p = self._symbols
        state = [phase, speed, q, speed * v, speed**2 * a, p]
        values = self._setup.function("outputs").call(state, True, False)
        names = [output for output, *_ in self._setup.module.OUTPUTS]
        return self._slopes(values[names.index(name)], [a, v, q])

    def _slopes(self, value: Any, states: Sequence[Any], *further: Any) -> _Slopes:
        """Derivatives of a symbolic column with respect to θ and, in further columns, with respect to the
        states."""
        import casadi

        *inputs, p = self._symbols
        order = list(self._setup.case.parameters)
        chosen = [inputs[1] if name == SPEED else p[order.index(name)] for name in self.names]
        # CasADi stores matrices by columns; the transpose yields the entries by rows.
        by_rows = casadi.jacobian(value, casadi.vertcat(*chosen, *states)).T
        columns, rows = (np.array(index, dtype=int) for index in by_rows.sparsity().get_triplet())
        nonzeros = casadi.cse(casadi.vertcat(*by_rows.nonzeros())) if len(rows) else by_rows
        function = casadi.Function("slopes", [*inputs, *further, p], [nonzeros])
        return _Slopes(by_rows.shape[::-1], rows, columns, function)


class GeneratedDependence(Dependence):
    """Derivatives of the generated functions for the parameters of a setup; see `Dependence`."""

    partial_outputs = True

    def __init__(
        self,
        slopes: GeneratedSlopes,
        setup: Setup,
        n: int,
        names: Sequence[str],
        compiled: Columns | None = None,
    ):
        """Store the derivatives with respect to the quantities θ.

        names: names of the quantities θ; `slopes` must contain all of these names. compiled: evaluation by
        compiled code, if available."""
        self._slopes, self._p, self._n, self._compiled = slopes, setup.p, n, compiled
        self._chosen = [slopes.names.index(name) for name in names]
        self.linear = not slopes.nonlinear

    def residual(self, phase: Array, speed: float, states: Array) -> Array:
        slopes = self._slopes.residual
        values = slopes.values(self._compiled, self._p, self._inputs(phase, speed, states))
        derivatives = np.zeros((len(phase), slopes.shape[0], len(self._chosen)))
        for place, column in enumerate(self._chosen):
            in_column = slopes.columns == column
            derivatives[:, slopes.rows[in_column], place] = values[in_column].T
        return derivatives

    def weighted_residual(self, phase: Array, speed: float, states: Array, weights: Array) -> Array:
        inputs = self._inputs(phase, speed, states)
        return self._slopes.residual.weighted(self._compiled, self._p, inputs, weights)[self._chosen]

    def matrices(self, phase: Array, speed: float, states: Array, weights: Array) -> tuple[Array, Array]:
        slopes = self._slopes.matrices
        inputs = [*self._inputs(phase, speed, states), weights.reshape(len(phase), -1)]
        if self.linear:
            sums = slopes.weighted(self._compiled, self._p, inputs, np.ones((len(phase), 1, 1)))
            return sums[self._chosen, 0], np.zeros_like(states)
        by_parameters, by_states = self._partial(slopes, slopes.values(self._compiled, self._p, inputs))
        return by_parameters.sum(axis=0), by_states

    def output(self, name: str, phase: Array, speed: float, states: Array) -> tuple[Array, Array]:
        # Outputs are not compiled: their formulas are short and are evaluated at few phases.
        slopes = self._slopes.output(name)
        return self._partial(slopes, slopes.values(None, self._p, self._inputs(phase, speed, states)))

    def _inputs(self, phase: Array, speed: float, states: Array) -> list[Array]:
        return [phase, np.full(len(phase), speed), *_by_order(states)]

    def _partial(self, slopes: _Slopes, values: Array) -> tuple[Array, Array]:
        """Return the derivatives of one quantity at phases (k,): with respect to θ as (k, r), and with
        respect to the states as (k, 3, n)."""
        (dense,), count = slopes.dense(values), len(self._slopes.names)
        return dense[self._chosen].T, dense[count:].T.reshape(-1, 3, self._n)


class DampedDependence(GeneratedDependence):
    """Derivatives of generated equations with the modal damping forces C(φ) q̇; see `Dependence`. C is
    differentiated by finite differences."""

    def __init__(
        self,
        slopes: GeneratedSlopes,
        setup: Setup,
        n: int,
        names: Sequence[str],
        compiled: Columns | None,
        damping: Callable[[Mapping[str, float], Array], Array],
    ):
        """Store the derivatives and the damping.

        damping: function of changed parameters and of phases (k,). It returns C (k, n, n) for derivatives of
        q with respect to time."""
        super().__init__(slopes, setup, n, names, compiled)
        self._damping, self._varied = cache(partial(_damping_slopes, damping, setup, tuple(names))), names

    def residual(self, phase: Array, speed: float, states: Array) -> Array:
        return super().residual(phase, speed, states) + self._forces(phase, speed, states)

    def weighted_residual(self, phase: Array, speed: float, states: Array, weights: Array) -> Array:
        generated = super().weighted_residual(phase, speed, states, weights)
        return generated + np.einsum("knr,knc->rc", self._forces(phase, speed, states), weights)

    def matrices(self, phase: Array, speed: float, states: Array, weights: Array) -> tuple[Array, Array]:
        by, by_states = super().matrices(phase, speed, states, weights)
        return by + np.einsum("kij,kijr->r", weights[:, 1], self._slopes_of_damping(phase, speed)), by_states

    def _forces(self, phase: Array, speed: float, states: Array) -> Array:
        return np.einsum("kijr,kj->kir", self._slopes_of_damping(phase, speed), states[:, 1])

    def _slopes_of_damping(self, phase: Array, speed: float) -> Array:
        """Derivatives (k, n, n, r) of ΩC with respect to the quantities θ."""
        by_time = np.array([1.0 if name == SPEED else speed for name in self._varied])
        return by_time * self._damping(phase.tobytes())


def _damping_slopes(
    damping: Callable[[Mapping[str, float], Array], Array], setup: Setup, names: Sequence[str], phases: bytes
) -> Array:
    """Derivatives (k, n, n, r) of C with respect to parameters, by finite differences. In place of the
    derivative with respect to the speed, the result contains C."""
    phase = np.frombuffer(phases)
    columns = [
        damping({}, phase)
        if name == SPEED
        else slope(lambda value, name=name: damping({name: value}, phase), setup.case.parameters[name])
        for name in names
    ]
    return np.stack(columns, axis=-1)


def _in_chunks(*arrays: Array) -> Iterator[tuple[Array, ...]]:
    """Yield consecutive chunks of the rows of arrays (k, …)."""
    starts = range(_CHUNK, len(arrays[0]), _CHUNK)
    return zip(*(np.split(array, starts) for array in arrays), strict=True)


def _by_order(states: Array) -> tuple[Array, Array, Array]:
    """Split states into q″, q′ and q, each (k, n)."""
    a, v, q = (states[:, order] for order in range(3))
    return a, v, q


_Interpolant = Callable[[Array], Array]


class AssembledDependence(Dependence):
    """Derivatives of assembled matrices and outputs by finite differences; see `Dependence`."""

    linear, partial_outputs = True, False

    def __init__(self, system: PeriodicSystem, names: Sequence[str]):
        self._system, self._names, self._less = system, tuple(names), 0
        self._cache: dict[tuple[bytes, float], Array] = {}
        self._interpolants: dict[tuple[str, float], list[tuple[_Interpolant, _Interpolant]]] = {}

    @property
    def less_accurate(self) -> "AssembledDependence":
        """Derivatives computed without the smallest step of the finite differences."""
        coarser = AssembledDependence(self._system, self._names)
        coarser._less, coarser._interpolants = 1, self._interpolants
        return coarser

    def residual(self, phase: Array, speed: float, states: Array) -> Array:
        n, entries = self._system.n, self._entries(phase, speed)
        by_row = entries[:, : 3 * n**2].reshape(-1, 3, n, n, entries.shape[-1])
        return np.einsum("kcijr,kcj->kir", by_row, states) - entries[:, 3 * n**2 :]

    def matrices(self, phase: Array, speed: float, states: Array, weights: Array) -> tuple[Array, Array]:
        entries = self._entries(phase, speed)[:, : 3 * self._system.n**2]
        return np.einsum("ke,ker->r", weights.reshape(len(phase), -1), entries), np.zeros_like(states)

    def output(self, name: str, phase: Array, speed: float, states: Array) -> tuple[Array, Array]:
        raise NotImplementedError

    def output_with_states(self, name: str, phase: Array, speed: float, states: Array, moved: Array) -> Array:
        def column(at: int) -> Array:
            def value(system: PeriodicSystem, omega: float, step: float) -> Array:
                a, v, q = (state.T for state in _by_order(states + step * moved[..., at]))
                return np.asarray(output_values(system, phase, omega, q, omega * v, omega**2 * a)[name])

            return self._slope(self._names[at], speed, value)

        return np.stack([column(at) for at in range(len(self._names))], axis=-1)

    def _entries(self, phase: Array, speed: float) -> Array:
        """Derivatives (k, 3n² + n, r) of Ω²M, ΩC and K in row order, and of d. The last result is cached."""
        key = phase.tobytes(), speed
        if key not in self._cache:
            columns = [
                np.concatenate([block[self._less](phase) for block in self._blocks(name, speed)], axis=1)
                for name in self._names
            ]
            self._cache = {key: np.stack(columns, axis=-1)}
        return self._cache[key]

    def _blocks(self, name: str, speed: float) -> list[tuple[_Interpolant, _Interpolant]]:
        """Interpolants, as functions of the phase, of the derivatives of d and of the entries of Ω²M, ΩC and
        K, row by row.

        Each interpolant is paired with a less accurate interpolant for error estimates. All grids use the
        interpolants, because a varied system takes longer to assemble than to sample."""
        if (name, speed) not in self._interpolants:
            n, moved = self._system.n, cache(self._moved(name, speed))

            @cache
            def sampled(phases: bytes) -> tuple[Array, Array]:
                phase = np.frombuffer(phases)

                def entries(number: float) -> Array:
                    system, omega = moved(number)
                    return entries_of(system, phase, omega)

                return slopes(entries, self._value(name, speed))

            def block(first: int, last: int, less: int) -> _Interpolant:
                return interpolated(
                    lambda phase: sampled(phase.tobytes())[less][:, first:last], self._system.period
                )

            bounds = list(pairwise((0, n**2, 2 * n**2, 3 * n**2, 3 * n**2 + n)))
            self._interpolants[name, speed] = [(block(*ends, 0), block(*ends, 1)) for ends in bounds]
        return self._interpolants[name, speed]

    def _slope(
        self, name: str, speed: float, value: Callable[[PeriodicSystem, float, float], Array]
    ) -> Array:
        """Derivative of `value` with respect to the quantity named `name`. value: function of a system, a
        speed and a step."""
        at, moved = self._value(name, speed), self._moved(name, speed)
        return slopes(lambda number: value(*moved(number), number - at), at)[self._less]

    def _value(self, name: str, speed: float) -> float:
        return speed if name == SPEED else self._system.labels.parameters[name]

    def _moved(self, name: str, speed: float) -> Callable[[float], tuple[PeriodicSystem, float]]:
        """Function that returns the system and the speed for a value of the named parameter or of the
        speed."""
        if name == SPEED:
            return lambda number: (self._system, number)
        return lambda number: (self._system.varied({name: number}), speed)
