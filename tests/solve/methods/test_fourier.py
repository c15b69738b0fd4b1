"""Harmonic balance by collocation, and the terms that Bahgat and Willmert's variant of it omits."""

import numpy as np
import pytest

from solve import Radau, floquet, periodic
from solve.methods.fourier import differentiation
from solve.period.grid import Grid
from tests.solve.certificates.population import member
from tests.solve.references import Shooting, multiplier_error, relative_error
from tests.solve.systems import constant, random_matrices, random_system, system

PHASES = np.linspace(0.0, 2 * np.pi, 401)


@pytest.mark.parametrize("seed", range(4))
def test_orbit_and_multipliers_equal_dop853(seed):
    given = random_system(seed, 1 + seed)
    truth = Shooting(given, 1.0)
    orbit = periodic(given, 1.0, "fourier", rtol=1e-9)
    assert relative_error(orbit.at(PHASES), truth.states(PHASES)[: given.n]) < 1e-9
    assert multiplier_error(orbit.multipliers, truth.multipliers) < 1e-9


def test_41_points_suffice_without_lightly_damped_modes():
    given = random_system(4, 2)
    truth = periodic(given, 1.0, Radau(13), rtol=1e-13)
    orbit = periodic(given, 1.0, "fourier", steps=41, rtol=0.5)
    assert relative_error(orbit.at(PHASES), truth.at(PHASES)) < 1e-13


def test_even_steps_become_odd():
    assert periodic(random_system(4, 2), 1.0, "fourier", steps=40, rtol=0.5).steps == 41


@pytest.mark.parametrize("method", ["fourier", "hill"])
def test_condition_number_does_not_grow_with_the_harmonics(method):
    coarse, fine = (periodic(random_system(4, 2), 1.0, method, steps=m, rtol=0.9) for m in (31, 81))
    assert fine.condition < 2 * coarse.condition < 1e4


@pytest.mark.parametrize(("index", "steps"), [(495, 203), (347, 17), (499, 33)])
def test_eigenvectors_at_the_truncation_limit_are_not_used(index, steps):
    """Undamped systems with a mode at 75 to 109 times the speed. If the orders reach this mode, eigenvectors
    with components at both ends of the spectrum must not be taken for central ones. Otherwise, no error may
    occur."""
    given = member(index)
    truth = floquet(given.system, given.speed, Radau(13), rtol=1e-11)
    stability = floquet(given.system, given.speed, "fourier", steps=steps, rtol=0.9)
    error = multiplier_error(stability.multipliers, truth.multipliers)
    assert error <= 10 * stability.error_estimate.multipliers
    if steps == 203:
        assert error < 1e-10


@pytest.mark.parametrize("method", ["fourier", "hill"])
def test_growing_mode_is_not_replaced_by_a_duplicate(method):
    """With 33 and 49 phases, the fast mode occurs twice before the soft one, whose stiffness is negative
    during part of the period and whose eigenvector is wide. Both grids then had two equal pairs and no
    growth."""
    M, C = np.array([[1.15, -0.44], [-0.44, 0.8]]), np.array([[0.2, -0.11], [-0.11, 0.04]])
    K, cos_2 = np.array([[88.3, -45.3], [-45.3, 23.8]]), np.array([[-12.0, -0.3], [-0.3, 0.0]])
    sin_1, cos_3 = np.array([[0.0, 0.5], [0.5, -2.3]]), np.array([[7.9, 1.7], [1.7, 2.4]])

    def matrices(phase, speed):
        at = phase[:, None, None]
        stiffness = K + sin_1 * np.sin(at) + cos_2 * np.cos(2 * at) + cos_3 * np.cos(3 * at)
        return M + 0 * at, C + 0 * at, stiffness, np.zeros((len(phase), 2))

    given = system(matrices, 2)
    stability = floquet(given, 0.54, method, rtol=1e-3)
    error = multiplier_error(stability.multipliers, Shooting(given, 0.54).multipliers)
    assert stability.verdict == "unstable"
    assert error <= 10 * stability.error_estimate.multipliers


def test_differentiation_is_exact_up_to_the_truncation_order():
    grid = Grid.uniform(9, 3.0)
    rate = 2 * np.pi / 3.0
    for k in range(5):
        wave = np.cos(k * rate * grid.nodes[:-1] + 0.3)
        slope = -k * rate * np.sin(k * rate * grid.nodes[:-1] + 0.3)
        np.testing.assert_allclose(differentiation(grid) @ wave, slope, rtol=0, atol=1e-12)


def at_speed(speed, damping=1.0):
    """System whose matrices depend on the phase only."""
    matrices = random_matrices(6, 2)

    def of_phase(phase, _):
        M, C, K, d = matrices(phase, 1.0)
        return M, damping * C, K, d

    return system(of_phase, 2), speed


def variants_error(speed):
    """True and estimated errors of Bahgat and Willmert's orbit."""
    given, omega = at_speed(speed)
    truth = periodic(given, omega, "radau", rtol=1e-9)
    orbit = periodic(given, omega, "bahgat-willmert", steps=61, rtol=0.9)
    return relative_error(orbit.at(PHASES), truth.at(PHASES)), orbit.error_estimate.orbit


def test_bahgat_willmert_variant_is_exact_for_constant_matrices_only():
    load = random_matrices(6, 2)
    plain = constant(np.eye(2), 0.1 * np.eye(2), np.diag([2.0, 3.0]), lambda phase: load(phase, 1.0)[3])
    truth = periodic(plain, 1.0, "fourier", rtol=1e-10)
    orbit = periodic(plain, 1.0, "bahgat-willmert", steps=61)
    assert relative_error(orbit.at(PHASES), truth.at(PHASES)) < 1e-12


def test_bahgat_willmert_variant_reports_its_growing_error():
    """Compared with harmonic balance on the full matrices, the error is proportional to the speed for
    quasi-static motion, and as large as the motion itself otherwise (section 6.4 of the thesis). Both errors
    are reported."""
    errors = {}
    for speed in (0.005, 0.01, 0.1, 1.0):
        errors[speed], stated = variants_error(speed)
        assert errors[speed] == pytest.approx(stated, rel=0.05)
    print(f"Bahgat-Willmert against harmonic balance: {errors}")
    assert errors[0.01] / errors[0.005] == pytest.approx(2.0, abs=0.1)
    assert errors[0.005] < 0.01
    assert errors[1.0] > 0.1
