"""Constant coefficients, compared with the matrix exponential and the frequency response in closed form."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from solve import floquet, periodic
from tests.solve.references import multiplier_error
from tests.solve.systems import constant, seeds, spd

METHODS = st.sampled_from(["auto", "radau", "gauss"])
PHASES = np.linspace(0.0, 2 * np.pi, 97)


def structure(seed, n, damping):
    rng = np.random.default_rng(seed)
    return spd(rng, n, 0.5, 2.0), damping * spd(rng, n, 0.1, 1.0), spd(rng, n, 0.5, 30.0)


def state_matrix(M, C, K):
    inverse, n = np.linalg.inv(M), len(M)
    return np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ K, -inverse @ C]])


def load(seed, n, orders=4):
    """Return the complex amplitudes (orders+1, n) of d = Re Σ D_k exp(ikφ), and d as a function of the
    phase."""
    rng = np.random.default_rng(seed + 1)
    D = rng.standard_normal((orders + 1, n)) + 1j * rng.standard_normal((orders + 1, n))
    return D, lambda phase: np.real(np.exp(1j * np.outer(phase, np.arange(orders + 1))) @ D)


@given(seeds, st.integers(1, 4), st.floats(0.2, 5.0), METHODS)
@settings(max_examples=40, deadline=None)
def test_multipliers_match_the_matrix_exponential(seed, n, speed, method):
    M, C, K = structure(seed, n, damping=0.5)
    system = constant(M, C, K, lambda phase: np.zeros((len(phase), n)))
    truth = np.linalg.eigvals(expm(state_matrix(M, C, K) * 2 * np.pi / speed))
    stability = floquet(system, speed, method, rtol=1e-11)
    assert len(stability.multipliers) == 2 * n
    assert multiplier_error(stability.multipliers, truth) < 1e-10
    assert stability.spectral_radius == pytest.approx(np.abs(truth).max(), rel=1e-10)


@given(seeds, st.integers(1, 4), st.floats(0.2, 5.0), METHODS)
@settings(max_examples=40, deadline=None)
def test_orbit_matches_the_frequency_response(seed, n, speed, method):
    """q = Re Σ (K + ikΩC - k²Ω²M)⁻¹ D_k exp(ikφ)."""
    M, C, K = structure(seed, n, damping=0.5)
    D, force = load(seed, n)
    response = np.array(
        [np.linalg.solve(K + 1j * k * speed * C - (k * speed) ** 2 * M, Dk) for k, Dk in enumerate(D)]
    )
    waves = np.exp(1j * np.outer(np.arange(len(D)), PHASES))
    orbit = periodic(constant(M, C, K, force), speed, method, rtol=1e-12)
    orders = 1j * speed * np.arange(len(D))
    for computed, power in zip(orbit.state(PHASES), range(3), strict=True):
        truth = np.real((response * orders[:, None] ** power).T @ waves)
        np.testing.assert_allclose(computed, truth, rtol=0, atol=3e-9 * np.abs(truth).max())
    np.testing.assert_allclose(
        orbit.at(PHASES), np.real(response.T @ waves), rtol=0, atol=1e-10 * np.abs(response).sum()
    )
    for name, amplitude in zip(orbit.coordinates, response.T, strict=True):
        amplitudes, angles = orbit.harmonics(name, 6)
        scale = np.abs(amplitude).max()
        assert amplitudes[0] == pytest.approx(amplitude[0].real, abs=1e-10 * scale)
        np.testing.assert_allclose(
            amplitudes[1:5] * np.exp(1j * angles[1:5]), amplitude[1:], rtol=0, atol=1e-10 * scale
        )
        np.testing.assert_allclose(amplitudes[5:], 0.0, rtol=0, atol=1e-10 * scale)


@given(seeds, st.integers(1, 3), st.floats(0.3, 3.0))
@settings(max_examples=25, deadline=None)
def test_exponents_equal_eigenvalues_modulo_the_speed(seed, n, speed):
    """λ = ln(ρ)/T differs from an eigenvalue by an integer multiple of iΩ."""
    M, C, K = structure(seed, n, damping=0.5)
    stability = floquet(constant(M, C, K, lambda phase: np.zeros((len(phase), n))), speed, rtol=1e-11)
    eigenvalues = np.linalg.eigvals(state_matrix(M, C, K))
    scale = np.exp(2 * np.pi / speed * (eigenvalues.real.max() - stability.exponents.real))
    for exponent, factor in zip(stability.exponents, scale, strict=True):
        turns = (exponent - eigenvalues) / (1j * speed)
        assert np.abs(turns - np.round(turns.real)).min() < 1e-9 * factor
        assert abs(exponent.imag) <= speed / 2 * (1 + 1e-12)


@pytest.mark.parametrize("method", ["radau", "gauss"])
def test_quasi_static_solution_omits_inertia_and_damping(method):
    M, C, K = structure(11, 3, damping=0.5)
    D, force = load(11, 3)
    orbit = periodic(constant(M, C, K, force), 2.0, method)
    phase = np.linspace(0.0, 2 * np.pi, 5001)
    truth = np.linalg.solve(K, force(phase).T)
    np.testing.assert_allclose(orbit.quasi_static.state(phase)[0], truth, rtol=0, atol=1e-13)
    statistics = orbit.quasi_static.statistics("q1")
    assert statistics.max == pytest.approx(truth[0].max(), rel=1e-5)
    assert statistics.mean == pytest.approx(np.linalg.solve(K, D[0].real)[0], abs=1e-13)
