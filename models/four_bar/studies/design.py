"""Design method as a study: target speed, run-up plan, simulated run-ups, and the command."""

import re
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
import typer

from models.four_bar.design import (
    Design,
    damping_effects,
    default_target,
    designed,
    least_ratio,
    plan_to_last,
    ratios_along,
)
from models.four_bar.design_map import (
    DesignError,
    DesignMap,
    allowed_lengths,
    checked_allowable,
    design_map,
)
from models.four_bar.linkage import Linkage
from models.four_bar.outcome import Outcome, Trial
from models.four_bar.plan import Plan
from models.four_bar.run_up import RunUp, simulate
from models.four_bar.stress_map import spaced
from models.four_bar.studies.shared import FourBar
from models.four_bar.views.tables import design_report
from solve.arrays import Array, uniform_phases
from solve.beams.motion import lowest_frequencies
from solve.beams.structure import StructureModel
from solve.commands.deliver import deliver_result
from solve.commands.groups import Flag, Results
from solve.errors import MissingValueError, UnitError, ValueOutOfBoundsError
from solve.results.contents import Column, Columns, FileContents, rows_of
from solve.results.result import Result
from solve.system import PeriodicSystem, shown_in
from solve.terminal import progress
from solve.units import (
    RAD_PER_S,
    GivenSpeed,
    ShownUnit,
    conversion,
    speed_in_si,
    speeds_in_si,
    with_unit,
)
from solve.views.show import printout
from solve.views.style import Figure

_HALVINGS = 6
"""Maximum number of simulated run-ups, each of which has half the duration of the previous one. Chosen by
judgement."""

_RETURN_FRACTION = 0.2
"""Duration of the return of the pivot, relative to that of the run-up. Chosen by judgement."""

_FIRST, _LAST, _RATIO = 1 / 32, 2 / 7, 1.04
"""First and last default speed of the map, relative to the mean lowest frequency, and ratio of neighbouring
speeds. Chosen by judgement.

The mean lowest frequency is then 32 to 3.5 times the speed, so that the map contains superharmonic resonances
of the orders 4 to 32.
"""

_FEWEST_SPEEDS, _LENGTHS, _MOST_LENGTHS = 5, 48, 200
"""Smallest number of speeds in a map; default number and largest number of lengths L4. Chosen by
judgement."""

_RANGE = re.compile(r"(?P<low>[^:\s]+):(?P<high>[^:\s]+)(:(?P<count>\d+))?\s+(?P<unit>\S.*)")


@dataclass(frozen=True)
class DesignResult(Outcome, Result):
    """Outcome of the design method as a result with a record, columns, tables, a figure and files."""

    @property
    def system(self) -> PeriodicSystem:  # type: ignore[override]
        return self.map.model

    @property
    def summary_values(self) -> dict[str, Any]:
        """Values of the result in SI units. Ratios are stresses divided by allowable stresses."""
        design, stresses, links = self.design, self.map, self.map.links
        smallest = self.least[0] * stresses.allowable
        return {
            "allowable": dict(zip(links, stresses.allowable, strict=True)),
            "speeds": stresses.speeds,
            "L4": stresses.L4,
            "own_L4": stresses.own_L4,
            "stress": dict(zip(links, np.moveaxis(stresses.stress, 2, 0), strict=True)),
            "error": float(np.nanmax(stresses.error)),
            "interpolation_error": stresses.interpolation_error,
            "limiting": design.limiting,
            "critical": design.peaks,
            "quiet": design.quiet,
            "quiet_of": design.quiet_of,
            "beyond": design.quiet_above,
            "least_ratio": design.needed,
            "damping": [{"speed": effect.speed, **effect.sensitivity} for effect in self.damping],
            "target": self.target,
            "returns": self.returns,
            "least": {"moving": self.least[0], "returning": self.least[1]},
            "smallest_allowable": dict(zip(links, smallest, strict=True)),
            "verdict": "plan" if self.plan is not None else "no plan",
            "text": self.text,
            "plan": self._plan_record,
            "trials": rows_of(self.trial_columns),
            "safe_acceleration": self.safe_acceleration,
        }

    @property
    def _plan_record(self) -> dict[str, Any] | None:
        if self.plan is None:
            return None
        steady = float(self.steady.max())
        return {**vars(self.plan), "greatest_steady_ratio": steady, "rate": self.design.rate}

    @property
    def columns(self) -> Columns:
        """Columns of the table, with one row per speed: the stress of each link for the mechanism's own L4,
        and the stress ratios that are needed to reach the speed."""
        needed, stresses, axes = self.design.needed, self.map, ("speed",)
        columns = {"speed": Column(stresses.speeds, "rad/s", "speed of the crank", axes=axes)}
        for number, link in enumerate(stresses.links):
            own_stress = stresses.stress[:, stresses.own_index, number]
            columns[f"{link}_stress"] = Column(
                own_stress, "Pa", f"largest of the {link} at its own L4", axes=axes
            )
        for name, ratio, how in (
            ("fixed", needed.fixed, "with L4 fixed"),
            ("moving", needed.moving, "with L4 changing"),
            ("returning", needed.returning, "with L4 changing and returning"),
        ):
            meaning = f"ratio to the allowable stress that is needed to reach the speed {how}"
            columns[f"least_ratio_{name}"] = Column(ratio, "1", meaning, axes=axes)
        return columns

    def file_contents(self) -> FileContents:
        """Columns of the table. Files .npz and .mat also contain the whole map and the simulation of the
        slowest run-up."""
        contents, stresses = super().file_contents(), self.map
        arrays = {**contents.numbers, "L4": stresses.L4, "stress": stresses.stress}
        arrays["links"] = np.array(stresses.links)
        if self.plan is not None:
            arrays |= {"plan_speed": self.plan.speed, "plan_L4": self.plan.L4}
            arrays |= {f"simulated_{name}": array for name, array in vars(self.trials[0].simulated).items()}
        return replace(contents, arrays=arrays)

    def plot(self) -> Figure:
        """Figure of the map with the plan, of the stress ratio that is needed to reach each speed, and of the
        slowest simulation."""
        from models.four_bar.views.figures import design_figure

        return design_figure(self)


printout.register(DesignResult)(design_report)


def carry_out(design: Design, target: float | None = None, duration: float = 60.0) -> DesignResult:
    """Apply the design method to a target speed.

    `target` is in rad/s; by default, the method chooses it. `duration` is that of the slowest run-up, in s.
    Raises DesignError for a target outside the map.
    """
    stresses, rate = design.map, design.rate
    if target is None:
        target = default_target(design)
    else:
        require_target(target, stresses.speeds, stresses.model.labels.speed_unit)
    until = stresses.until(target)
    least = least_ratio(until, rate, False), least_ratio(until, rate, True)
    returns = least[1] <= 1
    plan = plan_to_last(until, rate, returns)
    steady = np.empty((0, len(stresses.links))) if plan is None else ratios_along(until, plan)
    trials = [] if plan is None else _simulated(stresses, plan, returns, duration)
    speeds = [*(peak.speed for peak in design.peaks), *(band.quietest for band in design.quiet[1:]), target]
    effects = damping_effects(stresses, np.unique(speeds))
    return DesignResult(design, target, until, returns, least, plan, steady, trials, effects)


def require_target(target: float, speeds: Array, unit: ShownUnit) -> None:
    """Raise DesignError for a target (rad/s) outside the speeds of a map."""
    if not speeds[0] < target <= speeds[-1]:
        raise DesignError(
            f"the target, {unit.text(target, '.4g')}, is not between "
            f"{unit.span(speeds[0], speeds[-1], 'and', '.4g')}, the speeds of the map; widen --speeds"
        )


def _simulated(stresses: DesignMap, plan: Plan, returns: bool, duration: float) -> list[Trial]:
    """Simulate the plan with the duration `duration` (s), then with half of it, and so on, until a stress
    exceeds the allowable one."""
    trials: list[Trial] = []
    start, home = float(plan.speed[0]) / 10, stresses.own_L4 if returns else None
    for halving in range(_HALVINGS):
        within = duration / 2**halving
        run_up = RunUp(plan, start, within, home, _RETURN_FRACTION * within)
        with progress.task(f"run-up within {within:g} s"):
            simulated = simulate(stresses.stress_map, run_up, run_up.turns)
        trials.append(Trial(run_up, simulated, simulated.stress / stresses.allowable))
        if trials[-1].worst >= 1:
            break
    return trials


def design(
    four_bar: FourBar,
    results: Results,
    allowable: Annotated[
        str | None,
        Flag(
            'Allowable stress, for all links or for each: "crank=99 MPa,coupler=80 MPa,follower=90 MPa".',
            '"100 MPa"',
        ),
    ] = None,
    target: Annotated[
        str | None, Flag("Speed to run up to; by default, the method chooses it.", '"30 rad/s"')
    ] = None,
    speeds: Annotated[
        str | None, Flag("Initial speeds of the map; narrow peaks are refined.", '"A:B:N unit"')
    ] = None,
    L4: Annotated[
        str | None,
        typer.Option(
            "--L4",
            metavar='"A:B:N m"',
            help="Range and number of lengths L4; by default all with a transmission angle of 40° to 140°.",
        ),
    ] = None,
    time: Annotated[str, Flag("Duration of the slowest simulated run-up.", '"60 s"')] = "60 s",
) -> None:
    """Design for high speed: limiting critical speeds, quiet bands, run-up with a moving ground pivot."""
    model = four_bar.loaded()
    stresses = _allowable(model, allowable)
    goal = None if target is None else speed_in_si(target)
    duration = _quantity("--time", time, "s", "60 s")
    if not 0 < duration <= 3600:
        raise ValueOutOfBoundsError(f"--time is {time}; allowed: above 0 s, up to 3600 s, for example '60 s'")
    lengths, count = _lengths(model, L4)
    first_speeds = _speeds(model, speeds)
    model = shown_in(model, first_speeds[0] if goal is None or speeds else goal)
    if goal is not None:
        require_target(goal, np.array(first_speeds), model.labels.speed_unit)
    stress_map = design_map(model, stresses, np.array(first_speeds), lengths, count)
    deliver_result(results, carry_out(designed(stress_map), goal, duration), four_bar.choices)


def _allowable(model: StructureModel, text: str | None) -> dict[str, float]:
    """Return the allowable stresses (Pa) of the links."""
    links = [link.name for link in model.beams.freedoms.links]
    if text is None:
        raise MissingValueError('no allowable stress given; add one, such as --allowable "100 MPa"')
    if "=" not in text:
        return checked_allowable(links, dict.fromkeys(links, _quantity("--allowable", text, "Pa", "100 MPa")))
    stresses = {}
    for assignment in text.split(","):
        name, _, value = (word.strip() for word in assignment.partition("="))
        if name in stresses:
            raise ValueOutOfBoundsError(f"--allowable gives {name} twice; give it once")
        stresses[name] = _quantity("--allowable", value, "Pa", "crank=100 MPa")
    return checked_allowable(links, stresses)


def _quantity(flag: str, text: str, unit: str, example: str) -> float:
    """Parse a number with its unit. Raises UnitError."""
    try:
        return with_unit(text, unit)
    except UnitError as error:
        raise UnitError(f'{flag}: {error}; for example {flag} "{example}"') from None


def _speeds(model: StructureModel, text: str | None) -> list[GivenSpeed]:
    """Return the initial speeds (rad/s) of the map, in ascending order."""
    if text is None:
        phase = uniform_phases(36, model.period)
        mean = float(lowest_frequencies(*model.at_positions(phase).matrices(), 1).mean())
        return [GivenSpeed(omega, RAD_PER_S) for omega in spaced(_FIRST * mean, _LAST * mean, _RATIO)]
    speeds = sorted(set(speeds_in_si(text)))
    if len(speeds) < _FEWEST_SPEEDS:
        raise ValueOutOfBoundsError(
            f"--speeds is '{text}'; a map requires at least {_FEWEST_SPEEDS} different speeds, "
            'such as --speeds "5:45:60 rad/s"'
        )
    return speeds


def _lengths(model: StructureModel, text: str | None) -> tuple[tuple[float, float], int]:
    """Return the smallest and the largest L4 (m), and the number of lengths. Raises LinkageError if the crank
    cannot rotate fully."""
    linkage = Linkage.from_parameters(model.parameters, str(model.labels.options["branch"]))
    if text is None:
        return allowed_lengths(linkage), _LENGTHS
    usage = f'--L4 is \'{text}\'; write "A:B:N unit", N lengths from A to B, such as --L4 "0.52:0.63:48 m"'
    match = _RANGE.fullmatch(text.strip())
    if not match:
        raise UnitError(usage)
    try:
        low, high = (float(match[name]) * conversion(match["unit"], "m") for name in ("low", "high"))
    except ValueError:
        raise UnitError(usage) from None
    count = int(match["count"] or _LENGTHS)
    if not 0 < low < high or not 2 <= count <= _MOST_LENGTHS:
        raise ValueOutOfBoundsError(usage + f", A below B, N from 2 to {_MOST_LENGTHS}")
    for length in (low, high):
        replace(linkage, L4=length).require_full_turn()
    return (low, high), count
