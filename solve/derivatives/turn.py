"""A linear periodic problem on one grid, its stage systems factorised once, for any number of loads.

∂q/∂θ solves the same problem under the load ∂d/∂θ - ∂M/∂θ q̈ - ∂C/∂θ q̇ - ∂K/∂θ q. It is taken at the stages,
with the states that the method itself has there: what follows is the derivative of what the method gives on
this grid (A. Griewank, A. Walther, Evaluating Derivatives, 2nd ed., chapter 15), not of what it approximates.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from solve.arrays import Array, solved
from solve.kernel.engines import COMPILED
from solve.kernel.systems import solved_together
from solve.methods.collocation import Collocated
from solve.methods.method import no_orbit
from solve.period.curve import Curve
from solve.period.grid import Grid
from solve.period.period_map import SINGULAR, Steps, periodic_states
from solve.period.points import OnePoint, matrices
from solve.sizes import SMALL, require_size


@dataclass(frozen=True)
class Motions:
    """Periodic solutions under r loads: x (m+1, 2n, r) at the nodes; states (m, k, 3, n, r): q″, q′ and q, by
    the phase, at the phases of a `TurnOnGrid`."""

    x: Array
    states: Array


class TurnOnGrid:
    """A system at a speed on a grid, by a collocation method.

    phases (m, k): of every step its start, its stages, and its end where the last stage is not there already.
    `loaded` chooses those at which loads act: where every step starts at the last stage of the one before,
    the stages alone. A (m, 2n, 2n): maps of the steps; B (m, 2n, s n): from loads at their stages to the
    states at their ends.
    """

    def __init__(self, point: OnePoint, method: Collocated, grid: Grid, engine: str):
        """engine: COMPILED or NUMPY. Raises ValueOutOfBoundsError for more than can be held."""
        self.point, self.grid, self.rule = point, grid, method.collocation
        self.phases = grid.stages(np.array(self.rule.curve_nodes))
        n, s, m = point.n, len(self.rule.c), grid.steps
        require_size("steps", m, 2 * s * n * (s + 2) * n)
        self.closed = self.rule.stiffly_accurate and grid.smooth
        self.loaded = slice(1, None) if self.closed else slice(None)
        self._stages = slice(int(not self.closed), int(not self.closed) + s)
        sampled = matrices(point, self.phases[:, self.loaded].ravel())
        self.M, self.C, self.K, self.d = (part[0].reshape(m, -1, *part.shape[2:]) for part in sampled)
        M, C, K = (part[None, :, self._stages] for part in (self.M, self.C, self.K))
        unit = np.broadcast_to(np.eye(s * n).reshape(s, n, s * n), (1, m, s, n, s * n))
        together = solved_together if engine == COMPILED and n <= SMALL else solved
        a = self.rule.stage_accelerations(grid.h, M, C, K, unit, together)
        maps = self.rule.maps(grid.h, a)[0]
        self.A, self.B = maps[..., : 2 * n], maps[..., 2 * n :]
        self._responses = a[0].reshape(m, s * n, -1)

    @property
    def stages(self) -> slice:
        """Which of the k phases of a step are its stages."""
        return slice(1, 1 + len(self.rule.c))

    @cached_property
    def orbit(self) -> Motions:
        """The periodic solution itself, r = 1. Raises ResonanceError."""
        return self.under(self.d[..., None])

    @cached_property
    def curve(self) -> Curve:
        """The continuous curve of the periodic solution."""
        return self.curves(self.orbit)[0]

    def under(self, loads: Array) -> Motions:
        """Periodic solutions under loads (m, l, n, r) at the phases where they act. Raises ResonanceError."""
        m, _, _, r = loads.shape
        at_stages = loads[:, self._stages].reshape(m, -1, r)
        x, condition = periodic_states(Steps(self.A, self.B @ at_stages))
        if not condition < 1 / SINGULAR:
            raise no_orbit()
        states = self.stage_states(x[:-1], at_stages)
        before = np.roll(states[:, -1:], 1, axis=0) if self.closed else self._at_ends(0, x[:-1], loads)
        parts = [before, states]
        if self._ends_apart:
            parts.append(self._at_ends(-1, x[1:], loads))
        return Motions(x, np.concatenate(parts, axis=1))

    @property
    def _ends_apart(self) -> bool:
        """Whether ends of steps are no stages."""
        return self.phases.shape[1] > len(self.rule.c) + 1

    def stage_states(self, x: Array, loads: Array | None = None) -> Array:
        """q″, q′, q (m, s, 3, n, r) at the stages of steps from states x (m, 2n, r) at their starts, under
        loads (m, s n, r)."""
        m, N, r = x.shape
        a = self._responses[..., :N] @ x
        if loads is not None:
            a += self._responses[..., N:] @ loads
        a, A = a.reshape(m, -1, N // 2 * r), self.rule.A
        h, c = self.grid.h[:, None, None], np.array(self.rule.c)[:, None]
        q, v = x.reshape(m, 2, 1, -1).swapaxes(0, 1)
        states = np.stack((a, v + h * (A @ a), q + h * c * v + h**2 * (A @ A @ a)), axis=2)
        return states.reshape(m, -1, 3, N // 2, r)

    def _at_ends(self, place: int, x: Array, loads: Array) -> Array:
        """q″, q′, q (m, 1, 3, n, r) of states x (m, 2n, r) at the first or the last of the phases."""
        q, v = np.split(x, 2, axis=1)
        force = loads[:, place] - self.K[:, place] @ q - self.C[:, place] @ v
        return np.stack((solved(self.M[:, place], force), v, q), axis=1)[:, None]

    def curves(self, motions: Motions) -> Curve:
        """The continuous curves (r, n, …) of solutions."""
        data = self.data(motions)
        return Curve.of(self.grid.nodes, np.transpose(data, (3, 0, 2, 1)), self.rule.curve_powers)

    def data(self, motions: Motions) -> Array:
        """What makes the curves of solutions in every step, (m, 2 + k, n, r)."""
        h = self.grid.h[:, None, None]
        q, v = np.split(motions.x[:-1], 2, axis=1)
        a = h[:, None] ** 2 * motions.states[:, :, 0]
        return np.concatenate((q[:, None], (h * v)[:, None], a), axis=1)

    def of_data(self, phase: Array, weights: Array) -> Array:
        """Weights (m, 2 + k, n, c) of the data in sums over weights (p, 3, n, c) times q″, q′, q of the curve
        at phases (p,)."""
        from scipy.sparse import csr_array

        (m, k), (count, _, n, c), (step, basis) = self.phases.shape, weights.shape, self.curve.basis(phase)
        by_phase = np.zeros((count, 2 + k, n * c))
        for order, part in enumerate(weights.swapaxes(0, 1)[::-1]):
            if part.any():
                basis = self.curve.basis(phase, order)[1] if order else basis
                by_phase += (basis @ self.rule.curve_powers)[:, :, None] * part.reshape(count, 1, -1)
        summed = csr_array((np.ones(count), (step, np.arange(count))), shape=(m, count))
        return (summed @ by_phase.reshape(count, -1)).reshape(m, 2 + k, n, c)

    def pulled(self, of_data: Array) -> Array:
        """The adjoint problem: by how much loads (m, l, n) at the phases where they act raise sums with
        weights (m, 2 + k, n, c) of the data, (m, l, n, c). It is the same for any number of loads."""
        (m, loaded, n), c, h = self.d.shape, of_data.shape[-1], self.grid.h[:, None, None]
        states = np.concatenate((of_data[:, 0], h * of_data[:, 1]), axis=1)
        accelerations, found = h[:, None] ** 2 * of_data[:, 2:], np.zeros((m, loaded, n, c))
        if self.closed:
            accelerations[:, -1] += np.roll(accelerations[:, 0], -1, axis=0)
        else:
            found[:, 0], before = self._pulled_from_ends(0, accelerations)
            states += before
        responses = self._responses.swapaxes(1, 2) @ accelerations[:, self.stages].reshape(m, -1, c)
        states += responses[:, : 2 * n]
        if self._ends_apart:
            found[:, -1], behind = self._pulled_from_ends(-1, accelerations)
            states += np.roll(behind, 1, axis=0)
        y, _ = periodic_states(Steps(self.A.swapaxes(1, 2)[::-1], states[::-1]))
        at_stages = responses[:, 2 * n :] + self.B.swapaxes(1, 2) @ y[:-1][::-1]
        found[:, self._stages] = at_stages.reshape(m, -1, n, c)
        return found

    def _pulled_from_ends(self, place: int, accelerations: Array) -> tuple[Array, Array]:
        """Of what accelerations at the first or the last of the phases count, parts of the load there and of
        the state, (m, n, c) and (m, 2n, c)."""
        M, C, K = (part[:, place].swapaxes(1, 2) for part in (self.M, self.C, self.K))
        load = solved(M, accelerations[:, place])
        return load, -np.concatenate((K @ load, C @ load), axis=1)
