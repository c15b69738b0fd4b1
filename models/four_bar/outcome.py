"""What the design method comes to: the speed to run up to, the plan, and the plan simulated."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from models.four_bar.design import (
    DampingEffect,
    Design,
    damping_effects,
    default_target,
    least_ratio,
    least_ratio_at_any_rate,
    plan_to_last,
    ratios_along,
)
from models.four_bar.design_map import DesignError, DesignMap
from models.four_bar.linkage import Linkage
from models.four_bar.rigid.record import transmission_warnings
from models.four_bar.run_up.plan import Plan
from models.four_bar.run_up.ramp import RunUp, Simulated, simulate
from solve.arrays import Array
from solve.progress import stage
from solve.results.contents import model_record

_HALVINGS = 6
"""How often the duration of the run-up is halved at most, to find how fast is too fast."""

_WARNED = 0.05
"""Relative error of the map above which there is a warning."""

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
class Outcome:
    """What the design method comes to for a target speed.

    target: rad/s; until: the map up to it. returns: whether L4 comes back to the mechanism's own there.
    least: the part of the allowable stresses that a run-up to the target needs at least, without return
    and with it. plan: None where these are greater than 1. steady (k, links): ratios along the plan at the
    speeds (k,) of `until`. trials: the plan simulated, each within half the time of the one before, until
    one goes too high.
    """

    design: Design
    target: float
    until: DesignMap
    returns: bool
    least: tuple[float, float]
    plan: Plan | None
    steady: Array
    trials: list[Trial]
    damping: list[DampingEffect]

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
        stresses, least = self.design.map, self.least[0]
        error = stresses.error_until(self.target)
        absolute = np.unique(stresses.allowable) / 1e6 * least
        need = f"a run-up to {self.target:.4g} rad/s needs at least {least:.4g} times the allowable stress"
        if len(absolute) == 1:
            need += f", {absolute[0]:.4g} MPa"
        if least * (1 - error) > 1:
            text = f"no plan exists: {need}"
        else:
            text = f"no plan was found: {need}, which the map knows to {error:.1g} only"
        if least_ratio_at_any_rate(self.until) <= 1:
            text += "; below it L4 would have to change within less speed: begin --speeds lower"
        highest = stresses.speeds[np.flatnonzero(self.design.needed.moving <= 1)[-1]]
        return f"{text}; up to {highest:.4g} rad/s the allowable stress is enough"

    @property
    def warnings(self) -> list[str]:
        stresses, texts = self.design.map, []
        p, branch = stresses.model.parameters, str(stresses.model.options["branch"])
        for L4 in (stresses.L4[0], stresses.L4[-1]):
            ends = transmission_warnings(Linkage(p["L1"], p["L2"], p["L3"], float(L4), branch))
            texts += [f"at L4 = {L4:.4f} m {text}" for text in ends]
        if stresses.radius_bound.max() >= 1:
            at = stresses.speeds[stresses.radius_bound >= 1][0]
            texts.append(f"from {at:.4g} rad/s on the vibration may be unstable; see: python -m solve bands")
        if stresses.interpolation_error > _WARNED:
            missed = f"{stresses.interpolation_error:.2g}"
            texts.append(f"between its speeds the map misses up to {missed} of the stress")
        if np.nanmax(stresses.error) > _WARNED:
            texts.append(f"the map's stresses are known to {np.nanmax(stresses.error):.2g} only")
        last = stresses.own_L4 if self.plan is None else float(self.plan.L4[-1])
        texts += stresses.model.varied({"L4": last}).warnings(self.target)
        if self.plan is not None and self.trials[0].worst >= 1:
            texts.append("the simulated stress exceeds the allowable one; run up more slowly or allow more")
        return texts


def carry_out(
    design: Design,
    target: float | None = None,
    duration: float = 60.0,
) -> Outcome:
    """Carry the method out to a target speed (rad/s), by default the design's own; duration (s) of the
    slowest run-up. Raises DesignError for a target outside the map."""
    stresses, rate = design.map, design.rate
    speeds = stresses.speeds
    if target is None:
        target = default_target(design)
    else:
        require_target(target, speeds)
    until = stresses.until(target)
    least = least_ratio(until, rate, False), least_ratio(until, rate, True)
    returns = least[1] <= 1
    plan = plan_to_last(until, rate, returns)
    steady = np.empty((0, len(stresses.links))) if plan is None else ratios_along(until, plan)
    trials = [] if plan is None else trials_of(stresses, plan, returns, duration)
    at = [*(peak.speed for peak in design.peaks), *(band.quietest for band in design.quiet[1:]), target]
    effects = damping_effects(stresses, np.unique(at))
    return Outcome(design, target, until, returns, least, plan, steady, trials, effects)


def require_target(target: float, speeds: Array) -> None:
    """Raise DesignError for a target (rad/s) outside the rising speeds of a map."""
    if not speeds[0] < target <= speeds[-1]:
        raise DesignError(
            f"the target, {target:.4g} rad/s, is not between {speeds[0]:.4g} and {speeds[-1]:.4g} rad/s, "
            "the speeds of the map; widen --speeds"
        )


def trials_of(
    stresses: DesignMap,
    plan: Plan,
    returns: bool,
    duration: float,
) -> list[Trial]:
    """The plan simulated within the duration (s) and, until the stress goes too high, within half of it,
    a quarter and so on."""
    trials: list[Trial] = []
    start, home = float(plan.speed[0]) / 10, stresses.own_L4 if returns else None
    for halving in range(_HALVINGS):
        within = duration / 2**halving
        run_up = RunUp(plan, start, within, home, _PART_RETURNING * within)
        with stage(f"run-up within {within:g} s"):
            simulated = simulate(stresses.stress_map, run_up, run_up.turns)
        trials.append(Trial(run_up, simulated, simulated.stress / stresses.allowable))
        if trials[-1].worst >= 1:
            break
    return trials


def outcome_record(result: Outcome) -> dict[str, Any]:
    """The answer as plain data: the keys of `--json`. SI units; ratios are of stress to allowable."""
    design = result.design
    stresses = design.map
    return {
        **model_record(stresses.model),
        "allowable": dict(zip(stresses.links, stresses.allowable, strict=True)),
        "speeds": stresses.speeds,
        "L4": stresses.L4,
        "own_L4": stresses.own_L4,
        "stress": dict(zip(stresses.links, np.moveaxis(stresses.stress, 2, 0), strict=True)),
        "error": float(np.nanmax(stresses.error)),
        "interpolation_error": stresses.interpolation_error,
        "limiting": [peak._asdict() for peak in design.limiting],
        "critical": [peak._asdict() for peak in design.peaks],
        "quiet": [band._asdict() for band in design.quiet],
        "quiet_of": {link: [band._asdict() for band in bands] for link, bands in design.quiet_of.items()},
        "beyond": [each._asdict() for each in design.quiet_above],
        "least_ratio": design.needed._asdict(),
        "damping": [{"speed": each.speed, **each.sensitivity} for each in result.damping],
        "target": result.target,
        "returns": result.returns,
        "least": {"moving": result.least[0], "returning": result.least[1]},
        "smallest_allowable": {
            link: result.least[0] * float(stress)
            for link, stress in zip(stresses.links, stresses.allowable, strict=True)
        },
        "verdict": "plan" if result.plan is not None else "no plan",
        "text": result.text,
        "plan": None if result.plan is None else _plan_record(result),
        "trials": [_trial_record(trial) for trial in result.trials],
        "safe_acceleration": result.safe_acceleration,
        "warnings": result.warnings,
    }


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
