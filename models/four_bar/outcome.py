"""Result of the design method for a target speed: run-up plan, simulated run-ups and warnings."""

from dataclasses import dataclass, replace

import numpy as np

from models.four_bar.design import DampingEffect, Design, least_ratio_at_any_rate
from models.four_bar.design_map import DesignMap
from models.four_bar.linkage import Linkage, transmission_warnings
from models.four_bar.plan import Plan
from models.four_bar.run_up import RunUp, Simulated
from solve.arrays import Array
from solve.results.contents import Column, Columns, digits, speeds_of
from solve.results.serialization import Serializable, serializable, stored_property

_MAX_MAP_ERROR = 0.05
"""Relative error of a map above which a warning is issued. Chosen by judgement."""

for _kind in (Plan, RunUp, Simulated):
    serializable(_kind)


@serializable
@dataclass(frozen=True)
class Trial:
    """Simulated run-up. `ratio` (turns, links) are the ratios of the largest stress in each revolution to the
    allowable stress."""

    run_up: RunUp
    simulated: Simulated
    ratio: Array

    @property
    def worst(self) -> float:
        """Largest ratio of stress to allowable stress."""
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
class Outcome(Serializable):
    """Result of the design method for a target speed.

    `target` is in rad/s, and `until` is the map up to the target. `returns` is True if L4 returns to the
    mechanism's own length at the target speed. `least` are the smallest attainable stress ratios of a run-up
    to the target, without and with return of L4. `plan` is None if no plan exists. `steady` (k, links) are
    the ratios of steady motion along the plan, at the k speeds of `until`. `trials` are simulations of the
    plan, each with half the duration of the previous one, until the stress is too high.
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
    def map(self) -> DesignMap:
        return self.design.map

    @property
    def safe_acceleration(self) -> float | None:
        """Largest simulated acceleration (rad/s²) at which the stress stays below the allowable one."""
        safe = [trial.run_up.acceleration for trial in self.trials if trial.worst < 1]
        return max(safe) if safe and self.trials[0].worst < 1 else None

    @property
    def text(self) -> str:
        """Sentence that states the result."""
        if self.plan is None:
            return self._refusal
        target = self.map.model.labels.speed_unit.text(self.target, ".4g")
        ends = "L4 back at its own length" if self.returns else f"L4 = {self.plan.L4[-1]:.4f} m at the end"
        first = self.trials[0]
        outcome = "stays below" if first.worst < 1 else "exceeds"
        return (
            f"a plan exists to {target}, {ends}; in a simulated run-up of {first.run_up.duration:g} s the "
            f"stress {outcome} the allowable one (largest ratio {first.worst:.4g})"
        )

    @property
    def _refusal(self) -> str:
        stresses, least = self.map, self.least[0]
        unit = stresses.model.labels.speed_unit
        error = stresses.error_until(self.target)
        absolute = np.unique(stresses.allowable) / 1e6 * least
        target = unit.text(self.target, ".4g")
        need = f"a run-up to {target} requires at least {least:.4g} times the allowable stress"
        if len(absolute) == 1:
            need += f", {absolute[0]:.4g} MPa"
        if least * (1 - error) > 1:
            text = f"no plan exists: {need}"
        else:
            text = f"no plan was found: {need}; the map has a relative error of {error:.1g}"
        if least_ratio_at_any_rate(self.until) <= 1:
            text += (
                "; L4 would have to change below the lowest speed of the map: give a lower first "
                "speed in --speeds"
            )
        highest = float(stresses.speeds[np.flatnonzero(self.design.needed.moving <= 1)[-1]])
        return f"{text}; up to {unit.text(highest, '.4g')} the allowable stress is enough"

    @stored_property
    def warnings(self) -> list[str]:
        stresses, texts = self.map, []
        linkage = Linkage.from_parameters(
            stresses.model.labels.parameters, str(stresses.model.labels.options["branch"])
        )
        for L4 in (stresses.L4[0], stresses.L4[-1]):
            ends = transmission_warnings(replace(linkage, L4=float(L4)))
            texts += [f"at L4 = {L4:.4f} m {text}" for text in ends]
        if stresses.radius_bound.max() >= 1:
            speed = stresses.speeds[stresses.radius_bound >= 1][0]
            lowest = stresses.model.labels.speed_unit.text(speed, ".4g")
            texts.append(f"the vibration may be unstable from {lowest} upwards; see: python -m solve bands")
        if stresses.interpolation_error > _MAX_MAP_ERROR:
            error = f"{stresses.interpolation_error:.2g}"
            texts.append(f"interpolation between the speeds of the map has a relative error of {error}")
        if np.nanmax(stresses.error) > _MAX_MAP_ERROR:
            texts.append(f"the stresses of the map have a relative error of {np.nanmax(stresses.error):.2g}")
        last = stresses.own_L4 if self.plan is None else float(self.plan.L4[-1])
        texts += stresses.model.varied({"L4": last}).warnings(self.target)
        if self.plan is not None and self.trials[0].worst >= 1:
            texts.append(
                "the simulated stress exceeds the allowable one; run up more slowly, or raise the "
                "allowable stress"
            )
        return texts

    @property
    def trial_columns(self) -> Columns:
        """Columns of the table, with one row per simulated run-up."""
        trials, unit = self.trials, self.map.model.labels.speed_unit.per_second
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
