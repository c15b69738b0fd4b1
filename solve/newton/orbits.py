"""The periodic solution of nonlinear equations of motion, certified as the linear one is."""

import math
import reprlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from solve.argument import require_whole
from solve.certify.all_multipliers import Spectrum, refined, rigid_multipliers
from solve.certify.certified import Failed
from solve.certify.refinement import certified
from solve.contracts import Motion
from solve.errors import (
    NoOrbitError,
    ResonanceError,
    SolveError,
    UnbalancedLoadError,
    ValueOutOfBoundsError,
)
from solve.kernel.engines import chosen_engine
from solve.methods.choice import Rule, chosen, chosen_for
from solve.methods.collocation import Collocated
from solve.methods.radau import Radau
from solve.newton.continuation import by_load, by_speed
from solve.newton.iteration import Converged, Newton, Task, at_rest, iterated
from solve.newton.settling import by_transient
from solve.period.grid import Grid
from solve.period.points import OnePoint
from solve.progress import steps
from solve.results.nonlinear import NonlinearOrbit
from solve.results.orbit import Orbit
from solve.single import request
from solve.system import PeriodicSystem, of_system
from solve.units import speed_in_si

_STEPS = 64, 128
"""Of a period on the grids on which orbits are looked for; the last where one is followed."""

_TRANSIENT = "transient"
_WAYS = ("linear orbit", "load", "speed", _TRANSIENT)
"""In their order; for several periods the transient is first, as the others lead to an orbit of one."""


@of_system
def nonlinear(
    system: PeriodicSystem,
    speed: float | str,
    start: Orbit | Motion | None = None,
    periods: int = 1,
    method: str | Rule = "auto",
    steps: int | None = None,
    rtol: float = 1e-8,
    engine: str = "auto",
    all_multipliers: bool = False,
) -> NonlinearOrbit:
    """The periodic solution of a model's nonlinear equations at a speed (rad/s, or a text with unit).

    Each correction of Newton's iteration is a linear periodic problem; errors are estimated from two grids
    on which the iteration has converged, multipliers are those of the converged linearisation. periods: how
    many of the model's make one of the orbit. start: an orbit, or a motion with `nodes` from 0 to the end of
    its period and q (n, k) at phases (k,) when called, as `PeriodicSystem.along` takes it. Without, the
    iteration starts from the linear orbit; where that does not converge, the orbit is followed in the load
    or in the speed, or a transient from rest leads to it. all_multipliers: `rtol` holds for each multiplier,
    however small, on grids on which the iteration has converged too. Raises LinearModelError for systems
    without nonlinear equations, NoOrbitError, which says how far each way came, and other SolveError
    subclasses for bad input.
    """
    omega, rule, (used, notes) = speed_in_si(speed), chosen(method), chosen_engine(engine)
    require_whole("periods", periods)
    asked = request(steps, rtol, used, True)
    system.checked(omega)
    system = system.shown_in(omega)
    task = Task(system, omega, int(periods), _collocated(rule, system, omega), used, asked.rtol)
    search = _Search(task, steps, notes, all_multipliers)
    return search.found() if start is None else search.certified(search.iterated(start), "start")


def _collocated(rule: Rule, system: PeriodicSystem, speed: float) -> Collocated:
    rest = at_rest(system.n, Grid.uniform(1, system.period))
    ((method, _),) = chosen_for(rule, OnePoint(system.along(rest), speed))
    if not isinstance(method, Collocated):
        raise ValueOutOfBoundsError(
            f"method is {method.name}; a nonlinear orbit takes radau, gauss, or auto, which chooses"
        )
    return method


@dataclass(frozen=True)
class _Search:
    """Ways to an orbit, on grids of so many steps or, without, of few; notes: what the engine has to say;
    every: whether each multiplier shall have its digits."""

    task: Task
    steps: int | None
    notes: Sequence[str]
    every: bool = False

    @property
    def grids(self) -> list[Grid]:
        """Those on which orbits are looked for; the last where one is followed."""
        counts = [each * self.task.periods for each in _STEPS] if self.steps is None else [self.steps]
        return [self.task.grid(count) for count in counts]

    def found(self) -> NonlinearOrbit:
        """By the first way that leads to an orbit; where that is unstable, what a transient settles on, if it
        does on one that is not."""
        ways = _WAYS if self.task.periods == 1 else (_TRANSIENT, *_WAYS[:-1])
        failed: list[str] = []
        unstable: NonlinearOrbit | None = None
        with steps(len(ways)) as step:
            for way in ways:
                if unstable is not None and way != _TRANSIENT:
                    continue
                step(f"by the {way}")
                try:
                    orbit = self._by(way, failed)
                except UnbalancedLoadError:
                    raise
                except SolveError as error:
                    failed.append(f"by the {way}: {error}")
                    continue
                if orbit.verdict != "unstable" or (way == _TRANSIENT and unstable is None):
                    return orbit
                failed.append(f"by the {way}: an orbit that is unstable")
                unstable = unstable or orbit
        if unstable is not None:
            return replace(unstable, settled=False)
        raise NoOrbitError(
            f"no periodic orbit of {self.task.system.name} was reached at "
            f"{self.task.in_words(self.task.speed)}; {'; '.join(failed)}; there may be no stable orbit of "
            "this period: try more periods or another speed, or give a start"
        )

    def _by(self, way: str, failed: Sequence[str]) -> NonlinearOrbit:
        finest, settled = self.grids[-1], True
        if way == _TRANSIENT:
            reached, settled = by_transient(self.task, finest)
        elif way == "linear orbit":
            reached = self.iterated(None)
        else:
            reached = (by_load if way == "load" else by_speed)(self.task, finest)
        return self.certified(reached, way, failed, settled)

    def iterated(self, start: Orbit | Motion | None) -> Converged:
        """From a motion, by default rest, on the first of the grids on which the iteration converges."""
        motion = start.motion if isinstance(start, Orbit) else start
        if motion is not None and not hasattr(motion, "nodes"):
            raise ValueOutOfBoundsError(
                f"start is {reprlib.repr(start)}; allowed: an orbit or the motion of one; leave it out "
                "to begin with the linear orbit"
            )
        given = self.task.system.n if motion is None else len(motion(np.zeros(1)))
        if given != self.task.system.n:
            raise ValueOutOfBoundsError(
                f"start has {given} coordinates; {self.task.system.name} has {self.task.system.n}"
            )
        self._check_period(motion)
        for grid in self.grids[:-1]:
            try:
                return iterated(self.task, motion or self.task.rest(grid), grid)
            except (NoOrbitError, ResonanceError):
                continue
        return iterated(self.task, motion or self.task.rest(self.grids[-1]), self.grids[-1])

    def _check_period(self, motion: Motion | None) -> None:
        shares = 1.0 if motion is None else self.task.period / motion.nodes[-1]
        if not math.isclose(shares, max(1, round(shares)), rel_tol=1e-9):
            raise ValueOutOfBoundsError(
                f"the start repeats after {self.task.period / shares:.6g} in phase; allowed: the period of "
                f"the orbit, {self.task.period:.6g}, or a whole part of it; give `periods` to match"
            )

    def certified(
        self, found: Converged, way: str, failed: Sequence[str] = (), settled: bool = True
    ) -> NonlinearOrbit:
        """The orbit on grids that agree, from that on one grid."""
        task, start, first = self.task, found.curve, found.solutions.grid.steps
        asked = request(self.steps, task.rtol, task.engine, True)
        newton = Newton(task, start, first, found)
        asked = replace(asked, witness=Newton(replace(task, method=Radau()), start, first))
        (result,) = certified(newton.point(), newton, asked)
        if isinstance(result, Failed):
            raise result.reason
        assert result.solutions.curve is not None
        every_one = (
            refined(newton.point(), newton, asked, result.steps, rigid_multipliers(result))
            if self.every
            else None
        )
        linearised, result = task.system.along(result.solutions.curve[0]), replace(result, method=task.method)
        return NonlinearOrbit(
            linearised,
            task.speed,
            result,
            Spectrum(OnePoint(linearised, task.speed), result, every_one),
            self.notes,
            iterations=found.iterations,
            found_by=way,
            failed=tuple(failed),
            periods=task.periods,
            settled=settled,
        )
