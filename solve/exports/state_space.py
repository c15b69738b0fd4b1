"""Linearised equations as state space over the phase: x′ = A x + B (u + d), y = C x + D (u + d) + y₀, with
derivatives by time, x = (q, q̇), forces u along the coordinates beside the load d."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from solve.argument import require_whole
from solve.arrays import Array
from solve.errors import ValueOutOfBoundsError
from solve.exports.extras import labels, library
from solve.model.model import Model, ModelAlong
from solve.period.points import rate_of
from solve.sizes import require_size
from solve.system import PeriodicSystem, of_system
from solve.units import speed_in_si

if TYPE_CHECKING:
    import control

SAMPLES = 360
"""Of a period, by default: at every degree of a turn."""

_INSET = 1e-12
"""Part of a period within which a sample counts as one at a jump."""

_FORCES = {"m": "N", "rad": "N m"}
"""Units of the force along a coordinate, by that of the coordinate."""


class Coefficients(NamedTuple):
    """At k phases: A (k, 2n, 2n), B (k, 2n, n), C (k, p, 2n), D (k, p, n), the load d (k, n), and y₀ (k, p),
    the outputs without states and forces; also M, damping and stiffness (k, n, n), of which they follow."""

    A: Array
    B: Array
    C: Array
    D: Array
    d: Array
    y0: Array
    mass: Array
    damping: Array
    stiffness: Array


class Signals(NamedTuple):
    """Names of states, inputs and outputs, and the units of each."""

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    state_units: tuple[str, ...]
    input_units: tuple[str, ...]
    output_units: tuple[str, ...]


def signals(system: PeriodicSystem) -> Signals:
    """Of the state space of a system: q and q_dot, force_q; all coordinates, then outputs of a model whose
    derivatives are known."""
    names = system.coordinates
    units = [system.units.get(name, "") for name in names]
    known = _linear_outputs(system)
    return Signals(
        (*names, *(f"{name}_dot" for name in names)),
        tuple(f"force_{name}" for name in names),
        (*names, *known),
        (*units, *(f"{unit}/s" if unit not in ("", "1") else "1/s" for unit in units)),
        tuple(_FORCES.get(unit, "") for unit in units),
        (*units, *(system.units.get(name, "") for name in known)),
    )


def coefficients(system: PeriodicSystem, speed: float, phase: Array) -> Coefficients:
    """At phases (k,) and a speed in rad/s."""
    n, k = system.n, len(phase)
    M, damping, K, d = system.at(phase, speed)
    inverse = np.linalg.inv(M)
    rate = rate_of(M, damping, K, d)[..., :-1]
    B = np.concatenate((np.zeros_like(inverse), inverse), axis=1)
    C, D = np.zeros((k, n, 2 * n)), np.zeros((k, n, n))
    C[:, :, :n] = np.eye(n)
    y0 = np.zeros((k, n))
    names = _linear_outputs(system)
    if names:
        about = _about(system, phase, speed)
        slopes = _output_slopes(system, names, phase, speed, about)
        by_a, by_v, by_q = slopes[..., 0, :], slopes[..., 1, :], slopes[..., 2, :]
        moving = np.concatenate((by_q, by_v), axis=-1) + by_a @ rate[:, n:]
        C, D = np.concatenate((C, moving), axis=1), np.concatenate((D, by_a @ inverse), axis=1)
        values = system.output_values(phase, speed, *about[::-1])
        there = np.stack([values[name] for name in names], axis=1)
        there -= np.einsum("kpsn,snk->kp", slopes, about)
        y0 = np.concatenate((y0, there), axis=1)
    return Coefficients(rate, B, C, D, d, y0, M, damping, K)


def _linear_outputs(system: PeriodicSystem) -> Sequence[str]:
    """Outputs whose derivatives by the states are known."""
    return system.outputs if isinstance(system, Model) and not system.assembled else ()


def _about(system: PeriodicSystem, phase: Array, speed: float) -> Array:
    """q̈, q̇, q (3, n, k) about which outputs are linearised: those of the motion along which the equations
    are, else 0."""
    if not isinstance(system, ModelAlong):
        return np.zeros((3, system.n, len(phase)))
    return np.stack([speed**k * system.motion(phase, k) for k in (2, 1, 0)])


def _output_slopes(
    system: PeriodicSystem, names: Sequence[str], phase: Array, speed: float, about: Array
) -> Array:
    """Derivatives (k, p, 3, n) of outputs by q̈, q̇ and q, at these (3, n, k)."""
    rates = speed ** np.array([2.0, 1.0, 0.0])[:, None]
    # Those of a dependence are by derivatives by the phase, and so are the states that it takes.
    dependence, states = system.dependence(()), np.moveaxis(about, -1, 0) / rates
    return np.stack([dependence.output(name, phase, speed, states)[1] for name in names], axis=1) / rates


@dataclass(frozen=True, repr=False)
class StateSpace:
    """x′ = A x + B (u + d), y = C x + D (u + d) + y₀ over one period, derivatives by time.

    phase (m,): even, from 0, without the end of the period. A (m, 2n, 2n), B (m, 2n, n), C (m, p, 2n),
    D (m, p, n) at these phases; d (m, n): the load, which drives the vibration and is added to the inputs;
    y0 (m, p): outputs without states and forces. speed in rad/s. SI units.
    """

    system: PeriodicSystem
    speed: float
    phase: Array
    coefficients: Coefficients
    signals: Signals

    @property
    def A(self) -> Array:
        return self.coefficients.A

    @property
    def B(self) -> Array:
        return self.coefficients.B

    @property
    def C(self) -> Array:
        return self.coefficients.C

    @property
    def D(self) -> Array:
        return self.coefficients.D

    @property
    def d(self) -> Array:
        return self.coefficients.d

    @property
    def y0(self) -> Array:
        return self.coefficients.y0

    def frozen(self, phase: float) -> "control.StateSpace":
        """The system held still at a phase, at a jump just behind it, for python-control: poles there say
        nothing of stability, which is that of the whole turn. Raises MissingLibraryError,
        ValueOutOfBoundsError."""
        control = library("control", "control", "a state space of python-control")
        try:
            place = float(phase)
        except (TypeError, ValueError):
            place = math.nan
        if not math.isfinite(place):
            raise ValueOutOfBoundsError(f"phase is {phase}; allowed: a finite one, in rad")
        at = coefficients(self.system, self.speed, _after(self.system, np.array([place])))
        names = self.signals
        return control.StateSpace(
            *(part[0] for part in (at.A, at.B, at.C, at.D)),
            states=labels(names.states),
            inputs=labels(names.inputs),
            outputs=labels(names.outputs),
        )

    def __repr__(self) -> str:
        names = self.signals
        return (
            f"State space of {self.system.name} at {self.system.speed_unit.text(self.speed)}, "
            f"{len(self.phase)} phases\nstates  {', '.join(names.states)}\n"
            f"inputs  {', '.join(names.inputs)}\noutputs {', '.join(names.outputs)}"
        )


@of_system
def state_space(system: PeriodicSystem, speed: float | str, samples: int = SAMPLES) -> StateSpace:
    """The linearised equations at a speed (rad/s, or a text with unit) as a state space over the phase, at so
    many even phases of a period.

    Inputs are forces along the coordinates; outputs the coordinates, and those of a model that is given by
    formulas, linearised about q = 0 (a structure of beams has its coordinates alone). The system of a
    nonlinear orbit, `solve.nonlinear(…).system`, is linearised about that orbit, outputs too. At a jump of
    the matrices the value after it stands. Raises SolveError subclasses for bad input, NoMotionError.

    >>> import numpy as np
    >>> def oscillator(phase, speed):
    ...     one = np.ones((len(phase), 1, 1))
    ...     return 2 * one, 0.1 * one, 4.0 * one, np.cos(phase)[:, None]
    >>> made = state_space(PeriodicSystem(oscillator, ["q"]), 1.0, samples=8)
    >>> made.A[0].tolist(), made.B[0].tolist()
    ([[0.0, 1.0], [-2.0, -0.05]], [[0.0], [0.5]])
    """
    omega = speed_in_si(speed)
    system.require_motion()
    require_whole("samples", samples)
    system.checked(omega)
    system = system.shown_in(omega)
    require_size("samples", samples, each=20 * (system.n + len(system.outputs)) * system.n)
    phase = np.arange(samples) * (system.period / samples)
    return StateSpace(
        system, omega, phase, coefficients(system, omega, _after(system, phase)), signals(system)
    )


def _after(system: PeriodicSystem, phase: Array) -> Array:
    """Phases (k,), those at a jump of the matrices just behind it."""
    period, inset = system.period, _INSET * system.period
    apart = np.remainder(phase[:, None] - np.array(system.breaks) + period / 2, period) - period / 2
    return phase + 2 * inset * (np.abs(apart) <= inset).any(axis=1)
