"""H2 and H-infinity norms of the transfer from inputs to outputs of a periodic system."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from solve.arguments import checked_rtol, unique_names
from solve.arrays import SPLIT, Array, symmetric_of
from solve.errors import ControlError, MissingValueError, require_name
from solve.methods.gauss import Gauss
from solve.period.grid import Grid
from solve.single import floquet
from solve.studies.control.maps import FIRST_RTOL, Maps, bounded
from solve.studies.control.plant import Plant
from solve.studies.control.riccati import Riccati, solve_riccati
from solve.system import PeriodicSystem, of_system, shown_in
from solve.units import LARGEST, speed_in_si

_GROWTH = 4.0
"""Ratio of successive gains that are tried until two of them enclose the norm. Chosen by judgement."""


class Norm(NamedTuple):
    """Norm of a periodic system with its error.

    Attributes
    ----------
    value : float
        Norm, in the unit of the outputs divided by the unit of the inputs.
    error : float
        Estimated relative error.
    frequency : float or None
        Frequency in rad/s at which the gain is largest, at most π/T; None for the H2 norm, or if it is not
        found.
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
        Asymptotically stable system with inputs. The inputs of a closed loop are disturbances, such as
        u_disturbance.
    speed : float or str
        Ω in rad/s, or a string with a unit.
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
        If the system is not asymptotically stable, or has no inputs.
    SolveError
        Other subclasses for bad input.

    Notes
    -----
    The square of the norm is the mean over the period of tr(BᵀXB), where X is the periodic solution of −Ẋ =
    AᵀX + XA + CᵀC (P. Colaneri, Automatica 36 (2000) 1459-1473). This is a Riccati equation without its
    quadratic term.

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
    transfer = _Transfer.from_system(system, speed, outputs, inputs, checked_rtol(rtol))
    equation = transfer.riccati(lambda B, C: (0 * B, np.swapaxes(C, 1, 2) @ C), 1.0, rtol)
    solved, rule = solve_riccati(equation), Gauss(8).stages
    phase = solved.grid.stages(np.array(rule.c)).ravel()
    B = transfer.inputs_at(phase)
    X = symmetric_of(solved.curve(phase))
    sizes = np.sqrt(np.einsum("kii->ki", X).max(axis=0))
    weights = (solved.grid.h[:, None] * rule.b).ravel() / system.period
    square = float(weights @ np.einsum("kir,kij,kjr->k", B, X, B))
    change = solved.error * float(weights @ ((sizes @ np.abs(B)) ** 2).sum(axis=1))
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
    """Compute the H-infinity norm: the largest ratio, for any inputs, of the root mean square of the outputs
    to that of the inputs.

    Parameters
    ----------
    system : PeriodicSystem
        Asymptotically stable system with inputs. The inputs of a closed loop are disturbances, such as
        u_disturbance.
    speed : float or str
        Ω in rad/s, or a string with a unit.
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
    A number γ exceeds the norm if and only if the maximum of ∫ yᵀy − γ² uᵀu with respect to the inputs u is
    finite for any number of periods. Then the Riccati equation with the matrices A, −BBᵀ/γ² and CᵀC has a
    stabilising solution that does not become infinite. The maxima over the steps are combined by doubling,
    and the norm is found by bisection; `error` is that of the bisection. A value γ below the norm need not be
    a gain at any frequency: the gains are the singular values of the harmonic transfer function (N. M.
    Wereley, 1990), between which there may be gaps.

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
    transfer = _Transfer.from_system(system, speed, outputs, inputs, checked_rtol(rtol))
    low, high = transfer.enclosure()
    while high - low > rtol * low:
        middle = (low + high) / 2
        low, high = (low, middle) if transfer.below(middle) else (middle, high)
    if not low:
        return Norm(0.0, 0.0)
    return Norm((low + high) / 2, (high - low) / low, transfer.frequency(low))


class _Transfer(NamedTuple):
    """Transfer from selected inputs to selected outputs of an asymptotically stable system."""

    plant: Plant
    outputs: tuple[str, ...]
    inputs: list[int]

    @classmethod
    def from_system(
        cls,
        system: PeriodicSystem,
        speed: float | str,
        outputs: Sequence[str],
        inputs: Sequence[str] | None,
        rtol: float,
    ) -> "_Transfer":
        plant = Plant(shown_in(system, speed_in_si(speed)), speed_in_si(speed))
        plant.require_inputs()
        outputs = unique_names(outputs)
        plant.require_names(outputs)
        names = system.inputs if inputs is None else unique_names(inputs)
        for name in names:
            require_name("input", name, system.inputs)
        if not outputs or not names:
            given, such_as = ("inputs", system.inputs[0]) if outputs else ("outputs", plant.states[0])
            raise MissingValueError(f"'{given}' is empty; give at least one name, such as {such_as}")
        stability = floquet(plant.system, plant.speed, rtol=rtol)
        if stability.verdict != "asymptotically stable":
            raise ControlError(
                f"{system.labels.name} is {stability.verdict}; norms require an asymptotically stable system"
            )
        return cls(plant, outputs, [system.inputs.index(name) for name in names])

    def inputs_at(self, phase: Array) -> Array:
        """Columns of B (k, N, r) for the selected inputs, at phases (k,)."""
        return self.plant.input_matrix(phase)[..., self.inputs]

    def riccati(
        self, terms: Callable[[Array, Array], tuple[Array, Array]], sign: float, rtol: float
    ) -> Riccati:
        """Riccati equation with G = sign E Eᵀ. The function `terms` returns E and Q from B and C."""

        def coefficients(phase: Array) -> tuple[Array, Array, Array]:
            A, B, _ = self.plant.dynamics(phase)
            C = self.plant.rows(self.outputs, phase)
            return A, *terms(B[..., self.inputs], C)

        system = self.plant.system
        return Riccati(coefficients, self.plant.speed, system.period, system.breaks, sign, rtol)

    def maps(self, gain: float) -> Maps:
        """Maps of the steps for the cost ∫ yᵀy − gain² uᵀu, in balanced units."""
        equation = self.riccati(lambda B, C: (B / gain, np.swapaxes(C, 1, 2) @ C), -1.0, FIRST_RTOL)
        system = self.plant.system
        return equation.maps(Grid.uniform(2 * equation.first_steps(), system.period, system.breaks))[0]

    def below(self, gain: float) -> bool:
        """Whether the norm is below a gain."""
        return bounded(self.maps(gain))

    def enclosure(self) -> tuple[float, float]:
        """Gains below and above the norm; 0 and 0 if no input reaches an output. Raises ControlError."""
        gain = 1.0
        above = self.below(gain)
        while 1 / LARGEST < gain < LARGEST:
            gain = gain / _GROWTH if above else gain * _GROWTH
            if self.below(gain) != above:
                return (gain, gain * _GROWTH) if above else (gain / _GROWTH, gain)
        if above:
            return 0.0, 0.0
        raise ControlError("the H-infinity norm was not found: it exceeds every bound that was tried")

    def frequency(self, gain: float) -> float | None:
        """Frequency at which `gain`, just below the norm, is a singular value of the transfer; None if it is
        not found."""
        from scipy.linalg import eigvals

        A, G, H = (part[0] for part in self.maps(gain).period)
        zero, one = np.zeros_like(A), np.eye(len(A))
        multipliers: Any = eigvals(np.block([[A, zero], [-H, one]]), np.block([[one, G], [zero, A.T]]))
        on_circle = multipliers[np.abs(np.abs(multipliers) - 1) < SPLIT]
        angles = np.abs(np.angle(on_circle))
        if not len(angles):
            return None
        # The gain is exceeded between two frequencies. A single conjugate pair encloses the angle 0 or π.
        angle = angles.mean() if len(angles) == 4 else angles[0]
        if len(angles) == 2:
            angle = np.pi * (angle > np.pi / 2)
        return float(angle / self.plant.system.period * self.plant.speed)
