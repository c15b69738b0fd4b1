"""Modal uncoupling: exact for constant modes with proportional damping, inaccurate for rotating modes."""

import numpy as np
import pytest
from scipy.linalg import expm

from solve import floquet, periodic
from solve.errors import MatricesError
from tests.solve.references import multiplier_error, relative_error, slope
from tests.solve.systems import constant, random_system, spd, system

PHASES = np.linspace(0.0, 2 * np.pi, 301)


def proportional(seed, n):
    """Constant symmetric M and K with C = 0.05 M + 0.01 K."""
    rng = np.random.default_rng(seed)
    M, K = spd(rng, n, 0.5, 2.0), spd(rng, n, 0.5, 9.0)
    loads = rng.standard_normal((2, n))
    return constant(M, 0.05 * M + 0.01 * K, K, lambda phase: np.outer(np.cos(phase), loads[0]) + loads[1]), (
        M,
        0.05 * M + 0.01 * K,
        K,
        loads,
    )


@pytest.mark.parametrize("n", [1, 2, 4])
def test_multipliers_are_exact_for_constant_symmetric_proportional_systems(n):
    given, (M, C, K, _) = proportional(n, n)
    inverse = np.linalg.inv(M)
    state = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ K, -inverse @ C]])
    stability = floquet(given, 1.0, "modal", steps=24, rtol=0.9)
    assert multiplier_error(stability.multipliers, np.linalg.eigvals(expm(2 * np.pi * state))) < 1e-12


@pytest.mark.parametrize("n", [1, 2, 4])
def test_orbits_converge_for_constant_symmetric_proportional_systems(n):
    """The load is constant during each step, so that the order is two."""
    given, (M, C, K, loads) = proportional(n, n)
    wave = np.linalg.solve(K - M + 1j * C, loads[0])
    truth = np.real(np.outer(wave, np.exp(1j * PHASES))) + np.linalg.solve(K, loads[1])[:, None]
    steps = (48, 72, 96, 144)
    errors = [
        relative_error(periodic(given, 1.0, "modal", steps=m, rtol=0.9).at(PHASES), truth) for m in steps
    ]
    assert slope(steps, errors) == pytest.approx(2.0, abs=0.15)
    assert errors[-1] < 1e-2


def test_modal_converges_for_constant_shapes_with_varying_frequencies():
    """Uncoupled Mathieu equations in coordinates that mix them."""
    T = np.array([[0.6, -0.8], [0.8, 0.6]])

    def matrices(phase, speed):
        K = np.zeros((len(phase), 2, 2))
        K[:, 0, 0], K[:, 1, 1] = 1.3 + 0.4 * np.cos(phase), 6.0 + np.sin(phase)
        eye = np.broadcast_to(np.eye(2), K.shape)
        return eye, 0.1 * eye, T @ K @ T.T, np.column_stack((np.cos(phase), np.ones_like(phase)))

    given = system(matrices, 2)
    truth = periodic(given, 1.0, rtol=1e-9)
    steps = (100, 150, 200)
    computed = [periodic(given, 1.0, "modal", steps=m, rtol=0.9) for m in steps]
    for errors in (
        [multiplier_error(each.multipliers, truth.multipliers) for each in computed],
        [relative_error(each.at(PHASES), truth.at(PHASES)) for each in computed],
    ):
        assert slope(steps, errors) == pytest.approx(2.0, abs=0.15)


def turning(rate):
    """System with a stiff and a soft direction. `rate` is the number of revolutions of both directions per
    period."""

    def matrices(phase, speed):
        c, s = np.cos(rate * phase), np.sin(rate * phase)
        R = np.moveaxis(np.array([[c, -s], [s, c]]), -1, 0)
        K = R @ np.diag([2.3, 9.1]) @ np.swapaxes(R, 1, 2)
        eye = np.broadcast_to(np.eye(2), K.shape)
        return eye, 0.2 * eye, K, np.column_stack((np.cos(phase), np.ones_like(phase)))

    return system(matrices, 2)


def test_modal_reports_its_error_for_rotating_modes():
    """The omitted terms are as large as the Coriolis forces, 2Ω θ′, on any grid. The reported errors of orbit
    and multipliers equal the true ones."""
    truth = periodic(turning(1), 1.0, rtol=1e-10)
    for m in (200, 800):
        computed = periodic(turning(1), 1.0, "modal", steps=m, rtol=1e-3)
        orbit = relative_error(computed.at(PHASES), truth.at(PHASES))
        multipliers = multiplier_error(computed.multipliers, truth.multipliers)
        assert orbit > 0.1
        assert multipliers > 0.1
        assert computed.error_estimate.orbit == pytest.approx(orbit, rel=0.02)
        assert 0.5 < computed.error_estimate.multipliers / multipliers < 2.0
        assert any("modal is an approximation that gives the orbit to" in text for text in computed.warnings)


def test_damping_that_couples_the_modes_is_omitted():
    coupled = constant(
        np.eye(2),
        np.array([[0.4, 0.3], [0.3, 0.4]]),
        np.diag([1.3, 2.1]),
        lambda phase: np.ones((len(phase), 2)),
    )
    stability = floquet(coupled, 1.0, "modal", steps=24, rtol=0.9)
    lambdas = [-0.2 + 1j * np.sqrt(k - 0.04) for k in (1.3, 2.1)]
    expected = np.exp(2 * np.pi * np.array([*lambdas, *np.conj(lambdas)]))
    assert multiplier_error(stability.multipliers, expected) < 1e-12
    assert stability.error_estimate.multipliers > 0.1


def test_units_of_coordinates_do_not_change_the_approximation():
    """Modal masses are those of the equations in energy form, in any units."""
    given, units = random_system(5, 3), 2.0 ** np.array([-12, 0, 12])

    def matrices(phase, speed):
        M, C, K, d = given.at(phase, speed)
        return (*(units[:, None] * part * units for part in (M, C, K)), units * d)

    computed, again = (
        periodic(each, 1.0, "modal", steps=90, rtol=0.9) for each in (given, system(matrices, 3))
    )
    assert relative_error(units[:, None] * again.at(PHASES), computed.at(PHASES)) < 1e-12


def test_complex_frozen_modes_are_refused():
    circulatory = constant(
        np.eye(2), 0.1 * np.eye(2), [[2.0, 1.0], [-1.0, 2.0]], lambda phase: np.ones((len(phase), 2))
    )
    with pytest.raises(
        MatricesError, match=r"modal requires real modes of M and K at every phase, .* use radau or gauss"
    ):
        periodic(circulatory, 1.0, "modal")
