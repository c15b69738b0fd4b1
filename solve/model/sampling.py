"""Generated functions at many phases, without a Python call a phase."""

import math
import threading
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from solve.arrays import Array, Recent

if TYPE_CHECKING:
    import casadi

_CHUNK = 256
"""Phases an evaluation: large enough to hide the call, small enough to build at once."""

_MOST_DEGREE = 4
"""Of a polynomial of the speed."""

_MOST_KEPT = 2**24
"""Bytes of tables up to which they are kept."""


class Sampler:
    """A CasADi function of columns that writes into NumPy memory, many columns a call, one call after
    another. shared: the last so many inputs are the same for all columns."""

    def __init__(self, function: "casadi.Function", shared: int = 0):
        self._own = function.n_in() - shared
        alike = list(range(self._own, function.n_in()))
        mapped = (
            function.map("mapped", "serial", _CHUNK, alike, []) if shared else function.map(_CHUNK, "serial")
        )
        self._buffer, self._evaluate = mapped.buffer()
        rows = [1 if i in alike else _CHUNK for i in range(function.n_in())]
        self._inputs = [np.zeros((count, function.size1_in(i))) for i, count in enumerate(rows)]
        self._result = np.zeros((_CHUNK, function.size1_out(0)))
        self._alone = threading.Lock()
        for index, memory in enumerate(self._inputs):
            self._buffer.set_arg(index, memory.data)  # pyright: ignore[reportCallIssue]
        self._buffer.set_res(0, self._result.data)  # pyright: ignore[reportCallIssue]

    def __call__(self, *inputs: Array) -> Array:
        """Results (k, rows) for inputs (k, columns), or (k,) for those of one column, and shared ones
        (columns,)."""
        count = len(inputs[0])
        columns = [each.reshape(count, -1) if each.size else each for each in inputs[: self._own]]
        results = np.empty((count, self._result.shape[1]))
        with self._alone:
            for memory, given in zip(self._inputs[self._own :], inputs[self._own :], strict=True):
                memory[0] = given
            for start in range(0, count, _CHUNK):
                stop = min(start + _CHUNK, count)
                for memory, given in zip(self._inputs[: self._own], columns, strict=True):
                    memory[: stop - start] = given[start:stop]
                self._evaluate()
                results[start:stop] = self._result[: stop - start]
        return results


def symbol(name: str, size: int = 1) -> Any:
    """A column of CasADi."""
    import casadi

    return casadi.SX.sym(name, size)  # pyright: ignore[reportAttributeAccessIssue]


def inputs_of(function: "casadi.Function", *without: str) -> dict[str, Any]:
    """Symbols for the inputs of a generated function, but for some, by name."""
    return {name: symbol(name, function.size1_in(name)) for name in function.name_in() if name not in without}


def by_rows(matrices: Iterable[Any]) -> Any:
    """Entries of matrices of CasADi, each by rows, one after another in a column."""
    import casadi

    # CasADi stores by columns; the transposes come by rows.
    return casadi.vertcat(*(casadi.vec(casadi.densify(each.T)) for each in matrices))


def folded(function: "casadi.Function", parameters: Array, free: Sequence[int] = ()) -> "casadi.Function":
    """A generated function with its parameters, the last input, folded in, but for the free ones: these
    become the last input. Its outputs, each by rows, stand one after another."""
    import casadi

    inputs = inputs_of(function, "p").values()
    values, p = symbol("values", len(free)), casadi.SX(casadi.DM(parameters))
    for position, index in enumerate(free):
        p[index] = values[position]
    entries = by_rows(function.call([*inputs, p], True, False))
    return casadi.Function("folded", [*inputs, values], [entries])


def tangent(residual: "casadi.Function", parameters: Array, free: Sequence[int] = ()) -> "casadi.Function":
    """∂r/∂q̈, ∂r/∂q̇, ∂r/∂q by rows and d = ∂r/∂q̈ q̈ + ∂r/∂q̇ q̇ + ∂r/∂q q - r of a generated residual, one after
    another. It is a function of the residual's inputs, the last of which are q, qd and qdd, and of the
    parameters that are free, if any; the others are fixed."""
    import casadi

    inputs, values = list(inputs_of(residual, "p").values()), symbol("values", len(free))
    (r,) = folded(residual, parameters, free).call([*inputs, values], True, False)
    states = inputs[:-4:-1]
    matrices = [casadi.densify(casadi.jacobian(r, x)) for x in states]
    d = sum((A @ x for A, x in zip(matrices, states, strict=True)), -r)
    entries = casadi.cse(casadi.vertcat(by_rows(matrices), casadi.densify(d)))
    return casadi.Function("tangent", [*inputs, values] if len(free) else inputs, [entries])


def parted(entries: Array, n: int) -> tuple[Array, Array, Array, Array]:
    """M, C, K (m, n, n) and d (m, n) of entries (m, 3n² + n) by rows, one after another."""
    M, C, K = (entries[:, k * n**2 : (k + 1) * n**2].reshape(-1, n, n) for k in range(3))
    return M, C, K, entries[:, 3 * n**2 :]


class MatrixSampler:
    """M, C, K (m, n, n) and d (m, n) of a generated `linearised` function at fixed parameters.

    Where the entries are polynomials of the speed, as those of most mechanisms are, their coefficients are
    sampled once for a grid of phases and kept, so that the next solve on this grid, at any speed, is one
    product of matrices.
    """

    def __init__(self, linearised: "casadi.Function", parameters: Array):
        import casadi

        self.n = linearised.size1_out("d")
        phase, speed = symbol("phase"), symbol("speed")
        (entries,) = folded(linearised, parameters).call([phase, speed, casadi.SX(0, 1)], True, False)
        self._terms = _powers(entries, speed)
        inputs, values = ([phase, speed], entries) if self._terms is None else ([phase], self._terms.values)
        self._evaluate = Sampler(casadi.Function("matrices", inputs, [values]))
        self._table = Recent(self._evaluate, _MOST_KEPT)
        if self._terms is not None:
            every = np.arange(3 * self.n**2 + self.n)
            self._places = (self._terms.entry[:, None] == every).astype(float)
            self._powers = self._terms.power + np.maximum(2 - self._terms.entry // self.n**2, 0.0)

    def __call__(self, phase: Array, speed: float) -> tuple[Array, Array, Array, Array]:
        return parted(self.entries(phase, np.array([speed]))[0], self.n)

    def entries(self, phase: Array, speeds: Array) -> Array:
        """M, C, K by rows and d (P, m, 3n² + n) at speeds (P,)."""
        P, m, E = len(speeds), len(phase), 3 * self.n**2 + self.n
        if self._terms is None:
            return self._evaluate(np.tile(phase, P), np.repeat(speeds, m)).reshape(P, m, E)
        powers, table = speeds[:, None] ** self._terms.power, self._table(phase)
        found = table @ (powers[:, :, None] * self._places)
        if not np.isfinite(found).all():
            # 0·∞ is in all entries of the product.
            found = np.zeros((P, m, E))
            for column, entry in enumerate(self._terms.entry):
                found[..., entry] += powers[:, None, column] * table[:, column]
        return found

    def terms(self, phase: Array) -> tuple[Array, Array, Array] | None:
        """The coefficients (m, R) of powers of the speed, and to which entry, rising, and which power each
        belongs, (R,), of Ω²M, ΩC, K and d; None where these are no polynomials of the speed."""
        return None if self._terms is None else (self._table(phase), self._terms.entry, self._powers)


class _Terms(NamedTuple):
    """Coefficients of powers of the speed, `values` (R): to which entry, rising, and which power each
    belongs."""

    values: "casadi.SX"
    entry: Array
    power: Array


def _powers(entries: "casadi.SX", speed: "casadi.SX") -> _Terms | None:
    """The entries as polynomials of the speed; None where they are none."""
    import casadi

    parts, entry, power = [], [], []
    for k in range(_MOST_DEGREE + 1):
        part = casadi.substitute(entries, speed, 0) / math.factorial(k)
        present = [i for i in range(part.shape[0]) if not part[i].is_zero()]
        parts.append(part[present])
        entry += present
        power += [k] * len(present)
        entries = casadi.densify(casadi.jacobian(entries, speed))
        if entries.is_zero():
            order = np.argsort(entry, kind="stable")
            values = casadi.vertcat(*parts)[order.tolist()]
            return _Terms(values, np.array(entry, dtype=int)[order], np.array(power, dtype=int)[order])
    return None
