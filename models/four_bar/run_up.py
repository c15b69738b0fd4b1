"""Simulation of the vibration during a run-up with a moving ground pivot (section 7.5 of the thesis).

The independent variable is the crank angle φ. With Ω(φ) and Ω̇ = α, the equations of motion are Ω²M q″ + (ΩC
+ αM) q′ + K q = d. The load d consists of the inertia forces of the rigid motion, including those due to α
and to the motion of the pivot. M, C and K depend on the position. The steps of Radau's method are computed in
batches of one revolution."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from models.four_bar.linkage import BRANCHES, TURN, rates
from models.four_bar.plan import Plan
from models.four_bar.stress_map import StressMap, stress_rows
from solve import Radau
from solve.arrays import Array
from solve.beams.assembly import Positions
from solve.beams.motion import Motion, inertia_load
from solve.beams.structure import StructureModel
from solve.terminal import progress

_METHOD = Radau(order=7)
_STEPS, _SAMPLES = 64, 8
"""Number of steps per revolution, and number of crank angles per step at which the stress is evaluated.
Chosen by judgement."""


class Drive(NamedTuple):
    """Time (s), Ω (rad/s) and α (rad/s²) of the crank, and L4 (m) with its first two time derivatives; all
    are arrays (k,)."""

    time: Array
    speed: Array
    acceleration: Array
    L4: Array
    L4_velocity: Array
    L4_acceleration: Array


@dataclass(frozen=True)
class RunUp:
    """Execution of a plan, followed by two revolutions at the final speed.

    The speed increases with constant acceleration from `start` to the last speed of the plan (rad/s) within
    `duration` (s), and L4 follows the rounded plan. If `home` (m) is given, L4 then changes to this length
    within `returning` (s).
    """

    plan: Plan
    start: float
    duration: float
    home: float | None = None
    returning: float = 0.0

    @property
    def target(self) -> float:
        return float(self.plan.speed[-1])

    @property
    def acceleration(self) -> float:
        return (self.target - self.start) / self.duration

    @property
    def turns(self) -> int:
        """Number of revolutions, including the last revolutions at constant speed."""
        stay = self.returning if self.home is not None else 0.0
        return math.ceil((self._arrival + self.target * stay) / TURN) + 2

    @property
    def _arrival(self) -> float:
        """Crank angle φ at which the final speed is reached."""
        return (self.target + self.start) / 2 * self.duration

    def __call__(self, phi: Array) -> Drive:
        """Return the state of the drive at crank angles (k,), counted from the start φ = 0."""
        rising = phi < self._arrival
        alpha = np.where(rising, self.acceleration, 0.0)
        square = self.start**2 + 2 * self.acceleration * np.minimum(phi, self._arrival)
        speed = np.where(rising, np.sqrt(square), self.target)
        after = (phi - self._arrival) / self.target
        time = np.where(rising, (speed - self.start) / self.acceleration, self.duration + after)
        L4, slope, bend = self.plan.rounded(speed)
        if self.home is None:
            return Drive(time, speed, alpha, L4, slope * alpha, bend * alpha**2)
        back = np.clip(after / self.returning, 0.0, 1.0) * math.pi
        moves = (after > 0) & (after < self.returning)
        way, rate = (self.home - float(self.plan.L4[-1])) / 2, math.pi / self.returning
        return Drive(
            time,
            speed,
            alpha,
            L4 + way * (1 - np.cos(back)),
            slope * alpha + np.where(moves, way * rate * np.sin(back), 0.0),
            bend * alpha**2 + np.where(moves, way * rate**2 * np.cos(back), 0.0),
        )


@dataclass(frozen=True)
class Simulated:
    """Largest |stress| (Pa) of each link in each revolution, (turns, links).

    `time` (s), `speed` (rad/s) and `L4` (m) are the values (turns,) at the ends of the revolutions.
    """

    time: Array
    speed: Array
    L4: Array
    stress: Array


def simulate(stresses: StressMap, run_up: Callable[[Array], Drive], turns: int) -> Simulated:
    """Simulate the stresses during a run-up that starts from quasi-static equilibrium."""
    moving = _Moving(stresses, run_up)
    x = moving.at_rest()
    last, largest = np.zeros(len(x) // 2), []
    with progress.task("turns of the run-up", turns) as count:
        for turn in range(turns):
            x, last, peaks = moving.turn(turn, x, last)
            largest.append(peaks)
            count.add()
    at = run_up(np.arange(1, turns + 1) * TURN)
    return Simulated(at.time, at.speed, at.L4, np.array(largest))


@dataclass(frozen=True)
class _MotionWithDamping(Motion):
    """Equations of motion with prescribed damping matrices (k, n, n) at crank angles (k,)."""

    given: Callable[[Array], Array]

    @cached_property
    def _damping(self) -> Callable[[Array], Array]:
        return self.given


class _Moving:
    """Integration of the vibration of the four-bar linkage, with the crank angle φ as independent variable,
    one revolution at a time."""

    def __init__(self, stresses: StressMap, run_up: Callable[[Array], Drive]):
        self._map, self._drive = stresses, run_up
        self._model = model = stresses.lengths[0].model
        self._nodes, self._collocation = np.linspace(0.0, TURN, _STEPS + 1), _METHOD.stages
        self._h = np.diff(self._nodes)
        self._stages = (self._nodes[:-1, None] + self._h[:, None] * np.array(self._collocation.c)).ravel()
        self._samples = np.arange(_STEPS * _SAMPLES) * (TURN / (_STEPS * _SAMPLES))
        self._beams = replace(model.beams, angle=lambda phi: self._kinematics(phi)[0], carried=True)
        terms, stiffening, damping = (
            str(model.labels.options[name]) for name in ("terms", "stiffening", "damping")
        )
        self._motion = _MotionWithDamping(
            self._beams,
            lambda phi: self._kinematics(phi)[1:],
            TURN,
            terms,
            stiffening,
            damping,
            self._damping,
        )

    def at_rest(self) -> Array:
        """Return the state (q, q′) of quasi-static equilibrium at φ = 0."""
        positions = Positions(self._beams, np.zeros(1))
        _, K = positions.matrices()
        _, omega, alpha = self._kinematics(np.zeros(1))
        q = np.linalg.solve(K[0], inertia_load(positions, omega, alpha)[0])
        return np.concatenate((q, np.zeros_like(q)))

    def turn(self, number: int, x: Array, last: Array) -> tuple[Array, Array, Array]:
        """Integrate over the revolution `number`. Return the state and the acceleration at its end, and the
        largest |stress| (links,) in this revolution. `x` and `last` are the state and the acceleration at its
        start. Derivatives are with respect to φ.
        """
        h, s = self._h, len(self._collocation.c)
        drive = self._drive(number * TURN + self._stages)
        M, C, K, d = self._motion(number * TURN + self._stages, 1.0)
        speed, alpha = (part[:, None, None] for part in (drive.speed, drive.acceleration))
        parts = (speed**2 * M, speed * C + alpha * M, K, d)
        stages = (part.reshape(1, _STEPS, s, *part.shape[1:]) for part in parts)
        a = self._collocation.stage_accelerations(h, *stages)
        steps, states = self._collocation.steps(h, a), [x]
        for A, b in zip(steps.A[0], steps.b[0], strict=True):
            states.append(A @ states[-1] + b)
        states = np.array(states)
        inner = np.squeeze(a[0, ..., :-1] @ states[:-1, None, :, None], -1) + a[0, ..., -1]
        starts = np.concatenate((last[None], inner[:-1, -1]))
        accelerations = (part[None] for part in (starts, inner, inner[:, -1]))
        curve = self._collocation.curve(self._nodes, states[None], *accelerations)[0]
        return states[-1], inner[-1, -1], self._peaks(number, curve(self._samples))

    def _peaks(self, number: int, q: Array) -> Array:
        angle, *_ = self._kinematics(number * TURN + self._samples)
        stress = np.einsum("kasn,nk->ask", stress_rows(self._beams, angle), q, optimize=True)
        return self._map.by_link(np.abs(stress).sum(axis=0).max(axis=1), np.max)

    def _kinematics(self, phi: Array) -> tuple[Array, Array, Array]:
        """Return the angles (k, links) of the links, with their first two time derivatives."""
        return kinematics(self._model, phi, self._drive(phi))

    def _damping(self, phi: Array) -> Array:
        weights = self._map.weights(self._drive(phi).L4)
        return np.einsum("kc,ckij->kij", weights, self._damping_at_nodes)

    @cached_property
    def _damping_at_nodes(self) -> Array:
        """Damping matrices C (nodes, k, n, n) at the stages, for the interpolation nodes of L4 in the map."""
        return np.stack([length.model.at(self._stages, 0.0)[1] for length in self._map.lengths])


def kinematics(model: StructureModel, phi: Array, drive: Drive) -> tuple[Array, Array, Array]:
    """Return the angles (k, 3) of crank, coupler and follower at crank angles φ (k,), with their first two
    time derivatives.

    The ground pivot C moves along the x axis. The equations are Eqs. (3.3) and (3.11) of the thesis, with the
    rates of L4 added.
    """
    L1, L2, L3 = (model.parameters[name] for name in ("L1", "L2", "L3"))
    side = BRANCHES[str(model.labels.options["branch"])]
    e1 = np.exp(1j * phi)
    span = drive.L4 - L1 * e1
    gamma = side * np.arccos((L2**2 + L3**2 - np.abs(span) ** 2) / (2 * L2 * L3))
    e2 = span * np.conj(L2 - L3 * np.exp(1j * gamma))
    e2 /= np.abs(e2)
    e3 = e2 * np.exp(1j * gamma)
    pivot = drive.L4_velocity, drive.L4_acceleration
    omega, alpha = rates((L1, L2, L3), (e1, e2, e3), (drive.speed, drive.acceleration), pivot)
    return np.stack((phi, np.angle(e2), np.angle(e3)), axis=1), omega.T, alpha.T
