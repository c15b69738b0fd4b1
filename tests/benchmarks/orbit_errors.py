"""python -m tests.benchmarks.orbit_errors [--seed N] [--seconds S]: errors of nonlinear orbits.

Errors are divided by their estimates. Seven models have random parameters, speeds and tolerances; a mass with
backlash is solved near the folds of its branches. The true error is the difference from the orbit with a
tolerance of 1e-11 that starts on the orbit.
"""

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import cycle
from typing import Any

import numpy as np

import solve
from solve.model.model import Model
from tests.solve.newton.mechanisms import duffing, held_pendulum, model_of, stop
from tests.solve.newton.test_fold_errors import LOADS, NUMBERS, mesh
from tests.solve.newton.test_rub import NUMBERS as ROTOR
from tests.solve.newton.test_rub import jeffcott

FINEST = 1e-11
"""Tolerance of the reference."""

SAME = 0.05
"""Relative difference above which the reference is another orbit."""


@dataclass
class Trial:
    """Orbit to compute, by name of its model."""

    name: str
    model: Model
    speed: float
    rtol: float
    start: Any = None


def scaled(rng: np.random.Generator, numbers: dict[str, float]) -> dict[str, float]:
    """Numbers changed by up to 20 %."""
    return {name: value * rng.uniform(0.8, 1.2) for name, value in numbers.items()}


def trials(rng: np.random.Generator) -> Iterator[Trial]:
    """Yield orbits of all models in rotation, without end."""
    cam, gear, crank = solve.load("cam"), solve.load("gear_backlash"), solve.load("slider_crank")
    rotor, rpm = solve.load(jeffcott, **ROTOR), np.pi / 30
    for kind in cycle(range(8)):
        rtol = 10 ** rng.uniform(-9, -4)
        if kind == 0:
            numbers = scaled(rng, {name: cam.parameters[name] for name in ("k1", "k2", "c2")})
            yield Trial("cam", cam.varied(numbers), rng.uniform(60, 320) * rpm, rtol)
        elif kind == 1:
            numbers = scaled(rng, {name: gear.parameters[name] for name in ("k", "F")})
            yield Trial("gear_backlash", gear.varied(numbers), rng.uniform(18e3, 34e3), rtol)
        elif kind == 2:
            numbers = scaled(rng, {"g": crank.parameters["g"]})
            yield Trial("slider_crank", crank.varied(numbers), rng.uniform(300, 1500) * rpm, rtol)
        elif kind == 3:
            numbers = {"zeta": rng.uniform(0.02, 0.2), "alpha": rng.uniform(-0.05, 1), "k": 1.0}
            model = model_of(duffing(), f=rng.uniform(0.1, 0.6), **numbers)
            yield Trial("duffing", model, rng.uniform(0.5, 2.5), rtol)
        elif kind == 4:
            numbers = {"c": rng.uniform(0.1, 1), "t": rng.uniform(-0.5, 0.5), "F": rng.uniform(0.05, 0.5)}
            yield Trial("pendulum", model_of(held_pendulum(), g=1.0, **numbers), rng.uniform(0.5, 2), rtol)
        elif kind == 5:
            yield Trial("rub", rotor.varied(scaled(rng, ROTOR)), rng.uniform(60, 120), rtol)
        elif kind == 6:
            model = model_of(stop(), **scaled(rng, {"zeta": 0.05, "k": 1, "kappa": 10, "gap": 0.3, "f": 0.5}))
            yield Trial("stop", model, rng.uniform(0.5, 3), rtol)
        else:
            yield from beside_folds(rng)


def beside_folds(rng: np.random.Generator) -> Iterator[Trial]:
    """Yield orbits near the folds of a branch of a mass with random backlash."""
    model = solve.load(mesh, **scaled(rng, NUMBERS), **scaled(rng, LOADS))
    try:
        branch = solve.branch(model, (0.5, 0.9), points=30, rtol=1e-5)
    except solve.errors.SolveError:
        return
    for fold in branch.folds[:2]:
        start = branch.curve(int(np.argmin(np.abs(branch.values - fold["speed"]))))
        for side in (-1, 1):
            speed = fold["speed"] * (1 + side * 10 ** rng.uniform(-7, -3))
            yield Trial("backlash beside folds", model, speed, 10 ** rng.uniform(-7, -4), start)


def ratios(trial: Trial) -> tuple[float, float] | None:
    """Return the errors of orbit and multipliers, each divided by the sum of the estimates of both solutions;
    None if the solutions are different orbits."""
    try:
        start = {} if trial.start is None else {"start": trial.start}
        orbit = solve.nonlinear(trial.model, trial.speed, rtol=trial.rtol, **start)
        exact = solve.nonlinear(trial.model, trial.speed, start=orbit, rtol=FINEST)
    except solve.errors.SolveError:
        return None
    phases = np.linspace(0, orbit.phase[-1], 2003)[:-1]
    curve, reference = orbit.curve(phases), exact.curve(phases)
    sizes = np.abs(reference).max(axis=1)
    error = (np.abs(curve - reference).max(axis=1)[sizes > 0] / sizes[sizes > 0]).max(initial=0.0)
    if error > SAME:
        return None
    radius = abs(orbit.spectral_radius - exact.spectral_radius) / exact.spectral_radius
    estimates = orbit.error_estimate, exact.error_estimate
    return (
        error / sum(estimate.orbit for estimate in estimates),
        radius / sum(estimate.multipliers for estimate in estimates),
    )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seed", type=int, default=20270301)
    parser.add_argument("--seconds", type=float, default=300.0)
    given = parser.parse_args()
    measured: dict[str, list[tuple[float, float]]] = {}
    omitted, started = 0, time.process_time()
    for trial in trials(np.random.default_rng(given.seed)):
        if time.process_time() - started > given.seconds:
            break
        found = ratios(trial)
        if found is None:
            omitted += 1
        else:
            measured.setdefault(trial.name, []).append(found)
    for name, values in measured.items():
        orbit, multipliers = np.max(values, axis=0)
        print(f"{name}: {len(values)}; error at most {orbit:.2g} (orbit), {multipliers:.2g} (multipliers)")
    together = np.concatenate([np.array(values) for values in measured.values()])
    print(
        f"{len(together)} in all, {omitted} without two equal orbits; above 1: {(together > 1).sum(axis=0)}"
    )


if __name__ == "__main__":
    main()
