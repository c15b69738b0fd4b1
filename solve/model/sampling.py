"""Vectorised evaluation of generated functions at many phases."""

import math
import threading
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from solve.arrays import Array, Recent
from solve.contracts import Matrices
from solve.matrices import split_entries
from solve.threads import FunctionOwner, symbolic

if TYPE_CHECKING:
    import casadi

_CHUNK = 64
"""Number of phases per evaluation. Chosen by judgement: large enough that the overhead of a call is
negligible, and not larger, because even a few phases take as long as a whole chunk."""

_MAX_DEGREE = 4
"""Maximum degree of polynomials in the speed. Chosen by judgement."""

_CACHE_BYTES = 2**24
"""Memory limit of cached tables in bytes. Chosen by judgement."""


class Sampler(FunctionOwner):
    """Evaluation of a CasADi function with NumPy arrays, for many columns of inputs, in chunks. Calls are
    thread-safe.

    shared: number of inputs that are the same for all columns; these are the last inputs."""

    @symbolic
    def __init__(self, function: "casadi.Function", shared: int = 0):
        self._varying = function.n_in() - shared
        common = list(range(self._varying, function.n_in()))
        mapped = (
            function.map("mapped", "serial", _CHUNK, common, []) if shared else function.map(_CHUNK, "serial")
        )
        self._buffer, self._evaluate = mapped.buffer()
        rows = [1 if i in common else _CHUNK for i in range(function.n_in())]
        self._inputs = [np.zeros((count, function.size1_in(i))) for i, count in enumerate(rows)]
        self._result = np.zeros((_CHUNK, function.size1_out(0)))
        self._lock = threading.Lock()
        for index, memory in enumerate(self._inputs):
            self._buffer.set_arg(index, memory.data)  # pyright: ignore[reportCallIssue]
        self._buffer.set_res(0, self._result.data)  # pyright: ignore[reportCallIssue]

    def __call__(self, *inputs: Array) -> Array:
        """Evaluate the function k times and return the values (k, rows). Each input is an array (k, columns);
        (k,) for a single column; or (columns,) if it is shared by all evaluations."""
        count = len(inputs[0])
        columns = [x.reshape(count, -1) if x.size else x for x in inputs[: self._varying]]
        results = np.empty((count, self._result.shape[1]))
        with self._lock:
            for memory, value in zip(self._inputs[self._varying :], inputs[self._varying :], strict=True):
                memory[0] = value
            for start in range(0, count, _CHUNK):
                stop = min(start + _CHUNK, count)
                for memory, column in zip(self._inputs[: self._varying], columns, strict=True):
                    memory[: stop - start] = column[start:stop]
                self._evaluate()
                results[start:stop] = self._result[: stop - start]
        return results


def symbol(name: str, size: int = 1) -> Any:
    """Symbolic column (SX) of CasADi."""
    import casadi

    return casadi.SX.sym(name, size)  # pyright: ignore[reportAttributeAccessIssue]


def inputs_of(function: "casadi.Function", *without: str) -> dict[str, Any]:
    """Mapping from the names of the inputs of a generated function to symbols. without: inputs to omit."""
    return {name: symbol(name, function.size1_in(name)) for name in function.name_in() if name not in without}


def by_rows(matrices: Iterable[Any]) -> Any:
    """Column of the entries of CasADi matrices in row order."""
    import casadi

    # CasADi stores matrices by columns; transposes yield the entries by rows.
    return casadi.vertcat(*(casadi.vec(casadi.densify(matrix.T)) for matrix in matrices))


@symbolic
def folded(function: "casadi.Function", parameters: Array, free: Sequence[int] = ()) -> "casadi.Function":
    """Substitute the parameters of a generated function. The parameters with the indices `free` are not
    substituted, but become the last input. The outputs are concatenated, each in row order."""
    import casadi

    inputs = inputs_of(function, "p").values()
    values, p = symbol("values", len(free)), casadi.SX(casadi.DM(parameters))
    for position, index in enumerate(free):
        p[index] = values[position]
    entries = by_rows(function.call([*inputs, p], True, False))
    return casadi.Function("folded", [*inputs, values], [entries])


@symbolic
def tangent(residual: "casadi.Function", parameters: Array, free: Sequence[int] = ()) -> "casadi.Function":
    """Linearise a generated residual r. The result contains ∂r/∂q̈, ∂r/∂q̇ and ∂r/∂q in row order, then d =
    ∂r/∂q̈ q̈ + ∂r/∂q̇ q̇ + ∂r/∂q q - r.

    The inputs are the inputs of the residual, of which q, qd and qdd are the last, followed by the free
    parameters, if any. Values of the other parameters are substituted."""
    import casadi

    inputs, values = list(inputs_of(residual, "p").values()), symbol("values", len(free))
    (r,) = folded(residual, parameters, free).call([*inputs, values], True, False)
    states = inputs[:-4:-1]
    matrices = [casadi.densify(casadi.jacobian(r, x)) for x in states]
    d = sum((A @ x for A, x in zip(matrices, states, strict=True)), -r)
    entries = casadi.cse(casadi.vertcat(by_rows(matrices), casadi.densify(d)))
    return casadi.Function("tangent", [*inputs, values] if len(free) else inputs, [entries])


@symbolic
def nonzero_rows(function: "casadi.Function") -> Array:
    """Indices, in ascending order, of the entries of the only output that are not identically zero."""
    (entries,) = function.call(list(inputs_of(function).values()), True, False)
    return np.array([k for k in range(entries.numel()) if not entries[k].is_zero()])


class MatrixSampler:
    """Sampler of M, C, K (m, n, n) and d (m, n) of a generated `linearised` function with fixed parameters.

    For most mechanisms, the entries are polynomials in the speed. The coefficients are then sampled once per
    grid of phases and cached, and the entries on this grid at any speed are computed by a matrix product."""

    @symbolic
    def __init__(self, linearised: "casadi.Function", parameters: Array):
        import casadi

        self.n = linearised.size1_out("d")
        phase, speed = symbol("phase"), symbol("speed")
        (entries,) = folded(linearised, parameters).call([phase, speed, casadi.SX(0, 1)], True, False)
        terms = _speed_terms(entries, speed)
        inputs, values = ([phase, speed], entries) if terms is None else ([phase], terms.values)
        self._evaluate = Sampler(casadi.Function("matrices", inputs, [values]))
        self._table = Recent(self._evaluate, _CACHE_BYTES)
        # The expressions are not stored: their memory may only be released as `symbolic` describes.
        self._is_polynomial = terms is not None
        if terms is not None:
            self._entry, self._power = terms.entry, terms.power
            all_entries = np.arange(3 * self.n**2 + self.n)
            self._incidence = (self._entry[:, None] == all_entries).astype(float)
            self._powers = self._power + np.maximum(2 - self._entry // self.n**2, 0.0)

    def __call__(self, phase: Array, speed: float) -> Matrices:
        return split_entries(self.entries(phase, np.array([speed]))[0], self.n)

    def entries(self, phase: Array, speeds: Array) -> Array:
        """Entries (P, m, 3n² + n) of M, C and K in row order, and of d, at phases (m,) and speeds (P,)."""
        P, m, E = len(speeds), len(phase), 3 * self.n**2 + self.n
        if not self._is_polynomial:
            return self._evaluate(np.tile(phase, P), np.repeat(speeds, m)).reshape(P, m, E)
        powers, table = speeds[:, None] ** self._power, self._table(phase)
        entries = table @ (powers[:, :, None] * self._incidence)
        if not np.isfinite(entries).all():
            # In a matrix product, 0·∞ would make all entries NaN.
            entries = np.zeros((P, m, E))
            for column, entry in enumerate(self._entry):
                entries[..., entry] += powers[:, None, column] * table[:, column]
        return entries

    def terms(self, phase: Array) -> tuple[Array, Array, Array] | None:
        """Return coefficients (m, R) of powers of the speed in Ω²M, ΩC, K and d. Also return the index of the
        entry (R,), ascending, and the power (R,) of each coefficient. None if the entries are not polynomials
        in the speed."""
        return (self._table(phase), self._entry, self._powers) if self._is_polynomial else None


class _SpeedTerms(NamedTuple):
    """Coefficients `values` (R,) of powers of the speed, with the index of the entry (ascending) and the
    power of each coefficient."""

    values: "casadi.SX"
    entry: Array
    power: Array


def _speed_terms(entries: "casadi.SX", speed: "casadi.SX") -> _SpeedTerms | None:
    """Entries expanded as polynomials in the speed; None if they are not polynomials."""
    import casadi

    parts, entry, power = [], [], []
    for k in range(_MAX_DEGREE + 1):
        coefficient = casadi.sparsify(casadi.substitute(entries, speed, 0) / math.factorial(k))
        present = coefficient.row()
        parts.append(coefficient.nz[:])
        entry += present
        power += [k] * len(present)
        entries = casadi.densify(casadi.jacobian(entries, speed))
        if entries.is_zero():
            order = np.argsort(entry, kind="stable")
            values = casadi.vertcat(*parts)[order.tolist()]
            return _SpeedTerms(values, np.array(entry, dtype=int)[order], np.array(power, dtype=int)[order])
    return None
