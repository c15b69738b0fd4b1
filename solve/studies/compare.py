"""Comparison of methods on one problem, at equal steps and at equal accuracy."""

import math
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from solve.arguments import checked_rtol, require_integer
from solve.arrays import Array
from solve.certify.certified import unresolved_modes_warning, verdicts_of
from solve.certify.comparison import differences
from solve.certify.point_solver import PointSolver
from solve.errors import SolveError, ValueOutOfBoundsError, counted
from solve.kernel.engines import NUMPY
from solve.methods.choice import METHODS, Rule, chosen, chosen_for
from solve.methods.method import Method, Solutions
from solve.period.frozen import frozen
from solve.period.multipliers import VERDICTS
from solve.period.points import SinglePoint
from solve.results.comparison import MULTIPLIERS, ORBIT, Comparison, Row
from solve.results.orbit import Orbit
from solve.single import periodic, request
from solve.system import PeriodicSystem, of_system, shown_in
from solve.terminal import progress
from solve.units import speed_in_si

TARGETS = (1e-3, 1e-6)
"""Relative errors at which methods are compared by default."""

_REFERENCE_RTOL = 1e-12

_BISECTION_RATIO = 1.02
"""The bisection for the smallest sufficient number of steps ends when the ratio of the upper to the lower
bound is below this number. Chosen by judgement."""

_MAX_SECONDS = 2.0
"""Maximum time in seconds that one solution may take in the search for the smallest sufficient number of
steps. Chosen by judgement."""

_REPEATS = 5
_MAX_REPEAT_SECONDS = 0.1
"""Maximum number of timed runs of a solution, and total time in seconds after which no further run is
started. Chosen by judgement."""

_BEYOND = 1e-3
"""Rows with doubled steps are added until the error falls to this fraction of the smallest target. A figure
then shows the trend. Chosen by judgement."""


@of_system
def compare(
    system: PeriodicSystem,
    speed: float | str,
    methods: str | Sequence[str | Rule] | None = None,
    steps: Sequence[int] | None = None,
    targets: Sequence[float] = TARGETS,
) -> Comparison:
    """Compare methods with a converged reference solution, at equal steps and at equal accuracy.

    Parameters
    ----------
    system : PeriodicSystem
        System to solve.
    speed : float or str
        Speed in rad/s, or a string with a unit.
    methods : str or sequence of str or Method, optional
        Methods, by default all.
    steps : sequence of int, optional
        Numbers of steps for the comparison at equal steps; by default four numbers around the one that
        resolves the fastest mode.
    targets : sequence of float
        Relative errors for the comparison at equal accuracy. For each target, the smallest number of steps is
        sought with which the orbit (without a load, the multipliers) is accurate enough.

    Returns
    -------
    Comparison
        Errors and computing times of the methods, all of which run in NumPy. If a method fails, its row
        states the reason.

    Raises
    ------
    SolveError
        A subclass for bad input, and if no periodic solution exists.
    """
    omega = speed_in_si(speed)
    system = shown_in(system, omega)
    given_counts = [] if steps is None else list(steps)
    for count in given_counts:
        require_integer("steps", count)
    if len(targets) == 0:
        raise ValueOutOfBoundsError("'targets' is empty; give at least one relative error, such as 1e-3")
    goals = sorted((checked_rtol(target) for target in targets), reverse=True)
    named = [methods] if isinstance(methods, str) else methods
    rules = [chosen(method) for method in named or [name for name in METHODS if name != "auto"]]
    with progress.task("reference"):
        reference = periodic(system, omega, rtol=_REFERENCE_RTOL)
    judged_by = ORBIT if reference.q.any() else MULTIPLIERS
    finest = max(_BEYOND * min(goals), 10 * max(reference.error_estimate))
    rows, measured = [], []
    counts = given_counts or usual_steps(system, omega)
    with progress.task("methods", len(rules)):
        for rule in rules:
            run = _AgainstReference(reference, rule, judged_by)
            with progress.subtask("methods"), progress.task(run.name):
                rows += [run.measured(count, "equal steps") for count in counts]
                trace = run.refined(min(*goals, finest))
                measured += trace
                rows += [run.at_accuracy(goal, trace) for goal in goals]
    return Comparison(reference, judged_by, targets, rows, measured)


def usual_steps(system: PeriodicSystem, speed: float) -> list[int]:
    """Return four numbers of steps from the series 1, 2, 5, 10, … near ω_max T, which is the number of steps
    for ω_max h = 1."""
    phase_advance = max(float(frozen(SinglePoint(system, speed)).phase_advance[0]), 100.0)
    series = [digit * 10**power for power in range(1, 9) for digit in (1, 2, 5)]
    first = next(index for index, count in enumerate(series) if count >= 0.4 * phase_advance)
    return series[first : first + 4]


def label(method: Method) -> str:
    """Return the name of a method, followed by the settings that differ from the defaults."""
    defaults = type(method)().settings
    changed = [f" {name} {value}" for name, value in method.settings.items() if value != defaults[name]]
    return method.name + "".join(changed)


class _AgainstReference:
    """Comparison of one method with the reference solution."""

    def __init__(self, reference: Orbit, rule: Rule, judged_by: str):
        self.point = SinglePoint(reference.system, reference.speed)
        self.reference = reference.certified.solutions
        self.judged_by = judged_by
        self._modes = reference.certified.modes
        ((self.method, _),) = chosen_for(rule, self.point)
        self.name = label(self.method)
        solve_request = request(None, _REFERENCE_RTOL, NUMPY, orbit=True)
        self.solver = PointSolver(self.point, self.method, solve_request)

    @property
    def least(self) -> int:
        """Smallest number of steps that the method accepts."""
        return max(1, len(self.point.breaks), int(self.solver.min_steps[0]))

    def measured(self, steps: int, at: str, target: float | None = None, repeats: int = _REPEATS) -> Row:
        """Return a row with the errors and the time for a number of steps, or with the reason why the method
        failed. `at` names the group of rows."""
        blank = Row(self.name, self.method.order, None, at, asked=steps, target=target)
        if steps > self.solver.max_steps:
            return replace(blank, reason=self._limit)
        try:
            solution, seconds = self._timed(steps, repeats)
        except (SolveError, np.linalg.LinAlgError) as refusal:
            return replace(blank, reason=self._unnamed(str(refusal)))
        ((orbit_error, multiplier_error),) = self._differences(solution)
        unresolved = unresolved_modes_warning(self.method, self._phase_advance, solution.grid.steps)
        return replace(
            blank,
            steps=solution.grid.steps,
            orbit_error=float(orbit_error) if self.judged_by == ORBIT else math.nan,
            multiplier_error=float(multiplier_error),
            time=seconds,
            verdict=VERDICTS[verdicts_of(solution, np.zeros(1), self._modes)[0]],
            followed=not unresolved,
            warnings=[*map(self._unnamed, self.method.warnings), *unresolved],
        )

    def refined(self, goal: float) -> list[Row]:
        """Return rows with doubled steps, until the error is at most `goal`, the errors stop decreasing, or a
        memory or time limit is reached."""
        steps = max(2, self.least)
        trace: list[Row] = []
        while steps <= self.solver.max_steps:
            row = self.measured(steps, "doubled steps")
            trace.append(row)
            if row.error(self.judged_by) <= goal or 2 * row.time > _MAX_SECONDS or self._stalled(trace):
                break
            steps *= 2
        return trace

    def at_accuracy(self, goal: float, trace: list[Row]) -> Row:
        """Return a row with the smallest number of steps whose error is at most `goal`, found by bisection
        between two rows of `trace`."""
        reached = next((k for k, row in enumerate(trace) if row.error(self.judged_by) <= goal), None)
        if reached is None:
            reason = f"out of reach: {self._obstacle(goal, trace)}"
            return Row(self.name, self.method.order, None, "equal accuracy", target=goal, reason=reason)
        high = trace[reached].asked or 1
        low = (trace[reached - 1].asked or 1) if reached else self.least - 1
        while high > _BISECTION_RATIO * low and high - low > 1:
            middle = round(math.sqrt(max(low, 1) * high))
            middle = min(max(middle, low + 1), high - 1)
            reaches = self.measured(middle, "bisection", repeats=1).error(self.judged_by) <= goal
            low, high = (low, middle) if reaches else (middle, high)
        return self.measured(high, "equal accuracy", goal)

    def _differences(self, solution: Solutions) -> Array:
        return differences(solution, self.reference, self.solver.modes)

    def _solved(self, steps: int) -> Solutions:
        for failure in self.solver.unstable_points(steps, np.zeros(1, dtype=int)):
            raise failure.reason
        # If the solution of a method grows without bound, its errors show this; overflow warnings are not
        # needed.
        with np.errstate(all="ignore"):
            return self.solver.solve(steps, np.zeros(1, dtype=int)).checked()

    @property
    def _phase_advance(self) -> float:
        """Phase advance ω_max T in rad."""
        return float(self.solver.modes.phase_advance[0])

    def _timed(self, steps: int, repeats: int) -> tuple[Solutions, float]:
        """Return the solution and the shortest time of repeated runs."""
        times: list[float] = []
        while True:
            start = time.process_time()
            solution = self._solved(steps)
            times.append(time.process_time() - start)
            if len(times) == repeats or sum(times) > _MAX_REPEAT_SECONDS:
                return solution, min(times)

    def _stalled(self, trace: list[Row]) -> bool:
        """Whether three doublings of the steps did not reduce the error although the steps resolve the
        fastest mode."""
        phase_advance = self._phase_advance
        errors = [row.error(self.judged_by) for row in trace if (row.steps or 0) > phase_advance]
        return len(errors) > 3 and min(errors[-3:]) > 0.9 * min(errors[:-3])

    def _unnamed(self, refusal: str) -> str:
        """Return the message of an exception without the name of the method, because the row already contains
        the name."""
        return refusal.removeprefix(f"{self.method.name}: ").removeprefix(f"{self.method.name} ")

    @property
    def _limit(self) -> str:
        return f"takes at most {self.solver.max_steps} steps per period for n = {self.point.n}"

    def _obstacle(self, goal: float, trace: list[Row]) -> str:
        done = [row for row in trace if row.reason is None]
        if not done:
            return trace[-1].reason or "" if trace else self._limit
        last = done[-1]
        error = last.error(self.judged_by)
        so_far = f"{error:.1e} with {counted(last.steps, 'step')}"
        if not self.method.converges or self._stalled(trace):
            return f"{so_far}, and more steps do not reduce the error"
        if 2 * last.time > _MAX_SECONDS:
            so_far += f" and {last.time:.1f} s"
        order = self.method.curve_order if self.judged_by == ORBIT else self.method.order
        if math.isfinite(order):
            so_far += f", about {(last.steps or 1) * (error / goal) ** (1 / order):.0e} needed"
        return so_far if 2 * last.time > _MAX_SECONDS else f"{so_far}, {self._limit}"
