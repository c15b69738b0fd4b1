"""Linear periodic problem on one grid. Its stage systems are factorised once, and solved for any number of
loads.

∂q/∂θ solves the same problem under the load ∂d/∂θ - ∂M/∂θ q̈ - ∂C/∂θ q̇ - ∂K/∂θ q, evaluated at the stages
with the states of the method. The result is the exact derivative of the numerical solution on this grid (A.
Griewank, A. Walther, Evaluating Derivatives, 2nd ed., chapter 15)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

import numpy as np

from solve.arguments import require_size
from solve.arrays import Array, solved
from solve.contracts import Matrices
from solve.derivatives.stage_systems import close_periodically, propagate, stage_systems
from solve.matrices import split_entries
from solve.methods.collocated import Collocated
from solve.methods.collocation import Collocation
from solve.period.anchored import Anchored
from solve.period.curve import Curve
from solve.period.grid import Grid
from solve.period.points import SinglePoint, matrices, rate_of
from solve.period.rigid_body import Free


@dataclass(frozen=True, eq=False)
class Motions:
    """Periodic solutions for r loads.

    x (m+1, 2n, r): states at the nodes. accelerations (m, k, n, r): q″, with respect to the phase, at the k
    phases of each step of a `PeriodicProblem`. compute_states: function that returns the states at these
    phases. drift (n, r): steady velocities of a free machine, included only in the states that
    `compute_states` returns."""

    x: Array
    accelerations: Array
    compute_states: Callable[[], Array]
    drift: Array | None = None

    @cached_property
    def states(self) -> Array:
        """States q″, q′ and q at the k phases of each step, as an array (m, k, 3, n, r)."""
        return self.compute_states()


class PeriodicProblem:
    """Linear periodic problem of a system at a speed, discretised on a grid by a collocation method.

    phases (m, k): start, stages and, if it is not a stage, end of every step. `loaded` selects the l phases
    at which loads act. These are only the stages if every step starts at the last stage of the previous step.
    M, C, K (m, l, n, n) and d (m, l, n) are the matrices at these l phases, for derivatives with respect to
    the phase."""

    def __init__(
        self,
        point: SinglePoint,
        method: Collocated,
        grid: Grid,
        engine: str,
        known: Curve | None = None,
        free: Free | None = None,
    ):
        """Factorise the problem.

        engine: COMPILED or NUMPY. known: periodic solution on this grid, if known. free: rigid-body modes, if
        any; the anchored system is then solved. Raises ValueOutOfBoundsError if the memory limit is exceeded.
        """
        self.point, self.grid, self.rule = point, grid, method.stages
        self.phases = grid.stages(np.array(self.rule.curve_nodes))
        n, s, m = point.n, len(self.rule.c), grid.steps
        require_size("steps", m, 2 * s * n * (s + 2) * n)
        self.closed = self.rule.stiffly_accurate and grid.smooth
        self.loaded = slice(int(self.closed), None)
        self._stages = slice(int(not self.closed), int(not self.closed) + s)
        self.free, self._anchored = free, None if free is None else Anchored(point, free.modes)
        self._tables = (self._anchored or point).tables(self.phases[:, self.loaded].ravel())
        self._engine, self._known = engine, known
        self._systems = stage_systems(self.rule, grid.h, self._tables, self._stages, engine)
        # Weights of the stage accelerations at the end of a step: in q, to be multiplied by h², and in q′, to
        # be multiplied by h.
        self._weights = np.stack((self.rule.b @ self.rule.A, self.rule.b))
        self._step_powers = np.stack((grid.h**2, grid.h), axis=1)[:, :, None]
        self._cache: dict[tuple[bytes, int], tuple[Any, Array]] = {}

    @cached_property
    def _matrices(self) -> Matrices:
        entries = self._tables.entries()
        return split_entries(entries.reshape(self.grid.steps, -1, entries.shape[-1]), self.point.n)

    @property
    def A(self) -> Array:
        """One-step maps (m, 2n, 2n)."""
        return self._systems.maps

    def propagate(self, start: Array, backwards: bool = False) -> Array:
        """States (m+1, 2n, r) without loads, from the first states (2n, r). If `backwards`, the transposed
        maps are applied in reverse order."""
        A = self.A.swapaxes(1, 2)[::-1] if backwards else self.A
        return propagate(A, start, self._engine)

    def _end_states(self, a: Array) -> Array:
        """Contributions (m, 2n, r) of the stage accelerations `a` (m, s n, r) to the states at the ends of
        the steps."""
        m, _, r = a.shape
        return (self._step_powers * (self._weights @ a.reshape(m, len(self.rule.c), -1))).reshape(m, -1, r)

    def _end_states_transposed(self, y: Array) -> Array:
        """Transpose of `_end_states`: weights (m, s n, c) of the accelerations, from weights (m, 2n, c) of
        the states."""
        m, _, c = y.shape
        return (self._weights.T @ (self._step_powers * y.reshape(m, 2, -1))).reshape(m, -1, c)

    def end_state_gradient(self, weights: Array) -> Array:
        """Gradients (m, s n, c) of c weighted sums of the states at the ends of the steps, with respect to
        the loads at the stages. `weights` is (m, 2n, c)."""
        return self._systems.pulled(self._end_states_transposed(weights))

    @property
    def stages(self) -> slice:
        """Indices of the stages among the k phases of a step."""
        return slice(1, 1 + len(self.rule.c))

    @cached_property
    def orbit(self) -> Motions:
        """Periodic solution of the system, with r = 1. Raises ResonanceError."""
        if self._known is None:
            return self.solve(self._matrices[3][..., None])
        (m, k), n = self.phases.shape, self.point.n
        pieces = self._known.coefficients.swapaxes(0, 1).reshape(m * n, -1)
        states = (pieces @ _power_basis(self.rule, k).T).reshape(m, n, k, 3).transpose(0, 2, 3, 1)
        states = states / self.grid.h[:, None, None, None] ** np.array([2, 1, 0])[:, None]
        x = states[:, 0, :0:-1].reshape(m, -1)
        states = states[..., None]
        return Motions(np.concatenate((x, x[:1]))[..., None], states[:, :, 0], lambda: states)

    def at_nodes(self, breaks: Sequence[float], values: Array) -> Array:
        """Array (m, r) over the starts of steps. It contains the values (b, r) of the breaks, and is zero
        elsewhere."""
        at_starts, period = np.zeros((self.grid.steps, values.shape[1])), self.grid.period
        for phase, value in zip(breaks, values, strict=True):
            distance = np.abs((self.grid.nodes[:-1] - phase + period / 2) % period - period / 2)
            at_starts[distance.argmin()] = value
        return at_starts

    def jump(self, node: int) -> Array:
        """Jump (n,) of q″ of the periodic solution at the start of the step with index `node`."""
        return self.orbit.states[node, 0, 0, :, 0] - self.orbit.states[node - 1, -1, 0, :, 0]

    def rate_jump(self, node: int) -> Array:
        """Jump (2n, 2n) of the matrix P of x′ = P x + f at the start of the step with index `node`."""
        parts = (node, 0), (node - 1, -1)
        after, before = (rate_of(*(part[at] for part in self._matrices)) for at in parts)
        return (after - before)[:, :-1]

    @cached_property
    def curve(self) -> Curve:
        """Continuous curve of the periodic solution."""
        if self._known is not None:
            return self._known
        curve, drift = self.curves(self.orbit)[0], self.orbit.drift
        return curve if drift is None else replace(curve, drift=drift[:, 0])

    def solve(self, loads: Array, jumps: Array | None = None, level: Array | None = None) -> Motions:
        """Periodic solutions for r loads (m, l, n, r) at the loaded phases.

        jumps (m, 2n, r): jumps of the states at the starts of steps, where the matrices may jump. level
        (modes, r): mean motions along rigid-body modes, zero by default. Raises ResonanceError."""
        motions, drift = self._solve(loads, jumps), None
        if self._anchored is None:
            return motions
        if self._anchored.modes.dragged.any():
            # A drift may be far larger than the vibration, and would reduce the accuracy of the vibration.
            anchored, held = self._repeated(motions)
            drift = anchored.motion(self.curves(motions), held.mass)[0].drift
        if drift is not None:
            motions = self._solve(loads - self._damping @ drift.T, jumps)
        return self._unanchored(motions, drift, level)

    def _solve(self, loads: Array, jumps: Array | None) -> Motions:
        """Periodic solutions of the system or, for a free machine, of the anchored system."""
        m, _, n, r = loads.shape
        at_stages = loads[:, self._stages].reshape(m, -1, r)
        behind = np.zeros((m, 2 * n, r)) if jumps is None else np.roll(jumps, -1, axis=0)
        forced = self._systems.solved(at_stages)
        x = close_periodically(self.A, self._end_states(forced) + behind, self._engine)
        a = self._systems.by_state @ x[:-1] + forced
        a = a.reshape(m, -1, n, r)
        ends = x[1:] - behind
        before = np.roll(a[:, -1:], 1, axis=0) if self.closed else self._at_ends(0, x[:-1], loads)
        after = [self._at_ends(-1, ends, loads)] if self._ends_apart else []
        a = np.concatenate((before, a, *after), axis=1)
        return Motions(x, a, lambda: self._states(x, ends, a))

    def _unanchored(self, motions: Motions, drift: Array | None, level: Array | None) -> Motions:
        """Motions of the free machine, from motions of the anchored system.

        drift (r, n): steady velocities. The loads already contain their drag."""
        anchored, held = self._repeated(motions)
        curves = self.curves(motions)
        moved, _ = anchored.drifting(drift).motion(curves, held.mass)
        change = moved.coefficients.copy()
        change[..., : curves.coefficients.shape[-1]] -= curves.coefficients
        if level is not None:
            change[..., 0] += held.modes.vectors @ level.T[..., None]
        (m, k), count, fractions = self.phases.shape, len(change), np.array(self.rule.curve_nodes)
        added = Curve(moved.nodes, change)
        parts = [added.within(fractions, order).reshape(count, -1, m, k) for order in (2, 1, 0)]
        by_state = np.stack(parts).transpose(3, 4, 0, 2, 1)
        x, velocities = motions.x.copy(), None if moved.drift is None else moved.drift.T
        x[:-1] += by_state[:, 0, :0:-1].reshape(m, -1, count)
        x[-1] = x[0]

        def compute_states() -> Array:
            states = motions.states + by_state
            if velocities is not None:
                states[:, :, 1] += velocities
            return states

        return Motions(x, motions.accelerations + by_state[:, :, 0], compute_states, velocities)

    def _repeated(self, motions: Motions) -> tuple[Anchored, Free]:
        """Return the anchored system and the rigid-body modes, each repeated once per motion."""
        assert self._anchored is not None
        assert self.free is not None
        rows = np.zeros(motions.x.shape[-1], dtype=int)
        held = self.free[rows]
        return Anchored(self.point, held.modes), held

    @cached_property
    def _damping(self) -> Array:
        """Damping matrices C (m, l, n, n) of the original system, for derivatives with respect to the
        phase."""
        phases = self.phases[:, self.loaded]
        C = matrices(self.point, phases.ravel())[1][0]
        return C.reshape(*phases.shape, *C.shape[1:])

    @property
    def _ends_apart(self) -> bool:
        """Whether the end of a step is not a stage."""
        return self.phases.shape[1] > len(self.rule.c) + 1

    def _states(self, x: Array, ends: Array, a: Array) -> Array:
        """States q″, q′, q at the k phases of each step, as an array (m, k, 3, n, r).

        x (m+1, 2n, r): states at the nodes. ends (m, 2n, r): states at the ends of the steps. a (m, k, n, r):
        accelerations."""
        m, k, n, r = a.shape
        states = np.empty((m, k, 3, n, r))
        states[:, :, 0], states[:, 0, :0:-1] = a, x[:-1].reshape(m, 2, n, r)
        states[:, -1, :0:-1] = ends.reshape(m, 2, n, r)
        states[:, self.stages] = self._stage_states(x[:-1], a[:, self.stages])
        return states

    def stage_states(self, x: Array) -> Array:
        """States q″, q′, q at the stages, as an array (m, s, 3, n, r), without loads. x (m, 2n, r): states at
        the starts of the steps."""
        m, N, r = x.shape
        return self._stage_states(x, (self._systems.by_state @ x).reshape(m, -1, N // 2, r))

    def _stage_states(self, x: Array, a: Array) -> Array:
        """States q″, q′, q at the stages, as an array (m, s, 3, n, r), from states `x` (m, 2n, r) at the
        starts of the steps and accelerations `a` (m, s, n, r) at the stages."""
        m, s, n, r = a.shape
        A, a = self.rule.A, a.reshape(m, s, -1)
        h, c = self.grid.h[:, None, None], np.array(self.rule.c)[:, None]
        q, v = x.reshape(m, 2, 1, -1).swapaxes(0, 1)
        states = np.stack((a, v + h * (A @ a), q + h * c * v + h**2 * (A @ A @ a)), axis=2)
        return states.reshape(m, s, 3, n, r)

    def _at_ends(self, place: int, x: Array, loads: Array) -> Array:
        """Accelerations (m, 1, n, r) from the equations of motion, for states x (m, 2n, r) at the first or
        the last phase of each step."""
        q, v = np.split(x, 2, axis=1)
        M, C, K, _ = (part[:, place] for part in self._matrices)
        return solved(M, loads[:, place] - K @ q - C @ v)[:, None]

    def curves(self, motions: Motions) -> Curve:
        """Continuous curves (r, n, …) of solutions."""
        data = self.data(motions)
        return Curve.from_steps(self.grid.nodes, np.transpose(data, (3, 0, 2, 1)), self.rule.curve_powers)

    def data(self, motions: Motions) -> Array:
        """Data (m, 2 + k, n, r) that define the curves of solutions: for each step, q and h q′ at its start,
        and h² q″ at its k phases."""
        h = self.grid.h[:, None, None]
        q, v = np.split(motions.x[:-1], 2, axis=1)
        a = h[:, None] ** 2 * motions.accelerations
        return np.concatenate((q[:, None], (h * v)[:, None], a), axis=1)

    def at(self, data: Array, phase: Array, order: int = 0) -> Array:
        """Derivatives (p, …) of order `order` at phases (p,), for the curves defined by `data` (m, 2 + k,
        …)."""
        step, weights = self._basis(phase, order)
        here = data[step]
        return (weights[:, None] @ here.reshape(*here.shape[:2], -1)).reshape(len(step), *here.shape[2:])

    def data_weights(self, phase: Array, weights: Array) -> Array:
        """Weights (m, 2 + k, n, c) of the data, equivalent to `weights` (p, 3, n, c) of q″, q′ and q of the
        curve at phases (p,)."""
        k, (count, _, n, c) = self.phases.shape[1], weights.shape
        by_phase = np.zeros((count, 2 + k, n * c))
        for order, part in enumerate(weights.swapaxes(0, 1)[::-1]):
            if part.any():
                by_phase += self._basis(phase, order)[1][:, :, None] * part.reshape(count, 1, -1)
        return self._sum_in_steps(phase, by_phase).reshape(-1, 2 + k, n, c)

    def value_data_weights(self, phase: Array, weights: Array) -> Array:
        """Weights (m, 2 + k, c) of the data, equivalent to `weights` (p, c) of the values of one coordinate
        at phases (p,)."""
        return self._sum_in_steps(phase, self._basis(phase, 0)[1][:, :, None] * weights[:, None])

    def even_value_data_weights(self, fractions: Array, weights: Array) -> Array:
        """Result of `value_data_weights` for values at the same fractions (a,) of every step. `weights` is (m
        a, c)."""
        powers = fractions[:, None] ** np.arange(len(self.rule.curve_powers)) @ self.rule.curve_powers
        return powers.T @ weights.reshape(self.grid.steps, len(fractions), -1)

    def _sum_in_steps(self, phase: Array, values: Array) -> Array:
        """Sums (m, …) of the values (p, …) in each step; `phase` (p,) contains the phases of the values."""
        (inside, firsts), step = self._groups(phase), self._basis(phase, 0)[0]
        sums = np.zeros((self.grid.steps, *values.shape[1:]))
        sums[step[inside][firsts]] = np.add.reduceat(values[inside], firsts)
        return sums

    def _groups(self, phase: Array) -> tuple[Any, Array]:
        """Return a permutation that sorts phases by steps, and for each step the index of its first phase in
        the permutation."""
        key = phase.tobytes(), -1
        if key not in self._cache:
            step = self._basis(phase, 0)[0]
            inside = slice(None) if (np.diff(step) >= 0).all() else np.argsort(step, kind="stable")
            self._cache[key] = inside, np.flatnonzero(np.diff(step[inside], prepend=-1))
        return self._cache[key]

    def _basis(self, phase: Array, order: int) -> tuple[Array, Array]:
        """Return the steps (p,) that contain the phases, and weights (p, 2 + k): the derivative of the curve
        at each phase is a weighted sum of the data of the step."""
        key = phase.tobytes(), order
        if key not in self._cache:
            step, powers = self.curve.basis(phase, order)
            self._cache[key] = step, powers @ self.rule.curve_powers
        return self._cache[key]

    def adjoint(self, of_data: Array) -> Array:
        """Gradients (m, l, n, c) of c sums with respect to the loads at the l loaded phases of each step,
        computed by the adjoint problem.

        of_data (m, 2 + k, n, c): weights of the data in the sums. The cost does not depend on the number of
        loads."""
        m, _, n, c = of_data.shape
        loaded, h = self.phases[:, self.loaded].shape[1], self.grid.h[:, None, None]
        states = np.concatenate((of_data[:, 0], h * of_data[:, 1]), axis=1)
        accelerations, found = h[:, None] ** 2 * of_data[:, 2:], np.zeros((m, loaded, n, c))
        if self.closed:
            accelerations[:, -1] += np.roll(accelerations[:, 0], -1, axis=0)
        else:
            found[:, 0], before = self._adjoint_of_ends(0, accelerations)
            states += before
        at_stages = accelerations[:, self.stages].reshape(m, -1, c)
        states += self._systems.by_state.swapaxes(1, 2) @ at_stages
        if self._ends_apart:
            found[:, -1], behind = self._adjoint_of_ends(-1, accelerations)
            states += np.roll(behind, 1, axis=0)
        y = close_periodically(self.A.swapaxes(1, 2)[::-1], states[::-1], self._engine)
        at_stages = self._systems.pulled(at_stages + self._end_states_transposed(y[:-1][::-1]))
        found[:, self._stages] = at_stages.reshape(m, -1, n, c)
        return found

    def _adjoint_of_ends(self, place: int, accelerations: Array) -> tuple[Array, Array]:
        """Return weights (m, n, c) of the loads and weights (m, 2n, c) of the states, from the weights of the
        accelerations at the first or the last phase of each step."""
        M, C, K = (part[:, place].swapaxes(1, 2) for part in self._matrices[:3])
        load = solved(M, accelerations[:, place])
        return load, -np.concatenate((K @ load, C @ load), axis=1)


@cache
def _power_basis(rule: Collocation, k: int) -> Array:
    """Matrix (3 k, D) that maps coefficients of powers of θ in a step to h² q″, h q′ and q at the k phases of
    the step.

    At the stages, the values are computed as by the method; the curve agrees with these values up to its
    order."""
    data = np.linalg.inv(rule.curve_powers)
    a, basis, zero = data[2:], np.empty((k, 3, len(data))), np.zeros((1, len(rule.c)))
    at_stages = a[1 : 1 + len(rule.c)]
    v = np.concatenate((zero, rule.A, rule.b[None]))[:k]
    q = np.concatenate((zero, rule.A @ rule.A, (rule.b @ rule.A)[None]))[:k]
    theta = np.array([0.0, *rule.c, 1.0])[:k, None]
    basis[:, 0], basis[:, 1] = a, data[1] + v @ at_stages
    basis[:, 2] = data[0] + theta * data[1] + q @ at_stages
    return basis.reshape(3 * k, -1)
