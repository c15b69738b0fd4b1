"""Frequency of a mode, which the multiplier determines only modulo 2π/T."""

import math

import numpy as np
import pytest

import solve
from tests.solve.systems import constant, system

OMEGA = 1.3
"""Speed in rad/s; the period is one turn."""


def no_load(n):
    return lambda phase: np.zeros((len(phase), n))


def chain():
    """M, C and K of two masses with different units and sizes, and the roots λ. The frequencies are far above
    the speed."""
    M, K = np.diag([4.0, 1e-6]), np.array([[900.0, -0.001], [-0.001, 0.002]])
    C = 1e-3 * K
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    return M, C, K, np.linalg.eigvals(A)


@pytest.mark.parametrize("method", ["auto", "radau", "gauss", "newmark", "rk4"])
def test_modes_of_constant_coefficients_have_their_natural_frequencies(method):
    M, C, K, roots = chain()
    stability = solve.floquet(constant(M, C, K, no_load(2)), OMEGA, method, rtol=1e-4)
    truth = np.sort(np.abs(roots.imag))
    assert truth.min() > 10 * OMEGA
    np.testing.assert_allclose(sorted(mode.unfolded for mode in stability.modes), truth, rtol=1e-4)
    for mode, exponent in zip(stability.modes, stability.exponents, strict=True):
        assert mode.participation == pytest.approx(1.0, abs=1e-3)
        assert mode.folded == pytest.approx(exponent.imag, abs=1e-9)
        assert abs(mode.folded + mode.order * OMEGA) == pytest.approx(mode.unfolded, rel=1e-12)
        assert mode.mirror is None


def test_modes_with_large_phase_advance_have_no_order():
    """Hsu's method is exact for constant coefficients with any number of steps. Four steps do not resolve an
    order of 34, and the errors are unknown."""
    M, C, K, _ = chain()
    stability = solve.floquet(constant(M, C, K, no_load(2)), OMEGA, "hsu", steps=4, rtol=1e-4)
    assert stability.unresolved == 4
    assert [mode.order for mode in stability.modes] == [None] * 4


def test_floquet_modes_do_not_depend_on_step_lengths():
    M, C, K, _ = chain()
    without = solve.floquet(constant(M, C, K, no_load(2)), OMEGA, "radau", rtol=1e-6)
    given = system(lambda phase, speed: constant(M, C, K, no_load(2)).at(phase, speed), 2, breaks=(0.4, 3.0))
    stability = solve.floquet(given, OMEGA, "radau", rtol=1e-6)
    for ours, theirs in zip(stability.modes, without.modes, strict=True):
        assert ours.order == theirs.order
        assert ours.unfolded == pytest.approx(theirs.unfolded, rel=1e-6)


def test_rotating_coordinates_shift_the_order_by_one():
    """Isotropic pair in coordinates that rotate with the speed: both modes have the same multipliers, and
    their frequencies are ω ± Ω in the rotating coordinates."""
    omega = 7.45
    M, K, G = np.eye(2), (omega**2 - OMEGA**2) * np.eye(2), 2 * OMEGA * np.array([[0.0, -1.0], [1.0, 0.0]])
    stability = solve.floquet(constant(M, G, K, no_load(2)), OMEGA, rtol=1e-9)
    frequencies = sorted(mode.unfolded for mode in stability.modes)
    np.testing.assert_allclose(frequencies, np.repeat([omega - OMEGA, omega + OMEGA], 2), rtol=1e-8)


def test_negative_real_multiplier_has_two_orders():
    """Inside Mathieu's tongue about δ = 1, both multipliers are real and negative. The motion has half the
    frequency of the parameter, or odd multiples of it."""
    given = solve.load("mathieu", delta=1.0, epsilon=0.6)
    stability = solve.floquet(given, 1.0)
    assert stability.verdict == "unstable"
    for mode in stability.modes:
        assert (mode.order, mode.mirror) == (0, -1)
        assert mode.unfolded == pytest.approx(1.0, rel=1e-9)
        assert mode.participation == pytest.approx(0.5, abs=0.1)
    overdamped = constant([[1.0]], [[3.0]], [[1.0]], no_load(1))
    for mode in solve.floquet(overdamped, OMEGA, rtol=1e-6).modes:
        assert mode == (0.0, 0.0, 0, pytest.approx(1.0, abs=1e-9), None)


def test_gear_pair_has_the_frequency_of_its_mean_stiffness():
    """The frequency is 869 Hz, which the multiplier shows as 1.07 Hz."""
    pair = solve.load("gear_pair")
    stability = solve.floquet(pair, pair.labels.case_speed)
    phase = np.arange(4096) * (pair.period / 4096)
    M, _, K, _ = pair.at(phase, stability.speed)
    mean = math.sqrt(K.mean() / M.mean())
    first = stability.modes[0]
    assert first.unfolded == pytest.approx(mean, rel=0.02)
    assert abs(first.folded) < 0.01 * first.unfolded
    assert first.participation > 0.9


def test_methods_without_maps_give_the_folded_frequency_only():
    M, C, K, _ = chain()
    for mode in solve.floquet(constant(M, C, K, no_load(2)), OMEGA, "fourier", rtol=1e-4).modes:
        assert (mode.unfolded, mode.order, mode.participation) == (None, None, None)
