"""Closed loops with a digital controller, which samples the outputs, computes the feedback, and holds it."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from solve.arguments import checked_rtol, require_integer
from solve.arrays import Array, midpoint_phases, uniform_phases
from solve.errors import ControlError, ValueOutOfBoundsError
from solve.matrices import SAME_PHASE
from solve.period.grid import Grid
from solve.period.multipliers import radius_verdicts
from solve.results.controller import SampledLoop
from solve.studies.control.closed_loop import ClosedLoop, Observer
from solve.studies.control.feedback import FeedbackLoop
from solve.studies.control.maps import FIRST_RTOL, FROZEN_PHASES, step_maps
from solve.studies.control.output_feedback import OutputFeedback
from solve.studies.control.plant import Plant
from solve.system import PeriodicSystem, check, of_system
from solve.units import speed_in_si

_ORDER, _ADVANCE = 8, 1.0
"""Order of the Gauss method, and phase advance per step of the fastest frozen mode, on the first grid, for
the tolerance `FIRST_RTOL`. Chosen by judgement: intervals between samples are short."""

_MOST = 20000
"""Largest number of steps. Chosen by judgement."""


@of_system
def sampled(
    system: PeriodicSystem, speed: float | str, samples: int, delay: int = 1, rtol: float = 1e-6
) -> SampledLoop:
    """Compute the stability of a closed loop whose inputs are held between samples.

    Parameters
    ----------
    system : PeriodicSystem
        Closed loop: `closed` of a controller, or an `OutputFeedback` without delay and filters.
    speed : float or str
        Ω in rad/s, or a string with a unit.
    samples : int
        Number of samples per period, the first one at phase 0.
    delay : int
        1 if inputs computed from a sample act from the next sample on, 0 if they act immediately.
    rtol : float
        Relative tolerance of the spectral radius.

    Returns
    -------
    SampledLoop
        Spectral radius with its error, verdict, and largest absolute values of coordinates and inputs on the
        periodic orbit.

    Raises
    ------
    ControlError
        For a system that is not such a closed loop.
    SolveError
        Other subclasses for bad input.

    Notes
    -----
    At each sample, the controller reads the measured quantities y, computes u = −K x + f or u = −K x̂ + f,
    and holds u. Between samples, u and y are constant, and the equations of the observer are integrated: x̂′
    = (A − LC) x̂ + B u + b + L y. The monodromy matrix is the product of the transition matrices of the
    intervals, from Gauss collocation, and the matrices of the jumps at the samples. The error of the spectral
    radius is estimated as the difference between two grids.

    Examples
    --------
    >>> import solve
    >>> found = solve.lqr(solve.load("manipulator"), "70 rpm", {"q2": 1e8}, {"u": 1e-3})
    >>> [sampled(found.closed, "70 rpm", samples).verdict for samples in (200, 1000)]
    ['unstable', 'asymptotically stable']
    """
    omega, rtol = speed_in_si(speed), checked_rtol(rtol)
    require_integer("samples", samples)
    if samples > _MOST:
        raise ValueOutOfBoundsError(f"samples is {samples}; allowed: at most {_MOST} per period")
    if delay not in (0, 1):
        raise ValueOutOfBoundsError(f"delay is {delay!r}; allowed: 0 and 1, in samples")
    plain = isinstance(system, OutputFeedback) and system.n == system.model.n
    if not isinstance(system, FeedbackLoop) or not (plain or isinstance(system, ClosedLoop)):
        raise ControlError(
            f"{system!r} has no feedback to be sampled; allowed: `closed` of a controller, or an "
            "OutputFeedback without delay and filters"
        )
    check(system, omega)
    return _Drive(system, omega, samples, delay).certified(rtol)


@dataclass(frozen=True)
class _Drive:
    """Closed loop with the states z = (x, x̂, y, u, u⁺, 1). Here u⁺ are the inputs that will act from the
    next sample on. The last four components are constant between samples."""

    loop: FeedbackLoop
    speed: float
    samples: int
    delay: int

    @cached_property
    def plant(self) -> Plant:
        return Plant(self.loop.open_loop, self.speed)

    @cached_property
    def design(self) -> Plant:
        """Plant for which the feedback was designed."""
        return Plant(self.loop.design, self.speed)

    @cached_property
    def places(self) -> list[slice]:
        """Slices of z that contain x, x̂, y, u and u⁺."""
        observer, N = self._observer, self.plant.N
        r = len(self.loop.open_loop.inputs)
        sizes = N, *((0, 0) if observer is None else (N, len(observer.measured))), r, r * self.delay
        ends = np.cumsum((0, *sizes)).tolist()
        return [slice(*each) for each in pairwise(ends)]

    @property
    def _observer(self) -> Observer | None:
        return self.loop.observer if isinstance(self.loop, ClosedLoop) else None

    def rates(self, phase: Array) -> Array:
        """Matrices (k, Z, Z) at phases (k,) between samples, which map z to dz/dφ."""
        x, estimate, y, u, later = self.places
        A, B, b = self.plant.dynamics(phase)
        rates = np.zeros((len(phase), later.stop + 1, later.stop + 1))
        rates[:, x, x], rates[:, x, u], rates[:, x, -1] = A, B, b
        if (observer := self._observer) is not None:
            A, B, b = self.design.dynamics(phase)
            L = observer.gain(phase).T.reshape(len(phase), self.design.N, -1)
            rates[:, estimate, estimate] = A - L @ self.design.rows(observer.measured, phase)
            rates[:, estimate, y], rates[:, estimate, u], rates[:, estimate, -1] = L, B, b
        return rates / self.speed

    def jumps(self, phase: Array) -> Array:
        """Matrices (k, Z, Z) for samples at phases (k,), which map z before a sample to z after it."""
        x, estimate, y, u, later = self.places
        jumps = np.tile(np.eye(later.stop + 1), (len(phase), 1, 1))
        computed = later if self.delay else u
        if self.delay:
            jumps[:, u, u], jumps[:, u, later] = 0.0, np.eye(u.stop - u.start)
        jumps[:, computed, computed] = 0.0
        if (observer := self._observer) is not None:
            jumps[:, y, y] = 0.0
            jumps[:, y, x] = self.plant.rows(observer.measured, phase)
        jumps[:, computed, x if observer is None else estimate] = -self._gain(phase)
        if isinstance(self.loop, ClosedLoop) and self.loop.ahead is not None:
            jumps[:, computed, -1] = self.loop.ahead(phase).T
        return jumps

    def _gain(self, phase: Array) -> Array:
        """Gain K (k, r, N) from the states to the inputs, at phases (k,)."""
        if isinstance(self.loop, ClosedLoop):
            return self.loop.feedback(phase)
        assert isinstance(self.loop, OutputFeedback)
        return self.loop.gain_matrix(phase) @ self.design.rows(self.loop.measured, phase)

    def certified(self, rtol: float) -> SampledLoop:
        """Return the result on a grid that is refined until the spectral radii of two grids agree."""
        system = self.loop.open_loop
        phase = midpoint_phases(FROZEN_PHASES, system.period)
        fastest = np.abs(np.linalg.eigvals(self.rates(phase))).max() * system.period
        steps = int(np.ceil(max(fastest / (_ADVANCE * (rtol / FIRST_RTOL) ** (1 / _ORDER)), self.samples)))
        # If the number of steps is a multiple of the number of samples, doubling it refines every interval
        # between samples.
        steps = self.samples * -(-min(steps, _MOST) // self.samples)
        radius = self.solved(steps).spectral_radius
        while True:
            steps *= 2
            found = self.solved(steps)
            error = abs(found.spectral_radius - radius)
            if error <= rtol * max(found.spectral_radius, 1.0) or steps >= _MOST:
                (verdict,) = radius_verdicts(np.array([found.spectral_radius]), np.array([error]))
                return found._replace(error=error, verdict=verdict)
            radius = found.spectral_radius

    def solved(self, steps: int) -> SampledLoop:
        """Return the spectral radius and the orbit on a grid of about `steps` steps."""
        loop, period = self.loop.open_loop, self.loop.open_loop.period
        times = uniform_phases(self.samples, period)
        grid = Grid.uniform(steps, period, (*loop.breaks, *times))

        def coefficients(phase: Array) -> tuple[Array, Array, Array]:
            rates = self.rates(phase)
            return rates, np.zeros((*rates.shape[:2], 0)), np.zeros_like(rates)

        maps = step_maps(coefficients, grid, _ORDER)[0].A
        first = np.searchsorted(grid.nodes, times - SAME_PHASE * period)
        maps[first] = maps[first] @ self.jumps(times)
        Phi = np.eye(maps.shape[-1])
        for each in maps:
            Phi = each @ Phi
        Phi, load = Phi[:-1, :-1], Phi[:-1, -1]
        radius = float(np.abs(np.linalg.eigvals(Phi)).max())
        z = np.append(np.linalg.solve(np.eye(len(load)) - Phi, load), 1.0)
        largest = np.abs(z)
        for each in maps:
            z = each @ z
            largest = np.maximum(largest, np.abs(z))
        names = dict(zip(loop.coordinates, largest.tolist(), strict=False))
        names |= dict(zip(loop.inputs, largest[self.places[3]].tolist(), strict=True))
        return SampledLoop(self.samples, self.delay, radius, np.inf, "", names)
