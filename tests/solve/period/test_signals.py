"""Extrema, means and harmonics, compared with closed forms."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from solve.errors import ValueOutOfBoundsError
from solve.period.signals import harmonics, signal_statistics

amplitudes = st.floats(0.1, 10.0)
angles = st.floats(-3.0, 3.0)
orders = st.integers(1, 40)
periods = st.floats(0.5, 10.0)


@given(st.floats(-5.0, 5.0), amplitudes, angles, orders, periods)
def test_statistics_of_a_cosine(mean, amplitude, angle, order, period):
    omega = 2 * np.pi * order / period
    computed = signal_statistics(lambda phase: mean + amplitude * np.cos(omega * phase + angle), period)
    size = abs(mean) + amplitude
    assert computed.max == pytest.approx(mean + amplitude, abs=1e-13 * size)
    assert computed.min == pytest.approx(mean - amplitude, abs=1e-13 * size)
    assert computed.max_abs == pytest.approx(size, rel=1e-13)
    assert computed.mean == pytest.approx(mean, abs=1e-13 * size)
    for phase, extreme in ((computed.max_phase, 1.0), (computed.min_phase, -1.0)):
        assert 0.0 <= phase < period
        assert np.cos(omega * phase + angle) == pytest.approx(extreme, abs=1e-12)


@given(st.lists(st.tuples(amplitudes, angles), min_size=1, max_size=12), st.floats(-5.0, 5.0), periods)
def test_harmonics_of_a_sum_of_cosines(parts, mean, period):
    phases = 2 * np.pi / period

    def signal(phase):
        return mean + sum(
            a * np.cos(k * phases * phase + angle) for k, (a, angle) in enumerate(parts, start=1)
        )

    computed, turned = harmonics(signal, period, 15)
    assert computed.shape == turned.shape == (16,)
    assert computed[0] == pytest.approx(mean, abs=1e-12)
    assert turned[0] == 0.0
    np.testing.assert_allclose(computed[1 : len(parts) + 1], [a for a, _ in parts], rtol=0, atol=1e-12)
    np.testing.assert_allclose(turned[1 : len(parts) + 1], [angle for _, angle in parts], rtol=0, atol=1e-10)
    np.testing.assert_allclose(computed[len(parts) + 1 :], 0.0, rtol=0, atol=1e-12)


def test_negative_mean_retains_its_sign():
    assert harmonics(lambda phase: np.full_like(phase, -3.0), 1.0, 4)[0].tolist() == [
        -3.0,
        0.0,
        0.0,
        0.0,
        0.0,
    ]


@given(st.integers(0, 3000))
def test_number_of_harmonics_may_exceed_that_of_the_samples(count):
    computed, _ = harmonics(lambda phase: np.cos(7 * phase), 2 * np.pi, count)
    assert len(computed) == count + 1
    if count >= 7:
        assert computed[7] == pytest.approx(1.0, abs=1e-12)
    assert computed.sum() == pytest.approx(float(count >= 7), abs=1e-9)


@pytest.mark.parametrize("count", [-1, 2.5, "60", None])
def test_invalid_harmonic_counts_are_refused(count):
    with pytest.raises(ValueOutOfBoundsError, match=r"harmonics is .*; allowed: whole numbers of at least 0"):
        harmonics(np.cos, 2 * np.pi, count)


def test_extremum_between_samples_matches_the_curve():
    """The resonant peak 1/(1 + (φ - φ0)²/w²) is narrower than four samples and lies between grid points."""
    centre, width = 1.2345678, 4e-3

    def peak(phase):
        distance = np.mod(phase - centre + np.pi, 2 * np.pi) - np.pi
        return 1.0 / (1.0 + (distance / width) ** 2)

    computed = signal_statistics(peak, 2 * np.pi, samples=2048)
    assert computed.max == pytest.approx(1.0, abs=1e-12)
    assert computed.max_phase == pytest.approx(centre, abs=1e-8)


def test_extremum_at_the_end_of_the_period():
    computed = signal_statistics(lambda phase: np.cos(phase + 1e-4), 2 * np.pi)
    assert computed.max == pytest.approx(1.0, abs=1e-14)
    assert computed.max_phase == pytest.approx(2 * np.pi - 1e-4, abs=1e-7)


def test_statistics_of_a_constant():
    computed = signal_statistics(lambda phase: np.full_like(phase, -2.0), 1.0)
    assert (computed.max, computed.min, computed.max_abs, computed.mean) == (-2.0, -2.0, 2.0, -2.0)
