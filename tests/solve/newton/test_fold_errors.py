"""Error estimates of orbits near folds, where multipliers are sensitive to errors of the orbit."""

from typing import Any

import numpy as np

import solve
from derive import Max, Mechanism, cos, rate

NUMBERS: dict[str, Any] = {
    "c": 0.08000741,
    "k": 1.915232e-4,
    "kappa": 3.902804,
    "right": 0.3296791,
    "left": 0.05974475,
}
LOADS: dict[str, Any] = {"mean": 0.3746323, "f": 0.8686446, "e": 0.01329126}


def mesh():
    """Mass with backlash and a varying stiffness, under a mean load."""
    made = Mechanism("mesh", "Mass with backlash", energy="1/s^2")
    (q,) = made.coordinates(q=("1", "displacement"))
    c, k, kappa = made.parameters(
        c=("1/s", "damping"), k=("1/s^2", "weak spring"), kappa=("1/s^2", "stiffness of the stops")
    )
    right, left = made.parameters(right=("1", "clearance"), left=("1", "clearance on the other side"))
    mean, f, e = made.parameters(
        mean=("1/s^2", "mean load"), f=("1/s^2", "varying load"), e=("1", "variation of the weak spring")
    )
    made.kinetic, made.dissipation = rate(q) ** 2 / 2, c * rate(q) ** 2 / 2
    made.potential = k * (1 + e * cos(made.phase)) * q**2 / 2
    made.potential += kappa * (Max(0, q - right) ** 2 + Max(0, -q - left) ** 2) / 2
    made.force(mean + f * cos(made.phase), along=q)
    made.decline_drive_torque("an equation without units")
    return made


def test_multiplier_errors_near_folds_are_within_twice_the_estimate():
    model = solve.load(mesh, **NUMBERS, **LOADS)
    branch = solve.branch(model, (0.5, 0.7), points=20, rtol=1e-5)
    compared = 0
    for fold in branch.folds[:2]:
        start = branch.curve(int(np.argmin(np.abs(branch.values - fold["speed"]))))
        for speed in (fold["speed"] * (1 - 1e-6), fold["speed"] * (1 + 1e-6)):
            try:
                orbit = solve.nonlinear(model, speed, start=start, rtol=1e-4)
            except solve.errors.NoOrbitError:
                continue
            exact = solve.nonlinear(model, speed, start=orbit, rtol=1e-11)
            error = abs(orbit.spectral_radius - exact.spectral_radius) / exact.spectral_radius
            assert error <= 2 * orbit.error_estimate.multipliers + 1e-11
            compared += 1
    assert compared
