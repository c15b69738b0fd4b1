"""The design method as a result: the map and what a run-up needs, the plan and its simulations."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from models.four_bar.design import (
    Design,
    damping_effects,
    default_target,
    least_ratio,
    plan_to_last,
    ratios_along,
)
from models.four_bar.design_map import DesignError, DesignMap
from models.four_bar.results.design_draw import outcome_figure
from models.four_bar.results.design_report import outcome_report, trial_columns
from models.four_bar.results.outcome import Outcome, Trial
from models.four_bar.run_up.plan import Plan
from models.four_bar.run_up.ramp import RunUp, simulate
from solve.arrays import Array
from solve.results.contents import Column, Columns, FileContents, rows_of
from solve.results.result import Result
from solve.system import PeriodicSystem
from solve.terminal import progress
from solve.units import ShownUnit
from solve.views.show import printout
from solve.views.style import Figure

_HALVINGS = 6
"""How often the duration of the run-up is halved at most, to find how fast is too fast."""

_PART_RETURNING = 0.2
"""Duration of the pivot's return as part of that of the run-up."""


@dataclass(frozen=True)
class DesignResult(Outcome, Result):
    """An outcome with its columns, tables, picture and files."""

    @property
    def system(self) -> PeriodicSystem:  # type: ignore[override]
        return self.design.map.model

    @property
    def summary_values(self) -> dict[str, Any]:
        """SI units; ratios are of stress to allowable."""
        design = self.design
        stresses = design.map
        return {
            "allowable": dict(zip(stresses.links, stresses.allowable, strict=True)),
            "speeds": stresses.speeds,
            "L4": stresses.L4,
            "own_L4": stresses.own_L4,
            "stress": dict(zip(stresses.links, np.moveaxis(stresses.stress, 2, 0), strict=True)),
            "error": float(np.nanmax(stresses.error)),
            "interpolation_error": stresses.interpolation_error,
            "limiting": design.limiting,
            "critical": design.peaks,
            "quiet": design.quiet,
            "quiet_of": design.quiet_of,
            "beyond": design.quiet_above,
            "least_ratio": design.needed,
            "damping": [{"speed": each.speed, **each.sensitivity} for each in self.damping],
            "target": self.target,
            "returns": self.returns,
            "least": {"moving": self.least[0], "returning": self.least[1]},
            "smallest_allowable": {
                link: self.least[0] * float(stress)
                for link, stress in zip(stresses.links, stresses.allowable, strict=True)
            },
            "verdict": "plan" if self.plan is not None else "no plan",
            "text": self.text,
            "plan": None if self.plan is None else _plan_record(self),
            "trials": rows_of(trial_columns(self)),
            "safe_acceleration": self.safe_acceleration,
        }

    @property
    def columns(self) -> Columns:
        """The map by speed at the mechanism's own L4, with what a run-up to each speed needs."""
        design, stresses = self.design, self.design.map
        axes = ("speed",)
        columns = {"speed": Column(stresses.speeds, "rad/s", "speed of the crank", axes=axes)}
        for number, link in enumerate(stresses.links):
            own = stresses.stress[:, stresses.own, number]
            columns[f"{link}_stress"] = Column(own, "Pa", f"largest of the {link} at its own L4", axes=axes)
        for name, how in (
            ("fixed", "with L4 fixed"),
            ("moving", "with L4 changing"),
            ("returning", "with L4 changing and returning"),
        ):
            meaning = f"part of the allowable stress to reach the speed {how}"
            columns[f"least_ratio_{name}"] = Column(getattr(design.needed, name), "1", meaning, axes=axes)
        return columns

    def file_contents(self) -> FileContents:
        """In .npz and .mat also the whole map and the slowest simulation; .nc has the map in its metadata."""
        found, stresses = super().file_contents(), self.design.map
        arrays = {**found.numbers, "L4": stresses.L4, "stress": stresses.stress}
        arrays["links"] = np.array(stresses.links)
        if self.plan is not None:
            arrays |= {"plan_speed": self.plan.speed, "plan_L4": self.plan.L4}
            arrays |= {f"simulated_{name}": part for name, part in vars(self.trials[0].simulated).items()}
        return replace(found, arrays=arrays)

    def plot(self) -> Figure:
        """The map with the plan, what each speed needs, the simulation."""
        return outcome_figure(self)


printout.register(DesignResult)(outcome_report)


def carry_out(design: Design, target: float | None = None, duration: float = 60.0) -> DesignResult:
    """Carry the method out to a target speed (rad/s), by default the design's own; duration (s) of the
    slowest run-up. Raises DesignError for a target outside the map."""
    stresses, rate = design.map, design.rate
    speeds = stresses.speeds
    if target is None:
        target = default_target(design)
    else:
        require_target(target, speeds, stresses.model.speed_unit)
    until = stresses.until(target)
    least = least_ratio(until, rate, False), least_ratio(until, rate, True)
    returns = least[1] <= 1
    plan = plan_to_last(until, rate, returns)
    steady = np.empty((0, len(stresses.links))) if plan is None else ratios_along(until, plan)
    trials = [] if plan is None else trials_of(stresses, plan, returns, duration)
    at = [*(peak.speed for peak in design.peaks), *(band.quietest for band in design.quiet[1:]), target]
    effects = damping_effects(stresses, np.unique(at))
    return DesignResult(design, target, until, returns, least, plan, steady, trials, effects)


def require_target(target: float, speeds: Array, unit: ShownUnit) -> None:
    """Raise DesignError for a target (rad/s) outside the rising speeds of a map."""
    if not speeds[0] < target <= speeds[-1]:
        raise DesignError(
            f"the target, {unit.text(target, '.4g')}, is not between "
            f"{unit.span(speeds[0], speeds[-1], 'and', '.4g')}, the speeds of the map; widen --speeds"
        )


def trials_of(stresses: DesignMap, plan: Plan, returns: bool, duration: float) -> list[Trial]:
    """The plan simulated within the duration (s) and, until the stress goes too high, within half of it,
    a quarter and so on."""
    trials: list[Trial] = []
    start, home = float(plan.speed[0]) / 10, stresses.own_L4 if returns else None
    for halving in range(_HALVINGS):
        within = duration / 2**halving
        run_up = RunUp(plan, start, within, home, _PART_RETURNING * within)
        with progress.task(f"run-up within {within:g} s"):
            simulated = simulate(stresses.stress_map, run_up, run_up.turns)
        trials.append(Trial(run_up, simulated, simulated.stress / stresses.allowable))
        if trials[-1].worst >= 1:
            break
    return trials


def _plan_record(result: Outcome) -> dict[str, Any]:
    plan = result.plan
    assert plan is not None
    return {
        "speed": plan.speed,
        "L4": plan.L4,
        "lead": plan.lead,
        "greatest_steady_ratio": float(result.steady.max()),
        "rate": result.design.rate,
    }
