"""Harmonic transfer functions (N. M. Wereley, Analysis and Control of Linear Periodically Time Varying
Systems, PhD thesis, MIT, 1990): what the harmonics of a force, each modulated by exp(st), give of each
harmonic of the outputs."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from solve.arrays import Array
from solve.errors import ValueOutOfBoundsError
from solve.exports.extras import labels, library
from solve.exports.state_space import Coefficients, Signals, coefficients, signals
from solve.methods.fourier import MOST_UNKNOWNS
from solve.methods.hill import toeplitz, together
from solve.period.grid import Grid
from solve.system import PeriodicSystem, of_system
from solve.units import checked_rtol, speed_in_si

if TYPE_CHECKING:
    import control

_PROBE = 0.07 + 0.31j
"""Where the truncation is judged, in parts of the rotation 2π/T: off the frequencies of the excitation."""

_LOOKS = 64
"""Phases at which the fastest frequency is looked for."""

_STAGES = 12
"""Of Gauss's rule in a step, which holds a wave of the highest order."""


class TransferValues(NamedTuple):
    """values (2N+1, p, 2N+1, n), complex: what order k of input j gives of order i of output o, at
    [i + N, o, k + N, j]. error: estimated from half the orders, of an output and an input relative to the
    largest among their orders. warnings: what is doubtful about them."""

    values: Array
    error: float
    warnings: list[str]


@dataclass(frozen=True, repr=False)
class HarmonicTransfer:
    """y_i = Σ_k H_ik(s) u_k of u = Σ_k u_k exp((s + ikω)t), y alike, with ω = 2π/T and the orders i, k of
    -N … N.

    harmonics: N. orders: of the states in the balance, -orders … orders. error: of H at a probe off the
    imaginary axis, estimated from twice the orders. excitation (2N+1, n): Fourier coefficients of the load
    d; rest (2N+1, p): of the outputs without states and forces. The steady vibration is
    H(0) excitation + rest as far as N reaches. signals: names of states, inputs u and outputs y.
    """

    system: PeriodicSystem
    speed: float
    harmonics: int
    orders: int
    rtol: float
    signals: Signals

    @property
    def rotation(self) -> float:
        """ω = 2π/T in rad/s."""
        return 2 * math.pi / self.system.period * self.speed

    @cached_property
    def _spectra(self) -> "_Spectra":
        return _Spectra.of(self.system, self.speed, 4 * self.orders)

    @cached_property
    def error(self) -> float:
        return self.at(_PROBE * self.rotation).error

    @property
    def warnings(self) -> list[str]:
        """What is doubtful about the truncation, a sentence each."""
        return self._doubts(self.error)

    def _doubts(self, error: float) -> list[str]:
        if error <= self.rtol:
            return []
        jumps = "; the matrices jump, and their harmonics fall slowly" if self.system.breaks else ""
        most = _most_orders(self.system)
        more = "more orders, or " if self.orders < most else ""
        return [
            f"harmonic transfer function with {self.orders} orders of the states, of at most {most}: error "
            f"{error:.1e}, more than the {self.rtol:.1e} asked for{jumps}; give {more}a larger rtol"
        ]

    @property
    def excitation(self) -> Array:
        return self._kept(self._spectra.d)

    @property
    def rest(self) -> Array:
        return self._kept(self._spectra.y0)

    def _kept(self, spectrum: Array) -> Array:
        middle = len(spectrum) // 2
        return spectrum[middle - self.harmonics : middle + self.harmonics + 1]

    def at(self, s: complex) -> TransferValues:
        """H(s) at a complex s in 1/s, from twice the orders. Raises ValueOutOfBoundsError where s is not
        finite, or a pole."""
        try:
            place = complex(s)
        except (TypeError, ValueError):
            place = complex(math.nan)
        if not np.isfinite(place):
            raise ValueOutOfBoundsError(f"s is {s}; allowed: finite complex numbers, in 1/s, one at a time")
        coarse, fine = (
            self._spectra.transfer(place, orders, self.harmonics, self.rotation)
            for orders in (self.orders, 2 * self.orders)
        )
        if not np.isfinite(fine).all():
            raise ValueOutOfBoundsError(f"s = {place:.6g} is a pole of the system; give another s")
        largest = np.abs(fine).max(axis=(0, 2))
        off = np.abs(fine - coarse).max(axis=(0, 2))
        error = float((off / np.where(largest > 0, largest, 1.0)).max())
        return TransferValues(fine, error, self._doubts(error))

    def lifted(self) -> "control.StateSpace":
        """The truncated system as one without time in its coefficients, for python-control, whose state
        spaces are real: a signal is its mean and the amplitudes of cos kφ and sin kφ, named q1_0, q1_c1,
        q1_s1, q1_c2, …, which vary slowly where the signal is nearly periodic.

        Among its poles are the Floquet exponents ± ikω; those of the outermost orders are spoilt by the
        truncation. Raises MissingLibraryError.
        """
        control = library("control", "control", "a state space of python-control")
        orders, N = self.orders, self.harmonics
        A, B, C, D = self._spectra.lifted(orders, N, self.rotation)
        n, (p, r) = self.system.n, self._spectra.D.shape[1:]
        A = _real(A, orders, orders, 2 * n, 2 * n)
        B, C = _real(B, orders, N, 2 * n, r), _real(C, N, orders, p, 2 * n)
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
            f"Harmonic transfer function of {self.system.name} at {self.system.speed_unit.text(self.speed)}, "
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
    """The harmonic transfer function of the linearised equations at a speed (rad/s, or a text with unit).

    harmonics: N, inputs and outputs have the orders -N … N. orders: of the states; by default they are
    doubled until H is exact to `rtol`, or as many as a dense balance takes, with a warning. Inputs and
    outputs are those of `state_space`, also about a nonlinear orbit. Raises SolveError subclasses for bad
    input, NoMotionError.

    >>> import numpy as np
    >>> def oscillator(phase, speed):
    ...     one = np.ones((len(phase), 1, 1))
    ...     return one, 0.1 * one, 4.0 * one, np.cos(phase)[:, None]
    >>> made = harmonic_transfer(PeriodicSystem(oscillator, ["q"]), 1.0, harmonics=1)
    >>> H = made.at(0.0).values
    >>> H.shape, round(float(abs(H[2, 0, 2, 0])), 9)
    ((3, 1, 3, 1), 0.333148302)
    """
    omega, rtol = speed_in_si(speed), checked_rtol(rtol)
    system.require_motion()
    most = _most_orders(system)
    if not (isinstance(harmonics, int | np.integer) and 0 <= harmonics <= most):
        raise ValueOutOfBoundsError(
            f"harmonics is {harmonics!r}; allowed for {system.n} coordinates: 0 … {most}"
        )
    least = max(int(harmonics), 1)
    if orders is not None and not (isinstance(orders, int | np.integer) and least <= orders <= most):
        raise ValueOutOfBoundsError(
            f"orders is {orders!r}; allowed for {system.n} coordinates and {harmonics} harmonics: "
            f"{least} … {most}"
        )
    system.checked(omega)
    system = system.shown_in(omega)
    first = orders if orders is not None else min(least + _fastest(system, omega), most)
    while True:
        made = HarmonicTransfer(system, omega, int(harmonics), int(first), rtol, signals(system))
        if orders is not None or first == most or made.error <= rtol:
            return made
        first = min(2 * first, most)


def _most_orders(system: PeriodicSystem) -> int:
    """Of the states, so that twice as many are still worth waiting for."""
    return (MOST_UNKNOWNS // (2 * system.n) - 1) // 4


def _fastest(system: PeriodicSystem, speed: float) -> int:
    """The highest frequency with the drive held still, in orders: below it two truncations may agree on
    what neither holds."""
    phase = (np.arange(_LOOKS) + 0.5) * (system.period / _LOOKS)
    frequency = np.abs(np.linalg.eigvals(coefficients(system, speed, phase).A).imag).max()
    return math.ceil(frequency * system.period / (2 * math.pi * speed))


@dataclass(frozen=True)
class _Spectra:
    """Fourier coefficients of orders -K … K of A, B, C, D, d and y₀ (2K+1, …)."""

    A: Array
    B: Array
    C: Array
    D: Array
    d: Array
    y0: Array

    @classmethod
    def of(cls, system: PeriodicSystem, speed: float, highest: int) -> "_Spectra":
        """By Gauss's rule in steps that end at the jumps of the matrices."""
        grid = Grid.uniform(highest + 1, system.period, system.breaks)
        nodes, weights = np.polynomial.legendre.leggauss(_STAGES)
        phases = grid.stages((nodes + 1) / 2).ravel()
        parts: Coefficients = coefficients(system, speed, phases)
        orders = np.arange(-highest, highest + 1)
        waves = np.exp(-2j * np.pi / system.period * np.outer(orders, phases))
        waves *= (grid.h[:, None] * (weights / 2)).ravel() / system.period
        return cls(*(np.tensordot(waves, part, 1) for part in parts[:6]))

    def lifted(self, orders: int, harmonics: int, rotation: float) -> tuple[Array, Array, Array, Array]:
        """A - N, B, C and D of the lifted system, states of so many orders."""
        inner, outer = np.arange(-orders, orders + 1), np.arange(-harmonics, harmonics + 1)
        places = (
            (self.A, inner, inner),
            (self.B, inner, outer),
            (self.C, outer, inner),
            (self.D, outer, outer),
        )
        A, B, C, D = (together(toeplitz(*each)) for each in places)
        A[range(len(A)), range(len(A))] -= 1j * rotation * np.repeat(inner, self.A.shape[-1])
        return A, B, C, D

    @property
    def units(self) -> Array:
        """Of the states (2n,), in which rounding concerns all of them alike."""
        from scipy.linalg import matrix_balance

        mean = self.A[len(self.A) // 2].real
        return matrix_balance(mean, permute=False, separate=True)[1][0]

    def transfer(self, s: complex, orders: int, harmonics: int, rotation: float) -> Array:
        """C (s - A + N)⁻¹ B + D as (2N+1, p, 2N+1, r); NaN at a pole."""
        A, B, C, D = self.lifted(orders, harmonics, rotation)
        unit = np.tile(self.units, 2 * orders + 1)
        try:
            H = (C * unit) @ np.linalg.solve(
                s * np.eye(len(A)) - A * unit / unit[:, None], B / unit[:, None]
            ) + D
        except np.linalg.LinAlgError:
            H = np.full(D.shape, np.nan)
        p, r = self.D.shape[1:]
        return H.reshape(2 * harmonics + 1, p, 2 * harmonics + 1, r)


def _real(matrix: Array, rows: int, columns: int, height: int, width: int) -> Array:
    """A lifted matrix between signals of so many orders, as one between their means and the amplitudes of
    their cosines and sines."""
    blocks = matrix.reshape(2 * rows + 1, height, 2 * columns + 1, width)
    forth, back = _amplitudes(rows), np.linalg.inv(_amplitudes(columns))
    made = np.einsum("ij,jakb,kl->ialb", forth, blocks, back, optimize=True)
    return made.real.reshape(matrix.shape)


def _amplitudes(orders: int) -> Array:
    """Mean, cosine and sine amplitudes of coefficients of exp(ikφ), k = -orders … orders."""
    made = np.zeros((2 * orders + 1, 2 * orders + 1), dtype=complex)
    made[0, orders] = 1.0
    for k in range(1, orders + 1):
        made[2 * k - 1, [orders - k, orders + k]] = 1.0
        made[2 * k, [orders - k, orders + k]] = -1j, 1j
    return made


def _phasors(names: Sequence[str], orders: int) -> list[str]:
    parts = ["0", *(f"{part}{k}" for k in range(1, orders + 1) for part in "cs")]
    return labels(f"{name}_{part}" for part in parts for name in names)
