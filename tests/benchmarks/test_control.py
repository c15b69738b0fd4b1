"""Regulators reach the accuracy of the benchmark; with --benchmark-only, how long designs take."""

import pytest

from tests.benchmarks.control import ACCURACY, SPEEDS, contenders, error


@pytest.mark.parametrize("speed", SPEEDS[1:])
def test_accuracy(speed):
    assert error(speed) <= ACCURACY


@pytest.mark.parametrize("contender", contenders(SPEEDS[1])[:2], ids=lambda contender: contender.name)
def test_time(benchmark, contender):
    benchmark.pedantic(contender.run, rounds=5, warmup_rounds=1)
