"""Matrices at many phases from a CasADi function, without a Python call a phase."""

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
        M, C, K, d = linearised.call([phase, speed, casadi.DM(parameters)], True, False)
        # CasADi stores by columns; the transposes come out by rows.
        entries = casadi.vertcat(*(casadi.vec(casadi.densify(part.T)) for part in (M, C, K, d)))
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
