"""A linear periodic problem on one grid, its stage systems factorised once, for any number of loads.

∂q/∂θ solves the same problem under the load ∂d/∂θ - ∂M/∂θ q̈ - ∂C/∂θ q̇ - ∂K/∂θ q. It is taken at the stages,
with the states that the method itself has there: what follows is the derivative of what the method gives on
this grid (A. Griewank, A. Walther, Evaluating Derivatives, 2nd ed., chapter 15), not of what it approximates.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

import numpy as np

from solve.arguments import require_size
from solve.arrays import Array, solved
from solve.contracts import Matrices
from solve.derivatives.stages import closed, followed, stages
from solve.methods.collocation import Collocated, Collocation
from solve.period.anchored import Anchored
from solve.period.curve import Curve
from solve.period.grid import Grid
from solve.period.points import OnePoint, matrices, parted, rate_of
from solve.period.rigid_body import Free


@dataclass(frozen=True, eq=False)
class Motions:
    """Periodic solutions under r loads: x (m+1, 2n, r) at the nodes; accelerations (m, k, n, r), q″ with
    respect to the phase, at the phases of a `TurnOnGrid`; made: gives the states there; drift (n, r): steady
    velocities of a free machine, contained only in the states at these phases."""

    x: Array
    accelerations: Array
    made: Callable[[], Array]
    drift: Array | None = None

    @cached_property
    def states(self) -> Array:
        """q″, q′ and q (m, k, 3, n, r)."""
        return self.made()


class TurnOnGrid:
    """A system at a speed on a grid, by a collocation method.

    phases (m, k): of every step its start, its stages, and its end where the last stage is not there already.
    `loaded` chooses the l of these at which loads act: where every step starts at the last stage of the one
    before, the stages alone. M, C, K (m, l, n, n) and d (m, l, n) there, for derivatives by the phase.
    """

    def __init__(
        self,
        point: OnePoint,
        method: Collocated,
        grid: Grid,
        engine: str,
        known: Curve | None = None,
        free: Free | None = None,
    ):
        """engine: COMPILED or NUMPY; known: the periodic solution on this grid, if known; free: rigid-body
        modes of the system, which is then solved anchored. Raises ValueOutOfBoundsError if the memory limit
        is exceeded."""
        self.point, self.grid, self.rule = point, grid, method.collocation
        self.phases = grid.stages(np.array(self.rule.curve_nodes))
        n, s, m = point.n, len(self.rule.c), grid.steps
        require_size("steps", m, 2 * s * n * (s + 2) * n)
        self.closed = self.rule.stiffly_accurate and grid.smooth
        self.loaded = slice(int(self.closed), None)
        self._stages = slice(int(not self.closed), int(not self.closed) + s)
        self.free, self._anchored = free, None if free is None else Anchored(point, free.modes)
        self._tables = (self._anchored or point).tables(self.phases[:, self.loaded].ravel())
        self._engine, self._known = engine, known
        self._systems = stages(self.rule, grid.h, self._tables, self._stages, engine)
        # Of stage accelerations, h² and h times, in q and q′ at the ends of the steps.
        self._gains = np.stack((self.rule.b @ self.rule.A, self.rule.b))
        self._rates = np.stack((grid.h**2, grid.h), axis=1)[:, :, None]
        self._kept: dict[tuple[bytes, int], tuple[Any, Array]] = {}

    @cached_property
    def _matrices(self) -> Matrices:
        entries = self._tables.entries()
        return parted(entries.reshape(self.grid.steps, -1, entries.shape[-1]), self.point.n)

    @property
    def A(self) -> Array:
        """Maps of the steps (m, 2n, 2n)."""
        return self._systems.maps

    def followed(self, start: Array, backwards: bool = False) -> Array:
        """States (m+1, 2n, r), without loads, from the first (2n, r) on; of the transposed maps backwards."""
        A = self.A.swapaxes(1, 2)[::-1] if backwards else self.A
        return followed(A, start, self._engine)

    def _gained(self, a: Array) -> Array:
        """What accelerations at the stages (m, s n, r) add to the states at the ends (m, 2n, r)."""
        m, _, r = a.shape
        return (self._rates * (self._gains @ a.reshape(m, len(self.rule.c), -1))).reshape(m, -1, r)

    def _gained_by(self, y: Array) -> Array:
        """The transpose of this: of weights (m, 2n, c) of states at the ends those of the accelerations."""
        m, _, c = y.shape
        return (self._gains.T @ (self._rates * y.reshape(m, 2, -1))).reshape(m, -1, c)

    def pulled_ends(self, weights: Array) -> Array:
        """By how much loads at the stages (m, s n) of each step raise sums with weights (m, 2n, c) of the
        state at its end: (m, s n, c)."""
        return self._systems.pulled(self._gained_by(weights))

    @property
    def stages(self) -> slice:
        """Which of the k phases of a step are its stages."""
        return slice(1, 1 + len(self.rule.c))

    @cached_property
    def orbit(self) -> Motions:
        """The periodic solution itself, r = 1. Raises ResonanceError."""
        if self._known is None:
            return self.under(self._matrices[3][..., None])
        (m, k), n = self.phases.shape, self.point.n
        pieces = self._known.coefficients.swapaxes(0, 1).reshape(m * n, -1)
        states = (pieces @ _of_powers(self.rule, k).T).reshape(m, n, k, 3).transpose(0, 2, 3, 1)
        states = states / self.grid.h[:, None, None, None] ** np.array([2, 1, 0])[:, None]
        x = states[:, 0, :0:-1].reshape(m, -1)
        states = states[..., None]
        return Motions(np.concatenate((x, x[:1]))[..., None], states[:, :, 0], lambda: states)

    def at_nodes(self, breaks: Sequence[float], values: Array) -> Array:
        """Values (b, r) of breaks at the starts of the steps (m, r), where these are breaks."""
        found, period = np.zeros((self.grid.steps, values.shape[1])), self.grid.period
        for phase, value in zip(breaks, values, strict=True):
            apart = np.abs((self.grid.nodes[:-1] - phase + period / 2) % period - period / 2)
            found[apart.argmin()] = value
        return found

    def jump(self, node: int) -> Array:
        """How much q″ (n,) of the periodic solution jumps at the start of a step."""
        return self.orbit.states[node, 0, 0, :, 0] - self.orbit.states[node - 1, -1, 0, :, 0]

    def rate_jump(self, node: int) -> Array:
        """How much P (2n, 2n) of x′ = P x + f jumps at the start of a step."""
        parts = (node, 0), (node - 1, -1)
        after, before = (rate_of(*(part[at] for part in self._matrices)) for at in parts)
        return (after - before)[:, :-1]

    @cached_property
    def curve(self) -> Curve:
        """The continuous curve of the periodic solution."""
        if self._known is not None:
            return self._known
        curve, drift = self.curves(self.orbit)[0], self.orbit.drift
        return curve if drift is None else replace(curve, drift=drift[:, 0])

    def under(self, loads: Array, jumps: Array | None = None, level: Array | None = None) -> Motions:
        """Periodic solutions under loads (m, l, n, r) at the phases where they act, with jumps (m, 2n, r) of
        the states at the starts of steps where the matrices jump. level (modes, r): means along rigid-body
        modes, zero by default. Raises ResonanceError."""
        found, drift = self._under(loads, jumps), None
        if self._anchored is None:
            return found
        if self._anchored.modes.dragged.any():
            # A drift may be far larger than the vibration and would reduce its accuracy.
            anchored, held = self._for_each(found)
            drift = anchored.motion(self.curves(found), held.mass)[0].drift
        if drift is not None:
            found = self._under(loads - self._damping @ drift.T, jumps)
        return self._of_machine(found, drift, level)

    def _under(self, loads: Array, jumps: Array | None) -> Motions:
        """Periodic solutions of the anchored system if the machine is free."""
        m, _, n, r = loads.shape
        at_stages = loads[:, self._stages].reshape(m, -1, r)
        behind = np.zeros((m, 2 * n, r)) if jumps is None else np.roll(jumps, -1, axis=0)
        forced = self._systems.solved(at_stages)
        x = closed(self.A, self._gained(forced) + behind, self._engine)
        a = self._systems.by_state @ x[:-1] + forced
        a = a.reshape(m, -1, n, r)
        ends = x[1:] - behind
        before = np.roll(a[:, -1:], 1, axis=0) if self.closed else self._at_ends(0, x[:-1], loads)
        after = [self._at_ends(-1, ends, loads)] if self._ends_apart else []
        a = np.concatenate((before, a, *after), axis=1)
        return Motions(x, a, lambda: self._states(x, ends, a))

    def _of_machine(self, found: Motions, drift: Array | None, level: Array | None) -> Motions:
        """Motions of the free machine from those of the anchored system; drift (r, n): steady velocities
        whose drag is already part of the loads."""
        anchored, held = self._for_each(found)
        curves = self.curves(found)
        moved, _ = replace(anchored, drift=drift).motion(curves, held.mass)
        assert isinstance(moved, Curve)
        change = moved.coefficients.copy()
        change[..., : curves.coefficients.shape[-1]] -= curves.coefficients
        if level is not None:
            change[..., 0] += held.modes.vectors @ level.T[..., None]
        (m, k), count, fractions = self.phases.shape, len(change), np.array(self.rule.curve_nodes)
        added = Curve(moved.nodes, change)
        parts = [added.within(fractions, order).reshape(count, -1, m, k) for order in (2, 1, 0)]
        by_state = np.stack(parts).transpose(3, 4, 0, 2, 1)
        x, velocities = found.x.copy(), None if moved.drift is None else moved.drift.T
        x[:-1] += by_state[:, 0, :0:-1].reshape(m, -1, count)
        x[-1] = x[0]

        def made() -> Array:
            states = found.states + by_state
            if velocities is not None:
                states[:, :, 1] += velocities
            return states

        return Motions(x, found.accelerations + by_state[:, :, 0], made, velocities)

    def _for_each(self, found: Motions) -> tuple[Anchored, Free]:
        """The anchored system and its rigid-body modes, repeated for each of the motions."""
        assert self._anchored is not None
        assert self.free is not None
        every = np.zeros(found.x.shape[-1], dtype=int)
        held = self.free[every]
        return replace(self._anchored, modes=held.modes), held

    @cached_property
    def _damping(self) -> Array:
        """C (m, l, n, n) of the original system, with respect to the phase."""
        phases = self.phases[:, self.loaded]
        C = matrices(self.point, phases.ravel())[1][0]
        return C.reshape(*phases.shape, *C.shape[1:])

    @property
    def _ends_apart(self) -> bool:
        """Whether ends of steps are no stages."""
        return self.phases.shape[1] > len(self.rule.c) + 1

    def _states(self, x: Array, ends: Array, a: Array) -> Array:
        """q″, q′, q (m, k, 3, n, r) of states x (m+1, 2n, r) at the nodes and (m, 2n, r) at the ends of the
        steps, and accelerations (m, k, n, r)."""
        m, k, n, r = a.shape
        states = np.empty((m, k, 3, n, r))
        states[:, :, 0], states[:, 0, :0:-1] = a, x[:-1].reshape(m, 2, n, r)
        states[:, -1, :0:-1] = ends.reshape(m, 2, n, r)
        states[:, self.stages] = self._stage_states(x[:-1], a[:, self.stages])
        return states

    def stage_states(self, x: Array) -> Array:
        """q″, q′, q (m, s, 3, n, r) at the stages of steps from states x (m, 2n, r) at their starts, without
        loads."""
        m, N, r = x.shape
        return self._stage_states(x, (self._systems.by_state @ x).reshape(m, -1, N // 2, r))

    def _stage_states(self, x: Array, a: Array) -> Array:
        """The same with accelerations (m, s, n, r)."""
        m, s, n, r = a.shape
        A, a = self.rule.A, a.reshape(m, s, -1)
        h, c = self.grid.h[:, None, None], np.array(self.rule.c)[:, None]
        q, v = x.reshape(m, 2, 1, -1).swapaxes(0, 1)
        states = np.stack((a, v + h * (A @ a), q + h * c * v + h**2 * (A @ A @ a)), axis=2)
        return states.reshape(m, s, 3, n, r)

    def _at_ends(self, place: int, x: Array, loads: Array) -> Array:
        """Accelerations (m, 1, n, r) of states x (m, 2n, r) at the first or the last of the phases."""
        q, v = np.split(x, 2, axis=1)
        M, C, K, _ = (part[:, place] for part in self._matrices)
        return solved(M, loads[:, place] - K @ q - C @ v)[:, None]

    def curves(self, motions: Motions) -> Curve:
        """The continuous curves (r, n, …) of solutions."""
        data = self.data(motions)
        return Curve.of(self.grid.nodes, np.transpose(data, (3, 0, 2, 1)), self.rule.curve_powers)

    def data(self, motions: Motions) -> Array:
        """What makes the curves of solutions in every step, (m, 2 + k, n, r)."""
        h = self.grid.h[:, None, None]
        q, v = np.split(motions.x[:-1], 2, axis=1)
        a = h[:, None] ** 2 * motions.accelerations
        return np.concatenate((q[:, None], (h * v)[:, None], a), axis=1)

    def at(self, data: Array, phase: Array, order: int = 0) -> Array:
        """The derivatives of so high an order of the curves that data (m, 2 + k, …) make, at phases (p,):
        (p, …)."""
        step, weights = self._basis(phase, order)
        here = data[step]
        return (weights[:, None] @ here.reshape(*here.shape[:2], -1)).reshape(len(step), *here.shape[2:])

    def of_data(self, phase: Array, weights: Array) -> Array:
        """Weights (m, 2 + k, n, c) of the data in sums over weights (p, 3, n, c) times q″, q′, q of the curve
        at phases (p,)."""
        k, (count, _, n, c) = self.phases.shape[1], weights.shape
        by_phase = np.zeros((count, 2 + k, n * c))
        for order, part in enumerate(weights.swapaxes(0, 1)[::-1]):
            if part.any():
                by_phase += self._basis(phase, order)[1][:, :, None] * part.reshape(count, 1, -1)
        return self._in_steps(phase, by_phase).reshape(-1, 2 + k, n, c)

    def of_values(self, phase: Array, weights: Array) -> Array:
        """The same (m, 2 + k, c) of values of one coordinate, with weights (p, c)."""
        return self._in_steps(phase, self._basis(phase, 0)[1][:, :, None] * weights[:, None])

    def of_even_values(self, fractions: Array, weights: Array) -> Array:
        """The same at fractions (a,) of every step, with weights (m a, c)."""
        powers = fractions[:, None] ** np.arange(len(self.rule.curve_powers)) @ self.rule.curve_powers
        return powers.T @ weights.reshape(self.grid.steps, len(fractions), -1)

    def _in_steps(self, phase: Array, values: Array) -> Array:
        """Sums (m, …) over the phases (p,) of each step of values (p, …)."""
        (inside, firsts), step = self._groups(phase), self._basis(phase, 0)[0]
        made = np.zeros((self.grid.steps, *values.shape[1:]))
        made[step[inside][firsts]] = np.add.reduceat(values[inside], firsts)
        return made

    def _groups(self, phase: Array) -> tuple[Any, Array]:
        """In which order phases lie in one step after another, and where those of each step begin."""
        key = phase.tobytes(), -1
        if key not in self._kept:
            step = self._basis(phase, 0)[0]
            inside = slice(None) if (np.diff(step) >= 0).all() else np.argsort(step, kind="stable")
            self._kept[key] = inside, np.flatnonzero(np.diff(step[inside], prepend=-1))
        return self._kept[key]

    def _basis(self, phase: Array, order: int) -> tuple[Array, Array]:
        """Steps (p,) in which phases lie, and what the data of these count in the curve's derivative there,
        (p, 2 + k)."""
        key = phase.tobytes(), order
        if key not in self._kept:
            step, powers = self.curve.basis(phase, order)
            self._kept[key] = step, powers @ self.rule.curve_powers
        return self._kept[key]

    def pulled(self, of_data: Array) -> Array:
        """The adjoint problem: by how much loads (m, l, n) at the phases where they act raise sums with
        weights (m, 2 + k, n, c) of the data, (m, l, n, c). It is the same for any number of loads."""
        m, _, n, c = of_data.shape
        loaded, h = self.phases[:, self.loaded].shape[1], self.grid.h[:, None, None]
        states = np.concatenate((of_data[:, 0], h * of_data[:, 1]), axis=1)
        accelerations, found = h[:, None] ** 2 * of_data[:, 2:], np.zeros((m, loaded, n, c))
        if self.closed:
            accelerations[:, -1] += np.roll(accelerations[:, 0], -1, axis=0)
        else:
            found[:, 0], before = self._pulled_from_ends(0, accelerations)
            states += before
        at_stages = accelerations[:, self.stages].reshape(m, -1, c)
        states += self._systems.by_state.swapaxes(1, 2) @ at_stages
        if self._ends_apart:
            found[:, -1], behind = self._pulled_from_ends(-1, accelerations)
            states += np.roll(behind, 1, axis=0)
        y = closed(self.A.swapaxes(1, 2)[::-1], states[::-1], self._engine)
        at_stages = self._systems.pulled(at_stages + self._gained_by(y[:-1][::-1]))
        found[:, self._stages] = at_stages.reshape(m, -1, n, c)
        return found

    def _pulled_from_ends(self, place: int, accelerations: Array) -> tuple[Array, Array]:
        """Of what accelerations at the first or the last of the phases count, parts of the load there and of
        the state, (m, n, c) and (m, 2n, c)."""
        M, C, K = (part[:, place].swapaxes(1, 2) for part in self._matrices[:3])
        load = solved(M, accelerations[:, place])
        return load, -np.concatenate((K @ load, C @ load), axis=1)


@cache
def _of_powers(rule: Collocation, k: int) -> Array:
    """From the powers of θ in a step to h² q″, h q′ and q at its k phases, (3 k, D): at the stages what the
    method has there, which the curve meets to its order."""
    data = np.linalg.inv(rule.curve_powers)
    a, made, zero = data[2:], np.empty((k, 3, len(data))), np.zeros((1, len(rule.c)))
    at_stages = a[1 : 1 + len(rule.c)]
    v = np.concatenate((zero, rule.A, rule.b[None]))[:k]
    q = np.concatenate((zero, rule.A @ rule.A, (rule.b @ rule.A)[None]))[:k]
    theta = np.array([0.0, *rule.c, 1.0])[:k, None]
    made[:, 0], made[:, 1] = a, data[1] + v @ at_stages
    made[:, 2] = data[0] + theta * data[1] + q @ at_stages
    return made.reshape(3 * k, -1)
