"""The continuous curve of a solution: one polynomial a step, in the phase."""

from dataclasses import dataclass

import numpy as np

from solve.arrays import Array

_QUINTIC = np.linalg.inv(
    # Rows: q, q', q'' at the step's start, then at its end; columns: powers 0 … 5 of θ.
    np.array(
        [
            [1, 0, 0, 0, 0, 0],
            [0, 1, 0, 0, 0, 0],
            [0, 0, 2, 0, 0, 0],
            [1, 1, 1, 1, 1, 1],
            [0, 1, 2, 3, 4, 5],
            [0, 0, 2, 6, 12, 20],
        ],
        dtype=float,
    )
)


@dataclass(frozen=True)
class Curve:
    """q(phase) as powers of θ = (phase - node)/h in every step.

    nodes: (m+1,). coefficients: (degree+1, m, n), lowest power first.
    """

    nodes: Array
    coefficients: Array

    @classmethod
    def quintic(cls, nodes: Array, q: Array, v: Array, a_start: Array, a_end: Array) -> "Curve":
        """Hermite's quintic from q, v = dq/dphase at the nodes (m+1, n) and the second derivatives at
        both ends of each step (m, n); its own error is O(h^6)."""
        h = np.diff(nodes)[:, None]
        data = np.stack((q[:-1], h * v[:-1], h**2 * a_start, q[1:], h * v[1:], h**2 * a_end))
        return cls(nodes, np.tensordot(_QUINTIC, data, axes=1))

    def __call__(self, phase: Array, derivative: int = 0) -> Array:
        """q or its derivative by the phase, at phases (k,) of any turn: (n, k)."""
        nodes = self.nodes
        wrapped = np.mod(np.asarray(phase, dtype=float), nodes[-1])
        step = np.clip(np.searchsorted(nodes, wrapped, side="right") - 1, 0, len(nodes) - 2)
        h = nodes[step + 1] - nodes[step]
        theta = ((wrapped - nodes[step]) / h)[:, None]
        value = np.zeros((len(wrapped), self.coefficients.shape[2]))
        for power in range(len(self.coefficients) - 1, derivative - 1, -1):
            factor = np.prod(np.arange(power - derivative + 1, power + 1))
            value = value * theta + factor * self.coefficients[power, step]
        return (value / h[:, None] ** derivative).T
