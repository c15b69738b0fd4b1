"""Closed loop of a system and a periodic state feedback, or an observer with the feedback."""

from collections.abc import Mapping
from copy import copy
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from solve.arrays import Array, Plane
from solve.capabilities import Capabilities, Outputs
from solve.contracts import Columns, Events, Matrices, Motion
from solve.equations import (
    events_of,
    input_matrix,
    nonlinear_of,
    output_values,
    roundoff_of,
    sketched,
)
from solve.first_order import MixedSystem
from solve.period.curve import Curve
from solve.studies.control.plant import Plant, state_names
from solve.system import PeriodicSystem


class Observer(NamedTuple):
    """Observer x̂′ = A x̂ + b + B u + L (y − C x̂) of the measured quantities y.

    gain: curve of L (N y,) over the phase. measured: names of y."""

    gain: Curve
    measured: tuple[str, ...]


class ClosedLoop(MixedSystem, Outputs):
    """System with u = −K(φ)x + f(φ), or u = −K(φ)x̂ + f(φ) with the estimates x̂ of an observer as states.

    The load of the system is known to the observer. The inputs are further outputs. At other speeds than
    that of the design, the gains keep their values at each phase.

    Parameters
    ----------
    system : PeriodicSystem
        System with inputs.
    gain : Curve
        Curve of K (r N,) over the phase.
    observer : Observer, optional
        Observer of the states.
    ahead : Curve, optional
        Curve of the feedforward f (r,) over the phase.
    """

    def __init__(
        self,
        system: PeriodicSystem,
        gain: Curve,
        observer: Observer | None = None,
        ahead: Curve | None = None,
    ):
        names = state_names(system)
        estimates = () if observer is None else tuple(f"{name}_hat" for name in names)
        inertial = system.coordinates[: system.n - len(system.states)]
        states = (*system.states, *estimates)
        super().__init__(system.at, inertial, states, system.period, system.breaks)
        self.open_loop, self.model, self.gain, self.observer = system, system, gain, observer
        self.ahead, self.events = ahead, Events()
        self.outputs = (*system.outputs, *system.inputs)
        labels = system.labels
        rates = {name: f"{labels.units.get(name.removesuffix('_dot'), '')}/s" for name in names[system.n :]}
        units = {**rates, **labels.units}
        units = {**labels.units, **{f"{name}_hat": units.get(name, "") for name in names}}
        self.labels = replace(labels, name=f"{labels.name} with feedback", units=units)

    @property
    def n_open(self) -> int:
        """Number of coordinates without estimates."""
        return self.open_loop.n

    def feedback(self, phase: Array) -> Array:
        """K (k, r, N) at phases (k,)."""
        return self.gain(phase).T.reshape(len(phase), len(self.open_loop.inputs), -1)

    def at(self, phase: Array, speed: float) -> Matrices:
        system, n = self.open_loop, self.n_open
        p = n - len(system.states)
        M, C, K, d = (np.array(part) for part in system.at(phase, speed))
        inputs = input_matrix(system, phase, speed)
        force = inputs @ self.feedback(phase)
        if self.ahead is not None:
            d += np.einsum("knr,rk->kn", inputs, self.ahead(phase))
        if self.observer is None:
            C[..., :p] += force[..., n:]
            return M, C, K + force[..., :n], d
        # The observer has the equations of the model, also where the system is linearised about a motion.
        plant = Plant(self.model, speed)
        A, B, b = plant.dynamics(phase)
        if self.ahead is not None:
            b = b + np.einsum("knr,rk->kn", B, self.ahead(phase))
        N = plant.N
        L = self.observer.gain(phase).T.reshape(len(phase), N, -1)
        shown = L @ plant.rows(self.observer.measured, phase)
        mass, damping, stiffness = (np.zeros((len(phase), n + N, n + N)) for _ in range(3))
        mass[:, :n, :n], damping[:, :n, :n], stiffness[:, :n, :n] = M, C, K
        stiffness[:, :n, n:], damping[:, n:, n:] = force, np.eye(N)
        stiffness[:, n:, :n], damping[:, n:, :p] = -shown[..., :n], -shown[..., n:]
        stiffness[:, n:, n:] = B @ self.feedback(phase) + shown - A
        return mass, damping, stiffness, np.concatenate((d, b), axis=1)

    def inputs_of(self, phase: Array, q: Array, qd: Array) -> Array:
        """u (r, k) at phases (k,) for states q and q̇ (n, k)."""
        n, system = self.n_open, self.open_loop
        x = np.concatenate((q, qd[: n - len(system.states)])) if self.observer is None else q[n:]
        u = -np.einsum("krn,nk->rk", self.feedback(phase), x)
        return u if self.ahead is None else u + self.ahead(phase)

    def output_values(
        self, phase: Array, speed: Array | float, q: Array, qd: Array, qdd: Array, acceleration: float = 0.0
    ) -> Mapping[str, Array]:
        n = self.n_open
        values = output_values(self.model, phase, speed, q[:n], qd[:n], qdd[:n], acceleration)
        return {**values, **dict(zip(self.open_loop.inputs, self.inputs_of(phase, q, qd), strict=True))}

    @property
    def capabilities(self) -> Capabilities:
        own = self.model.capabilities
        return super().capabilities._replace(
            outputs=self,
            nonlinear=None if own.nonlinear is None else self,
            linearisation=self,
            domain=own.domain,
            sketch=None if own.sketch is None else self._sketched,
        )

    def _sketched(self, phase: Array, speed: float, q: Array, fineness: float) -> Mapping[str, Plane]:
        return sketched(self.model, phase, speed, q[: self.n_open], fineness)

    def along(self, motion: Motion, compiled: Columns | None = None) -> PeriodicSystem:
        return self._about(nonlinear_of(self.model).along(self._without_estimates(motion), compiled))

    def along_events(self, motion: Motion, speed: float, compiled: Columns | None = None) -> PeriodicSystem:
        return self._about(
            nonlinear_of(self.model).along_events(self._without_estimates(motion), speed, compiled)
        )

    def event_normals(self, motion: Motion, speed: float) -> Array:
        return np.zeros((0, 1 + 2 * self.n))

    def roundoff(self, phase: Array, speed: float) -> Array:
        bounds = np.zeros((len(phase), self.n))
        bounds[:, : self.n_open] = roundoff_of(self.open_loop, phase, speed)
        return bounds

    def _about(self, linearised: PeriodicSystem) -> "ClosedLoop":
        """Closed loop with the equations linearised about a motion; the feedback is linear already."""
        made = copy(self)
        made.open_loop, made.events = linearised, events_of(linearised)
        made.breaks, made.period = linearised.breaks, linearised.period
        return made

    def _without_estimates(self, motion: Motion) -> Motion:
        """Motion of the coordinates of the system alone."""
        return motion if self.observer is None else _Leading(motion, self.n_open)


class _Leading:
    """The first n coordinates of a motion."""

    def __init__(self, motion: Motion, n: int):
        self._motion, self._n = motion, n

    @property
    def nodes(self) -> Array:
        return self._motion.nodes

    def __call__(self, phase: Array, derivative: int = 0) -> Array:
        return self._motion(phase, derivative)[: self._n]
