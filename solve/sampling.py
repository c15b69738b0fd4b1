"""Matrices at many phases from a CasADi function, without a Python call a phase."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from solve.arrays import Array

if TYPE_CHECKING:
    import casadi

_CHUNK = 256
"""Phases an evaluation: large enough to hide the call, small enough to build at once."""


class Sampler:
    """M, C, K (m, n, n) and d (m, n) of a generated `linearised` function at fixed parameters.

    The parameters are folded into the expressions, and a mapped function writes into NumPy memory;
    one sampler serves one thread.
    """

    def __init__(self, linearised: "casadi.Function", parameters: Array):
        import casadi

        self.n = linearised.size1_out("d")
        phase, speed = casadi.SX.sym("phase"), casadi.SX.sym("speed")  # pyright: ignore[reportAttributeAccessIssue]
        entries = _by_rows(linearised.call([phase, speed, casadi.DM(parameters)], True, False))
        folded = casadi.Function("matrices", [phase, speed], [entries])
        mapped = folded.map("matrices_mapped", "serial", _CHUNK, [1], [])
        self._buffer, self._evaluate = mapped.buffer()
        self._phase, self._speed = np.zeros(_CHUNK), np.zeros(1)
        self._entries = np.zeros((_CHUNK, 3 * self.n**2 + self.n))
        self._buffer.set_arg(0, self._phase.data)  # pyright: ignore[reportCallIssue]
        self._buffer.set_arg(1, self._speed.data)  # pyright: ignore[reportCallIssue]
        self._buffer.set_res(0, self._entries.data)  # pyright: ignore[reportCallIssue]

    def __call__(self, phase: Array, speed: float) -> tuple[Array, Array, Array, Array]:
        n, m = self.n, len(phase)
        entries = np.empty((m, 3 * n**2 + n))
        self._speed[0] = speed
        for start in range(0, m, _CHUNK):
            count = min(_CHUNK, m - start)
            self._phase[:count] = phase[start : start + count]
            self._evaluate()
            entries[start : start + count] = self._entries[:count]
        M, C, K = (entries[:, k * n**2 : (k + 1) * n**2].reshape(m, n, n) for k in range(3))
        return M, C, K, entries[:, 3 * n**2 :]


class PointSampler:
    """The same where every phase has its own speed, and values of its own for some of the parameters."""

    def __init__(self, linearised: "casadi.Function", parameters: Array, free: Sequence[int]):
        """`free`: which of the parameters vary; the others are folded in."""
        import casadi

        self.n = linearised.size1_out("d")
        phase, speed = casadi.SX.sym("phase"), casadi.SX.sym("speed")  # pyright: ignore[reportAttributeAccessIssue]
        values, p = casadi.SX.sym("values", len(free)), casadi.SX(casadi.DM(parameters))  # pyright: ignore[reportAttributeAccessIssue]
        for position, index in enumerate(free):
            p[index] = values[position]
        entries = _by_rows(linearised.call([phase, speed, p], True, False))
        folded = casadi.Function("matrices", [phase, speed, values], [entries])
        self._buffer, self._evaluate = folded.map(_CHUNK, "serial").buffer()
        self._inputs = np.zeros(_CHUNK), np.zeros(_CHUNK), np.zeros((_CHUNK, len(free)))
        self._entries = np.zeros((_CHUNK, 3 * self.n**2 + self.n))
        for index, memory in enumerate(self._inputs):
            self._buffer.set_arg(index, memory.data)  # pyright: ignore[reportCallIssue]
        self._buffer.set_res(0, self._entries.data)  # pyright: ignore[reportCallIssue]

    def __call__(self, phase: Array, speed: Array, values: Array) -> Array:
        """M, C, K by rows and d (k, 3n² + n) at phases (k,), speeds (k,) and values (k, v)."""
        entries = np.empty((len(phase), self._entries.shape[1]))
        for start in range(0, len(phase), _CHUNK):
            count = min(_CHUNK, len(phase) - start)
            for memory, given in zip(self._inputs, (phase, speed, values), strict=True):
                memory[:count] = given[start : start + count]
            self._evaluate()
            entries[start : start + count] = self._entries[:count]
        return entries


def _by_rows(matrices: Sequence["casadi.SX"]) -> "casadi.SX":
    """Entries of matrices one after another. CasADi stores by columns; the transposes come by rows."""
    import casadi

    return casadi.vertcat(*(casadi.vec(casadi.densify(part.T)) for part in matrices))
