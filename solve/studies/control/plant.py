"""State-space form ẋ = A x + B u + b of a system with inputs at a speed, and the rows C of its outputs."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from solve.arrays import Array, definite_solved
from solve.contracts import Matrices
from solve.equations import derivatives_of, input_matrix
from solve.errors import ControlError, ValueOutOfBoundsError, require_name
from solve.first_order import FirstOrderSystem
from solve.matrices import leading
from solve.model.model import LinearisedModel, Model
from solve.system import PeriodicSystem


@dataclass(frozen=True)
class Plant:
    """System at a speed in rad/s, in state-space form with the states x = (q, q̇). For the rows of outputs,
    the speed may be an array with one value per phase."""

    system: PeriodicSystem
    speed: float

    @cached_property
    def states(self) -> tuple[str, ...]:
        """Names of the N states: the coordinates, and NAME_dot for each coordinate with a second
        derivative."""
        return state_names(self.system)

    @property
    def N(self) -> int:
        return len(self.states)

    def dynamics(self, phase: Array) -> tuple[Array, Array, Array]:
        """Return A (k, N, N), B (k, N, r) and b (k, N) at phases (k,)."""
        system = self.system
        inputs = input_matrix(system, phase, self.speed)
        return state_equations(system.at(phase, self.speed), inputs, len(system.states))

    def input_matrix(self, phase: Array) -> Array:
        """Return only the matrix B (k, N, r) of `dynamics`."""
        system, first_order = self.system, len(self.system.states)
        M, C, *_ = system.at(phase, self.speed)
        rates = definite_solved(leading(M, C, first_order), input_matrix(system, phase, self.speed))
        return _by_rates(rates, first_order)

    def require_inputs(self) -> None:
        """Raise ControlError if the system has no inputs."""
        if not self.system.inputs:
            raise ControlError(
                f"{self.system.labels.name} has no inputs; declare them, for example with "
                'mechanism.input("u", "N", along=q1), or create the system with the argument `inputs`; see '
                "docs/control.md"
            )

    def rows(self, names: Sequence[str], phase: Array) -> Array:
        """Return matrices C (k, y, N) at phases (k,). The products C x are the linear terms of the named
        states and outputs.

        Raises UnknownNameError, and ValueOutOfBoundsError for an output that depends on accelerations."""
        system, outputs = self.system, self.require_names(names)
        rows = np.zeros((len(phase), len(names), self.N))
        for at, name in enumerate(names):
            if name in self.states:
                rows[:, at, self.states.index(name)] = 1.0
            elif isinstance(system, FirstOrderSystem):
                C = system.equations_at(phase, self.speed)[3]
                rows[:, at] = C[:, outputs.index(name)]
            else:
                rows[:, at] = self._output_row(name, phase)
        return rows

    def require_names(self, names: Sequence[str]) -> Sequence[str]:
        """Return the names of the outputs for which `rows` is available. Raises UnknownNameError for names
        that are neither states nor such outputs."""
        system = self.system
        outputs = system.outputs if isinstance(system, FirstOrderSystem) else linear_outputs(system)
        for name in names:
            require_name("state or output", name, [*self.states, *outputs])
        return outputs

    def _output_row(self, name: str, phase: Array) -> Array:
        """Return the derivatives (k, N) of a model's output with respect to the states."""
        state = reference_state(self.system, phase, self.speed)
        slopes = output_slopes(self.system, [name], phase, self.speed, state)[:, 0]
        if slopes[:, 0].any():
            raise ValueOutOfBoundsError(
                f"{name} depends on accelerations, which the inputs change directly; allowed: states, and "
                f"outputs without accelerations, such as {self.states[0]}"
            )
        return np.concatenate((slopes[:, 2], slopes[:, 1]), axis=-1)


def state_equations(matrices: Matrices, inputs: Array, first_order: int) -> tuple[Array, Array, Array]:
    """Return A (k, N, N), B (k, N, r) and b (k, N) of ẋ = A x + B u + b, from M, C, K, d and the input matrix
    (k, n, r). The last `first_order` coordinates are of first order."""
    M, C, K, d = matrices
    n = d.shape[1]
    p = n - first_order
    given = np.concatenate((-K, -C[..., :p], d[..., None], inputs), axis=-1)
    rate = _by_rates(definite_solved(leading(M, C, first_order), given), first_order)
    rate[:, :p, n : n + p] = np.eye(p)
    return rate[..., : n + p], rate[..., n + p + 1 :], rate[..., n + p]


def _by_rates(highest: Array, first_order: int) -> Array:
    """Return the rows (k, N, c) of the equations for ẋ, from the rows (k, n, c) of the equations for the
    highest derivatives. The rows for the velocities of second-order coordinates are zero."""
    k, n, c = highest.shape
    p = n - first_order
    rows = np.zeros((k, n + p, c))
    rows[:, n:], rows[:, p:n] = highest[:, :p], highest[:, p:]
    return rows


def state_names(system: PeriodicSystem) -> tuple[str, ...]:
    """Return the names of the states x = (q, q̇) of a system."""
    inertial = system.coordinates[: system.n - len(system.states)]
    return *system.coordinates, *(f"{name}_dot" for name in inertial)


def linear_outputs(system: PeriodicSystem) -> Sequence[str]:
    """Return the names of the outputs that are differentiable with respect to the states."""
    return system.outputs if isinstance(system, Model) and not system.assembled else ()


def reference_state(system: PeriodicSystem, phase: Array, speed: float) -> Array:
    """Return the values of q̈, q̇ and q (3, n, k), at k phases, about which outputs are linearised: the
    motion of a `LinearisedModel`, and otherwise 0."""
    if not isinstance(system, LinearisedModel):
        return np.zeros((3, system.n, len(phase)))
    return np.stack([speed**k * system.motion(phase, k) for k in (2, 1, 0)])


def output_slopes(
    system: PeriodicSystem, names: Sequence[str], phase: Array, speed: float, state: Array
) -> Array:
    """Return the derivatives (k, p, 3, n) of p outputs with respect to q̈, q̇ and q, whose values are `state`
    (3, n, k)."""
    rates = np.asarray(speed)[..., None, None] ** np.array([2.0, 1.0, 0.0])[:, None]
    # `Dependence` uses derivatives with respect to the phase.
    dependence, states = derivatives_of(system).by(()), np.moveaxis(state, -1, 0) / rates
    return np.stack([dependence.output(name, phase, speed, states)[1] / rates for name in names], axis=1)
