"""Harmonic transfer functions (N. M. Wereley, Analysis and Control of Linear Periodically Time Varying
Systems, PhD thesis, MIT, 1990). They map the harmonics of a force modulated by exp(st) to the harmonics of
the outputs."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from solve.arguments import checked_rtol
from solve.arrays import Array
from solve.errors import ValueOutOfBoundsError, counted
from solve.exports.state_space import (
    Coefficients,
    Signals,
    coefficients,
    labels,
    python_control,
    signals,
)
from solve.labels import require_motion
from solve.methods.fourier import MOST_UNKNOWNS
from solve.methods.hill import toeplitz, together
from solve.period.grid import Grid
from solve.system import PeriodicSystem, check, multiplier_count, of_system, shown_in
from solve.units import speed_in_si

if TYPE_CHECKING:
    import control

_PROBE = 0.07 + 0.31j
"""Point s, in units of 2π/T, at which the truncation error is estimated; not an excitation frequency. A
choice."""

_PHASES = 64
"""Number of phases at which the highest natural frequency is sampled. A choice."""

_GAUSS_POINTS = 12
"""Number of Gauss points per step; a step is one period of the highest harmonic."""


class TransferValues(NamedTuple):
    """Values of a harmonic transfer function.

    values (2N+1, p, 2N+1, n), complex: values[i + N, o, k + N, j] maps harmonic k of input j to harmonic i of
    output o. error: largest estimated error; for each pair of output and input it is relative to the largest
    value of any harmonics. warnings: warnings about the truncation.
    """

    values: Array
    error: float
    warnings: list[str]


@dataclass(frozen=True, repr=False)
class HarmonicTransfer:
    """Harmonic transfer function H with y_i = Σ_k H_ik(s) u_k, for u = Σ_k u_k exp((s + ikω)t) and y of the
    same form, with ω = 2π/T and harmonics i, k from -N to N.

    Parameters
    ----------
    system : PeriodicSystem
        System.
    speed : float
        Ω in rad/s.
    harmonics : int
        N.
    orders : int
        Number of harmonics of the states, -orders … orders.
    rtol : float
        Tolerance of `error`.
    signals : Signals
        Names of states, inputs u and outputs y.

    Notes
    -----
    The steady vibration is H(0) excitation + rest, up to harmonic N.
    """

    system: PeriodicSystem
    speed: float
    harmonics: int
    orders: int
    rtol: float
    signals: Signals

    @property
    def rotation(self) -> float:
        """Angular frequency ω = 2π/T in rad/s."""
        return 2 * math.pi / self.system.period * self.speed

    @cached_property
    def _spectra(self) -> "_Spectra":
        return _Spectra.from_system(self.system, self.speed, 4 * self.orders)

    @cached_property
    def error(self) -> float:
        """Error of H at a point next to the imaginary axis, estimated with twice as many harmonics of the
        states."""
        return self.at(_PROBE * self.rotation).error

    @property
    def warnings(self) -> list[str]:
        """Warnings about the truncation."""
        return self._warnings(self.error)

    def _warnings(self, error: float) -> list[str]:
        if error <= self.rtol:
            return []
        jumps = "; the matrices jump, and their harmonics decay slowly" if self.system.breaks else ""
        most = _most_orders(self.system)
        more = "more orders, or " if self.orders < most else ""
        return [
            f"harmonic transfer function: error {error:.1e} with {self.orders} orders of the states "
            f"(at most {most}), above the tolerance {self.rtol:.1e}{jumps}; give {more}a larger rtol"
        ]

    @property
    def excitation(self) -> Array:
        """Fourier coefficients (2N+1, r) of the load d; zero for a first-order system with inputs."""
        return self._truncated(self._spectra.d)

    @property
    def rest(self) -> Array:
        """Fourier coefficients (2N+1, p) of the outputs without states and forces. For a first-order system
        with inputs, the coefficients of its outputs without inputs."""
        return self._truncated(self._spectra.y0) + self._spectra.free_response(
            2 * self.orders, self.harmonics, self.rotation
        )

    def _truncated(self, spectrum: Array) -> Array:
        middle = len(spectrum) // 2
        return spectrum[middle - self.harmonics : middle + self.harmonics + 1]

    def at(self, s: complex) -> TransferValues:
        """Evaluate H(s), and estimate its error with twice as many harmonics of the states.

        Parameters
        ----------
        s : complex
            Complex frequency in 1/s.

        Returns
        -------
        TransferValues

        Raises
        ------
        ValueOutOfBoundsError
            If s is not finite or is a pole.
        """
        try:
            point = complex(s)
        except (TypeError, ValueError):
            point = complex(math.nan)
        if not np.isfinite(point):
            raise ValueOutOfBoundsError(f"s is {s}; allowed: finite complex numbers, in 1/s, one at a time")
        coarse, fine = (
            self._spectra.transfer(point, orders, self.harmonics, self.rotation)
            for orders in (self.orders, 2 * self.orders)
        )
        if not np.isfinite(fine).all():
            raise ValueOutOfBoundsError(f"s = {point:.6g} is a pole of the system; give another value of s")
        largest = np.abs(fine).max(axis=(0, 2))
        difference = np.abs(fine - coarse).max(axis=(0, 2))
        error = float((difference / np.where(largest > 0, largest, 1.0)).max())
        return TransferValues(fine, error, self._warnings(error))

    def gain(self, frequency: float) -> float:
        """Largest singular value of H at a frequency.

        This is the largest ratio of the rms of the outputs to the rms of the inputs, for signals with the
        frequencies `frequency` + kω, k = -N … N.

        Parameters
        ----------
        frequency : float
            Frequency in rad/s.

        Returns
        -------
        float

        Raises
        ------
        ValueOutOfBoundsError
            As for `at`.
        """
        H = self.at(1j * frequency).values
        return float(np.linalg.norm(H.reshape(H.shape[0] * H.shape[1], -1), 2))

    def lifted(self) -> "control.StateSpace":
        """Time-invariant state space of python-control that represents the truncated system.

        The state space is real: each signal is represented by its mean and the amplitudes of cos kφ and sin
        kφ, named q1_0, q1_c1, q1_s1, q1_c2, …. These amplitudes vary slowly if the signal is nearly periodic.
        The poles include the Floquet exponents ± ikω; those of the outermost harmonics are inaccurate.

        Returns
        -------
        control.StateSpace

        Raises
        ------
        MissingLibraryError
        """
        control = python_control()
        orders, N = self.orders, self.harmonics
        A, B, C, D = self._spectra.lifted(orders, N, self.rotation)
        size, (p, r) = multiplier_count(self.system), self._spectra.D.shape[1:]
        A = _real(A, orders, orders, size, size)
        B, C = _real(B, orders, N, size, r), _real(C, N, orders, p, size)
        names = self.signals
        return control.StateSpace(
            *(A, B, C, _real(D, N, N, p, r)),
            states=_phasors(names.states, orders),
            inputs=_phasors(names.inputs, N),
            outputs=_phasors(names.outputs, N),
        )

    def __repr__(self) -> str:
        names = self.signals
        return (
            f"Harmonic transfer function of {self.system.labels.name} at "
            f"{self.system.labels.speed_unit.text(self.speed)}, "
            f"orders -{self.harmonics} … {self.harmonics}\ninputs  {', '.join(names.inputs)}\n"
            f"outputs {', '.join(names.outputs)}\n"
            f"error {self.error:.1e} with {self.orders} orders of the states"
        )


@of_system
def harmonic_transfer(
    system: PeriodicSystem,
    speed: float | str,
    harmonics: int = 10,
    orders: int | None = None,
    rtol: float = 1e-8,
) -> HarmonicTransfer:
    """Compute the harmonic transfer function of the linearised equations.

    Parameters
    ----------
    system : PeriodicSystem
        System; inputs and outputs are those of `solve.state_space`.
    speed : float or str
        Ω in rad/s, or a text with unit.
    harmonics : int
        N: inputs and outputs have harmonics -N … N.
    orders : int, optional
        Number of harmonics of the states. By default it is doubled until the error is at most `rtol`, or up
        to the limit of dense matrices, with a warning.
    rtol : float
        Tolerance of the estimated error.

    Returns
    -------
    HarmonicTransfer
        Harmonic transfer function of the linearised equations.

    Raises
    ------
    NoMotionError
        For systems at rest.
    SolveError
        Other subclasses for invalid input.

    Examples
    --------
    >>> import numpy as np
    >>> def oscillator(phase, speed):
    ...     one = np.ones((len(phase), 1, 1))
    ...     return one, 0.1 * one, 4.0 * one, np.cos(phase)[:, None]
    >>> transfer = harmonic_transfer(PeriodicSystem(oscillator, ["q"]), 1.0, harmonics=1)
    >>> H = transfer.at(0.0).values
    >>> H.shape, round(float(abs(H[2, 0, 2, 0])), 9)
    ((3, 1, 3, 1), 0.333148302)
    """
    omega, rtol = speed_in_si(speed), checked_rtol(rtol)
    require_motion(system)
    most = _most_orders(system)
    if not (isinstance(harmonics, int | np.integer) and 0 <= harmonics <= most):
        raise ValueOutOfBoundsError(
            f"harmonics is {harmonics!r}; allowed for {counted(system.n, 'coordinate')}: 0 … {most}"
        )
    least = max(int(harmonics), 1)
    if orders is not None and not (isinstance(orders, int | np.integer) and least <= orders <= most):
        raise ValueOutOfBoundsError(
            f"orders is {orders!r}; allowed for {counted(system.n, 'coordinate')} and "
            f"{counted(harmonics, 'harmonic')}: "
            f"{least} … {most}"
        )
    check(system, omega)
    system = shown_in(system, omega)
    first = orders if orders is not None else min(least + _highest_frequency(system, omega), most)
    while True:
        transfer = HarmonicTransfer(system, omega, int(harmonics), int(first), rtol, signals(system))
        if orders is not None or first == most or transfer.error <= rtol:
            return transfer
        first = min(2 * first, most)


def _most_orders(system: PeriodicSystem) -> int:
    """Largest number of harmonics of the states for which twice as many fit into dense matrices."""
    return (MOST_UNKNOWNS // multiplier_count(system) - 1) // 4


def _highest_frequency(system: PeriodicSystem, speed: float) -> int:
    """Harmonic number of the highest natural frequency at fixed phase. Two truncations with fewer harmonics
    may agree although both are wrong."""
    phase = (np.arange(_PHASES) + 0.5) * (system.period / _PHASES)
    frequency = np.abs(np.linalg.eigvals(coefficients(system, speed, phase).A).imag).max()
    return math.ceil(frequency * system.period / (2 * math.pi * speed))


@dataclass(frozen=True)
class _Spectra:
    """Fourier coefficients (2K+1, …) of A, B, C, D, d, y₀ and b for harmonics -K … K."""

    A: Array
    B: Array
    C: Array
    D: Array
    d: Array
    y0: Array
    b: Array

    @classmethod
    def from_system(cls, system: PeriodicSystem, speed: float, highest: int) -> "_Spectra":
        """Spectra by Gauss quadrature in steps that end at the jumps of the matrices."""
        grid = Grid.uniform(highest + 1, system.period, system.breaks)
        nodes, weights = np.polynomial.legendre.leggauss(_GAUSS_POINTS)
        phases = grid.stages((nodes + 1) / 2).ravel()
        matrices: Coefficients = coefficients(system, speed, phases)
        orders = np.arange(-highest, highest + 1)
        waves = np.exp(-2j * np.pi / system.period * np.outer(orders, phases))
        waves *= (grid.h[:, None] * (weights / 2)).ravel() / system.period
        return cls(*(np.tensordot(waves, matrix, 1) for matrix in matrices[:7]))

    def lifted(self, orders: int, harmonics: int, rotation: float) -> tuple[Array, Array, Array, Array]:
        """Matrices A - N, B, C and D of the lifted system, whose states have the harmonics -orders …
        orders."""
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
        """Scales (N,) of the states that balance the mean A, so that round-off affects all states equally."""
        from scipy.linalg import matrix_balance

        mean = self.A[len(self.A) // 2].real
        return matrix_balance(mean, permute=False, separate=True)[1][0]

    def transfer(self, s: complex, orders: int, harmonics: int, rotation: float) -> Array:
        """Transfer function C (s - A + N)⁻¹ B + D as (2N+1, p, 2N+1, r); NaN at a pole."""
        A, B, C, D = self.lifted(orders, harmonics, rotation)
        H = self._response(s, A, B, C) + D
        p, r = self.D.shape[1:]
        return H.reshape(2 * harmonics + 1, p, 2 * harmonics + 1, r)

    def free_response(self, orders: int, harmonics: int, rotation: float) -> Array:
        """Coefficients (2N+1, p) of the outputs due to the load b; zero without this load."""
        p = self.D.shape[1]
        if not self.b.any():
            return np.zeros((2 * harmonics + 1, p))
        A, _, C, _ = self.lifted(orders, harmonics, rotation)
        middle = len(self.b) // 2
        loads = self.b[middle - orders : middle + orders + 1].reshape(-1, 1)
        return self._response(0.0, A, loads, C).reshape(-1, p)

    def _response(self, s: complex, A: Array, B: Array, C: Array) -> Array:
        """Values C (s - A)⁻¹ B for lifted matrices; NaN at a pole."""
        unit = np.tile(self.units, len(A) // len(self.units))
        try:
            return (C * unit) @ np.linalg.solve(
                s * np.eye(len(A)) - A * unit / unit[:, None], B / unit[:, None]
            )
        except np.linalg.LinAlgError:
            return np.full((len(C), B.shape[1]), np.nan)


def _real(matrix: Array, rows: int, columns: int, height: int, width: int) -> Array:
    """Lifted matrix converted from complex harmonics to means and amplitudes of cosines and sines."""
    blocks = matrix.reshape(2 * rows + 1, height, 2 * columns + 1, width)
    forward, backward = _amplitudes(rows), np.linalg.inv(_amplitudes(columns))
    converted = np.einsum("ij,jakb,kl->ialb", forward, blocks, backward, optimize=True)
    return converted.real.reshape(matrix.shape)


def _amplitudes(orders: int) -> Array:
    """Matrix that converts the coefficients of exp(ikφ), k = -orders … orders, to mean, cosine and sine
    amplitudes."""
    matrix = np.zeros((2 * orders + 1, 2 * orders + 1), dtype=complex)
    matrix[0, orders] = 1.0
    for k in range(1, orders + 1):
        matrix[2 * k - 1, [orders - k, orders + k]] = 1.0
        matrix[2 * k, [orders - k, orders + k]] = -1j, 1j
    return matrix


def _phasors(names: Sequence[str], orders: int) -> list[str]:
    suffixes = ["0", *(f"{wave}{k}" for k in range(1, orders + 1) for wave in "cs")]
    return labels(f"{name}_{suffix}" for suffix in suffixes for name in names)
