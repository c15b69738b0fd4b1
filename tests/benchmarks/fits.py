"""Fits of the cam: coverage of the intervals, and times with exact and with finite-difference Jacobians.

python -m tests.benchmarks.fits [TRIALS]
"""

import sys
import tempfile
from functools import partial
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

import solve
from solve.studies.fit_problem import Problem
from solve.studies.measured import measured
from tests.benchmarks.timing import median

SPEED = "400 rpm"
FREE = {"k1": 1.05, "k3": 1.03, "I1": 0.95, "m2": 1.04, "c1": 1.1, "c3": 0.9}
"""True parameters, by those of the case from which fits start."""
CHANNELS = "shaft_torque", "contact_force", "output_displacement"
ANGLES = np.arange(0.0, 360.0, 2.0)
NOISE = 0.01
TRIALS = 5
"""Of the parameters in a search whose time is taken."""


def record_file(file: Path, orbit, seed: int) -> Path:
    """Write a record of three channels with normal noise of 1 % of the standard deviation of each channel."""
    rng, columns = np.random.default_rng(seed), [ANGLES]
    for name in CHANNELS:
        values = orbit.signal(name)(np.radians(ANGLES))
        columns.append(values + NOISE * np.std(values) * rng.standard_normal(len(values)))
    header = ["phase (deg)", *(f"{name} ({orbit.system.labels.units[name]})" for name in CHANNELS)]
    rows = [",".join(map(repr, map(float, row))) for row in zip(*columns, strict=True)]
    file.write_text("\n".join([",".join(header), *rows]), encoding="utf-8")
    return file


def coverage(trials: int, first: int = 0) -> dict[str, int]:
    """Return the number of trials in which each interval contains the true value."""
    cam, held = solve.load("cam"), dict.fromkeys(FREE, 0)
    true = {name: cam.parameters[name] * part for name, part in FREE.items()}
    orbit = solve.periodic(cam.varied(true), SPEED)
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(first, first + trials):
            file = record_file(Path(folder) / "record.csv", orbit, seed)
            fitted = solve.fit(cam, file, list(FREE), speed=SPEED, rtol=1e-5)
            for name, value in true.items():
                held[name] += fitted.parameters[name].low <= value <= fitted.parameters[name].high
    return held


def times(names: list[str]) -> tuple[float, float]:
    """Return times of fits to the first trials with exact Jacobians and with SciPy's two-point Jacobians."""
    cam = solve.load("cam")
    true = {name: cam.parameters[name] * FREE.get(name, 1.01) for name in names}
    with tempfile.TemporaryDirectory() as folder:
        file = record_file(Path(folder) / "record.csv", solve.periodic(cam.varied(true), SPEED), 0)
        sets = measured(file, cam, solve.periodic(cam, SPEED).speed)

    def search(exact: bool):
        problem = Problem(cam, sets, names, "auto", 1e-7)

        def residuals(x):
            model, parts = problem.varied(x), []
            for each in sets:
                orbit = solve.periodic(model, each.speed, rtol=1e-7)
                for name, values in each.channels.items():
                    parts.append((orbit.signal(name)(each.at) - values) / problem.scales[name])
            return np.concatenate(parts)

        around = problem.start - 1, problem.start + 1
        settings = {"x_scale": "jac", "max_nfev": TRIALS, "bounds": around}
        if exact:
            return least_squares(problem.residuals, problem.start, jac=problem.jacobian, **settings)
        return least_squares(residuals, problem.start, jac="2-point", **settings)

    (exact, ours), (differences, theirs) = (median(partial(search, each), 1) for each in (True, False))
    assert ours.nfev == theirs.nfev
    return exact, differences


def main() -> None:
    trials = int(sys.argv[1]) if len(sys.argv) > 1 else 500
    every = [name for name in solve.load("cam").parameters if name != "I0"]
    for names in (list(FREE), every[:40]):
        exact, differences = times(names)
        print(f"{len(names)} parameters: exact {exact:.2f} s, 2-point {differences:.2f} s", end="")
        print(f", {exact / differences:.3f} of it")
    for name, count in coverage(trials).items():
        print(f"{name}: {count} of {trials}, {100 * count / trials:.1f} %")


if __name__ == "__main__":
    main()
