"""The outcome of the design method: target speed, run-up plan and simulated run-ups, with their warnings."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

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
from models.four_bar.linkage import Linkage, transmission_warnings
from models.four_bar.plan import Plan
from models.four_bar.run_up import RunUp, Simulated
from solve.arrays import Array
from solve.results.contents import Column, Columns, digits, speeds_of
from solve.results.lasting import Lasting, lasting

_MAX_MAP_ERROR = 0.05
"""Relative error of the map above which a warning is issued: a choice."""

for _kind in (Band, DampingEffect, Design, NeededRatios, Peak, QuietSpeed, Plan, RunUp, Simulated):
    lasting(_kind)


@lasting
@dataclass(frozen=True)
class Trial:
    """A simulated run-up; ratio (turns, links): largest stress over the allowable one in each revolution."""

    run_up: RunUp
    simulated: Simulated
    ratio: Array

    @property
    def worst(self) -> float:
        """Largest ratio."""
        return float(self.ratio.max())

    @property
    def worst_speed(self) -> float:
        """Speed (rad/s) at the end of the revolution with the largest ratio."""
        return float(self.simulated.speed[self.ratio.max(axis=1).argmax()])

    @property
    def worst_time(self) -> float:
        """Time (s) at the end of the revolution with the largest ratio."""
        return float(self.simulated.time[self.ratio.max(axis=1).argmax()])


@dataclass(frozen=True)
class Outcome(Lasting):
    """Result of the design method for a target speed.

    target: rad/s; until: the map up to the target. returns: whether L4 returns to the mechanism's own length
    there. least: smallest ratio of stress to allowable stress for a run-up to the target, without and with
    the return. plan: None where no plan exists. steady (k, links): ratios along the plan at the speeds (k,)
    of `until`. trials: the plan simulated, each within half the time of the one before, until the stress is
    too high.
    """

    _calculated: ClassVar[tuple[str, ...]] = ("warnings",)

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
    def map(self) -> DesignMap:
        return self.design.map

    @property
    def safe_acceleration(self) -> float | None:
        """Largest simulated acceleration (rad/s²) with a stress below the allowable one."""
        safe = [trial.run_up.acceleration for trial in self.trials if trial.worst < 1]
        return max(safe) if safe and self.trials[0].worst < 1 else None

    @property
    def text(self) -> str:
        """The result in one sentence."""
        if self.plan is None:
            return self._refusal
        target = self.map.model.speed_unit.text(self.target, ".4g")
        ends = "L4 back at its own length" if self.returns else f"L4 = {self.plan.L4[-1]:.4f} m at the end"
        first = self.trials[0]
        outcome = "stays below" if first.worst < 1 else "exceeds"
        return (
            f"a plan exists to {target}, {ends}; simulated within {first.run_up.duration:g} s "
            f"its stress {outcome} the allowable one, at most {first.worst:.4g} of it"
        )

    @property
    def _refusal(self) -> str:
        stresses, least = self.map, self.least[0]
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
            text = f"no plan was found: {need}, with an error of {error:.1g} of the map"
        if least_ratio_at_any_rate(self.until) <= 1:
            text += "; below it L4 would have to change within less speed: begin --speeds lower"
        highest = float(stresses.speeds[np.flatnonzero(self.design.needed.moving <= 1)[-1]])
        return f"{text}; up to {unit.text(highest, '.4g')} the allowable stress is enough"

    @cached_property
    def warnings(self) -> list[str]:
        stresses, texts = self.map, []
        own = Linkage.of(stresses.model.parameters, str(stresses.model.options["branch"]))
        for L4 in (stresses.L4[0], stresses.L4[-1]):
            ends = transmission_warnings(replace(own, L4=float(L4)))
            texts += [f"at L4 = {L4:.4f} m {text}" for text in ends]
        if stresses.radius_bound.max() >= 1:
            speed = stresses.speeds[stresses.radius_bound >= 1][0]
            lowest = stresses.model.speed_unit.text(speed, ".4g")
            texts.append(f"from {lowest} on the vibration may be unstable; see: python -m solve bands")
        if stresses.interpolation_error > _MAX_MAP_ERROR:
            error = f"{stresses.interpolation_error:.2g}"
            texts.append(f"interpolation between the speeds of the map has a relative error of {error}")
        if np.nanmax(stresses.error) > _MAX_MAP_ERROR:
            texts.append(f"the stresses of the map have a relative error of {np.nanmax(stresses.error):.2g}")
        last = stresses.own_L4 if self.plan is None else float(self.plan.L4[-1])
        texts += stresses.model.varied({"L4": last}).warnings(self.target)
        if self.plan is not None and self.trials[0].worst >= 1:
            texts.append("the simulated stress exceeds the allowable one; run up more slowly or allow more")
        return texts

    @property
    def trial_columns(self) -> Columns:
        """A row a simulated run-up."""
        trials, unit = self.trials, self.map.model.speed_unit.per_second
        durations = [trial.run_up.duration for trial in trials]
        accelerations = [trial.run_up.acceleration for trial in trials]
        ratios, speeds = [trial.worst for trial in trials], [trial.worst_speed for trial in trials]
        return {
            "duration": Column(durations, "s", "", "within", "{:.4g} s".format),
            "acceleration": Column(
                accelerations, "rad/s^2", "", "acceleration", lambda value: unit.text(value, ".3g")
            ),
            "greatest_ratio": Column(ratios, "1", "", "stress/allowable", digits(".4f")),
            "at_speed": speeds_of(self.map.model, speeds, "", "at speed ({})", ".2f"),
            "at_time": Column([trial.worst_time for trial in trials], "s"),
            "turns": Column([trial.run_up.turns for trial in trials]),
            "verdict": Column(["below" if ratio < 1 else "too high" for ratio in ratios], heading=" "),
        }
