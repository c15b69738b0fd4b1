"""All contenders reach the required accuracy; with --benchmark-only, their times are measured."""

import pytest

from tests.benchmarks.frequencies import ACCURACY, CONTENDERS, error


@pytest.mark.parametrize("contender", CONTENDERS, ids=lambda contender: contender.name)
def test_contenders_reach_the_accuracy(contender):
    assert error(contender.run()) <= ACCURACY


@pytest.mark.parametrize("contender", CONTENDERS, ids=lambda contender: contender.name)
def test_times_are_measured(benchmark, contender):
    benchmark.pedantic(contender.run, rounds=5, warmup_rounds=1)
