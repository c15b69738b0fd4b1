"""All contenders reach the required accuracy; with --benchmark-only, their times are measured."""

import numpy as np
import pytest

from tests.benchmarks.cam import ACCURACY, CONTENDERS, SPECTRAL_RADIUS, error, reference

QUICK = [contender for contender in CONTENDERS if contender.repeats > 1]
SLOW = [contender for contender in CONTENDERS if contender.repeats == 1]


def holds(contender):
    result = contender.run()
    assert error(result) <= ACCURACY
    if len(result[2]):
        assert np.abs(result[2]).max() == pytest.approx(SPECTRAL_RADIUS, rel=1e-5)


@pytest.mark.parametrize("contender", QUICK, ids=lambda contender: contender.name)
def test_contenders_reach_the_accuracy(contender):
    holds(contender)


@pytest.mark.slow
@pytest.mark.parametrize("contender", SLOW, ids=lambda contender: contender.name)
def test_slow_contenders_reach_the_accuracy(contender):
    holds(contender)


def test_reference_is_converged():
    assert max(reference().error_estimate) < 1e-10
    assert reference().spectral_radius == pytest.approx(SPECTRAL_RADIUS, rel=1e-9)


@pytest.mark.parametrize("contender", QUICK, ids=lambda contender: contender.name)
def test_times_are_measured(benchmark, contender):
    benchmark.pedantic(contender.run, rounds=contender.repeats, warmup_rounds=1)
