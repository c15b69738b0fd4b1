"""Base of closed loops: a system whose inputs are set by feedback."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import replace
from typing import Any, Self

import numpy as np

from solve.arrays import CACHE_SIZE, Array, Plane
from solve.capabilities import Capabilities, Linearisation, Nonlinear, Outputs, Variation
from solve.contracts import Columns, Dependence, Events, Integrator, Matrices, Motion, ParameterDerivatives
from solve.equations import (
    event_normals,
    events_of,
    input_matrix,
    nonlinear_of,
    output_values,
    require_bounds,
    roundoff_of,
    sketched,
    varying_of,
)
from solve.errors import NoDerivativeError
from solve.first_order import MixedSystem
from solve.model.model import Model
from solve.studies.control.integration import FeedbackIntegrator
from solve.studies.control.plant import state_names
from solve.system import PeriodicSystem

_BYTES = 2**21
"""Largest size, in bytes, of the matrix entries on a grid that are cached. Caching helps because the
solutions and the error estimates on one grid evaluate the same phases up to four times. Chosen by
judgement."""


class FeedbackLoop(MixedSystem, Outputs, Linearisation, Variation, Nonlinear):
    """System whose inputs are set by feedback; the inputs become outputs. Its own inputs NAME_disturbance are
    added to the values that the feedback sets.

    `model` is the system without feedback. `open_loop` is this system, or its equations linearised about a
    motion. `design` is the system for which the feedback was designed; an observer uses the equations of
    `design`.

    Parameters
    ----------
    system : PeriodicSystem
        System with inputs.
    further : sequence of str
        Coordinates that the feedback adds, after the second-order coordinates of the system.
    estimates : sequence of str
        States that the feedback adds, after those of the system.
    """

    def __init__(self, system: PeriodicSystem, further: Sequence[str] = (), estimates: Sequence[str] = ()):
        inertial = system.coordinates[: system.n - len(system.states)]
        states = (*system.states, *estimates)
        super().__init__(system.at, [*inertial, *further], states, system.period, system.breaks)
        self.design = system
        self._take(system)
        self.inputs = tuple(f"{name}_disturbance" for name in system.inputs)
        self.outputs = (*system.outputs, *system.inputs)

    def _take(self, system: PeriodicSystem) -> None:
        """Set the system without feedback, and derive the labels of the closed loop from it."""
        self.open_loop, self.model, self.breaks, self.events = system, system, system.breaks, Events()
        self._kept: dict[tuple[bytes, float], tuple[Array, Array]] = {}
        names, units = state_names(system), dict(system.labels.units)
        rates = {name: f"{units.get(name.removesuffix('_dot'), '')}/s" for name in names[system.n :]}
        estimates = {f"{name}_hat": unit for name, unit in {**units, **rates}.items() if name in names}
        forces = {f"{name}_disturbance": units.get(name, "") for name in system.inputs}
        name = f"{system.labels.name} with feedback"
        self.labels = replace(system.labels, name=name, units={**units, **estimates, **forces})

    @property
    def n_open(self) -> int:
        """Number of coordinates of the system without feedback."""
        return self.open_loop.n

    @abstractmethod
    def closed(self, phase: Array, speed: Any, matrices: Matrices, inputs: Array, observed: Any) -> Matrices:
        """Return M, C, K and d of the closed loop at phases (k,). The speed is a number or an array (k,).

        `matrices` and `inputs` are M, C, K, d and the input matrix of the system without feedback. `observed`
        is a function that returns the same quantities for the system for which the feedback was designed."""

    @abstractmethod
    def inputs_of(self, phase: Array, speed: Any, q: Array, qd: Array) -> Array:
        """Return u (r, k) at phases (k,), for q and q̇ (n, k). The speed is a number or an array (k,)."""

    def at(self, phase: Array, speed: float) -> Matrices:
        def observed() -> tuple[Matrices, Array]:
            return self.design.at(phase, speed), input_matrix(self.design, phase, speed)

        system = self.open_loop
        matrices, inputs = system.at(phase, speed), input_matrix(system, phase, speed)
        return self.closed(phase, speed, matrices, inputs, observed)

    def used_entries(self, phase: Array, speed: float) -> tuple[Array, Array]:
        key = phase.tobytes(), speed
        used = self._kept.get(key)
        if used is None:
            used = super().used_entries(phase, speed)
            if len(self._kept) >= CACHE_SIZE:
                self._kept.clear()
            if used[0].nbytes <= _BYTES:
                self._kept[key] = used
        return used

    @property
    def capabilities(self) -> Capabilities:
        model_capabilities = self.model.capabilities
        return super().capabilities._replace(
            outputs=self,
            nonlinear=None if model_capabilities.nonlinear is None else self,
            linearisation=self,
            variation=self,
            domain=model_capabilities.domain,
            sketch=None if model_capabilities.sketch is None else self._sketched,
            varying=None if model_capabilities.varying is None else self._varying_at,
        )

    def _varying_at(self, phase: Array, speed: Array, acceleration: float) -> Matrices:
        matrices = varying_of(self.open_loop)(phase, speed, acceleration)
        return self._varying_by(phase, speed, acceleration, matrices)

    def _varying_by(self, phase: Array, speed: Any, acceleration: float, matrices: Matrices) -> Matrices:
        """Return the matrices of the closed loop for a varying speed (k,). `matrices` are those of the system
        without feedback."""

        def observed() -> tuple[Matrices, Array]:
            matrices = varying_of(self.design)(phase, speed, acceleration)
            return matrices, input_matrix(self.design, phase, speed)

        return self.closed(phase, speed, matrices, input_matrix(self.open_loop, phase, speed), observed)

    def marcher(self, sizes: Array, count: int, rtol: float) -> Integrator:
        system = self.model
        if not isinstance(system, Model):
            return nonlinear_of(system).marcher(sizes, count, rtol)

        def equations(phase: Array, speed: Array, acceleration: float, q: Array, qd: Array) -> Matrices:
            state = q[:, : system.n], qd[:, : system.n]
            matrices = system.tangent.varying(phase, speed, acceleration, *state)
            return self._varying_by(phase, speed, acceleration, matrices)

        return FeedbackIntegrator(equations, len(self.states), self.period, sizes, count, rtol)

    def _inputs_at(self, phase: Array, speed: float) -> list[Array]:
        B, n = np.zeros((len(phase), self.n, len(self.inputs))), self.n_open
        B[:, :n] = input_matrix(self.open_loop, phase, speed)
        return [B]

    def output_values(
        self, phase: Array, speed: Array | float, q: Array, qd: Array, qdd: Array, acceleration: float = 0.0
    ) -> Mapping[str, Array]:
        n = self.n_open
        values = output_values(self.model, phase, speed, q[:n], qd[:n], qdd[:n], acceleration)
        u = self.inputs_of(phase, speed, q, qd)
        return {**values, **dict(zip(self.open_loop.inputs, u, strict=True))}

    def varied(
        self, parameters: Mapping[str, Any] | None = None, options: Mapping[str, Any] | None = None
    ) -> Self:
        """Closed loop with the same feedback, in which some parameters and options of the system are
        changed."""
        return self.around(self.model.varied(parameters, options))

    def around(self, system: PeriodicSystem) -> Self:
        """Closed loop with the same feedback and another system that has the same states and inputs."""
        changed = copy(self)
        changed._take(system)
        return changed

    def require_bounds(self, parameters: Mapping[str, float]) -> None:
        require_bounds(self.model, parameters)

    def many_points(self, names: Sequence[str]) -> None:
        """Return None, because each point requires its own system."""

    def _sketched(self, phase: Array, speed: float, q: Array, fineness: float) -> Mapping[str, Plane]:
        return sketched(self.model, phase, speed, q[: self.n_open], fineness)

    @property
    def derivatives(self) -> ParameterDerivatives:
        """Object that rejects every parameter, because derivatives are not available."""
        return _NoDerivatives(self)

    @property
    def moves_breaks(self) -> bool:
        variation = self.model.capabilities.variation
        return variation is not None and variation.moves_breaks

    def along(self, motion: Motion, compiled: Columns | None = None) -> PeriodicSystem:
        return self._about(nonlinear_of(self.model).along(self._of_system(motion), compiled))

    def along_events(self, motion: Motion, speed: float, compiled: Columns | None = None) -> PeriodicSystem:
        return self._about(nonlinear_of(self.model).along_events(self._of_system(motion), speed, compiled))

    def event_normals(self, motion: Motion, speed: float, phases: Array, names: Sequence[str] = ()) -> Array:
        n = self.n_open
        open_loop_normals = event_normals(self.open_loop, self._of_system(motion), speed, phases, names)
        normals = np.zeros((len(open_loop_normals), 1 + 2 * self.n + len(names)))
        normals[:, : n + 1], normals[:, self.n + 1 : self.n + 1 + n] = (
            open_loop_normals[:, : n + 1],
            open_loop_normals[:, n + 1 : 2 * n + 1],
        )
        normals[:, 2 * self.n + 1 :] = open_loop_normals[:, 2 * n + 1 :]
        return normals

    def roundoff(self, phase: Array, speed: float) -> Array:
        bounds = np.zeros((len(phase), self.n))
        bounds[:, : self.n_open] = roundoff_of(self.open_loop, phase, speed)
        return bounds

    def _about(self, linearised: PeriodicSystem) -> "FeedbackLoop":
        """Return the closed loop in which the equations of the system are linearised about a motion. The
        feedback is already linear."""
        loop = copy(self)
        loop.open_loop, loop.events, loop._kept = linearised, events_of(linearised), {}
        loop.breaks, loop.period = linearised.breaks, linearised.period
        return loop

    def _of_system(self, motion: Motion) -> Motion:
        """Return the motion of the coordinates of the system, without those that the feedback adds."""
        return motion if self.n == self.n_open else _Leading(motion, self.n_open)


class _NoDerivatives:
    """Derivatives object that rejects every parameter; see `ParameterDerivatives`."""

    names: tuple[str, ...] = ()

    def __init__(self, loop: FeedbackLoop):
        self._loop = loop

    def of_breaks(self, names: Sequence[str]) -> Array:
        """Derivatives (b, 0) of the breaks: an empty array."""
        return np.zeros((len(self._loop.breaks), 0))

    def by(self, names: Sequence[str], compiled: Columns | None = None) -> Dependence:
        """Raise NoDerivativeError for any parameter."""
        raise NoDerivativeError(
            f"{self._loop.labels.name} has no equations that can be differentiated; use "
            "solve.OutputFeedback, whose gains have derivatives"
        )


class _Leading:
    """The first n coordinates of a motion."""

    def __init__(self, motion: Motion, n: int):
        self._motion, self._n = motion, n

    @property
    def nodes(self) -> Array:
        return self._motion.nodes

    def __call__(self, phase: Array, derivative: int = 0) -> Array:
        return self._motion(phase, derivative)[: self._n]
