"""Probabilities of events for normal variables: coverage of the intervals, rare events, weights."""

import numpy as np
import pytest
from scipy.stats import chi2, norm

from solve.studies.probability import SEARCH_SPREAD, Mixture, centres_of
from solve.studies.sobol_indices import sobol_indices

DIRECTION = np.array([0.6, 0.48, -0.64])


def half_space(distance):
    return lambda z: z @ DIRECTION - distance


def both_sides(distance):
    return lambda z: np.abs(z @ DIRECTION) - distance


def outside_a_ball(distance):
    square = chi2.isf(norm.sf(distance), 3)
    return lambda z: (z**2).sum(axis=-1) - square


def gradient_of(margin):
    """Return the margin at a point and its derivatives by differences."""
    steps = 1e-6 * np.eye(3)
    return lambda z: (float(margin(z[None])[0]), (margin(z + steps) - margin(z - steps)) / 2e-6)


def estimated(margin, samples, seed):
    rng = np.random.default_rng(seed)
    wide = SEARCH_SPREAD * rng.standard_normal((samples // 8, 3))
    centres = centres_of(gradient_of(margin), wide[margin(wide) > 0])
    mixture = Mixture.about(centres, 3, samples - len(wide))
    z, none = mixture.samples(rng), np.zeros(samples - len(wide), dtype=bool)
    return mixture.probability(mixture.weights(z), margin(z) > 0, none, none)


@pytest.mark.parametrize("distance", [4.264891, 2.326348, 0.841621], ids=["1e-5", "1e-2", "0.2"])
@pytest.mark.parametrize(
    ("event", "sides"),
    [
        (half_space, 1),
        pytest.param(both_sides, 2, marks=pytest.mark.slow),
        pytest.param(outside_a_ball, 1, marks=pytest.mark.slow),
    ],
)
def test_intervals_cover_the_truth_in_92_to_98_percent(event, sides, distance):
    truth = sides * norm.sf(distance)
    found = [estimated(event(distance), 2048, seed) for seed in range(300)]
    covered = np.mean([each.low <= truth <= each.high for each in found])
    # Two standard deviations of 300 repetitions, 2.5 %, lie about the range.
    assert 0.92 - 0.01 <= covered <= 0.98 + 0.01
    assert np.median([(each.high - each.low) / 2 for each in found]) < 0.3 * truth


@pytest.mark.parametrize("truth", [0.02, 0.3])
def test_plain_samples_have_the_wilson_interval(truth):
    rng, covered = np.random.default_rng(1), 0
    for _ in range(300):
        events = rng.random(500) < truth
        none = np.zeros(500, dtype=bool)
        found = Mixture.about([], 1, 500).probability(np.ones(500), events, none, none)
        p, z = events.mean(), 1.959964
        middle = (p + z**2 / 1000) / (1 + z**2 / 500)
        assert found.low + found.high == pytest.approx(2 * middle)
        covered += found.low <= truth <= found.high
    assert 0.92 <= covered / 300 <= 0.98


def test_undetermined_samples_widen_the_interval_upwards_only():
    events = np.arange(1000) < 20
    is_open = (np.arange(1000) >= 20) & (np.arange(1000) < 50)
    none, mixture = np.zeros(1000, dtype=bool), Mixture.about([], 2, 1000)
    plain = mixture.probability(np.ones(1000), events, none, none)
    found = mixture.probability(np.ones(1000), events, is_open, none)
    assert (found.value, found.low) == (plain.value, plain.low)
    assert found.high > 0.05 > plain.high
    assert (found.events, found.undetermined, found.failed) == (20, 30, 0)


def test_nearest_points_of_an_event_are_found():
    (one,) = centres_of(gradient_of(half_space(4.0)), np.zeros((0, 3)))
    np.testing.assert_allclose(one, 4.0 * DIRECTION, atol=1e-6)
    both = centres_of(gradient_of(both_sides(3.0)), np.array([3.2 * DIRECTION, -3.5 * DIRECTION]))
    np.testing.assert_allclose(np.abs([centre @ DIRECTION for centre in both]), 3.0)
    assert np.prod([centre @ DIRECTION for centre in both]) < 0


def ishigami(cube):
    """T. Ishigami, T. Homma, ISUMA 1990, with a = 7, b = 0.1."""
    x1, x2, x3 = np.pi * (2 * cube.T - 1)
    return (np.sin(x1) + 7 * np.sin(x2) ** 2 + 0.1 * x3**4 * np.sin(x1))[:, None]


def test_sobol_indices_equal_the_closed_form_of_ishigami():
    first = 0.5 * (1 + 0.1 * np.pi**4 / 5) ** 2, 49 / 8, 0.0
    mixed = 8 * 0.1**2 * np.pi**8 / 225
    variance = sum(first) + mixed
    ((found), *_), unknown = sobol_indices(ishigami, 3, 4096, np.random.default_rng(0))
    assert unknown == 0
    for index, part, total in zip(found, first, (first[0] + mixed, first[1], mixed), strict=True):
        assert index.first == pytest.approx(part / variance, abs=1e-2)
        assert index.total == pytest.approx(total / variance, abs=1e-2)
        assert abs(index.first - part / variance) < max(3 * index.first_error, 1e-3)


def test_points_without_a_value_are_omitted_and_counted():
    def holed(cube):
        return np.where(cube[:, :1] < 0.25, np.nan, cube[:, :1])

    ((found,), unknown) = sobol_indices(holed, 2, 1024, np.random.default_rng(0))
    assert 300 < unknown < 600
    assert found[0].first == pytest.approx(1.0, abs=0.05)
    assert found[1].total == 0.0


@pytest.mark.parametrize(("low", "high", "samples"), [(3.7, 4.6, 400), (3.5, 5.0, 200), (4.0, 6.0, 200)])
def test_upper_end_holds_for_an_event_away_from_the_centre(low, high, samples):
    """The event low < z < high lies between 0 and the only centre, at z = 7. Few samples lie in it, and most
    of them far from its nearest and most probable point."""
    mixture, truth = Mixture.about([np.array([7.0])], 1, samples), norm.sf(low) - norm.sf(high)
    none, above = np.zeros(samples, dtype=bool), 0
    for seed in range(200):
        z = mixture.samples(np.random.default_rng(seed))
        event = (z[:, 0] > low) & (z[:, 0] < high)
        above += truth <= mixture.probability(mixture.weights(z), event, none, none).high
    assert above >= 190


def test_interval_of_a_certain_event_ends_at_one():
    for samples in range(100, 1000, 50):
        mixture, none = Mixture.about([], 1, samples), np.zeros(samples, dtype=bool)
        found = mixture.probability(np.ones(samples), ~none, none, none)
        assert (found.value, found.high) == (1.0, 1.0)


def test_intervals_of_frequent_events_hold_for_any_sum_of_the_weights():
    """The mean of the weights is above 1 for about half of the seeds."""
    mixture, truth = Mixture.about([np.array([-2.5, 1.0])], 2, 400), norm.cdf(2.0)
    inside = 0
    for seed in range(100):
        z = mixture.samples(np.random.default_rng(seed))
        weights, none = mixture.weights(z), np.zeros(len(z), dtype=bool)
        found = mixture.probability(weights, z[:, 0] > -2.0, none, none)
        inside += found.low <= truth <= found.high
        certain = mixture.probability(weights, ~none, none, none)
        assert (certain.value, certain.high) == (1.0, 1.0)
        assert certain.low > 0.95
        unknown = mixture.probability(weights, none, none, ~none)
        assert (unknown.value, unknown.low, unknown.high) == (0.0, 0.0, 1.0)
    assert inside >= 90
