"""Every contender reaches its accuracy; with --benchmark-only, how long each takes."""

import pytest

from tests.benchmarks.frequencies import ACCURACY, CONTENDERS, error


@pytest.mark.parametrize("contender", CONTENDERS, ids=lambda contender: contender.name)
def test_accuracy(contender):
    assert error(contender.run()) <= ACCURACY


@pytest.mark.parametrize("contender", CONTENDERS, ids=lambda contender: contender.name)
def test_time(benchmark, contender):
    benchmark.pedantic(contender.run, rounds=5, warmup_rounds=1)
