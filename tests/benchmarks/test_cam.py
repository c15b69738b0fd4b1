"""Every contender reaches its accuracy; with --benchmark-only, how long each takes."""

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
def test_accuracy(contender):
    holds(contender)


@pytest.mark.slow
@pytest.mark.parametrize("contender", SLOW, ids=lambda contender: contender.name)
def test_accuracy_of_slow_ones(contender):
    holds(contender)


def test_the_reference_is_converged():
    assert max(reference().error_estimate) < 1e-10
    assert reference().spectral_radius == pytest.approx(SPECTRAL_RADIUS, rel=1e-9)


@pytest.mark.parametrize("contender", QUICK, ids=lambda contender: contender.name)
def test_time(benchmark, contender):
    benchmark.pedantic(contender.run, rounds=contender.repeats, warmup_rounds=1)
