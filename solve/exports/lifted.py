"""Lifted systems: Fourier coefficients of periodic state spaces, and constant state spaces for the harmonics
of the signals."""

from collections.abc import Sequence

import numpy as np

from solve.arrays import Array
from solve.exports.state_space import Coefficients, coefficients, labels
from solve.methods.hill import toeplitz, together
from solve.period.grid import Grid
from solve.system import PeriodicSystem

_GAUSS_POINTS = 12
"""Number of Gauss points per step. The length of a step is one period of the highest harmonic."""


class Spectra(Coefficients):
    """Fourier coefficients (2K+1, …) of a state space for the harmonics -K … K."""

    @classmethod
    def from_system(cls, system: PeriodicSystem, speed: float, highest: int) -> "Spectra":
        """Compute the spectra by Gauss quadrature. Steps end at the jumps of the matrices."""
        grid = Grid.uniform(highest + 1, system.period, system.breaks)
        nodes, weights = np.polynomial.legendre.leggauss(_GAUSS_POINTS)
        phases = grid.stages((nodes + 1) / 2).ravel()
        orders = np.arange(-highest, highest + 1)
        waves = np.exp(-2j * np.pi / system.period * np.outer(orders, phases))
        waves *= (grid.h[:, None] * (weights / 2)).ravel() / system.period
        return cls(*(np.tensordot(waves, matrix, 1) for matrix in coefficients(system, speed, phases)))

    def lifted(self, orders: int, harmonics: int, rotation: float) -> tuple[Array, Array, Array, Array]:
        """Return the matrices A - N, B, C and D of the lifted system, whose states have the harmonics -orders
        … orders."""
        inner, outer = np.arange(-orders, orders + 1), np.arange(-harmonics, harmonics + 1)
        blocks = (
            (self.A, inner, inner),
            (self.B, inner, outer),
            (self.C, outer, inner),
            (self.D, outer, outer),
        )
        A, B, C, D = (together(toeplitz(*block)) for block in blocks)
        A[range(len(A)), range(len(A))] -= 1j * rotation * np.repeat(inner, self.A.shape[-1])
        return A, B, C, D

    @property
    def units(self) -> Array:
        """Scales (N,) of the states that balance the mean of A. Round-off then affects all states equally."""
        from scipy.linalg import matrix_balance

        mean = self.A[len(self.A) // 2].real
        return matrix_balance(mean, permute=False, separate=True)[1][0]

    def transfer(self, s: complex, orders: int, harmonics: int, rotation: float) -> Array:
        """Transfer function C (s - A + N)⁻¹ B + D, as an array (2N+1, p, 2N+1, r); NaN at a pole."""
        A, B, C, D = self.lifted(orders, harmonics, rotation)
        H = self._response(s, A, B, C) + D
        p, r = self.D.shape[1:]
        return H.reshape(2 * harmonics + 1, p, 2 * harmonics + 1, r)

    def free_response(self, orders: int, harmonics: int, rotation: float) -> Array:
        """Fourier coefficients (2N+1, p) of the outputs due to the load b; zero if b is zero."""
        p = self.D.shape[1]
        if not self.b.any():
            return np.zeros((2 * harmonics + 1, p))
        A, _, C, _ = self.lifted(orders, harmonics, rotation)
        middle = len(self.b) // 2
        loads = self.b[middle - orders : middle + orders + 1].reshape(-1, 1)
        return self._response(0.0, A, loads, C).reshape(-1, p)

    def _response(self, s: complex, A: Array, B: Array, C: Array) -> Array:
        """Return C (s - A)⁻¹ B for lifted matrices; NaN at a pole."""
        unit = np.tile(self.units, len(A) // len(self.units))
        try:
            return (C * unit) @ np.linalg.solve(
                s * np.eye(len(A)) - A * unit / unit[:, None], B / unit[:, None]
            )
        except np.linalg.LinAlgError:
            return np.full((len(C), B.shape[1]), np.nan)


def real_matrix(matrix: Array, rows: int, columns: int, height: int, width: int) -> Array:
    """Convert a lifted matrix for complex harmonics to a lifted matrix for means and amplitudes of cosines
    and sines."""
    blocks = matrix.reshape(2 * rows + 1, height, 2 * columns + 1, width)
    forward, backward = _amplitudes(rows), np.linalg.inv(_amplitudes(columns))
    converted = np.einsum("ij,jakb,kl->ialb", forward, blocks, backward, optimize=True)
    return converted.real.reshape(matrix.shape)


def _amplitudes(orders: int) -> Array:
    """Matrix that converts coefficients of exp(ikφ), k = -orders … orders, to the mean and the amplitudes of
    cosines and sines."""
    matrix = np.zeros((2 * orders + 1, 2 * orders + 1), dtype=complex)
    matrix[0, orders] = 1.0
    for k in range(1, orders + 1):
        matrix[2 * k - 1, [orders - k, orders + k]] = 1.0
        matrix[2 * k, [orders - k, orders + k]] = -1j, 1j
    return matrix


def phasors(names: Sequence[str], orders: int) -> list[str]:
    """Names of the mean and of the amplitudes of cosines and sines, for each signal."""
    suffixes = ["0", *(f"{wave}{k}" for k in range(1, orders + 1) for wave in "cs")]
    return labels(f"{name}_{suffix}" for suffix in suffixes for name in names)
