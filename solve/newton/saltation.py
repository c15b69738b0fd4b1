"""Saltation: the jump of a perturbation at an event at which the force jumps (M. di Bernardo, C. Budd, A. R.
Champneys, P. Kowalczyk, Piecewise-smooth Dynamical Systems, 2008, 2.3).

A perturbation y moves the phase of the event, and so does a change δ of a parameter θ of the switching
function g. The states are x = (q, q'), where first-order coordinates have no q'. With the rates f⁻ and f⁺ of
the states before and after the event,

    y⁺ = S y⁻ + s δ,   S = I + w ∇gᵀ,   s = w ∂g/∂θ,   w = (f⁺ - f⁻) / (∂g/∂φ + ∇gᵀ f⁻).

For continuous forces, S = I and s = 0. If a parameter moves a break, that is, a phase b(θ) at which the
matrices jump, S = I and s = (f⁻ - f⁺) db/dθ. Newton's iteration includes these jumps and therefore converges
quadratically."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from solve.arrays import Array
from solve.equations import derivatives_of, event_normals, events_of
from solve.matrices import leading
from solve.methods.collocated import Collocated
from solve.methods.free import Free, solutions_on
from solve.methods.method import Solutions
from solve.period.curve import Curve
from solve.period.grid import Grid
from solve.period.period_map import Steps, monodromy, period
from solve.period.points import Points
from solve.system import PeriodicSystem, in_phase

_JUMP = 1e-6
"""Jump of q'', relative to its largest modulus, below which forces count as continuous. Chosen by judgement:
above the errors due to the phases of events, and far below jumps that affect multipliers."""


@dataclass(frozen=True)
class EventJump:
    """Jump of perturbations at an event of a motion.

    step: index of the step before the event. matrix: S (N, N). state (N,): state of the motion at the event.
    by_parameters: s (N, k)."""

    step: int
    matrix: Array
    state: Array
    by_parameters: Array

    def after(self, maps: Array) -> Array:
        """Return the map (N, N + 1 + k) of a step that ends with this jump. `maps` is the map of the step
        without the jump. The columns belong to the state, the load and the k parameters."""
        N = len(self.state)
        jumped = self.matrix @ maps
        jumped[:, N] += self.state - self.matrix @ self.state
        jumped[:, N + 1 :] += self.by_parameters
        return jumped


def event_jumps(
    along: PeriodicSystem, curve: Curve, speed: float, grid: Grid, names: Sequence[str] = ()
) -> list[EventJump]:
    """Return the jumps at the events of a motion; empty if no force jumps there.

    along: system linearised along the motion. curve: the motion. speed: in rad/s. grid: grid with the events
    as nodes. names: parameters θ, which may include "speed"."""
    events = np.array(events_of(along).phases)
    if not len(events):
        return []
    nodes, states, before, after = _at_nodes(along, curve, speed, grid, events)
    n, inertial = along.n, states.shape[1] - along.n
    jumps = after - before
    if np.abs(jumps[:, n:]).max() <= _JUMP * np.abs(curve.sampled(1, 2)[:, :inertial]).max():
        return []
    normals, found = event_normals(along, curve, speed, events, names), []
    for k, (normal, state) in enumerate(zip(normals, states, strict=True)):
        gradient, by_parameters = normal[1 : n + inertial + 1], normal[2 * n + 1 :]
        weight = jumps[k] / (normal[0] + gradient @ before[k])
        matrix = np.eye(n + inertial) + np.outer(weight, gradient)
        found.append(EventJump(int(nodes[k]), matrix, state, np.outer(weight, by_parameters)))
    return found


def break_jumps(
    along: PeriodicSystem,
    curve: Curve,
    speed: float,
    grid: Grid,
    breaks: Sequence[float],
    names: Sequence[str],
) -> list[EventJump]:
    """Return the jumps that are due to breaks whose phases depend on the parameters `names`.

    breaks: breaks of the model over the period, which are nodes of the grid. The other arguments are those of
    `event_jumps`."""
    slopes = derivatives_of(along).of_breaks(names)
    moved = np.flatnonzero(slopes.any(axis=1))
    if not len(moved):
        return []
    phases = np.array(breaks)[moved]
    phases = np.where(phases > 0, phases, grid.period)
    nodes, states, before, after = _at_nodes(along, curve, speed, grid, phases)
    one = np.eye(states.shape[1])
    return [
        EventJump(int(node), one, state, np.outer(rate, slope))
        for node, state, rate, slope in zip(nodes, states, before - after, slopes[moved], strict=True)
    ]


def _at_nodes(
    along: PeriodicSystem, curve: Curve, speed: float, grid: Grid, phases: Array
) -> tuple[Array, Array, Array, Array]:
    """Return the indices (k,) of the steps that end at `phases` (k,), the states (k, N) of the motion at
    these phases, and the rates (k, N) of the states before and after them. The phases must be nodes of the
    grid."""
    nodes = np.abs(grid.nodes[1:, None] - phases).argmin(axis=0)
    ends, inertial = grid.stages(np.array([0.0, 1.0])), along.n - len(along.states)
    states = np.concatenate((curve(phases), curve(phases, 1)[:inertial])).T
    sides = ends[nodes, 1], ends[(nodes + 1) % grid.steps, 0]
    before, after = (_rates(along, speed, phase, states) for phase in sides)
    return nodes, states, before, after


def solutions_with_jumps(
    method: Collocated, points: Points, grid: Grid, engine: str, held: Free | None, jumps: Sequence[EventJump]
) -> Solutions:
    """Return the solutions of a single point. They include the jumps of perturbations at events.

    held: rigid-body modes of the point. If there are any, the jumps are included in the monodromy matrix, but
    not in the curve."""
    with np.errstate(all="ignore"):
        chain = method.discretise(points, grid)
        maps = np.concatenate((chain.steps.A[0], chain.steps.b[0, ..., None]), axis=-1)
        for jump in jumps:
            maps[jump.step] = jump.after(maps[jump.step])
        steps = Steps(maps[None, ..., :-1], maps[None, ..., -1])
        if held is not None:
            found = solutions_on(method, points, grid, True, engine, held)
            return replace(found, Phi=monodromy(steps), units=None, steps=steps)
        Phi, states, condition = period(steps)
        return method.sound(points, grid, Phi, chain.curve(states), condition, steps)


def _rates(along: PeriodicSystem, speed: float, phase: Array, states: Array) -> Array:
    """Return the derivatives (k, N) of `states` (k, N) of the motion with respect to the phase, at `phase`
    (k,)."""
    M, C, K, d = in_phase(along, phase, speed)
    first_order = len(along.states)
    q, v = states[:, : along.n], states[:, along.n :]
    inertial = v.shape[1]
    force = d - np.einsum("kij,kj->ki", K, q) - np.einsum("kij,kj->ki", C[:, :, :inertial], v)
    highest = np.linalg.solve(leading(M, C, first_order), force[..., None])[..., 0]
    return np.concatenate((v, highest[:, inertial:], highest[:, :inertial]), axis=1)
