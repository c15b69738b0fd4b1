"""Stiff modes in turned axes: the round-off of large stiffnesses acts on the soft modes."""

import numpy as np
import pytest

import solve
from tests.solve.references import multiplier_error, relative_error

PHASES = np.linspace(0.0, 2 * np.pi, 200, endpoint=False)


def in_axes(seed):
    """A system in the axes of its modes, in turned axes with other units, and the map from the former to the
    latter coordinates. Stiff modes are 20 to 1e4 times as fast as the speed; entries are rounded once."""
    rng = np.random.default_rng((1826, seed))
    n = int(rng.integers(2, 7))
    stiff = np.arange(n) < rng.integers(1, n)
    omega = np.where(stiff, 10 ** rng.uniform(1.3, 4.0, n), 10 ** rng.uniform(-0.5, 0.7, n))
    zeta = np.where(stiff, 10 ** rng.uniform(-2.0, -0.2, n), 10 ** rng.uniform(-3.0, -0.8, n))
    swing, load = rng.standard_normal((n, n)), rng.standard_normal(n)
    units = 10 ** rng.uniform(-3.0, 3.0, n) if seed % 2 else np.ones(n)
    axes = units[:, None] * np.linalg.qr(rng.standard_normal((n, n)))[0]

    def system(axes):
        wide = np.asarray(axes, dtype=np.longdouble)
        changes = wide @ (0.1 * (swing + swing.T)) @ wide.T
        M, C, K = (wide * part @ wide.T for part in (np.ones(n), 2 * zeta * omega, omega**2))

        def matrices(phase, speed):
            cosine, growing = np.cos(phase)[:, None, None], 1 + np.sin(phase)[:, None]
            every = np.ones((len(phase), 1, 1)) * M, np.ones((len(phase), 1, 1)) * C, K + cosine * changes
            return tuple(part.astype(float) for part in (*every, growing * (wide @ load)))

        return solve.PeriodicSystem(matrices, [f"q{i}" for i in range(n)])

    return system(np.eye(n)), system(axes), np.linalg.inv(axes.T)


@pytest.mark.parametrize("rtol", [1e-8, 1e-12])
def test_errors_of_stiff_modes_in_turned_axes_are_honest_and_sharp(rtol):
    """In the axes of the modes, rounding changes each mode by round-off of its own."""
    visible, sharp = 0, 0
    for seed in range(12):
        straight, turned, back = in_axes(seed)
        truth = solve.periodic(straight, 1.0, rtol=1e-12)
        orbit = solve.periodic(turned, 1.0, rtol=rtol)
        errors = (
            relative_error(orbit.at(PHASES), back @ truth.at(PHASES)),
            multiplier_error(orbit.multipliers, truth.multipliers),
        )
        for error, estimate, own in zip(errors, orbit.error_estimate, truth.error_estimate, strict=True):
            assert error <= 10 * estimate + own, (seed, error, estimate)
            visible, sharp = visible + (error > 1e-12), sharp + (error > 1e-12 and estimate <= 100 * error)
    assert sharp >= 0.8 * visible > 0


def test_a_tolerance_below_the_round_off_costs_no_steps():
    """Twelve digits of a mode of 1 rad/s are lost beside one of 1e4 rad/s; without its round-off the steps
    would be doubled to their limit."""
    _, turned, _ = in_axes(0)
    orbit = solve.periodic(turned, 1.0, rtol=1e-13)
    assert max(orbit.error_estimate) > 1e-13
    assert orbit.steps <= 4096
    assert any("attainable accuracy" in warning for warning in orbit.warnings)
