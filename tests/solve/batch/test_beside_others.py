"""A point in a batch is as accurate as a single point."""

import numpy as np
import pytest

import solve
from solve.batch.family import BuiltFamily
from solve.batch.tables import Sampled
from solve.period.grid import Grid
from tests.solve.references import multiplier_error


def rotated_system(angle, scale):
    """Return a stiff mode in axes rotated by an angle. The units of the coordinates differ by the factor
    `scale`."""
    mixed = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0]
    swing = 0.3 * mixed @ np.diag([0.5, 0.75, 1.0]) @ mixed.T
    axes, omega = np.eye(3), np.array([1e3, 2.1, 0.7])
    axes[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    units = np.diag(scale ** np.array([-1.0, 0.0, 1.0]))
    K, C = (units @ axes @ np.diag(part) @ axes.T @ units for part in (omega**2, 0.1 * omega))

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        varying = K + np.cos(phase)[:, None, None] * (units @ swing @ units)
        return units @ units * one, C * one, varying, np.ones((len(phase), 3))

    return solve.PeriodicSystem(matrices, ["a", "b", "c"])


def test_monodromy_matrices_are_independent_of_the_batch():
    """The matrices are equal bit for bit, although only some points require row exchanges."""
    points = np.column_stack((np.linspace(0.0, 1.5, 9), np.logspace(-3, 3, 9)))
    every = Sampled(BuiltFamily(rotated_system, ("angle", "scale"), points, 1.0), points, "compiled")
    grid = Grid.uniform(48, 2 * np.pi)
    Phi = solve.Radau().solutions(every, grid, False, "compiled").Phi
    for first in range(8):
        two = every[np.array([first, first + 1])]
        np.testing.assert_array_equal(
            solve.Radau().solutions(two, grid, False, "compiled").Phi, Phi[first : first + 2]
        )


@pytest.mark.parametrize("scales", [[1e-6, 1e-3, 1.0, 1e3, 1e6], [0.1, 1.0, 10.0]])
def test_points_in_a_batch_are_as_accurate_as_single_points(scales):
    """Units do not affect multipliers. Each point eliminates the coordinates in its own order."""
    angles = [0.0, 0.4, np.pi / 4, 1.2, np.pi / 2]
    chart = solve.chart(rotated_system, {"angle": angles}, {"scale": scales}, speed=1.0, boundaries=False)
    truth = [solve.floquet(rotated_system(angle, 1.0), 1.0, engine="numpy", rtol=1e-11) for angle in angles]
    for row, scale in enumerate(scales):
        for column, angle in enumerate(angles):
            error = multiplier_error(chart.multipliers[row, column], truth[column].multipliers)
            # The reference is computed in doubles too: both errors are part of the difference.
            estimate = chart.error_estimate[row, column] + truth[column].error_estimate.multipliers
            assert error <= 10 * estimate, (scale, angle)
            assert error <= 2e-10


def pulsed(strength, stiffness, start):
    """Return an oscillator with a pulse of the stiffness and of the load that lasts 1/80 of the period."""

    def matrices(phase, speed):
        one, width = np.ones((len(phase), 1, 1)), 2 * np.pi / 80
        fraction = np.mod(phase - start, 2 * np.pi) / width
        pulse = np.where(fraction < 1, np.sin(np.pi * fraction) ** 4, 0.0) / width
        K = (stiffness + strength * pulse)[:, None, None]
        return one, 0.03 * one, K, (1 + strength * pulse)[:, None]

    return solve.PeriodicSystem(matrices, ["q"])


@pytest.mark.parametrize("cell", [5, 17, 42, 58])
def test_pulses_between_training_phases_are_included(cell):
    """The pulse begins after one of the 64 phases from which shared terms are computed and ends before the
    next phase."""
    start = (cell + 0.6) * 2 * np.pi / 64
    strengths, stiffnesses = [0.0, 0.4, 0.9, 1.6], [0.9, 2.2, 4.0]
    chart = solve.chart(
        lambda strength, stiffness: pulsed(strength, stiffness, start),
        {"strength": strengths},
        {"stiffness": stiffnesses},
        speed=1.0,
        boundaries=False,
    )
    for column, strength in enumerate(strengths):
        for row, stiffness in enumerate(stiffnesses):
            alone = solve.floquet(pulsed(strength, stiffness, start), 1.0)
            assert chart.spectral_radius[row, column] == pytest.approx(alone.spectral_radius, rel=1e-8)
            assert chart.verdicts[row, column] == alone.verdict
