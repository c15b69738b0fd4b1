"""What the design method comes to: the speed to run up to, the plan, and the plan simulated."""

from dataclasses import dataclass, replace

import numpy as np

from models.four_bar.design import (
    Band,
    DampingEffect,
    Design,
    NeededRatios,
    Peak,
    QuietSpeed,
    least_ratio_at_any_rate,
)
from models.four_bar.design_map import DesignMap
from models.four_bar.linkage import Linkage
from models.four_bar.rigid.record import transmission_warnings
from models.four_bar.run_up.plan import Plan
from models.four_bar.run_up.ramp import RunUp, Simulated
from solve.arrays import Array
from solve.results.serialization import Serializable, serializable, stored_property

_WARNED = 0.05
"""Relative error of the map above which there is a warning."""

for _kind in (Band, DampingEffect, Design, NeededRatios, Peak, QuietSpeed, Plan, RunUp, Simulated):
    serializable(_kind)


@serializable
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

    @property
    def worst_time(self) -> float:
        """The time (s) then."""
        return float(self.simulated.time[self.ratio.max(axis=1).argmax()])


@dataclass(frozen=True)
class Outcome(Serializable):
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
        target = self.until.model.speed_unit.text(self.target, ".4g")
        ends = "L4 back at its own length" if self.returns else f"L4 = {self.plan.L4[-1]:.4f} m at the end"
        first = self.trials[0]
        outcome = "stays below" if first.worst < 1 else "exceeds"
        return (
            f"a plan exists to {target}, {ends}; simulated within {first.run_up.duration:g} s "
            f"its stress {outcome} the allowable one, at most {first.worst:.4g} of it"
        )

    @property
    def _refusal(self) -> str:
        stresses, least = self.design.map, self.least[0]
        unit = stresses.model.speed_unit
        error = stresses.error_until(self.target)
        absolute = np.unique(stresses.allowable) / 1e6 * least
        target = unit.text(self.target, ".4g")
        need = f"a run-up to {target} needs at least {least:.4g} times the allowable stress"
        if len(absolute) == 1:
            need += f", {absolute[0]:.4g} MPa"
        if least * (1 - error) > 1:
            text = f"no plan exists: {need}"
        else:
            text = f"no plan was found: {need}, which the map knows to {error:.1g} only"
        if least_ratio_at_any_rate(self.until) <= 1:
            text += "; below it L4 would have to change within less speed: begin --speeds lower"
        highest = float(stresses.speeds[np.flatnonzero(self.design.needed.moving <= 1)[-1]])
        return f"{text}; up to {unit.text(highest, '.4g')} the allowable stress is enough"

    @stored_property
    def warnings(self) -> list[str]:
        stresses, texts = self.design.map, []
        own = Linkage.of(stresses.model.parameters, str(stresses.model.options["branch"]))
        for L4 in (stresses.L4[0], stresses.L4[-1]):
            ends = transmission_warnings(replace(own, L4=float(L4)))
            texts += [f"at L4 = {L4:.4f} m {text}" for text in ends]
        if stresses.radius_bound.max() >= 1:
            at = stresses.speeds[stresses.radius_bound >= 1][0]
            from_ = stresses.model.speed_unit.text(at, ".4g")
            texts.append(f"from {from_} on the vibration may be unstable; see: python -m solve bands")
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
