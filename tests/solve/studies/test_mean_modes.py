"""Frozen modes that cross within a period, compared with multiplier angles and with means of known
frequencies."""

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

import solve
from solve.studies.mean_frequencies import MeanFrequencies, combinations
from solve.studies.mean_modes import mean_modes, shift_by_rates
from tests.solve import systems


def oscillators(swing, coupling, damping=(0.0, 0.0)):
    """Return two oscillators coupled by a stiffness. Their ω², 1 + swing cos φ and 1.44 - swing cos φ, cross
    twice per period."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        wave = np.cos(phase)[:, None, None]
        stiffness = np.diag([1.0, 1.44]) + swing * wave * np.diag([1.0, -1.0])
        between = coupling * np.array([[0.0, 1.0], [1.0, 0.0]])
        return (
            one * np.eye(2),
            one * np.diag(damping),
            stiffness + between,
            np.cos(phase)[:, None] * np.ones(2),
        )

    return systems.system(matrices, 2)


def mean_root(middle, swing):
    """Return the mean of sqrt(middle + swing cos φ) over a period."""
    return np.sqrt(middle + swing * np.cos((np.arange(4096) + 0.5) * np.pi / 2048)).mean()


def angle_off(system, speed):
    """Return the largest difference, in revolutions, between the angles of the multipliers and those of the
    mean frequencies."""
    rho = np.array(solve.floquet(system, speed).multipliers)
    turned = np.abs(np.angle(rho[np.imag(rho) > 0])) / (2 * np.pi)
    expected = mean_modes(system, speed).frequencies / speed
    off = np.abs(turned[:, None] - np.abs(expected - np.round(expected)))
    return off[linear_sum_assignment(off)].max()


@pytest.mark.parametrize("speed", [0.0, 0.07, 0.2, 1.9])
def test_crossing_modes_keep_their_identity(speed):
    modes = mean_modes(oscillators(0.5, 0.0, (0.1, 0.3)), speed)
    np.testing.assert_allclose(modes.frequencies, [mean_root(1.0, 0.5), mean_root(1.44, -0.5)], rtol=1e-9)
    np.testing.assert_allclose(modes.rates, [0.05, 0.15], rtol=1e-9)


def test_coupled_identical_modes_have_symmetric_candidates():
    """The combinations x + y and x - y are uncoupled, with ω² = 1 ± 0.3 cos φ."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        between = 0.3 * np.cos(phase)[:, None, None] * np.array([[0.0, 1.0], [1.0, 0.0]])
        return one * np.eye(2), 0 * one * np.eye(2), one * np.eye(2) + between, np.zeros((len(phase), 2))

    system = systems.system(matrices, 2)
    np.testing.assert_allclose(mean_modes(system, 0.3).frequencies, mean_root(1.0, 0.3), rtol=1e-9)
    critical = solve.critical_speeds(system, np.linspace(1.6, 2.4, 41), orders=4)
    (row,) = [row for row in critical.rows if row.radius]
    assert row.combination is None
    assert {one.modes for one in row.candidates} >= {(1, 1), (2, 2)}
    assert {one.order for one in row.candidates} == {1}


def test_speed_determines_identities_in_an_avoided_crossing():
    """According to the angles of the multipliers, modes keep their ranks at low speeds and their shapes at
    high speeds. Between these, the two mean frequencies jump; the jump is not a combination resonance."""
    system, slow, quick = oscillators(0.5, 0.1), 0.03, 0.37
    for speed in (slow, quick):
        assert angle_off(system, speed) < 0.01
    low, high = (np.diff(mean_modes(system, speed).frequencies) for speed in (slow, quick))
    assert high < 0.7 * low
    jump = MeanFrequencies(system, np.geomspace(slow, quick, 40))
    for one in combinations(jump, 4):
        weights = np.eye(2)[one.modes[0] - 1] + one.sign * np.eye(2)[one.modes[1] - 1]
        assert jump.at(one.speed) @ weights == pytest.approx(one.order * one.speed, rel=0.01)


@pytest.mark.parametrize("speed", [20.0, 30.0])
def test_decay_rates_of_approaching_modes_match_the_multipliers(speed):
    """Of two close modes, the lower always has little damping and the higher much damping, whatever their
    shapes. If modes were identified by shape, both would have the mean damping. The multipliers show which
    rule holds."""
    manipulator = solve.load("manipulator")
    omega = speed * np.pi / 30
    rho = np.array(solve.floquet(manipulator, omega).multipliers)
    decays = np.sort(-np.log(np.abs(rho[np.imag(rho) > 0])) * omega / (2 * np.pi))
    modes = mean_modes(manipulator, omega)
    np.testing.assert_allclose(modes.rates, decays, rtol=0.25)


@pytest.mark.parametrize("coupling", [0.0, 0.05])
def test_tongues_of_crossing_modes_are_assigned_to_them(coupling):
    critical = solve.critical_speeds(
        oscillators(0.5, coupling, (0.02, 0.02)), np.linspace(1.6, 2.6, 41), orders=4
    )
    computed = {
        row.combination.modes: row.radius.speed for row in critical.rows if row.radius and row.combination
    }
    assert set(computed) == {(1, 1), (2, 2)} | ({(2, 1)} if coupling else set())
    for mode, middle in ((1, 1.0), (2, 1.44)):
        assert computed[mode, mode] == pytest.approx(2 * mean_root(middle, 0.5), rel=0.01)


def turning_frame():
    """Return a mass on four equal springs, ω = 100 rad/s, in a frame that rotates at Ω: λ = ± i (ω ± Ω)."""

    def matrices(phase, speed):
        one, turned = np.ones((len(phase), 1, 1)), np.array([[0.0, -1.0], [1.0, 0.0]])
        K = (100.0**2 - speed**2) * np.eye(2)
        return one * np.eye(2), one * 2 * speed * turned, one * K, np.ones((len(phase), 2))

    return systems.system(matrices, 2)


def test_neglected_gyroscopic_forces_are_measured_and_reported():
    expected = 120.0 / np.sqrt(100.0**2 - 20.0**2) - 1
    assert shift_by_rates(turning_frame(), 20.0) == pytest.approx(expected, rel=1e-12)
    assert shift_by_rates(oscillators(0.1, 0.0, (0.2, 0.4)), 1.0) < 1e-12
    warnings = solve.critical_speeds(turning_frame(), [30.0, 50.0]).notes
    (reported,) = [text for text in warnings if "gyroscopic forces" in text]
    assert "are unreliable there" in reported
    still = solve.critical_speeds(oscillators(0.1, 0.0, (0.01, 0.01)), [0.5, 2.0]).notes
    assert not any("gyroscopic" in text for text in still)
