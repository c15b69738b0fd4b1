"""All solutions of the linear periodic problem along a motion while parameters vary.

The state x at phase 0 and the changes p of k parameters satisfy x = Φ x + g + G p. These are 2n equations for
2n + k unknowns, so that their solutions are one particular solution and k tangents. At a fold, where I - Φ is
singular, these equations remain regular (H. B. Keller, Lectures on Numerical Methods in Bifurcation Problems,
1987, 4.3)."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from solve.arrays import Array
from solve.contracts import Columns, Matrices
from solve.equations import derivatives_of, entries_of, events_of
from solve.errors import NoOrbitError, SolveError
from solve.kernel.engines import COMPILED
from solve.kernel.formulas import columns_by
from solve.methods.collocation import Collocation
from solve.methods.free import free, solutions_on
from solve.newton.branch_points import DAMPING, ContinuationParameters, Unknowns
from solve.newton.iteration import Task, linearised_along
from solve.newton.saltation import EventJump, break_jumps, event_jumps, solutions_with_jumps
from solve.period.curve import Curve
from solve.period.grid import Grid
from solve.period.multipliers import Multipliers
from solve.period.points import SinglePoint, Tables
from solve.system import PeriodicSystem, in_phase

_BLOCKS, _MANY_STATES = 8, 24
"""Number of blocks of the period, whose initial states are unknowns, and number of states above which a
single block is used. Choices: with 8 blocks, a solution that grows by |ρ| over the period loses log10|ρ|/8
digits."""


_REGULAR = 1e-2
"""Smallest distance of a multiplier from +1 above which I - Φ counts as regular. The inverse of this distance
amplifies round-off. A choice."""


_FREE_JUMPS = (
    "forces jump at an event of the orbit, such as a contact with a dashpot, or at a phase that depends on "
    "the parameter; branches of free machines require continuous forces; use sweep --nonlinear"
)


@dataclass(frozen=True)
class LinearFamily:
    """Solutions of a linear periodic problem: a particular solution, k tangents to the set of solutions, and
    the monodromy matrix."""

    unknowns: Unknowns
    tangents: tuple[Unknowns, ...]
    Phi: Array

    @cached_property
    def multipliers(self) -> Array:
        """Floquet multipliers (2n,), largest modulus first."""
        if not np.isfinite(self.Phi).all():
            raise NoOrbitError("the multipliers overflow")
        return Multipliers.from_matrices(self.Phi[None]).values[0]


def linear_family(
    parameters: ContinuationParameters, unknowns: Unknowns, grid: Grid, sizes: Array
) -> LinearFamily:
    """Solutions of the Newton equations about given unknowns, on a grid. sizes (n,): scales of the
    coordinates. Raises SolveError subclasses if there are no solutions."""
    task = parameters.task_at(unknowns.values)
    along, grid = linearised_along(task, unknowns.curve, grid)
    equations = _Equations(along, task, unknowns.curve, parameters.names, parameters.task.rigid is not None)
    jumps = equations.jumps(grid)
    if equations.free:
        if jumps:
            raise NoOrbitError(_FREE_JUMPS)
        return _by_periodic_solutions(equations, unknowns, grid)
    if task.engine == COMPILED and not jumps and DAMPING not in parameters.names:
        family = _if_regular(equations, unknowns, grid)
        if family is not None:
            return family
    steps = _Steps(equations, grid, jumps)
    unit = np.concatenate((np.tile(np.tile(sizes, 2), steps.blocks), parameters.spans))
    columns = _null_space(*steps.closing(), unit)
    curves = steps.curves(columns)
    count = len(parameters.names)
    changes = columns[len(columns) - count :].T
    tangents = tuple(Unknowns(curves[k + 1], changes[k + 1]) for k in range(count))
    return LinearFamily(Unknowns(curves[0], unknowns.values + changes[0]), tangents, steps.monodromy)


def _null_space(matrix: Array, right: Array, unit: Array) -> Array:
    """Columns (c, 1 + k): a solution z of `matrix` z = `right`, followed by a basis of the null space. unit
    (c,): scales of the unknowns."""
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
    """Equations linearised along a motion, with the loads d and -∂r/∂θ for each parameter θ.

    free: whether the machine has rigid-body modes."""

    along: PeriodicSystem
    task: Task
    motion: Curve
    names: Sequence[str]
    free: bool = False
    _entries: dict[bytes, tuple[Array, Array]] = field(default_factory=dict, init=False, repr=False)

    def at(self, phase: Array) -> Matrices:
        """Ω²M, ΩC, K (m, n, n) and the loads (m, n, 1 + k) at phases (m,)."""
        speed = self.task.speed
        M, C, K, d = in_phase(self.along, phase, speed)
        return M, C, K, np.concatenate((d[..., None], self.by_parameters(phase)), axis=-1)

    def by_parameters(self, phase: Array) -> Array:
        """Loads -∂r/∂θ (m, n, k) at phases (m,)."""
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
        """Jumps of disturbances at the events of the motion, and at breaks that the parameters move."""
        names = [name for name in self.names if name != DAMPING]
        motion = self.along, self.motion, self.task.speed, grid
        return [*event_jumps(*motion, names), *break_jumps(*motion, self.task.breaks, names)]

    def entries(self, phase: Array) -> tuple[Array, Array]:
        """Entries (m, 3n² + n) of the linearised system and loads -∂r/∂θ (m, n, k) at phases (m,). They are
        cached, because all loads are solved on one grid."""
        key = phase.tobytes()
        if key not in self._entries:
            self._entries[key] = entries_of(self.along, phase, self.task.speed), self.by_parameters(phase)
        return self._entries[key]


@dataclass(frozen=True)
class _UnderLoad(SinglePoint):
    """Linearised system with the load -∂r/∂θ of one parameter, or with its own load d if `load` is None."""

    equations: _Equations
    load: int | None

    def tables(self, phase: Array) -> Tables:
        entries, loads = self.equations.entries(phase)
        if self.load is not None:
            entries = np.concatenate((entries[:, : 3 * self.n**2], loads[..., self.load]), axis=1)
        return Tables.from_entries(entries[None], self.n, self.first_order)


class _Steps:
    """Radau's method on a grid for several loads. The maps of the steps are multiplied within each block."""

    def __init__(self, equations: _Equations, grid: Grid, jumps: Sequence[EventJump]):
        method: Collocation = equations.task.method.collocation
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
        """Monodromy matrix Φ(T) (2n, 2n)."""
        Phi = np.eye(self._states)
        for block in self._chain[:, -1, :, : self._states]:
            Phi = block @ Phi
        return Phi

    def closing(self) -> tuple[Array, Array]:
        """Matrix (B·2n, B·2n + k) and right-hand side (B·2n,) of the equations that couple the B blocks
        periodically."""
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
        """Unknowns (size,) of the homogeneous motion that starts from a state (2n,) at phase 0."""
        unknowns, N = np.zeros(size), self._states
        for block, end in enumerate(self._chain[:, -1, :, :N]):
            unknowns[block * N : (block + 1) * N] = start
            start = end @ start
        return unknowns

    def curves(self, columns: Array) -> Curve:
        """Curves (c, n, …) of the solutions in the columns (B·2n + k, c). The load d acts in the first column
        only."""
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
    """Maps (B, l, N, N + r) from the start of each block to the ends of the l steps of the block, from the
    maps (m, N, N + r) of the steps."""
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


def _if_regular(equations: "_Equations", unknowns: Unknowns, grid: Grid) -> LinearFamily | None:
    """Compute the solutions if no multiplier is near +1; otherwise return None."""
    try:
        family = _by_periodic_solutions(equations, unknowns, grid)
        regular = np.abs(np.linalg.eigvals(family.Phi) - 1).min() > _REGULAR
    except (SolveError, np.linalg.LinAlgError):
        return None
    return family if regular else None


def _by_periodic_solutions(equations: _Equations, unknowns: Unknowns, grid: Grid) -> LinearFamily:
    """Compute the solutions as periodic responses, one per load, in compiled code. This requires a regular I
    - Φ, or a machine with rigid-body modes. Raises SolveError."""
    along, task = equations.along, equations.task
    held = free(SinglePoint(along, task.speed)) if equations.free else None
    loads = None, *range(len(equations.names))
    found = [
        solutions_on(
            task.method, _UnderLoad(along, task.speed, equations, load), grid, True, task.engine, held
        )
        for load in loads
    ]
    curves = [solutions.checked().curve for solutions in found]
    assert all(isinstance(curve, Curve) for curve in curves)
    tangents = zip(curves[1:], np.eye(len(equations.names)), strict=True)
    vectors = (Unknowns(curve[0], change) for curve, change in tangents)  # pyright: ignore
    return LinearFamily(Unknowns(curves[0][0], unknowns.values), tuple(vectors), found[0].Phi[0])  # pyright: ignore


def multipliers_of(parameters: ContinuationParameters, unknowns: Unknowns, grid: Grid, sizes: Array) -> Array:
    """Floquet multipliers (2n,) of the problem linearised about given unknowns, largest modulus first. Raises
    SolveError."""
    task = parameters.task_at(unknowns.values)
    if task.engine != COMPILED or parameters.task.rigid is not None:
        return linear_family(parameters, unknowns, grid, sizes).multipliers
    along, grid = linearised_along(task, unknowns.curve, grid)
    point = SinglePoint(along, task.speed)
    jumps = event_jumps(along, unknowns.curve, task.speed, grid)
    if jumps:
        found = solutions_with_jumps(task.method, point, grid, task.engine, None, jumps)
    else:
        found = task.method.solutions(point, grid, False, task.engine)
    return LinearFamily(unknowns, (), found.checked().Phi[0]).multipliers


def mode_of(parameters: ContinuationParameters, unknowns: Unknowns, grid: Grid, multiplier: float) -> Curve:
    """Free motion over one period, real, in the Floquet mode with the multiplier nearest to a given real
    value."""
    task = parameters.task_at(unknowns.values)
    along, grid = linearised_along(task, unknowns.curve, grid)
    equations = _Equations(along, task, unknowns.curve, parameters.names)
    steps = _Steps(equations, grid, equations.jumps(grid))
    values, vectors = np.linalg.eig(steps.monodromy)
    start = np.real(vectors[:, np.abs(values - multiplier).argmin()])
    columns = np.zeros((steps.blocks * len(start) + len(parameters.names), 2))
    columns[:, 1] = steps.from_start(start, len(columns))
    return steps.curves(columns)[1]
