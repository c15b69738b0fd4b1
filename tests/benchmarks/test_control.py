"""Regulators reach the accuracy of the benchmark; with --benchmark-only, design times are measured."""

import pytest

from tests.benchmarks.control import ACCURACY, SPEEDS, contenders, error


@pytest.mark.parametrize("speed", SPEEDS[1:])
def test_regulators_reach_the_accuracy(speed):
    assert error(speed) <= ACCURACY


@pytest.mark.parametrize("contender", contenders(SPEEDS[1])[:2], ids=lambda contender: contender.name)
def test_times_are_measured(benchmark, contender):
    benchmark.pedantic(contender.run, rounds=5, warmup_rounds=1)
