"""The continuous curve of a solution over the phase: polynomials by steps, or a Fourier series."""

import math
from dataclasses import dataclass
from typing import Protocol

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


class PeriodicCurve(Protocol):
    """nodes: phases (m+1,) from 0 to the period."""

    @property
    def nodes(self) -> Array: ...

    def __call__(self, phase: Array, derivative: int = 0) -> Array:
        """q or its derivative by the phase, at phases (k,) of any turn: (n, k)."""
        ...


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
        powers = np.arange(derivative, len(self.coefficients))
        terms = self.coefficients[derivative:, step]
        if derivative:
            factors = [math.perm(power, derivative) for power in powers.tolist()]
            terms *= np.array(factors, dtype=float)[:, None, None]
        value = terms[-1]
        for term in terms[-2::-1]:
            value *= theta
            value += term
        return (value / h[:, None] ** derivative).T if derivative else value.T


@dataclass(frozen=True)
class FourierCurve:
    """q(phase) = Re Σ_k coefficients[k] exp(ik 2π phase/period), coefficients (N+1, n) complex."""

    nodes: Array
    coefficients: Array

    @classmethod
    def through(cls, nodes: Array, q: Array) -> "FourierCurve":
        """The trigonometric interpolant of q (m, n) at m uniform nodes, m odd, without the end."""
        coefficients = 2.0 * np.fft.rfft(q, axis=0) / len(q)
        coefficients[0] /= 2.0
        return cls(nodes, coefficients)

    def __call__(self, phase: Array, derivative: int = 0) -> Array:
        rates = 2j * np.pi / self.nodes[-1] * np.arange(len(self.coefficients))
        waves = np.exp(np.outer(np.asarray(phase, dtype=float), rates)) * rates**derivative
        return np.real(waves @ self.coefficients).T
