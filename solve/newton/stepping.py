"""The linear motion of a system, whether its drive keeps its speed or not, turn by turn, by steps of Radau's
method."""

import math
from functools import cached_property

import numpy as np

from solve.arrays import Array
from solve.contracts import Matrices, driven
from solve.methods.method import Discretisation
from solve.methods.radau import Radau
from solve.newton.iteration import without_zeros
from solve.period.frozen import frozen
from solve.period.grid import Grid
from solve.period.points import OnePoint
from solve.system import PeriodicSystem

_FIRST, _MOST = 64, 2**14
"""Steps a turn at first, and at most."""

_LOOKS = 32
"""Places of a turn at which its fastest mode is looked for."""

METHOD = Radau()

_KEPT = 2**21
"""Entries of matrices of a turn up to which its maps are kept for the next."""


class StepMarcher:
    """Turn after turn with `count` states a turn, evenly in time; the steps are doubled until both agree to
    rtol of the largest that each coordinate has reached, from `sizes` (n,) on, or there are 16384 of them:
    vibrations too fast for these end no motion. off: how far steps disagreed, at most so far, relative to the
    same. angle: by which the fastest mode turned in a step, ω_max h; steps damp out what they do not follow.
    """

    def __init__(self, system: PeriodicSystem, sizes: Array, count: int, rtol: float):
        self.nodes = np.linspace(0.0, system.period, count + 1)
        self._system, self._rtol, self._steps = system, rtol, _FIRST
        self._largest, self._turn = sizes, _Turn(system, 0.0, 0.0)
        self.angle, self.off = 0.0, 0.0

    def __call__(self, state: Array, start: float, speed: float, last: float | None = None) -> Array:
        """See `Marcher`."""
        ends = speed, speed if last is None else last
        if self._turn.ends != ends:
            self._turn = _Turn(self._system, *ends)
        turn = self._turn
        found, _ = turn.motion(state, self._steps, self.nodes)
        while True:
            coarse, (found, reached) = found, turn.motion(state, 2 * self._steps, self.nodes)
            sizes = np.maximum(self._largest, reached)
            change = np.abs(found[0] - coarse[0]).max(axis=1)
            off = float((change / without_zeros(sizes)).max())
            agree, steps = off <= self._rtol, 2 * self._steps
            if agree or steps == _MOST:
                self.off, self.angle = max(self.off, off), max(self.angle, turn.reach / steps)
                self._largest, self._steps = sizes, max(_FIRST, self._steps // 2) if agree else self._steps
                return found
            self._steps = steps


class _Turn:
    """A turn while the speed goes from the first to the last (rad/s), over s, time times the mean speed."""

    def __init__(self, system: PeriodicSystem, first: float, last: float):
        self._system, self.ends = system, (first, last)
        self._mean, self._made = (first + last) / 2, dict[int, Discretisation]()

    def motion(self, state: Array, steps: int, nodes: Array) -> tuple[Array, Array]:
        """q, v, a (3, n, k) at nodes (k,) by so many steps from the state (2n,), and max|q| (n,) at their
        ends."""
        made = self._made.get(steps) or self._discretised(steps)
        if steps * self._system.n**2 <= _KEPT:
            self._made[steps] = made
        x = np.empty((len(made.steps.A[0]) + 1, len(state)))
        x[0] = state
        for k, (A, b) in enumerate(zip(made.steps.A[0], made.steps.b[0], strict=True)):
            x[k + 1] = A @ x[k] + b
        curve = made.curve(x[None])[0]
        # At the period itself the curve begins anew.
        inside = np.minimum(nodes, np.nextafter(self._system.period, 0.0))
        largest = np.abs(x[:, : len(state) // 2]).max(axis=0)
        return np.stack([curve(inside, order) for order in range(3)]), largest

    def _discretised(self, steps: int) -> Discretisation:
        grid = Grid.uniform(steps, self._system.period, self._breaks)
        return METHOD.discretise(self._point, grid)

    @cached_property
    def _point(self) -> OnePoint:
        if self.ends[0] == self.ends[1]:
            return OnePoint(self._system, self._mean)
        given = self._system.coordinates, self._system.period, self._breaks
        return OnePoint(PeriodicSystem(self._matrices, *given), self._mean)

    @cached_property
    def reach(self) -> float:
        """Angle that the fastest mode turns in the turn."""
        return float(frozen(self._point, _LOOKS).phase_advance[0]) if self._mean else 0.0

    def _matrices(self, s: Array, _: float) -> Matrices:
        phase, speed, acceleration = driven(s, *self.ends, self._system.period)
        return self._system.varying(phase, speed, acceleration)

    @cached_property
    def _breaks(self) -> tuple[float, ...]:
        """Where the matrices jump, over s: φ mean = first s + slope s²/2 solved for s; and 0, since a turn
        does not begin as it ends."""
        first, last = self.ends
        if first == last:
            return 0.0, *self._system.breaks
        slope = (last - first) / self._system.period
        phases = {0.0, *(float(each) % self._system.period for each in self._system.breaks)}
        ways = (2 * self._mean * phase for phase in phases)
        return tuple(way / (first + math.sqrt(first**2 + slope * way)) if way else 0.0 for way in ways)
