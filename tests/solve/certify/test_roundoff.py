"""Stiff modes in rotated axes: the round-off of large stiffnesses affects the soft modes."""

import numpy as np
import pytest

import solve
from tests.solve.references import multiplier_error, relative_error

PHASES = np.linspace(0.0, 2 * np.pi, 200, endpoint=False)


def in_axes(seed):
    """Return a system in modal axes, the same system in rotated axes with other units, and the map from the
    former to the latter coordinates. Stiff modes are 20 to 1e4 times faster than the speed. Entries are
    rounded once."""
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
def test_estimates_in_rotated_axes_are_sharp_bounds(rtol):
    """In modal axes, each mode has only its own round-off."""
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


def test_tolerance_below_round_off_does_not_refine_the_grid():
    """A mode of 1 rad/s next to one of 1e4 rad/s loses several digits. If this round-off were not estimated,
    the steps would be doubled up to the limit."""
    _, turned, _ = in_axes(0)
    orbit = solve.periodic(turned, 1.0, rtol=1e-13)
    assert max(orbit.error_estimate) > 1e-13
    assert orbit.steps <= 4096
    assert any("attainable accuracy" in warning for warning in orbit.warnings)


@pytest.mark.parametrize("method", ["auto", "fourier"])
@pytest.mark.parametrize("detuning", [4e-16, -7e-15, 5e-15])
def test_tuning_within_round_off_does_not_refine_the_grid(method, detuning):
    """The rotation of a wheel of 40 kg m² with an absorber is round-off of the moments that cancel on it.
    Two solutions may have common digits of this rotation by chance, and finer grids do not add any."""
    speed, wheel, absorber = 50.0, 40.0, 2.5
    stiffness = absorber * (3 * speed) ** 2 * (1 + detuning)

    def matrices(phase, speed):
        every = np.ones((len(phase), 1, 1))
        K = every * np.array([[6e6 + stiffness, -stiffness], [-stiffness, stiffness]])
        K[:, 0, 0] += 1e6 * np.sin(phase)
        load = np.cos(3 * phase)[:, None] * np.array([800.0, 0.0])
        return every * np.diag([wheel, absorber]), every * np.diag([900.0, 0.0]), K, load

    system = solve.PeriodicSystem(matrices, ["wheel", "absorber"])
    orbit = solve.periodic(system, speed, method=method, rtol=1e-12)
    assert np.abs(orbit.q[0]).max() < 1e-13 * np.abs(orbit.q[1]).max()
    np.testing.assert_allclose(np.abs(orbit.q[1]).max(), 800.0 / stiffness, rtol=1e-10)
    assert orbit.steps < 300
    assert orbit.error_estimate.orbit < 1e-10
