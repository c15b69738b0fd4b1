"""Norms of the transfer from inputs to outputs of a periodic system: H2, and H-infinity over frequency."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from solve.arrays import Array, symmetric_of
from solve.errors import ControlError, require_name
from solve.exports.harmonic_transfer import HarmonicTransfer, harmonic_transfer
from solve.first_order import FirstOrderSystem
from solve.methods.gauss import Gauss
from solve.period.grid import Grid
from solve.single import floquet
from solve.studies.control.plant import Plant
from solve.studies.control.riccati import Riccati, solve_riccati
from solve.system import PeriodicSystem, of_system, shown_in
from solve.units import checked_rtol, speed_in_si

_ORDERS, _HARMONICS = 16, 2
"""Harmonics of the states, and of inputs and outputs, in the gain from which the search starts. Choices."""

_ON_CIRCLE = 1e-7
"""Distance of a multiplier of the Hamiltonian system from the unit circle that counts as none. A choice:
double multipliers lose half their digits."""

_MAP_RTOL = 1e-8
"""Tolerance for which the steps of the map of the Hamiltonian system are chosen, which has twice as many."""

_GROWTH, _MOST = 1.3, 80
"""Factor by which the search for an upper bound grows, and most tests. Choices."""


class Norm(NamedTuple):
    """Norm of a periodic system with its error.

    Attributes
    ----------
    value : float
        Norm in the unit of the outputs divided by that of the inputs.
    error : float
        Estimated relative error.
    frequency : float or None
        Frequency in rad/s of the largest gain, up to half the frequency of the period; None for H2.
    warnings : tuple of str
        Reasons to doubt the value.
    """

    value: float
    error: float
    frequency: float | None = None
    warnings: tuple[str, ...] = ()


@of_system
def h2_norm(
    system: PeriodicSystem,
    speed: float | str,
    outputs: Sequence[str],
    inputs: Sequence[str] | None = None,
    rtol: float = 1e-8,
) -> Norm:
    """Compute the H2 norm: the root mean square of outputs under white noise of unit density at the inputs.

    Parameters
    ----------
    system : PeriodicSystem
        Asymptotically stable system with inputs. Those of a closed loop are disturbances, u_disturbance.
    speed : float or str
        Ω in rad/s, or a text with unit.
    outputs : sequence of str
        Names of states and outputs.
    inputs : sequence of str, optional
        Names of inputs, by default all.
    rtol : float
        Relative tolerance.

    Returns
    -------
    Norm
        Norm with its error.

    Raises
    ------
    ControlError
        For a system that is not asymptotically stable, or without inputs.
    SolveError
        Other subclasses for bad input.

    Notes
    -----
    The square is the mean over the period of tr(C P Cᵀ), with the periodic solution of Ṗ = AP + PAᵀ + BBᵀ
    (P. Colaneri, Automatica 36 (2000) 1459-1473), a Riccati equation without its quadratic term.

    Examples
    --------
    >>> import numpy as np
    >>> def oscillator(phase, speed):
    ...     one = np.ones((len(phase), 1, 1))
    ...     return one, 0.2 * one, 4.0 * one, np.zeros((len(phase), 1)), one
    >>> norm = h2_norm(PeriodicSystem(oscillator, ["q"], inputs=["u"]), 1.0, ["q"])
    >>> round(norm.value**2, 9)
    0.625
    """
    transfer = _Transfer.of(system, speed, outputs, inputs, checked_rtol(rtol))
    equation = transfer.riccati(lambda B, C: (B, 0 * np.swapaxes(C, 1, 2) @ C), 1.0, True, rtol)
    solved, rule = solve_riccati(equation), Gauss(8).collocation
    phase = solved.grid.stages(np.array(rule.c))
    rows = transfer.rows(phase.ravel())
    P = symmetric_of(solved.curve(phase.ravel()))
    sizes = np.sqrt(np.einsum("kii->ki", P).max(axis=0))
    weights = (solved.grid.h[:, None] * rule.b).ravel() / system.period
    square = float(weights @ np.einsum("kyi,kij,kyj->k", rows, P, rows))
    change = solved.error * float(weights @ ((np.abs(rows) @ sizes) ** 2).sum(axis=1))
    warnings = () if solved.error <= rtol else (f"the variance is accurate to {solved.error:.1e} only",)
    return Norm(float(np.sqrt(square)), change / (2 * square) if square else 0.0, warnings=warnings)


@of_system
def hinf_norm(
    system: PeriodicSystem,
    speed: float | str,
    outputs: Sequence[str],
    inputs: Sequence[str] | None = None,
    rtol: float = 1e-6,
) -> Norm:
    """Compute the H-infinity norm: the largest ratio of root mean squares of outputs and inputs of any kind.

    Parameters
    ----------
    system : PeriodicSystem
        Asymptotically stable system with inputs. Those of a closed loop are disturbances, u_disturbance.
    speed : float or str
        Ω in rad/s, or a text with unit.
    outputs : sequence of str
        Names of states and outputs.
    inputs : sequence of str, optional
        Names of inputs, by default all.
    rtol : float
        Relative tolerance of the gains.

    Returns
    -------
    Norm
        Norm with the error of the bisection, and the frequency of the largest gain.

    Raises
    ------
    ControlError, SolveError
        As for `h2_norm`.

    Notes
    -----
    The gain at a frequency is the largest singular value of the harmonic transfer function (N. M. Wereley,
    1990). γ is one of its singular values at a frequency ω if exp(iωT) is a multiplier of the Hamiltonian
    system with the matrices A, BBᵀ/γ² and CᵀC. The largest γ with a multiplier of modulus 1 is found by
    bisection, above a gain of few harmonics; the error is that of the bisection.

    Examples
    --------
    >>> import numpy as np
    >>> def oscillator(phase, speed):
    ...     one = np.ones((len(phase), 1, 1))
    ...     return one, 0.2 * one, 4.0 * one, np.zeros((len(phase), 1)), one
    >>> norm = hinf_norm(PeriodicSystem(oscillator, ["q"], inputs=["u"]), 1.0, ["q"])
    >>> bool(abs(norm.value - 1 / np.sqrt(0.1596)) < 1e-6)
    True
    """
    transfer = _Transfer.of(system, speed, outputs, inputs, checked_rtol(rtol))
    low = high = transfer.lower_bound()
    frequency = None
    for _ in range(_MOST):
        if (angle := transfer.angle(high)) is None:
            break
        low, frequency, high = high, angle, high * _GROWTH
    else:
        raise ControlError("the H-infinity norm is not found: every gain that was tried is exceeded")
    # A gain of few harmonics may be slightly too large.
    if frequency is None:
        low /= _GROWTH
        frequency = transfer.angle(low)
    while high - low > rtol * low:
        middle = (low + high) / 2
        if (angle := transfer.angle(middle)) is None:
            high = middle
        else:
            low, frequency = middle, angle
    warnings = (
        () if frequency is not None else ("the largest gain is not confirmed by the Hamiltonian system",)
    )
    error = (high - low) / low if frequency is not None else np.inf
    return Norm((low + high) / 2, error, frequency, warnings)


class _Transfer(NamedTuple):
    """Transfer from some inputs to outputs of an asymptotically stable system, and frequencies of modes."""

    plant: Plant
    outputs: tuple[str, ...]
    inputs: list[int]
    modes: Array

    @classmethod
    def of(
        cls,
        system: PeriodicSystem,
        speed: float | str,
        outputs: Sequence[str],
        inputs: Sequence[str] | None,
        rtol: float,
    ) -> "_Transfer":
        plant = Plant(shown_in(system, speed_in_si(speed)), speed_in_si(speed))
        plant.require_inputs()
        plant.require_names(tuple(outputs))
        names = system.inputs if inputs is None else inputs
        for name in names:
            require_name("input", name, system.inputs)
        stability = floquet(plant.system, plant.speed, rtol=rtol)
        if stability.verdict != "asymptotically stable":
            raise ControlError(
                f"{system.labels.name} is {stability.verdict}; norms require an asymptotically stable system"
            )
        base = 2 * np.pi / system.period * plant.speed
        folded = np.abs(np.imag(stability.exponents)) % base
        modes = np.minimum(folded, base - folded)
        return cls(plant, tuple(outputs), [system.inputs.index(name) for name in names], modes)

    def rows(self, phase: Array) -> Array:
        """C (k, y, N)."""
        return self.plant.rows(self.outputs, phase)

    def riccati(
        self, terms: Callable[[Array, Array], tuple[Array, Array]], sign: float, filters: bool, rtol: float
    ) -> Riccati:
        """Equation whose matrices E and Q, with G = sign E Eᵀ, are functions of B and C."""

        def coefficients(phase: Array) -> tuple[Array, Array, Array]:
            A, B, _ = self.plant.dynamics(phase)
            return A, *terms(B[..., self.inputs], self.rows(phase))

        system = self.plant.system
        return Riccati(coefficients, self.plant.speed, system.period, system.breaks, filters, sign, rtol)

    def angle(self, gain: float) -> float | None:
        """Frequency at which a gain is a singular value; None if there is none."""
        from scipy.linalg import eigvals

        equation = self.riccati(lambda B, C: (B / gain, np.swapaxes(C, 1, 2) @ C), -1.0, False, _MAP_RTOL)
        system = self.plant.system
        grid = Grid.uniform(2 * equation.first_steps(), system.period, system.breaks)
        A, G, H = (part[0] for part in equation.maps(grid).period)
        zero, one = np.zeros_like(A), np.eye(len(A))
        multipliers: Any = eigvals(np.block([[A, zero], [-H, one]]), np.block([[one, G], [zero, A.T]]))
        on_circle = multipliers[np.abs(np.abs(multipliers) - 1) < _ON_CIRCLE]
        if not len(on_circle):
            return None
        return float(np.abs(np.angle(on_circle[0])) / system.period * self.plant.speed)

    def lower_bound(self) -> float:
        """Largest gain at the frequencies of modes and at 0, with few harmonics."""
        transfer = self._of_few_harmonics()
        return max(float(transfer.gain(each)) for each in (0.0, *self.modes))

    def _of_few_harmonics(self) -> HarmonicTransfer:
        """Harmonic transfer function of the chosen inputs and outputs."""
        system, plant = self.plant.system, self.plant
        inputs = [f"input{k}" for k in range(len(self.inputs))]
        outputs = [f"output{k}" for k in range(len(self.outputs))]

        def matrices(phase: Array, speed: float) -> tuple[Array, ...]:
            A, B, _ = plant.dynamics(phase)
            D = np.zeros((len(phase), len(outputs), len(inputs)))
            return A, np.zeros(A.shape[:2]), B[..., self.inputs], self.rows(phase), D

        made = FirstOrderSystem(matrices, plant.states, system.period, system.breaks, inputs, outputs)
        return harmonic_transfer(made, plant.speed, _HARMONICS, _ORDERS)
