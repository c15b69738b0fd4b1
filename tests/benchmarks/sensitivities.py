"""Times of derivatives of the cam's orbit relative to one certified solution and to central differences.

python -m tests.benchmarks.sensitivities
"""

import statistics

import numpy as np

import solve
from solve.derivatives.grid_derivatives import GridDerivatives, dependence_of
from solve.derivatives.point import quantities_by
from solve.methods.collocated import Collocated
from tests.benchmarks.timing import median

SPEED = "600 rpm"

ROUNDS = 16
"""The first to warm up."""


def differences(cam, names, quantity):
    """Return central differences of a statistic with respect to the parameters."""
    computed = {}
    for name in names:
        at = cam.parameters[name]
        step = 1e-4 * (abs(at) or 1.0)
        ends = [solve.periodic(cam.varied({name: at + way * step}), SPEED) for way in (-1, 1)]
        low, high = (orbit.statistics(quantity).max_abs for orbit in ends)
        computed[name] = (high - low) / (2 * step)
    return computed


def on_its_grid(cam, names):
    """Return derivatives of a certified orbit on its grid, without error estimates."""
    orbit = solve.periodic(cam, SPEED)
    rule = orbit.certified.method
    assert isinstance(rule, Collocated)
    return GridDerivatives(orbit, rule, orbit.steps, dependence_of(orbit, names), names, True)


def curves_at(cam, names, phases):
    """Return the curves of all coordinates and their derivatives, as a fit uses them."""
    on = on_its_grid(cam, names)
    return [(on.orbit.signal(name)(phases), on.forward.signal(name, phases)) for name in cam.coordinates]


def main():
    cam = solve.load("cam")
    names = [name for name in cam.parameters if name != "I0"][:40]
    phases = np.linspace(0, 2 * np.pi, 180, endpoint=False)
    alone = {of: quantities_by(cam, [of], names)[0] for of in ("q3.max_abs", "spectral_radius")}
    figures = [
        f"{name}.{figure}" for name in cam.coordinates for figure in ("max", "min", "rms", "harmonic1")
    ]
    calls = {
        "one certified orbit": lambda: solve.periodic(cam, SPEED),
        "q3.max_abs by 40 parameters": lambda: solve.sensitivities(cam, SPEED, "q3.max_abs", names),
        "12 figures of all coordinates by 40": lambda: solve.sensitivities(cam, SPEED, figures, names),
        "spectral_radius by 40": lambda: solve.sensitivities(cam, SPEED, "spectral_radius", names),
        "q3.max_abs by 40, without errors": lambda: on_its_grid(cam, names).slopes(alone["q3.max_abs"]),
        "spectral_radius by 40, without errors": lambda: on_its_grid(cam, names).slopes(
            alone["spectral_radius"]
        ),
        "3 curves by 40, without errors": lambda: curves_at(cam, names, phases),
    }
    times = taken_in_turns(calls)
    times["central differences of q3.max_abs by 40"] = median(lambda: differences(cam, names, "q3"), 1)[0]
    one = next(iter(times.values()))
    for what, cost in times.items():
        print(f"{what:42}{1e3 * cost:10.1f} ms{cost / one:8.1f} times")


def taken_in_turns(calls):
    """Return median processor times in seconds of alternating calls, which other programs slow equally."""
    times = {what: [] for what in calls}
    for _ in range(ROUNDS):
        for what, call in calls.items():
            times[what].append(median(call, 1)[0])
    return {what: statistics.median(each[1:]) for what, each in times.items()}


if __name__ == "__main__":
    main()
