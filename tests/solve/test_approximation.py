"""Trigonometric interpolation with all harmonics above round-off."""

import numpy as np
import pytest

from solve.approximation import Trigonometric, interpolated

PERIOD = 3.0


def smooth(phase):
    """Return a constant plus harmonics that decrease by a factor of 2 to 3.7."""
    angle = 2 * np.pi * phase[:, None] / PERIOD
    return np.concatenate((1 / (1.25 - np.cos(angle)), 1 / (2 + np.sin(angle)), 1 + 0 * angle), axis=1)


@pytest.mark.parametrize("noise", [0.0, 1e-12])
def test_harmonics_below_roundoff_are_omitted(noise):
    """The slowest sequence, 2^-k, reaches round-off at the 53rd harmonic and 1e-12 at the 40th."""
    rng = np.random.default_rng(4)

    def function(phase):
        return smooth(phase) + noise * rng.standard_normal((len(phase), 3))

    curve = interpolated(function, PERIOD)
    assert isinstance(curve, Trigonometric)
    assert (30 if noise else 45) < len(curve._frequencies) < (50 if noise else 65)
    phase = rng.uniform(0, PERIOD, 100)
    np.testing.assert_allclose(curve(phase), smooth(phase), rtol=0, atol=max(10 * noise, 4e-14))


def test_zero_functions_have_one_harmonic():
    curve = interpolated(lambda phase: np.zeros((len(phase), 2)), PERIOD)
    np.testing.assert_array_equal(curve(np.array([0.1, 2.0])), np.zeros((2, 2)))


def test_functions_with_a_kink_are_returned_unchanged():
    def kinked(phase):
        return np.abs(np.sin(2 * np.pi * phase / PERIOD))[:, None]

    assert interpolated(kinked, PERIOD) is kinked
