"""Results of tests.benchmarks.fits with fewer trials."""

import pytest
from scipy.stats import binom

from tests.benchmarks.fits import FREE, coverage, times

TRIALS = 30


@pytest.mark.slow
def test_cam_confidence_intervals_have_nominal_coverage():
    held = coverage(TRIALS, first=10_000)
    assert list(held) == list(FREE)
    # That fewer hold, in one of six parameters, is one case in a thousand at 95 %.
    assert min(held.values()) >= binom.ppf(1e-3 / len(FREE), TRIALS, 0.95)
    assert sum(held.values()) < len(FREE) * TRIALS


@pytest.mark.slow
def test_both_searches_evaluate_the_same_trials():
    exact, differences = times(["k1", "c1"])
    assert min(exact, differences) > 0
