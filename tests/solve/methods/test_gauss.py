"""Invariants of Gauss's methods: the unit circle, reciprocal pairs, and undamped unresolved modes."""

import numpy as np
import pytest

from solve import floquet
from solve.errors import ValueOutOfBoundsError
from solve.methods.gauss import Gauss
from tests.solve.systems import constant, spd, system

ORDERS = [4, 6, 8, 10, 12, 14, 16]


def symmetric(seed, n):
    """System with M = I, C = 0 and symmetric K(φ): Hamilton's equations for (q, q′)."""
    rng = np.random.default_rng(seed)
    mean, wave = spd(rng, n, 0.5, 6.0), 0.6 * spd(rng, n, 0.2, 1.0)

    def matrices(phase, speed):
        K = mean + np.cos(phase)[:, None, None] * wave
        return np.broadcast_to(np.eye(n), K.shape), 0 * K, K, np.ones((len(phase), n))

    return system(matrices, n)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("seed", range(4))
def test_multipliers_are_reciprocal_pairs_on_any_grid(order, seed):
    """The map of a step of any length is symplectic."""
    for steps in (1, 3, 8):
        values = floquet(symmetric(seed, 3), 1.0, Gauss(order), steps=steps, rtol=0.9).multipliers
        sensitivity = np.abs(values).max() ** 2
        for value in values:
            assert np.abs(values - 1 / value).min() < 1e-6 * sensitivity
        assert np.prod(values).real == pytest.approx(1.0, abs=1e-11 * sensitivity)
        coefficients = np.poly(values).real  # a reciprocal polynomial reads alike from both ends
        np.testing.assert_allclose(
            coefficients, coefficients[::-1], rtol=0, atol=1e-11 * np.abs(coefficients).max()
        )


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("angle", [0.1, 3.0, 100.0])
def test_undamped_mode_retains_its_amplitude_at_any_step(order, angle):
    steps = 20
    plain = constant(
        np.eye(1),
        np.zeros((1, 1)),
        [[(angle * steps / (2 * np.pi)) ** 2]],
        lambda phase: np.ones((len(phase), 1)),
    )
    values = floquet(plain, 1.0, Gauss(order), steps=steps, rtol=0.9).multipliers
    np.testing.assert_allclose(np.abs(values), 1.0, rtol=0, atol=1e-11)


@pytest.mark.parametrize("order", ORDERS)
def test_unresolved_stiff_mode_of_gauss_gives_a_warning(order):
    """The exact |ρ| are exp(-2π·2500) and exp(-0.05·2π). Because |R(-∞)| = 1, the stiff mode appears
    undamped."""
    given = constant(
        np.eye(2), np.diag([0.1, 5e3]), np.diag([1.3, 2.5e7]), lambda phase: np.ones((len(phase), 2))
    )
    stability = floquet(given, 1.0, Gauss(order), steps=8, rtol=1e-3)
    true = np.exp(-0.1 * np.pi)
    assert stability.spectral_radius > 0.8 > true
    assert stability.error_estimate.multipliers > 0.1
    assert any("leave stiff modes unresolved" in text for text in stability.warnings)
    assert any("gives the multipliers to" in text for text in stability.warnings)


@pytest.mark.parametrize("order", [2, 5, 18, 0])
def test_invalid_orders_are_refused(order):
    with pytest.raises(
        ValueOutOfBoundsError, match=rf"order of gauss is {order}; allowed: 4, 6, .*16; try order 10"
    ):
        Gauss(order)
