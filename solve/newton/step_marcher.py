"""Integration of linear motion by steps, one period after another."""

import math
from functools import cached_property

import numpy as np

from solve.arrays import Array
from solve.certify.coefficients import ResampledPoints
from solve.contracts import Matrices, driven
from solve.equations import varying_of
from solve.first_order import MixedSystem
from solve.methods.method import Discretisation
from solve.methods.radau import Radau
from solve.newton.iteration import without_zeros
from solve.period.frozen import frozen
from solve.period.grid import Grid
from solve.period.points import DerivedPoints, Points, SinglePoint, Tables
from solve.system import PeriodicSystem

_FIRST_STEPS, _MAX_STEPS = 64, 2**14
"""Initial and maximum number of steps per period. Chosen by judgement."""

_PHASES = 32
"""Number of phases per period at which the frequency of the fastest mode is computed. Chosen by judgement."""

_MAX_CACHED = 2**21
"""Largest value of (number of steps) × (number of coordinates)² for which the one-step maps of a period are
stored for the next period. The maps then occupy at most 64 MB."""

_RESOLVED = 1e-10
"""Relative difference between the coefficients and their interpolant below which the interpolant is exact
enough for every tolerance. Chosen by judgement: about 1000 times the round-off of coefficients."""

_METHOD = Radau()


class StepMarcher:
    """Integrator of linear motion by steps of Radau's method, one period at a time, with `count` states per
    period.

    The number of steps is doubled until two results, and the result for averaged coefficients, agree to
    `rtol`, or until this number reaches 16384. The difference of the results is relative to the largest value
    of each coordinate so far, which is initially `sizes` (n,). The steps damp out modes that they do not
    resolve.

    error: largest relative difference so far. angle: largest ω_max h of the fastest mode so far.
    """

    def __init__(self, system: PeriodicSystem, sizes: Array, count: int, rtol: float):
        self.nodes = np.linspace(0.0, system.period, count + 1)
        self._system, self._rtol, self._steps = system, rtol, _FIRST_STEPS
        self._largest, self._period = sizes, _PeriodSteps(system, 0.0, 0.0)
        self.angle, self.error = 0.0, 0.0

    @property
    def damps(self) -> bool:
        """Whether the steps have damped out the fastest modes."""
        return self.angle > _METHOD.follows

    def __call__(self, state: Array, start: float, speed: float, last: float | None = None) -> Array:
        """Return the states of a period; see `Integrator`."""
        ends = speed, speed if last is None else last
        if self._period.ends != ends:
            self._period = _PeriodSteps(self._system, *ends)
        period = self._period
        fine, _ = period.motion(state, self._steps, self.nodes)
        while True:
            coarse, (fine, reached) = fine, period.motion(state, 2 * self._steps, self.nodes)
            sizes = np.maximum(self._largest, reached)
            steps, error = 2 * self._steps, _change(fine, coarse, sizes)
            if error <= self._rtol and (averaged := period.averaged_motion(state, steps, self.nodes)):
                error = _change(fine, averaged[0], np.maximum(sizes, averaged[1]))
            agree = error <= self._rtol
            if agree or steps == _MAX_STEPS:
                self.error, self.angle = max(self.error, error), max(self.angle, period.phase_advance / steps)
                self._largest, self._steps = (
                    sizes,
                    max(_FIRST_STEPS, self._steps // 2) if agree else self._steps,
                )
                return fine
            self._steps = steps


def _change(motion: Array, other: Array, sizes: Array) -> float:
    """Largest difference between the coordinates of two motions, relative to their sizes (n,)."""
    return float((np.abs(motion[0] - other[0]).max(axis=1) / without_zeros(sizes)).max())


class _WithBreaks(DerivedPoints):
    """Points whose period has additional breaks."""

    def __init__(self, points: Points, breaks: tuple[float, ...]):
        super().__init__(points)
        self.breaks = breaks

    def __getitem__(self, positions: Array) -> "_WithBreaks":
        return _WithBreaks(self.points[positions], self.breaks)

    def tables(self, phase: Array) -> Tables:
        return self.points.tables(phase)


class _PeriodSteps:
    """Steps over a period in which the speed changes linearly in time from `first` to `last` (rad/s). The
    independent variable s is the time multiplied by the mean speed."""

    def __init__(self, system: PeriodicSystem, first: float, last: float):
        self._system, self.ends = system, (first, last)
        self._mean_speed, self._cache = (first + last) / 2, dict[int, Discretisation]()
        self._averaged = dict[int, Discretisation | None]()

    def motion(self, state: Array, steps: int, nodes: Array) -> tuple[Array, Array]:
        """Return the motion q, v, a (3, n, k) at `nodes` (k,) from the state (2n,), and max|q| (n,) at the
        steps."""
        discretisation = self._cache.get(steps) or _METHOD.discretise(self._point, self._grid(steps))
        if steps * self._system.n**2 <= _MAX_CACHED:
            self._cache[steps] = discretisation
        return self._motion(discretisation, state, nodes)

    def averaged_motion(self, state: Array, steps: int, nodes: Array) -> tuple[Array, Array] | None:
        """Return the result of `motion` for coefficients that are averaged over the phases between the
        stages; None if the stages resolve the coefficients."""
        if steps not in self._averaged:
            self._averaged[steps] = self._averages(steps)
        averaged = self._averaged[steps]
        return None if averaged is None else self._motion(averaged, state, nodes)

    def _averages(self, steps: int) -> Discretisation | None:
        points = _WithBreaks(self._point, self._breaks)
        resampled = ResampledPoints(points, steps, (_METHOD.stages, _METHOD.with_another_stage.stages))
        if resampled.relative_difference[0] <= _RESOLVED:
            return None
        return _METHOD.discretise(resampled, self._grid(steps))

    def _motion(self, discretisation: Discretisation, state: Array, nodes: Array) -> tuple[Array, Array]:
        n, N = len(state) // 2, discretisation.steps.A.shape[-1]
        x = np.empty((len(discretisation.steps.A[0]) + 1, N))
        # The last coordinates may be first-order states without rates.
        x[0] = state[:N]
        for k, (A, b) in enumerate(zip(discretisation.steps.A[0], discretisation.steps.b[0], strict=True)):
            x[k + 1] = A @ x[k] + b
        curve = discretisation.curve(x[None])[0]
        # The curve is periodic: at the end of the period, it would return the values at the start.
        inside = np.minimum(nodes, np.nextafter(self._system.period, 0.0))
        largest = np.abs(x[:, :n]).max(axis=0)
        return np.stack([curve(inside, order) for order in range(3)]), largest

    def _grid(self, steps: int) -> Grid:
        return Grid.uniform(steps, self._system.period, self._breaks)

    @cached_property
    def _point(self) -> SinglePoint:
        if self.ends[0] == self.ends[1]:
            return SinglePoint(self._system, self._mean_speed)
        system = self._system
        inertial, states = system.coordinates[: system.n - len(system.states)], system.states
        varying = MixedSystem(self._matrices, inertial, states, system.period, self._breaks)
        return SinglePoint(varying, self._mean_speed)

    @cached_property
    def phase_advance(self) -> float:
        """Phase advance ω_max T of the fastest mode per period."""
        return float(frozen(self._point, _PHASES).phase_advance[0]) if self._mean_speed else 0.0

    def _matrices(self, s: Array, _: float) -> Matrices:
        phase, speed, acceleration = driven(s, *self.ends, self._system.period)
        return varying_of(self._system)(phase, speed, acceleration)

    @cached_property
    def _breaks(self) -> tuple[float, ...]:
        """Values of s at which the matrices jump, from φ · mean = first · s + slope · s²/2. They include s =
        0, because the state at the end of a period differs from the state at its start."""
        first, last = self.ends
        if first == last:
            return 0.0, *self._system.breaks
        slope = (last - first) / self._system.period
        phases = {0.0, *(float(phase) % self._system.period for phase in self._system.breaks)}
        doubled = (2 * self._mean_speed * phase for phase in phases)
        return tuple(
            value / (first + math.sqrt(first**2 + slope * value)) if value else 0.0 for value in doubled
        )
