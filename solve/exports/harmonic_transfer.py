"""Harmonic transfer functions (N. M. Wereley, Analysis and Control of Linear Periodically Time Varying
Systems, PhD thesis, MIT, 1990). They map the harmonics of a force modulated by exp(st) to the harmonics of
the outputs."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from solve.arguments import checked_rtol
from solve.arrays import Array, midpoint_phases
from solve.errors import ValueOutOfBoundsError, counted
from solve.exports.lifted import Spectra, phasors, real_matrix
from solve.exports.state_space import (
    Signals,
    coefficients,
    python_control,
    signals,
)
from solve.labels import require_motion
from solve.methods.fourier import MOST_UNKNOWNS
from solve.system import PeriodicSystem, check, multiplier_count, of_system, shown_in
from solve.units import speed_in_si

if TYPE_CHECKING:
    import control

_PROBE = 0.07 + 0.31j
"""Point s, in units of 2π/T, at which the truncation error is estimated. It is not an excitation frequency.
Chosen by judgement."""

_PHASES = 64
"""Number of phases at which the highest natural frequency is sampled. Chosen by judgement."""


class TransferValues(NamedTuple):
    """Values of a harmonic transfer function.

    values (2N+1, p, 2N+1, n), complex: values[i + N, o, k + N, j] maps harmonic k of input j to harmonic i of
    output o. error: largest estimated error. For each pair of an output and an input, errors are relative to
    the largest value over all harmonics. warnings: warnings about the truncation."""

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
        Speed Ω in rad/s.
    harmonics : int
        Highest harmonic N of inputs and outputs.
    orders : int
        Highest harmonic of the states, which have the harmonics -orders … orders.
    rtol : float
        Tolerance of `error`.
    signals : Signals
        Names of states, inputs u and outputs y.

    Notes
    -----
    The outputs of the steady vibration, up to harmonic N, are H(0) `excitation` + `rest`.
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
    def _spectra(self) -> Spectra:
        return Spectra.from_system(self.system, self.speed, 4 * self.orders)

    @cached_property
    def error(self) -> float:
        """Error of H at a point near the imaginary axis. It is estimated from a solution with twice as many
        harmonics of the states."""
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
            f"the harmonic transfer function has the error {error:.1e} with {self.orders} of at most {most} "
            f"orders of the states, above the tolerance {self.rtol:.1e}{jumps}; give {more}a larger rtol"
        ]

    @property
    def excitation(self) -> Array:
        """Fourier coefficients (2N+1, r) of the load d. They are zero for a first-order system with
        inputs."""
        return self._truncated(self._spectra.d)

    @property
    def rest(self) -> Array:
        """Fourier coefficients (2N+1, p) of the outputs for zero states and forces. For a first-order system
        with inputs, they are the coefficients of its outputs for zero inputs."""
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
        """Time-invariant state space (python-control) that represents the truncated system.

        The state space is real: each signal is represented by its mean and the amplitudes of cos kφ and sin
        kφ, named q1_0, q1_c1, q1_s1, q1_c2, …. These amplitudes vary slowly if the signal is nearly periodic.
        The poles are the Floquet exponents ± ikω; the poles of the outermost harmonics are inaccurate.

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
        A = real_matrix(A, orders, orders, size, size)
        B, C = real_matrix(B, orders, N, size, r), real_matrix(C, N, orders, p, size)
        names = self.signals
        return control.StateSpace(
            *(A, B, C, real_matrix(D, N, N, p, r)),
            states=phasors(names.states, orders),
            inputs=phasors(names.inputs, N),
            outputs=phasors(names.outputs, N),
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
        System. Its inputs and outputs are those of `solve.state_space`.
    speed : float or str
        Speed Ω in rad/s, or a string with a unit.
    harmonics : int
        Highest harmonic N of inputs and outputs, which have the harmonics -N … N.
    orders : int, optional
        Highest harmonic of the states. By default, it is doubled until the error is at most `rtol`. If the
        memory limit of dense matrices is reached before, a warning is issued.
    rtol : float
        Tolerance of the estimated error.

    Returns
    -------
    HarmonicTransfer
        Harmonic transfer function of the linearised equations.

    Raises
    ------
    NoMotionError
        If the system is at rest.
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
            f"the value of orders is {orders!r}; allowed for {counted(system.n, 'coordinate')} and "
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
    """Highest harmonic of the states for which dense matrices with twice as many harmonics fit into
    memory."""
    return (MOST_UNKNOWNS // multiplier_count(system) - 1) // 4


def _highest_frequency(system: PeriodicSystem, speed: float) -> int:
    """Number of the harmonic that is nearest to the highest natural frequency at fixed phase. With fewer
    harmonics, two truncations may agree although both are wrong."""
    phase = midpoint_phases(_PHASES, system.period)
    frequency = np.abs(np.linalg.eigvals(coefficients(system, speed, phase).A).imag).max()
    return math.ceil(frequency * system.period / (2 * math.pi * speed))
