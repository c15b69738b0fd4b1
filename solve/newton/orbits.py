"""Periodic solutions of nonlinear equations of motion, with error estimates."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from solve.arguments import require_integer, require_steps
from solve.certify.all_multipliers import Spectrum, refined_multipliers
from solve.certify.certified import Failed
from solve.certify.refinement import certified
from solve.contracts import Motion
from solve.equations import events_of
from solve.errors import (
    ChatterError,
    NoOrbitError,
    ResonanceError,
    SolveError,
    UnbalancedLoadError,
    ValueOutOfBoundsError,
)
from solve.kernel.engines import chosen_engine
from solve.methods.choice import Rule, chosen, chosen_for
from solve.methods.collocated import Collocated
from solve.newton.iteration import QUADRATIC, Converged, Task, at_rest, curve_of, iterate
from solve.newton.method import Newton
from solve.newton.saltation import event_jumps
from solve.newton.starts import Start, motion_of
from solve.newton.strategies import by_load, by_speed, by_transient
from solve.period.grid import Grid
from solve.period.points import SinglePoint
from solve.results.special_orbits import NonlinearOrbit
from solve.single import request
from solve.system import PeriodicSystem, check, of_system, shown_in
from solve.terminal import progress
from solve.units import speed_in_si

_STEPS = 64, 128
"""Numbers of steps per period of the grids on which orbits are sought. Continuation in load or speed uses the
last grid. Chosen by judgement."""

_GIVEN_STEPS = 512
"""Minimum number of steps per period of the finest grid on which an orbit is sought from a given motion.
Chosen by judgement: with this number, an orbit with contact at a stop 30000 times as stiff as the spring is
recovered when the iteration starts from this orbit."""

_TRANSIENT = "transient"
_STRATEGIES = ("linear orbit", "load", "speed", _TRANSIENT)
"""Strategies in the order in which they are tried. For several periods, the transient comes first, because
the other strategies converge to an orbit of one period."""


@of_system
def nonlinear(
    system: PeriodicSystem,
    speed: float | str,
    start: Start | None = None,
    periods: int = 1,
    method: str | Rule = "auto",
    steps: int | None = None,
    rtol: float = 1e-8,
    engine: str = "auto",
    all_multipliers: bool = False,
) -> NonlinearOrbit:
    """Compute a periodic solution of the nonlinear equations of a model at a speed.

    Parameters
    ----------
    system : Model
        Model with nonlinear equations.
    speed : float or str
        Speed in rad/s, or a string with a unit.
    start : Orbit, Transient, (q, q̇), callable or path, optional
        Initial motion of Newton's iteration, over the period of the orbit or an integer fraction of it:

        - a linear or nonlinear orbit, even one for other parameter values, another speed or another number of
          steps;
        - a transient, of which the last periods are used;
        - the path of a .nc or .npz file of an orbit or a transient;
        - q and q̇ (n,) at phase 0, where q̇ is the derivative with respect to time. The motion is integrated
          from this state over the period;
        - a function of phases (k,) that returns q (n, k), or a motion with `nodes` as for
          `PeriodicSystem.along`.

        By default, the iteration starts from the linear orbit. If it does not converge, the initial motion is
        obtained by continuation in the load, by continuation in the speed, or from a transient from rest. If
        the orbit is unstable, a transient is tried too.
    periods : int
        Number of model periods per period of the orbit.
    method : str or Method
        "auto", "radau" or "gauss".
    steps : int, optional
        Number of steps per period of the orbit.
    rtol : float
        Tolerance of the orbit and of the multipliers.
    engine : str
        "auto", "compiled" or "numpy".
    all_multipliers : bool
        Whether to apply `rtol` to each multiplier, however small.

    Returns
    -------
    NonlinearOrbit
        Periodic orbit. Its `system` is the system linearised along the orbit.

    Raises
    ------
    LinearModelError
        For systems without nonlinear equations.
    NoOrbitError
        If no orbit is found. The message states the progress of each strategy.
    ChatterError
        If the motion passes too many switches of the equations per period.
    ValueOutOfBoundsError, FileError
        For bad input.

    Notes
    -----
    Each correction of the iteration is the solution of a linear periodic problem. The error of the orbit is
    estimated from the difference between this orbit and the orbit by the method with one more stage. The
    multipliers are those of the system linearised along the orbit.
    """
    omega, rule, (used, notes) = speed_in_si(speed), chosen(method), chosen_engine(engine)
    require_integer("periods", periods)
    if steps is not None:
        require_steps(steps)
    solve_request = request(steps, rtol, used, True)
    check(system, omega)
    system = shown_in(system, omega)
    collocated = _collocated(rule, at_rest(system, omega, used))
    task = Task(system, omega, int(periods), collocated, used, solve_request.rtol)
    search = _Search(task, steps, notes, all_multipliers)
    return search.find() if start is None else search.certified(search.iterate(start), "start")


def _collocated(rule: Rule, point: SinglePoint) -> Collocated:
    ((method, _),) = chosen_for(rule, point)
    if not isinstance(method, Collocated):
        raise ValueOutOfBoundsError(
            f"method is {method.name}; nonlinear orbits support radau, gauss and auto"
        )
    return method


@dataclass(frozen=True)
class _Search:
    """Search for an orbit by several strategies.

    steps: number of steps of the grid; None for an automatic choice. notes: notes on the engine.
    all_multipliers: whether `rtol` applies to each multiplier."""

    task: Task
    steps: int | None
    notes: Sequence[str]
    all_multipliers: bool = False

    @property
    def grids(self) -> list[Grid]:
        """Grids on which the orbit is sought. Continuation in load or speed uses the last one."""
        counts = [steps * self.task.periods for steps in _STEPS] if self.steps is None else [self.steps]
        return [self.task.grid(count) for count in counts]

    def find(self) -> NonlinearOrbit:
        """Return the orbit that the first successful strategy finds. If this orbit is unstable, but a
        transient settles on an orbit that is not unstable, return the orbit of the transient."""
        strategies = _STRATEGIES if self.task.periods == 1 else (_TRANSIENT, *_STRATEGIES[:-1])
        failed: list[str] = []
        unstable: NonlinearOrbit | None = None
        with progress.steps(len(strategies)) as step:
            for strategy in strategies:
                if unstable is not None and strategy != _TRANSIENT:
                    continue
                step(f"by the {strategy}")
                try:
                    orbit = self._orbit_by(strategy, failed)
                except UnbalancedLoadError:
                    raise
                except SolveError as error:
                    if isinstance(error, ChatterError) and strategy == _TRANSIENT:
                        raise
                    failed.append(f"by the {strategy}: {error}")
                    continue
                if orbit.verdict != "unstable" or (strategy == _TRANSIENT and unstable is None):
                    return orbit
                failed.append(f"by the {strategy}: the orbit is unstable")
                unstable = unstable or orbit
        if unstable is not None:
            return replace(unstable, settled=False)
        raise NoOrbitError(
            f"no periodic orbit of {self.task.system.labels.name} was reached at "
            f"{self.task.speed_text(self.task.speed)}; {'; '.join(failed)}; there may be no stable "
            "orbit of this period: try more periods or another speed, or give an orbit or a transient "
            "as the start"
        )

    def _orbit_by(self, strategy: str, failed: Sequence[str]) -> NonlinearOrbit:
        finest, settled = self.grids[-1], True
        if strategy == _TRANSIENT:
            reached, settled = by_transient(self.task, finest)
        elif strategy == "linear orbit":
            reached = self.iterate(None)
        else:
            reached = (by_load if strategy == "load" else by_speed)(self.task, finest)
        return self.certified(reached, strategy, failed, settled)

    def iterate(self, start: Start | None) -> Converged:
        """Return the orbit by Newton's iteration from the motion of `start` (by default, from rest), on the
        first grid on which the iteration converges."""
        motion = None if start is None else motion_of(start, self.task)
        self._check_period(motion)
        *coarser, finest = self.grids if motion is None else self._grids_from(motion)
        for grid in coarser:
            try:
                return iterate(self.task, motion or self.task.rest(grid), grid, last=QUADRATIC)
            except (NoOrbitError, ResonanceError):
                continue
        return iterate(self.task, motion or self.task.rest(finest), finest, last=QUADRATIC)

    def _grids_from(self, motion: Motion) -> list[Grid]:
        """Return the grids of a search that starts from `motion`. Coarse grids may not resolve its short
        contacts. The last grid therefore has at least as many steps as the motion."""
        if self.steps is not None:
            return self.grids
        steps = round(self.task.period / motion.nodes[-1]) * (len(motion.nodes) - 1)
        steps = max(steps, _GIVEN_STEPS * self.task.periods)
        return [*self.grids, self.task.grid(min(steps, self.task.method.most_steps(self.task.system.n)))]

    def _check_period(self, motion: Motion | None) -> None:
        ratio = 1.0 if motion is None else self.task.period / motion.nodes[-1]
        if not math.isclose(ratio, max(1, round(ratio)), rel_tol=1e-9):
            raise ValueOutOfBoundsError(
                f"the start repeats after {self.task.period / ratio:.6g} in phase; allowed: the period of "
                f"the orbit, {self.task.period:.6g}, or an integer fraction of it; give `periods` to match"
            )

    def certified(
        self, found: Converged, strategy: str, failed: Sequence[str] = (), settled: bool = True
    ) -> NonlinearOrbit:
        """Certify the orbit `found`, which was computed on one grid."""
        task, start, first = self.task, found.curve, found.solutions.grid.steps
        solve_request = request(self.steps, task.rtol, task.engine, True)
        newton = Newton(task, start, first, predicts=self.steps is None)
        (result,) = certified(newton.point(), newton, solve_request)
        if isinstance(result, Failed):
            raise result.reason
        refined = refined_multipliers(newton.point(), result) if self.all_multipliers else None
        curve, grid = curve_of(result.solutions), result.solutions.grid
        linearised = task.along(curve)
        result = replace(result, method=task.method)
        jumps = event_jumps(linearised, curve, task.speed, grid)
        return NonlinearOrbit(
            linearised,
            task.speed,
            result,
            Spectrum(
                SinglePoint(linearised, task.speed),
                result,
                refined,
                self.all_multipliers,
                newton if jumps else None,
            ),
            self.notes,
            iterations=found.iterations,
            found_by=strategy,
            failed=tuple(failed),
            periods=task.periods,
            settled=settled,
            events=events_of(linearised).phases,
            grazing=events_of(linearised).grazing,
        )
