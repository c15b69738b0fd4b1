"""Base of closed loops: a system with a feedback of its own to the inputs."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from copy import copy
from typing import Any, Self

import numpy as np

from solve.arrays import Array, Plane
from solve.contracts import Columns, Integrator, Matrices, Motion
from solve.first_order import MixedSystem
from solve.labels import Labels
from solve.model.model import Model
from solve.studies.control.integration import FeedbackIntegrator
from solve.studies.control.plant import state_names
from solve.system import PeriodicSystem

_LABELS = [name for name, value in vars(Labels).items() if not callable(value) and not name.startswith("_")]
_OWN = ("n", "first_order", "multiplier_count", "coordinates", "inputs", "outputs", "states", "name")


class FeedbackLoop(MixedSystem):
    """System with feedback. Its inputs NAME_disturbance are added to those of the feedback, which are
    outputs.

    open_loop: the system without feedback, or its equations linearised about a motion; model: the system
    itself; design: the system for which the feedback was designed, which an observer contains.

    Parameters
    ----------
    system : PeriodicSystem
        System with inputs.
    further : sequence of str
        Coordinates that the feedback adds, behind those with second derivatives of the system.
    estimates : sequence of str
        States that the feedback adds, behind those of the system.
    """

    def __init__(self, system: PeriodicSystem, further: Sequence[str] = (), estimates: Sequence[str] = ()):
        inertial = system.coordinates[: system.n - system.first_order]
        states = (*system.states, *estimates)
        super().__init__(system.at, [*inertial, *further], states, system.period, system.breaks)
        self.design = system
        self._take(system)
        self.inputs = tuple(f"{name}_disturbance" for name in system.inputs)
        self.outputs = (*system.outputs, *system.inputs)

    def _take(self, system: PeriodicSystem) -> None:
        """Use a system with other parameters, and its labels."""
        self.open_loop, self.model = system, system
        vars(self).update({name: getattr(system, name) for name in _LABELS if name not in _OWN})
        self.name, self.breaks = f"{system.name} with feedback", system.breaks
        names, units = state_names(system), dict(system.units)
        rates = {name: f"{units.get(name.removesuffix('_dot'), '')}/s" for name in names[system.n :]}
        estimates = {f"{name}_hat": unit for name, unit in {**units, **rates}.items() if name in names}
        forces = {f"{name}_disturbance": units.get(name, "") for name in system.inputs}
        self.units = {**units, **estimates, **forces}

    @property
    def n_open(self) -> int:
        """Number of coordinates of the system without feedback."""
        return self.open_loop.n

    @abstractmethod
    def closed(self, phase: Array, speed: Any, matrices: Matrices, inputs: Array, observed: Any) -> Matrices:
        """M, C, K and d of the closed loop at phases (k,) and a speed, a number or (k,).

        matrices, inputs: those of the system without feedback; observed: a function that returns the matrices
        of the system of the design and those of its inputs."""

    @abstractmethod
    def inputs_of(self, phase: Array, speed: Any, q: Array, qd: Array) -> Array:
        """u (r, k) at phases (k,) and a speed, a number or (k,), for states q and q̇ (n, k)."""

    def at(self, phase: Array, speed: float) -> Matrices:
        def observed() -> tuple[Matrices, Array]:
            return self.design.at(phase, speed), self.design.input_matrix(phase, speed)

        system = self.open_loop
        matrices, inputs = system.at(phase, speed), system.input_matrix(phase, speed)
        return self.closed(phase, speed, matrices, inputs, observed)

    def varying(self, phase: Array, speed: Array, acceleration: float) -> Matrices:
        return self._varying_by(
            phase, speed, acceleration, self.open_loop.varying(phase, speed, acceleration)
        )

    def _varying_by(self, phase: Array, speed: Any, acceleration: float, matrices: Matrices) -> Matrices:
        """Matrices of the closed loop at speeds (k,) that change, from those of the system."""

        def observed() -> tuple[Matrices, Array]:
            return self.design.varying(phase, speed, acceleration), self.design.input_matrix(phase, speed)

        return self.closed(phase, speed, matrices, self.open_loop.input_matrix(phase, speed), observed)

    def marcher(self, sizes: Array, count: int, rtol: float) -> Integrator:
        system = self.model
        if not (isinstance(system, Model) and system.nonlinear):
            return super().marcher(sizes, count, rtol)

        def equations(phase: Array, speed: Array, acceleration: float, q: Array, qd: Array) -> Matrices:
            state = q[:, : system.n], qd[:, : system.n]
            matrices = system.varying_about(phase, speed, acceleration, *state)
            return self._varying_by(phase, speed, acceleration, matrices)

        return FeedbackIntegrator(equations, self.first_order, self.period, sizes, count, rtol)

    def input_matrix(self, phase: Array, speed: float) -> Array:
        B, n = np.zeros((len(phase), self.n, len(self.inputs))), self.n_open
        B[:, :n] = self.open_loop.input_matrix(phase, speed)
        return B

    def output_values(
        self, phase: Array, speed: Array | float, q: Array, qd: Array, qdd: Array, acceleration: float = 0.0
    ) -> Mapping[str, Array]:
        n = self.n_open
        values = self.model.output_values(phase, speed, q[:n], qd[:n], qdd[:n], acceleration)
        u = self.inputs_of(phase, speed, q, qd)
        return {**values, **dict(zip(self.open_loop.inputs, u, strict=True))}

    def varied(
        self, parameters: Mapping[str, float] | None = None, options: Mapping[str, Any] | None = None
    ) -> Self:
        """Closed loop of the system with some parameters and options changed, and the same feedback."""
        made = copy(self)
        made._take(self.model.varied(parameters, options))
        return made

    def require_bounds(self, parameters: Mapping[str, float]) -> None:
        self.model.require_bounds(parameters)

    def sketched(self, phase: Array, speed: float, q: Array, fineness: float = 1.0) -> Mapping[str, Plane]:
        return self.model.sketched(phase, speed, q[: self.n_open], fineness)

    def require_desired_motion(self, speeds: Array) -> None:
        self.model.require_desired_motion(speeds)

    @property
    def nonlinear(self) -> bool:
        return self.model.nonlinear

    @property
    def moves_breaks(self) -> bool:
        return self.model.moves_breaks

    def along(self, motion: Motion, compiled: Columns | None = None) -> PeriodicSystem:
        return self._about(self.model.along(self._of_system(motion), compiled))

    def along_events(self, motion: Motion, speed: float, compiled: Columns | None = None) -> PeriodicSystem:
        return self._about(self.model.along_events(self._of_system(motion), speed, compiled))

    def roundoff(self, phase: Array, speed: float) -> Array:
        bounds = np.zeros((len(phase), self.n))
        bounds[:, : self.n_open] = self.open_loop.roundoff(phase, speed)
        return bounds

    def _about(self, linearised: PeriodicSystem) -> "FeedbackLoop":
        """Closed loop with the equations linearised about a motion; the feedback is linear already."""
        made = copy(self)
        made.open_loop, made.events = linearised, linearised.events
        made.breaks, made.period = linearised.breaks, linearised.period
        return made

    def _of_system(self, motion: Motion) -> Motion:
        """Motion of the coordinates of the system alone."""
        return motion if self.n == self.n_open else _Leading(motion, self.n_open)


class _Leading:
    """The first n coordinates of a motion."""

    def __init__(self, motion: Motion, n: int):
        self._motion, self._n = motion, n

    @property
    def nodes(self) -> Array:
        return self._motion.nodes

    def __call__(self, phase: Array, derivative: int = 0) -> Array:
        return self._motion(phase, derivative)[: self._n]
