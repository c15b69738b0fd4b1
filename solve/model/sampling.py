"""Matrices at many phases from a CasADi function, without a Python call a phase."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from solve.arrays import Array

if TYPE_CHECKING:
    import casadi

_CHUNK = 256
"""Phases an evaluation: large enough to hide the call, small enough to build at once."""

_MOST_DEGREE = 4
"""Of a polynomial of the speed."""

_MOST_KEPT = 2**24
"""Bytes of tables up to which they are kept."""


class Sampler:
    """M, C, K (m, n, n) and d (m, n) of a generated `linearised` function at fixed parameters.

    The parameters are folded into the expressions. Where the entries are polynomials of the speed, as
    those of most mechanisms are, their coefficients are sampled once for a grid of phases and kept, so
    that the next solve on this grid, at any speed, is one product of matrices. One sampler serves one
    thread.
    """

    def __init__(self, linearised: "casadi.Function", parameters: Array):
        import casadi

        self.n = linearised.size1_out("d")
        phase, speed = casadi.SX.sym("phase"), casadi.SX.sym("speed")  # pyright: ignore[reportAttributeAccessIssue]
        entries = _by_rows(linearised.call([phase, speed, casadi.DM(parameters)], True, False))
        self._terms = _powers(entries, speed)
        if self._terms is None:
            self._evaluate = _Mapped(casadi.Function("matrices", [phase, speed], [entries]))
        else:
            self._evaluate = _Mapped(casadi.Function("matrices", [phase], [self._terms.values]))
        self._kept: dict[bytes, Array] = {}

    def __call__(self, phase: Array, speed: float) -> tuple[Array, Array, Array, Array]:
        n, m = self.n, len(phase)
        entries = self._entries(phase, speed)
        M, C, K = (entries[:, k * n**2 : (k + 1) * n**2].reshape(m, n, n) for k in range(3))
        return M, C, K, entries[:, 3 * n**2 :]

    def _entries(self, phase: Array, speed: float) -> Array:
        """M, C, K by rows and d (m, 3n² + n)."""
        if self._terms is None:
            return self._evaluate(phase[:, None], np.full((len(phase), 1), speed))
        rows = np.zeros((len(self._terms.entry), 3 * self.n**2 + self.n))
        rows[range(len(rows)), self._terms.entry] = speed**self._terms.power
        return self._table(phase) @ rows

    def _table(self, phase: Array) -> Array:
        """The terms (m, R) at the phases."""
        key = phase.tobytes()
        if key not in self._kept:
            if sum(table.nbytes for table in self._kept.values()) > _MOST_KEPT:
                self._kept.clear()
            self._kept[key] = self._evaluate(phase[:, None])
        return self._kept[key]


class _Terms(NamedTuple):
    """Coefficients of powers of the speed, `values` (R): to which entry and which power each belongs."""

    values: "casadi.SX"
    entry: Array
    power: Array


class PointSampler:
    """Matrices where every phase has its own speed, and values of its own for some of the parameters."""

    def __init__(self, linearised: "casadi.Function", parameters: Array, free: Sequence[int]):
        """`free`: which of the parameters vary; the others are folded in."""
        import casadi

        self.n = linearised.size1_out("d")
        phase, speed = casadi.SX.sym("phase"), casadi.SX.sym("speed")  # pyright: ignore[reportAttributeAccessIssue]
        values, p = _freed(parameters, free)
        entries = _by_rows(linearised.call([phase, speed, p], True, False))
        self._evaluate = _Mapped(casadi.Function("matrices", [phase, speed, values], [entries]))

    def __call__(self, phase: Array, speed: Array, values: Array) -> Array:
        """M, C, K by rows and d (k, 3n² + n) at phases (k,), speeds (k,) and values (k, v)."""
        return self._evaluate(phase[:, None], speed[:, None], values)


class ConditionSampler:
    """A generated `conditions` function where every phase has values of its own for some parameters."""

    def __init__(self, conditions: "casadi.Function", parameters: Array, free: Sequence[int]):
        """over_phase: whether the conditions depend on the phase at all."""
        import casadi

        phase = casadi.SX.sym("phase")  # pyright: ignore[reportAttributeAccessIssue]
        values, p = _freed(parameters, free)
        (margins,) = conditions.call([phase, p], True, False)
        self.over_phase = any(casadi.which_depends(margins, phase, 1, False))
        self._evaluate = _Mapped(casadi.Function("conditions", [phase, values], [margins]))

    def __call__(self, phase: Array, values: Array) -> Array:
        """Margins (k, conditions), positive where a condition holds, at phases (k,) and values (k, v)."""
        return self._evaluate(phase[:, None], values)


class OutputSampler:
    """A generated `outputs` function where every phase has its own speed, state and free parameters."""

    def __init__(self, outputs: "casadi.Function", parameters: Array, free: Sequence[int]):
        import casadi

        phase, speed = casadi.SX.sym("phase"), casadi.SX.sym("speed")  # pyright: ignore[reportAttributeAccessIssue]
        state = [casadi.SX.sym(name, outputs.size1_in(name)) for name in ("q", "qd", "qdd")]  # pyright: ignore[reportAttributeAccessIssue]
        values, p = _freed(parameters, free)
        found = casadi.vertcat(*outputs.call([phase, speed, *state, p], True, False))
        self._evaluate = _Mapped(casadi.Function("outputs", [phase, speed, values, *state], [found]))

    def __call__(self, phase: Array, speed: Array, values: Array, q: Array, qd: Array, qdd: Array) -> Array:
        """Outputs (k, o) at phases (k,), speeds (k,), values (k, v) and states (k, n)."""
        return self._evaluate(phase[:, None], speed[:, None], values, q, qd, qdd)


class _Mapped:
    """A CasADi function of columns that writes into NumPy memory, many columns a call."""

    def __init__(self, function: "casadi.Function"):
        self._buffer, self._evaluate = function.map(_CHUNK, "serial").buffer()
        self._inputs = [np.zeros((_CHUNK, function.size1_in(i))) for i in range(function.n_in())]
        self._result = np.zeros((_CHUNK, function.size1_out(0)))
        for index, memory in enumerate(self._inputs):
            self._buffer.set_arg(index, memory.data)  # pyright: ignore[reportCallIssue]
        self._buffer.set_res(0, self._result.data)  # pyright: ignore[reportCallIssue]

    def __call__(self, *inputs: Array) -> Array:
        """Results (k, rows) for inputs (k, columns)."""
        count = len(inputs[0])
        found = np.empty((count, self._result.shape[1]))
        for start in range(0, count, _CHUNK):
            stop = min(start + _CHUNK, count)
            for memory, given in zip(self._inputs, inputs, strict=True):
                memory[: stop - start] = given[start:stop]
            self._evaluate()
            found[start:stop] = self._result[: stop - start]
        return found


def _freed(parameters: Array, free: Sequence[int]) -> tuple["casadi.SX", "casadi.SX"]:
    """Symbols for the free parameters, and all parameters with these among them."""
    import casadi

    values, p = casadi.SX.sym("values", len(free)), casadi.SX(casadi.DM(parameters))  # pyright: ignore[reportAttributeAccessIssue]
    for position, index in enumerate(free):
        p[index] = values[position]
    return values, p


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
            return _Terms(casadi.vertcat(*parts), np.array(entry, dtype=int), np.array(power, dtype=int))
    return None


def _by_rows(matrices: Sequence["casadi.SX"]) -> "casadi.SX":
    """Entries of matrices one after another. CasADi stores by columns; the transposes come by rows."""
    import casadi

    return casadi.vertcat(*(casadi.vec(casadi.densify(part.T)) for part in matrices))
