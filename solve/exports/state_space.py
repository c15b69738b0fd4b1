"""State-space form of the linearised equations over the phase: x′ = A x + B (u + d) + b, y = C x + D (u + d)
+ y₀.

Derivatives are with respect to time, and x = (q, q̇). The forces u act along the coordinates in addition to
the load d. The load b is zero except for a first-order system with named inputs u."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from solve.arguments import number_or_nan, require_integer, require_size
from solve.arrays import Array, uniform_phases
from solve.equations import output_values
from solve.errors import MissingLibraryError, ValueOutOfBoundsError
from solve.first_order import FirstOrderSystem
from solve.labels import require_motion
from solve.matrices import SAME_PHASE, leading
from solve.period.points import rate_of
from solve.studies.control.plant import linear_outputs, output_slopes, reference_state, state_names
from solve.system import PeriodicSystem, check, of_system, shown_in
from solve.units import speed_in_si

if TYPE_CHECKING:
    import control

SAMPLES = 360
"""Default number of phases per period: one per degree of a revolution."""

_FORCES = {"m": "N", "rad": "N m"}
"""Mapping from units of coordinates to units of forces."""


class Coefficients(NamedTuple):
    """Coefficients of a state space at k phases.

    A (k, N, N), B (k, N, r), C (k, p, N), D (k, p, r): matrices. d (k, r), b (k, N): loads. y₀ (k, p):
    outputs for zero states and forces. mass, damping, stiffness (k, n, n): matrices of the equations of
    motion."""

    A: Array
    B: Array
    C: Array
    D: Array
    d: Array
    y0: Array
    b: Array
    mass: Array
    damping: Array
    stiffness: Array


class Signals(NamedTuple):
    """Names and units of states, inputs and outputs."""

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    state_units: tuple[str, ...]
    input_units: tuple[str, ...]
    output_units: tuple[str, ...]


def signals(system: PeriodicSystem) -> Signals:
    """Signals of the state space of a system. States are q and q_dot, inputs force_q, and outputs the
    coordinates and the differentiable outputs of the model.

    The input load_x acts on a first-order state x, unless the system has named inputs."""
    names = system.coordinates
    units = [system.labels.units.get(name, "") for name in names]
    inertial = len(names) - len(system.states)
    outputs = linear_outputs(system)
    loads = [f"{'force' if at < inertial else 'load'}_{name}" for at, name in enumerate(names)]
    result = Signals(
        state_names(system),
        tuple(loads),
        (*names, *outputs),
        (*units, *(f"{unit}/s" if unit not in ("", "1") else "1/s" for unit in units[:inertial])),
        tuple(_FORCES.get(unit, "") for unit in units[:inertial]) + ("",) * len(system.states),
        (*units, *(system.labels.units.get(name, "") for name in outputs)),
    )
    if not isinstance(system, FirstOrderSystem):
        return result
    if system.inputs:
        units = tuple(system.labels.units.get(name, "") for name in system.inputs)
        result = result._replace(inputs=system.inputs, input_units=units)
    if system.outputs:
        units = tuple(system.labels.units.get(name, "") for name in system.outputs)
        result = result._replace(outputs=system.outputs, output_units=units)
    return result


def coefficients(system: PeriodicSystem, speed: float, phase: Array) -> Coefficients:
    """Coefficients at phases (k,) and a speed in rad/s."""
    n, k, inertial = system.n, len(phase), system.n - len(system.states)
    M, damping, K, d = system.at(phase, speed)
    inverse = np.linalg.inv(leading(M, damping, len(system.states)))
    rate = rate_of(M, damping, K, d, len(system.states))[..., :-1]
    B = np.zeros((k, n + inertial, n))
    B[:, n:], B[:, inertial:n] = inverse[:, :inertial], inverse[:, inertial:]
    C, D = np.zeros((k, n, n + inertial)), np.zeros((k, n, n))
    C[:, :, :n] = np.eye(n)
    y0 = np.zeros((k, n))
    names = linear_outputs(system)
    if names:
        state = reference_state(system, phase, speed)
        slopes = output_slopes(system, names, phase, speed, state)
        by_a, by_v, by_q = slopes[..., 0, :], slopes[..., 1, :], slopes[..., 2, :]
        by_state = np.concatenate((by_q, by_v), axis=-1) + by_a @ rate[:, n:]
        C, D = np.concatenate((C, by_state), axis=1), np.concatenate((D, by_a @ inverse), axis=1)
        values = output_values(system, phase, speed, *state[::-1])
        constant = np.stack([values[name] for name in names], axis=1)
        constant -= np.einsum("kpsn,snk->kp", slopes, state)
        y0 = np.concatenate((y0, constant), axis=1)
    result = Coefficients(rate, B, C, D, d, y0, np.zeros((k, n + inertial)), M, damping, K)
    return _with_signals(system, result, phase, speed) if isinstance(system, FirstOrderSystem) else result


def _with_signals(
    system: FirstOrderSystem, coefficients: Coefficients, phase: Array, speed: float
) -> Coefficients:
    """Return the coefficients for the named inputs and outputs of a system. Without named inputs or outputs,
    return `coefficients` unchanged."""
    if not (system.inputs or system.outputs):
        return coefficients
    _, b, B, C, D = system.equations_at(phase, speed)
    if system.inputs:
        without = np.zeros((len(phase), len(system.inputs)))
        coefficients = coefficients._replace(
            B=B, D=np.zeros((len(phase), coefficients.C.shape[1], B.shape[2])), d=without, b=b
        )
    if system.outputs:
        D = D if system.inputs else np.zeros((*C.shape[:2], coefficients.B.shape[2]))
        coefficients = coefficients._replace(C=C, D=D, y0=np.zeros(C.shape[:2]))
    return coefficients


def _coefficient(name: str, description: str) -> Any:
    """Property that returns the coefficient `name`."""
    return property(lambda space: getattr(space.coefficients, name), doc=description)


@dataclass(frozen=True, repr=False)
class StateSpace:
    """State space x′ = A x + B (u + d) + b, y = C x + D (u + d) + y₀ over one period.

    Derivatives are with respect to time.

    Parameters
    ----------
    system : PeriodicSystem
        System.
    speed : float
        Ω in rad/s.
    phase : (m,) array
        Equidistant phases from 0, without the end of the period.
    coefficients : Coefficients
        Matrices A (m, N, N), B (m, N, r), C (m, p, N), D (m, p, r). The load d (m, r) is added to the inputs.
        The outputs for zero states and forces are y0 (m, p). The load of a first-order system with inputs is
        b (m, N). All values are in SI units.
    signals : Signals
        Names and units of states, inputs and outputs.
    """

    system: PeriodicSystem
    speed: float
    phase: Array
    coefficients: Coefficients
    signals: Signals

    A = _coefficient("A", "State matrices (m, 2n, 2n).")
    B = _coefficient("B", "Input matrices (m, 2n, n).")
    C = _coefficient("C", "Output matrices (m, p, 2n).")
    D = _coefficient("D", "Feedthrough matrices (m, p, n).")
    d = _coefficient("d", "Loads (m, n), which are added to the inputs.")
    y0 = _coefficient("y0", "Outputs (m, p) without states and forces.")
    b = _coefficient("b", "Constant terms (m, N) of the states.")

    def frozen(self, phase: float) -> "control.StateSpace":
        """Time-invariant state space (python-control) at a fixed phase.

        At a jump of the matrices, their values just after the jump are used. The poles of this state space do
        not determine the stability of the periodic system.

        Parameters
        ----------
        phase : float
            Phase in rad.

        Returns
        -------
        control.StateSpace

        Raises
        ------
        MissingLibraryError, ValueOutOfBoundsError
        """
        control = python_control()
        place = number_or_nan(phase)
        if not math.isfinite(place):
            raise ValueOutOfBoundsError(f"phase is {phase}; allowed: a finite angle in rad")
        there = coefficients(self.system, self.speed, _after(self.system, np.array([place])))
        names = self.signals
        return control.StateSpace(
            *(matrix[0] for matrix in (there.A, there.B, there.C, there.D)),
            states=labels(names.states),
            inputs=labels(names.inputs),
            outputs=labels(names.outputs),
        )

    def __repr__(self) -> str:
        names = self.signals
        return (
            f"State space of {self.system.labels.name} at {self.system.labels.speed_unit.text(self.speed)}, "
            f"{len(self.phase)} phases\nstates  {', '.join(names.states)}\n"
            f"inputs  {', '.join(names.inputs)}\noutputs {', '.join(names.outputs)}"
        )


@of_system
def state_space(system: PeriodicSystem, speed: float | str, samples: int = SAMPLES) -> StateSpace:
    """Compute the state space of the linearised equations over a period.

    Parameters
    ----------
    system : PeriodicSystem
        System. The system of a nonlinear orbit, `solve.nonlinear(…).system`, is linearised about the orbit.
    speed : float or str
        Ω in rad/s, or a string with a unit.
    samples : int
        Number of equidistant phases per period. At a jump, the matrices just after the jump are used.

    Returns
    -------
    StateSpace
        State space whose inputs are forces along the coordinates. Its outputs are the coordinates and, for
        models with formulas, the outputs linearised about q = 0. For a `FirstOrderSystem` with named inputs
        and outputs, the named inputs and outputs are used instead.

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
    ...     return 2 * one, 0.1 * one, 4.0 * one, np.cos(phase)[:, None]
    >>> space = state_space(PeriodicSystem(oscillator, ["q"]), 1.0, samples=8)
    >>> space.A[0].tolist(), space.B[0].tolist()
    ([[0.0, 1.0], [-2.0, -0.05]], [[0.0], [0.5]])
    """
    omega = speed_in_si(speed)
    require_motion(system)
    require_integer("samples", samples)
    check(system, omega)
    system = shown_in(system, omega)
    require_size("samples", samples, each=20 * (system.n + len(system.outputs)) * system.n)
    phase = uniform_phases(samples, system.period)
    return StateSpace(
        system, omega, phase, coefficients(system, omega, _after(system, phase)), signals(system)
    )


def _after(system: PeriodicSystem, phase: Array) -> Array:
    """Return the phases (k,). A phase at a jump of the matrices is moved to just after the jump."""
    period, inset = system.period, SAME_PHASE * system.period
    distance = np.remainder(phase[:, None] - np.array(system.breaks) + period / 2, period) - period / 2
    return phase + 2 * inset * (np.abs(distance) <= inset).any(axis=1)


def python_control() -> Any:
    """Module `control` of the package python-control. Raises MissingLibraryError."""
    try:
        import control
    except ImportError:
        raise MissingLibraryError.of_extra("a state space of python-control", "control", "control") from None
    return control


def labels(names: Iterable[str]) -> list[str]:
    """Names of signals for python-control, which permits no dots.

    >>> labels(["force_q.1"])
    ['force_q_1']
    """
    return [name.replace(".", "_") for name in names]
