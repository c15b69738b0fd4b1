"""What the design method answers: the speed to run up to, the plan, and the plan simulated."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from models.four_bar.design import Damping, Design, DesignError, silent
from models.four_bar.linkage import Linkage
from models.four_bar.rigid.record import concerns
from models.four_bar.run_up.plan import Plan
from models.four_bar.run_up.ramp import RunUp, Simulated, simulate
from solve.arrays import Array
from solve.results.record import model_record

_HALVINGS = 6
"""How often the duration of the run-up is halved at most, to find how fast is too fast."""

_ROUGH = 0.05
"""Relative error of the map beyond which it is told."""

_PART_RETURNING = 0.2
"""Duration of the pivot's return as part of that of the run-up."""


@dataclass(frozen=True)
class Trial:
    """A simulated run-up; ratio (turns, links) of stress to allowable stress."""

    run_up: RunUp
    simulated: Simulated
    ratio: Array

    @property
    def worst(self) -> float:
        return float(self.ratio.max())

    @property
    def worst_speed(self) -> float:
        """Speed (rad/s) at the end of the worst turn."""
        return float(self.simulated.speed[self.ratio.max(axis=1).argmax()])


@dataclass(frozen=True)
class Verdict:
    """The design's answer.

    target: rad/s. returns: whether L4 comes back to the mechanism's own there. least: the part of the
    allowable stresses that a run-up to the target needs at least, without return and with it. plan: None
    where these are greater than 1. steady (k, links): ratios along the plan at speeds (k,). trials: the
    plan simulated, each within half the time of the one before, until one goes too high.
    """

    design: Design
    target: float
    returns: bool
    least: tuple[float, float]
    plan: Plan | None
    speeds: Array
    steady: Array
    trials: list[Trial]
    damping: list[Damping]

    @property
    def safe_acceleration(self) -> float | None:
        """Greatest of the simulated accelerations (rad/s²) at which the stress stays below the allowable."""
        safe = [trial.run_up.acceleration for trial in self.trials if trial.worst < 1]
        return max(safe) if safe and self.trials[0].worst < 1 else None

    @property
    def text(self) -> str:
        """The answer in one sentence."""
        if self.plan is None:
            return self._refusal
        ends = "L4 back at its own length" if self.returns else f"L4 = {self.plan.L4[-1]:.4f} m at the end"
        first = self.trials[0]
        outcome = "stays below" if first.worst < 1 else "exceeds"
        return (
            f"a plan exists to {self.target:.4g} rad/s, {ends}; simulated within {first.run_up.duration:g} s "
            f"its stress {outcome} the allowable one, at most {first.worst:.4g} of it"
        )

    @property
    def _refusal(self) -> str:
        design, least = self.design, self.least[0]
        doubt = design.doubt(self.target)
        absolute = np.unique(design.allowable) / 1e6 * least
        found = f"a run-up to {self.target:.4g} rad/s needs at least {least:.4g} times the allowable stress"
        if len(absolute) == 1:
            found += f", {absolute[0]:.4g} MPa"
        if least * (1 - doubt) > 1:
            found = f"no plan exists: {found}"
        else:
            found = f"no plan was found: {found}, which the map knows to {doubt:.1g} only"
        if design.least_resting(self.target) <= 1:
            found += "; below it L4 would have to change within less speed: begin --speeds lower"
        highest = design.speeds[np.flatnonzero(design.with_pivot <= 1)[-1]]
        return f"{found}; up to {highest:.4g} rad/s the allowable stress is enough"

    @property
    def warnings(self) -> list[str]:
        design, found = self.design, []
        for L4 in (design.L4[0], design.L4[-1]):
            p = design.model.parameters
            links = Linkage(p["L1"], p["L2"], p["L3"], float(L4), str(design.model.options["branch"]))
            found += [f"at L4 = {L4:.4f} m {text}" for text in concerns(links)]
        if design.growth.max() >= 1:
            at = design.speeds[design.growth >= 1][0]
            found.append(f"from {at:.4g} rad/s on the vibration may be unstable; see: python -m solve bands")
        if design.missed > _ROUGH:
            found.append(f"between its speeds the map misses up to {design.missed:.2g} of the stress")
        if np.nanmax(design.error) > _ROUGH:
            found.append(f"the map's stresses are known to {np.nanmax(design.error):.2g} only")
        last = design.own_L4 if self.plan is None else float(self.plan.L4[-1])
        found += design.model.varied({"L4": last}).doubts(self.target)
        if self.plan is not None and self.trials[0].worst >= 1:
            found.append("the simulated stress exceeds the allowable one; run up more slowly or allow more")
        return found


def verdict(
    design: Design,
    target: float | None = None,
    duration: float = 60.0,
    progress: Callable[[str, int], None] = silent,
) -> Verdict:
    """Carry the method out to a target speed (rad/s), by default the design's own goal; duration (s) of
    the slowest run-up. Raises DesignError for a target outside the map."""
    speeds = design.speeds
    if target is None:
        target = design.goal()
    elif not speeds[0] < target <= speeds[-1]:
        raise DesignError(
            f"the target, {target:.4g} rad/s, is not between {speeds[0]:.4g} and {speeds[-1]:.4g} rad/s, "
            "the speeds of the map; widen --speeds"
        )
    least = design.least_allowable(target, False), design.least_allowable(target, True)
    returns = least[1] <= 1
    plan = design.plan(target, returns)
    part = design.until(target)
    steady = np.empty((0, len(design.links))) if plan is None else design.along(plan)
    trials = [] if plan is None else trials_of(design, plan, returns, duration, progress)
    at = [*(peak.speed for peak in design.peaks), *(band.quietest for band in design.quiet[1:]), target]
    return Verdict(design, target, returns, least, plan, part, steady, trials, design.damping(np.unique(at)))


def trials_of(
    design: Design,
    plan: Plan,
    returns: bool,
    duration: float,
    progress: Callable[[str, int], None] = silent,
) -> list[Trial]:
    """The plan simulated within the duration (s) and, until the stress goes too high, within half of it,
    a quarter and so on."""
    found: list[Trial] = []
    start, home = float(plan.speed[0]) / 10, design.own_L4 if returns else None
    for halving in range(_HALVINGS):
        within = duration / 2**halving
        run_up = RunUp(plan, start, within, home, _PART_RETURNING * within)
        what = f"run-up within {within:g} s"
        simulated = simulate(design.map, run_up, run_up.turns, lambda done, what=what: progress(what, done))
        found.append(Trial(run_up, simulated, simulated.stress / design.allowable))
        if found[-1].worst >= 1:
            break
    return found


def verdict_record(found: Verdict) -> dict[str, Any]:
    """The answer as plain data: the keys of `--json`. SI units; ratios are of stress to allowable."""
    design = found.design
    return {
        **model_record(design.model),
        "allowable": dict(zip(design.links, design.allowable, strict=True)),
        "speeds": design.speeds,
        "L4": design.L4,
        "own_L4": design.own_L4,
        "stress": dict(zip(design.links, np.moveaxis(design.stress, 2, 0), strict=True)),
        "error": float(np.nanmax(design.error)),
        "interpolation_error": design.missed,
        "limiting": [vars(peak) for peak in design.limiting],
        "critical": [vars(peak) for peak in design.peaks],
        "quiet": [vars(band) for band in design.quiet],
        "quiet_of": {link: [vars(band) for band in design.quiet_of(link)] for link in design.links},
        "beyond": [vars(each) for each in design.beyond],
        "least_ratio": {
            "fixed": design.without_pivot,
            "moving": design.with_pivot,
            "returning": design.with_return,
        },
        "damping": [{"speed": each.speed, **each.sensitivity} for each in found.damping],
        "target": found.target,
        "returns": found.returns,
        "least": {"moving": found.least[0], "returning": found.least[1]},
        "smallest_allowable": {
            link: found.least[0] * float(stress)
            for link, stress in zip(design.links, design.allowable, strict=True)
        },
        "verdict": "plan" if found.plan is not None else "no plan",
        "text": found.text,
        "plan": None if found.plan is None else _plan_record(found),
        "trials": [_trial_record(trial) for trial in found.trials],
        "safe_acceleration": found.safe_acceleration,
        "warnings": found.warnings,
    }


def _plan_record(found: Verdict) -> dict[str, Any]:
    plan = found.plan
    assert plan is not None
    return {
        "speed": plan.speed,
        "L4": plan.L4,
        "lead": plan.lead,
        "greatest_steady_ratio": float(found.steady.max()),
        "rate": found.design.rate,
    }


def _trial_record(trial: Trial) -> dict[str, Any]:
    at = trial.ratio.argmax() // trial.ratio.shape[1]
    return {
        "duration": trial.run_up.duration,
        "acceleration": trial.run_up.acceleration,
        "greatest_ratio": trial.worst,
        "at_speed": trial.worst_speed,
        "at_time": float(trial.simulated.time[at]),
        "turns": trial.run_up.turns,
    }
