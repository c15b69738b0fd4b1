"""All solutions of the linear periodic problem along a motion while k parameters vary.

The state x at phase 0 and the changes p of the parameters satisfy x = Φ x + g + G p. Here, g and the columns
of G are the states at the end of the period that result from zero initial states, under the load and under a
unit change of each parameter. These are 2n equations for 2n + k unknowns. Their solutions are one particular
solution plus combinations of k tangents. At a fold, where I - Φ is singular, the equations remain regular (H.
B. Keller, Lectures on Numerical Methods in Bifurcation Problems, 1987, 4.3)."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from solve.arrays import Array
from solve.contracts import Columns, Matrices
from solve.equations import derivatives_of, events_of, used_entries_of
from solve.errors import NoOrbitError, SolveError
from solve.kernel.engines import COMPILED
from solve.kernel.formulas import columns_by
from solve.methods.collocation import Collocation
from solve.methods.free import free, solutions_on
from solve.methods.method import Solutions
from solve.newton.branch_points import DAMPING, ContinuationParameters, Unknowns
from solve.newton.iteration import Task, curve_of, linearised_along
from solve.newton.saltation import EventJump, break_jumps, event_jumps
from solve.period.curve import Curve
from solve.period.grid import Grid
from solve.period.multipliers import Multipliers
from solve.period.points import SinglePoint, Tables
from solve.system import PeriodicSystem, in_phase

_BLOCKS, _MANY_STATES = 8, 24
"""Number of blocks into which the period is divided, and the number of states above which there is only one
block. The initial state of each block is unknown. Chosen by judgement: with 8 blocks, a solution that grows
by |ρ| over the period loses log10|ρ|/8 digits."""


_REGULAR = 1e-2
"""Distance from +1 of the nearest multiplier above which I - Φ counts as regular. The inverse of this
distance amplifies round-off. Chosen by judgement."""

_REGULAR_NEARBY = 0.05
"""Distance from +1 of the nearest multiplier above which the tangents at neighbouring unknowns may be used.
The inverse of this distance amplifies the difference between the tangents, which slows the convergence.
Chosen by judgement."""

_FREE_JUMPS = (
    "forces jump at an event of the orbit, such as a contact with a dashpot, or at a phase that depends on "
    "the parameter; branches of free machines require continuous forces; use sweep --nonlinear"
)


class LinearFamily:
    """Solutions of Newton's linear equations about given unknowns, on a grid: a particular solution, k
    tangents to the set of solutions, and the monodromy matrix. Each of them is computed when it is first
    used.

    sizes (n,): scales of the coordinates. more_stages: whether to use the method with one more stage. The
    properties raise SolveError subclasses if there are no solutions."""

    def __init__(
        self,
        parameters: ContinuationParameters,
        unknowns: Unknowns,
        grid: Grid,
        sizes: Array,
        more_stages: bool = False,
    ):
        task, is_free = parameters.task_at(unknowns.values), parameters.task.rigid is not None
        if more_stages:
            task = replace(task, method=task.method.with_another_stage)
        along, self._grid = linearised_along(task, unknowns.curve, grid)
        self._unknowns, self._sizes, self._spans = unknowns, sizes, parameters.spans
        self._equations = _Equations(along, task, unknowns.curve, parameters.names, is_free)
        self._jumps = self._equations.jumps(self._grid)
        if is_free and self._jumps:
            raise NoOrbitError(_FREE_JUMPS)
        self._is_coupled = not is_free and bool(
            task.engine != COMPILED or self._jumps or DAMPING in parameters.names
        )
        self._periodic: dict[int | None, Solutions] = {}

    @property
    def unknowns(self) -> Unknowns:
        """Particular solution."""
        curve = self._response(None)
        return self._null_space[0] if curve is None else Unknowns(curve, self._unknowns.values)

    @cached_property
    def tangents(self) -> tuple[Unknowns, ...]:
        """Tangents, one per parameter."""
        changes = np.eye(len(self._spans))
        curves = [self._response(load) for load in range(len(changes))]
        pairs = zip(curves, changes, strict=True)
        found = tuple(Unknowns(curve, change) for curve, change in pairs if curve is not None)
        return found if len(found) == len(changes) else tuple(self._null_space[1:])

    @cached_property
    def Phi(self) -> Array:
        """Monodromy matrix (2n, 2n)."""
        for solutions in self._periodic.values():
            return solutions.Phi[0]
        if self._is_coupled:
            return self._steps.monodromy
        return self._solutions(None).Phi[0]

    @cached_property
    def multipliers(self) -> Array:
        """Floquet multipliers (2n,), largest modulus first."""
        if not np.isfinite(self.Phi).all():
            raise NoOrbitError("the multipliers overflow")
        return Multipliers.from_matrices(self.Phi[None]).values[0]

    @property
    def is_regular(self) -> bool:
        """Whether all multipliers are so far from +1 that tangents computed at neighbouring unknowns may
        replace the tangents at these unknowns."""
        return not self._is_coupled and self._distance > _REGULAR_NEARBY

    @cached_property
    def _distance(self) -> float:
        """Distance from +1 of the nearest multiplier."""
        return float(np.abs(np.linalg.eigvals(self.Phi) - 1).min())

    def _response(self, load: int | None) -> Curve | None:
        """Return the periodic response to the load -∂r/∂θ of the parameter with index `load`, or to the load
        d if `load` is None.

        Return None if the equations of `_null_space` must be solved instead, for example because a multiplier
        is near +1. For machines with rigid-body modes, the equations of `_null_space` are never used."""
        if self._is_coupled:
            return None
        try:
            curve = curve_of(self._solutions(load).checked())
            self._is_coupled = not self._equations.free and not self._distance > _REGULAR
        except (SolveError, np.linalg.LinAlgError):
            if self._equations.free:
                raise
            self._is_coupled = True
            return None
        return None if self._is_coupled else curve

    def _solutions(self, load: int | None) -> Solutions:
        if load not in self._periodic:
            equations, task = self._equations, self._equations.task
            point = _UnderLoad(equations, load)
            held = free(SinglePoint(equations.along, task.speed)) if equations.free else None
            self._periodic[load] = solutions_on(task.method, point, self._grid, True, task.engine, held)
        return self._periodic[load]

    @cached_property
    def _steps(self) -> "_Steps":
        return _Steps(self._equations, self._grid, self._jumps)

    @cached_property
    def _null_space(self) -> list[Unknowns]:
        """Particular solution, followed by the tangents, from the equations that remain regular at folds."""
        steps, count = self._steps, len(self._spans)
        unit = np.concatenate((np.tile(np.tile(self._sizes, 2), steps.blocks), self._spans))
        columns = _null_space(*steps.closing(), unit)
        curves, changes = steps.curves(columns), columns[len(columns) - count :].T
        first = Unknowns(curves[0], self._unknowns.values + changes[0])
        return [first, *(Unknowns(curves[k], changes[k]) for k in range(1, 1 + count))]


def _null_space(matrix: Array, right: Array, unit: Array) -> Array:
    """Return an array (c, 1 + k). Its first column z solves `matrix` z = `right`; the other columns are a
    basis of the null space of `matrix`. unit (c,): scales of the unknowns."""
    rows = unit[: len(matrix), None]
    scaled = matrix * unit / rows
    Q, R = np.linalg.qr(scaled.T, mode="complete")
    size = len(right)
    try:
        first = Q[:, :size] @ np.linalg.solve(R[:size].T, right / rows[:, 0])
    except np.linalg.LinAlgError:
        raise NoOrbitError("the equations along the branch are singular") from None
    columns = unit[:, None] * np.column_stack((first, Q[:, size:]))
    if not np.isfinite(columns).all():
        raise NoOrbitError("the equations along the branch are singular")
    return columns


@dataclass(frozen=True)
class _Equations:
    """Equations linearised along the motion `motion`, with the load d and one load -∂r/∂θ for each parameter
    θ.

    names: parameters θ. free: whether the machine has rigid-body modes."""

    along: PeriodicSystem
    task: Task
    motion: Curve
    names: Sequence[str]
    free: bool = False
    _entries: dict[bytes, tuple[Array, Array]] = field(default_factory=dict, init=False, repr=False)

    def at(self, phase: Array) -> Matrices:
        """Return Ω²M, ΩC, K (m, n, n) and the loads (m, n, 1 + k) at phases (m,)."""
        speed = self.task.speed
        M, C, K, d = in_phase(self.along, phase, speed)
        return M, C, K, np.concatenate((d[..., None], self.by_parameters(phase)), axis=-1)

    def by_parameters(self, phase: Array) -> Array:
        """Return the loads -∂r/∂θ (m, n, k) at phases (m,)."""
        compiled: Columns | None = columns_by(self.task.engine)
        names = [name for name in self.names if name != DAMPING]
        dependence = derivatives_of(self.along).by(names, compiled)
        curve, beside = self.motion, bool(events_of(self.along).phases)
        states = np.stack([state.T for state in curve.states(phase, (2, 1, 0), beside)], axis=1)
        columns = -dependence.residual(phase, self.task.speed, states)
        if DAMPING in self.names:
            M = in_phase(self.along, phase, self.task.speed)[0]
            columns = np.concatenate((columns, -M @ states[:, 1, :, None]), axis=-1)
        return columns

    def jumps(self, grid: Grid) -> list[EventJump]:
        """Return the jumps of perturbations at the events of the motion, and at breaks whose phase depends on
        a parameter."""
        names = [name for name in self.names if name != DAMPING]
        motion = self.along, self.motion, self.task.speed, grid
        return [*event_jumps(*motion, names), *break_jumps(*motion, self.task.breaks, names)]

    def entries(self, phase: Array) -> tuple[Array, Array]:
        """Return the entries (m, R) of the linearised system that may differ from zero, at phases (m,), and
        the indices (R,) of the entries. The result is cached, because the solutions for all loads use the
        same phases."""
        key = phase.tobytes()
        if key not in self._entries:
            self._entries[key] = used_entries_of(self.along, phase, self.task.speed)
        return self._entries[key]


class _UnderLoad(SinglePoint):
    """Linearised system whose load is -∂r/∂θ for the parameter θ with index `load`. If `load` is None, the
    load is d."""

    def __init__(self, equations: _Equations, load: int | None):
        super().__init__(equations.along, equations.task.speed)
        self.equations, self.load = equations, load

    def tables(self, phase: Array) -> Tables:
        entries, numbers = self.equations.entries(phase)
        if self.load is not None:
            homogeneous, first = int(np.searchsorted(numbers, 3 * self.n**2)), 3 * self.n**2
            loads = self.equations.by_parameters(phase)[..., self.load]
            entries = np.concatenate((entries[:, :homogeneous], loads), axis=1)
            numbers = np.concatenate((numbers[:homogeneous], np.arange(first, first + self.n)))
        return Tables(entries[None], np.ones((1, len(numbers))), numbers, self.n, self.first_order)


class _Steps:
    """Steps of Radau's method on a grid, for several loads. Within each block, the maps of the steps are
    multiplied."""

    def __init__(self, equations: _Equations, grid: Grid, jumps: Sequence[EventJump]):
        method: Collocation = equations.task.method.stages
        phases, n = grid.stages(np.array(method.c)), equations.along.n
        M, C, K, loads = (
            part.reshape(1, *phases.shape, *part.shape[1:]) for part in equations.at(phases.ravel())
        )
        self._equations, self._grid, self._method = equations, grid, method
        self._stages = method.stage_accelerations(grid.h, M, C, K, loads)
        self._states = 2 * n
        self.blocks = _BLOCKS if self._states <= _MANY_STATES else 1
        maps = method.maps(grid.h, self._stages)[0]
        for jump in jumps:
            maps[jump.step] = jump.after(maps[jump.step])
        self._chain = _joined(maps, self._states, self.blocks)

    @property
    def monodromy(self) -> Array:
        """Monodromy matrix (2n, 2n) of the period."""
        Phi = np.eye(self._states)
        for block in self._chain[:, -1, :, : self._states]:
            Phi = block @ Phi
        return Phi

    def closing(self) -> tuple[Array, Array]:
        """Return the matrix (B·2n, B·2n + k) and the right-hand side (B·2n,) of the equations that connect
        the B blocks with each other and the last block with the first."""
        ends, N, B = self._chain[:, -1], self._states, self.blocks
        matrix = np.zeros((B * N, B * N + ends.shape[-1] - N - 1))
        for block, end in enumerate(ends):
            rows = slice(block * N, (block + 1) * N)
            after = (block + 1) % B
            matrix[rows, after * N : (after + 1) * N] += np.eye(N)
            matrix[rows, rows] -= end[:, :N]
            matrix[rows, B * N :] = -end[:, N + 1 :]
        return matrix, ends[:, :, N].ravel()

    def from_start(self, start: Array, size: int) -> Array:
        """Return the unknowns (size,) of the homogeneous motion from the state `start` (2n,) at phase 0."""
        unknowns, N = np.zeros(size), self._states
        for block, end in enumerate(self._chain[:, -1, :, :N]):
            unknowns[block * N : (block + 1) * N] = start
            start = end @ start
        return unknowns

    def curves(self, columns: Array) -> Curve:
        """Return the curves (c, n, …) of the solutions whose unknowns are the columns of `columns` (B·2n + k,
        c). The load d acts in the first solution only."""
        N, B, grid, method = self._states, self.blocks, self._grid, self._method
        loads = np.zeros((self._chain.shape[-1] - N, columns.shape[1]))
        loads[0, 0], loads[1:] = 1.0, columns[B * N :]
        starts = np.concatenate(
            (columns[: B * N].reshape(B, N, -1), np.broadcast_to(loads, (B, *loads.shape))), axis=1
        )
        ends = (self._chain @ starts[:, None]).reshape(-1, N, columns.shape[1])[: grid.steps]
        x = np.concatenate((starts[:1, :N], ends))
        driven = np.concatenate((x[:-1], np.broadcast_to(loads, (grid.steps, *loads.shape))), axis=1)
        stages = self._stages[0].reshape(grid.steps, -1, driven.shape[1]) @ driven
        stages = np.moveaxis(stages.reshape(grid.steps, len(method.c), N // 2, -1), -1, 0)
        last = stages[:, :, -1]
        first = np.roll(last, 1, axis=1)
        behind = np.flatnonzero(grid.at_break)
        if len(behind):
            M, C, K, d = self._equations.at(grid.stages(np.array([0.0, 1.0]))[behind, 0])
            q, v = x[behind, : N // 2], x[behind, N // 2 :]
            first[:, behind] = np.moveaxis(np.linalg.solve(M, d @ loads - K @ q - C @ v), -1, 0)
        return method.curve(grid.nodes, np.moveaxis(x, -1, 0), first, stages, last)


def _joined(maps: Array, states: int, blocks: int) -> Array:
    """Return the maps (B, l, N, N + r) from the start of each block to the end of each of its l steps. `maps`
    (m, N, N + r) are the maps of the single steps."""
    length = -(-len(maps) // blocks)
    padded = np.zeros((blocks * length, *maps.shape[1:]))
    padded[..., :states] = np.eye(states)
    padded[: len(maps)] = maps
    chain = padded.reshape(blocks, length, *maps.shape[1:])
    for step in range(1, length):
        one = chain[:, step].copy()
        chain[:, step] = one[..., :states] @ chain[:, step - 1]
        chain[:, step, :, states:] += one[..., states:]
    return chain


def mode_of(parameters: ContinuationParameters, unknowns: Unknowns, grid: Grid, multiplier: float) -> Curve:
    """Return the real free motion over one period in a Floquet mode: the mode whose multiplier is nearest to
    the real value `multiplier`."""
    task = parameters.task_at(unknowns.values)
    along, grid = linearised_along(task, unknowns.curve, grid)
    equations = _Equations(along, task, unknowns.curve, parameters.names)
    steps = _Steps(equations, grid, equations.jumps(grid))
    values, vectors = np.linalg.eig(steps.monodromy)
    start = np.real(vectors[:, np.abs(values - multiplier).argmin()])
    columns = np.zeros((steps.blocks * len(start) + len(parameters.names), 2))
    columns[:, 1] = steps.from_start(start, len(columns))
    return steps.curves(columns)[1]
