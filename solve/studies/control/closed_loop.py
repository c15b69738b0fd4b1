"""Closed loop of a system with periodic state feedback, or with an observer and feedback."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from solve.arrays import Array
from solve.contracts import Matrices
from solve.errors import ControlError
from solve.first_order import FirstOrderSystem
from solve.labels import Labels
from solve.period.curve import Curve
from solve.results import save
from solve.results.controller import Controller
from solve.results.serialization import StoredSystem
from solve.studies.control.feedback import FeedbackLoop
from solve.studies.control.plant import Plant, state_equations, state_names
from solve.system import PeriodicSystem, of_system


class Observer(NamedTuple):
    """Observer x̂′ = A x̂ + b + B u + L (y − C x̂) with measured quantities y.

    `gain` is the curve of the entries of L (N y,) versus phase; `measured` contains the names of y."""

    gain: Curve
    measured: tuple[str, ...]


class Compensator(FirstOrderSystem):
    """Regulator with an observer: x̂′ = (A − BK − LC) x̂ + b + B f + L y. Its inputs are y, and its outputs
    are u = −K x̂, to which the feedforward f must be added. Its load is b + B f.

    Parameters
    ----------
    loop : ClosedLoop
        Closed loop with an observer.
    """

    def __init__(self, loop: "ClosedLoop"):
        assert loop.observer is not None
        system, measured = loop.design, loop.observer.measured
        states = [f"{name}_hat" for name in state_names(system)]
        signals = [f"{name}_measured" for name in measured], system.inputs
        super().__init__(self._equations, states, system.period, system.breaks, *signals)
        self._loop = loop
        labels = {"units": loop.labels.units, "speed_unit": system.labels.speed_unit}
        self.labels = Labels(name=f"controller of {system.labels.name}", **labels)

    def _equations(self, phase: Array, speed: float) -> tuple[Array, ...]:
        loop, plant = self._loop, Plant(self._loop.design, speed)
        assert loop.observer is not None
        A, B, b = plant.dynamics(phase)
        K, L = loop.feedback(phase), loop.observer.gain(phase).T.reshape(len(phase), plant.N, -1)
        if loop.ahead is not None:
            b = b + np.einsum("knr,rk->kn", B, loop.ahead(phase))
        A = A - B @ K - L @ plant.rows(loop.observer.measured, phase)
        return A, b, L, -K, np.zeros((len(phase), K.shape[1], L.shape[2]))


class ClosedLoop(FeedbackLoop):
    """Closed loop with u = −K(φ)x + f(φ), or with u = −K(φ)x̂ + f(φ). The estimates x̂ of the observer are
    then additional states.

    The equations of the observer include the load of the system. The inputs of the system become additional
    outputs. If the speed or the parameters differ from those of the design, the gains at each phase remain
    the same.

    Parameters
    ----------
    system : PeriodicSystem
        System with inputs.
    gain : Curve
        Curve of the entries of K (r N,) versus phase.
    observer : Observer, optional
        Observer of the states.
    ahead : Curve, optional
        Curve of the feedforward f (r,) versus phase.
    """

    def __init__(
        self,
        system: PeriodicSystem,
        gain: Curve,
        observer: Observer | None = None,
        ahead: Curve | None = None,
    ):
        estimates = () if observer is None else [f"{name}_hat" for name in state_names(system)]
        super().__init__(system, (), estimates)
        self.gain, self.observer, self.ahead = gain, observer, ahead

    def feedback(self, phase: Array) -> Array:
        """Gain K (k, r, N) at phases (k,)."""
        return self.gain(phase).T.reshape(len(phase), len(self.open_loop.inputs), -1)

    def closed(
        self,
        phase: Array,
        speed: Any,
        matrices: Matrices,
        inputs: Array,
        observed: Callable[[], tuple[Matrices, Array]],
    ) -> Matrices:
        n, p = self.n_open, self.n_open - len(self.open_loop.states)
        M, C, K, d = map(np.array, matrices)
        force = inputs @ self.feedback(phase)
        if self.ahead is not None:
            d += np.einsum("knr,rk->kn", inputs, self.ahead(phase))
        if self.observer is None:
            C[..., :p] += force[..., n:]
            return M, C, K + force[..., :n], d
        # The observer contains the equations of the design system, even if the system itself is linearised
        # about a motion.
        A, B, b = state_equations(*observed(), len(self.design.states))
        if self.ahead is not None:
            b = b + np.einsum("knr,rk->kn", B, self.ahead(phase))
        N = A.shape[-1]
        L = self.observer.gain(phase).T.reshape(len(phase), N, -1)
        shown = L @ Plant(self.design, speed).rows(self.observer.measured, phase)
        mass, damping, stiffness = (np.zeros((len(phase), n + N, n + N)) for _ in range(3))
        mass[:, :n, :n], damping[:, :n, :n], stiffness[:, :n, :n] = M, C, K
        stiffness[:, :n, n:], damping[:, n:, n:] = force, np.eye(N)
        stiffness[:, n:, :n], damping[:, n:, :p] = -shown[..., :n], -shown[..., n:]
        stiffness[:, n:, n:] = B @ self.feedback(phase) + shown - A
        return mass, damping, stiffness, np.concatenate((d, b), axis=1)

    def inputs_of(self, phase: Array, speed: Any, q: Array, qd: Array) -> Array:
        n, system = self.n_open, self.open_loop
        x = np.concatenate((q, qd[: n - len(system.states)])) if self.observer is None else q[n:]
        u = -np.einsum("krn,nk->rk", self.feedback(phase), x)
        return u if self.ahead is None else u + self.ahead(phase)


@of_system
def closed_loop(system: PeriodicSystem, controller: Controller | str | Path) -> ClosedLoop:
    """Close the loop of a system with an existing controller.

    Parameters
    ----------
    system : PeriodicSystem
        System with the same states and inputs as the one for which the controller was designed. Its
        parameters may differ.
    controller : Controller, str or Path
        Result of `solve.lqr`, `solve.lqg` or `solve.control`, or the file to which it was saved.

    Returns
    -------
    ClosedLoop
        Closed loop for `solve.periodic`, `solve.sweep`, `solve.chart` and `solve.transient`. An observer
        keeps the equations, parameters and options of the design. A file contains no equations: the observer
        of a controller from a file uses the equations of `system`, with the parameters and options of the
        design if `system` has parameters.

    Raises
    ------
    ControlError
        For a filter alone, or for a controller with other states, inputs or period.
    FileError
        If the file cannot be read.

    Examples
    --------
    >>> import solve
    >>> press = solve.load("manipulator")
    >>> found = solve.lqr(press, "70 rpm", {"q2": 1e8}, {"u": 1e-3})
    >>> solve.floquet(closed_loop(press.varied({"k1": 5e4}), found), "70 rpm").verdict
    'asymptotically stable'
    """
    found = controller if isinstance(controller, Controller) else save.open(controller)
    if not isinstance(found, Controller) or found.kind == "kalman":
        what = "the Kalman filter" if isinstance(found, Controller) else f"{controller!r}"
        if isinstance(controller, str | Path):
            what = f"{str(controller)!r}"
        raise ControlError(
            f"{what} holds no feedback; allowed: a controller from solve.lqr, solve.lqg or "
            "solve.control with lqr, or its .npz or .nc file"
        )
    system_text, design_text = (
        f"the states {', '.join(states)}, the inputs {', '.join(inputs)} and the period {period:.6g}"
        for states, inputs, period in (
            (state_names(system), system.inputs or ("(none)",), system.period),
            (found.states, found.signals, found.system.period),
        )
    )
    if system_text != design_text:
        raise ControlError(
            f"the controller of {found.system.labels.name} is for {design_text}; {system.labels.name} has "
            f"{system_text}; design a controller for {system.labels.name}"
        )
    observer = found.observer and Observer(found.observer.gains, found.observer.signals)
    design = found.system
    if isinstance(design, StoredSystem):
        labels, varied = design.labels, system.capabilities.variation is not None
        design = system.varied(labels.parameters, labels.options) if varied else system
    return ClosedLoop(design, found.gains, observer, found.ahead).around(system)
