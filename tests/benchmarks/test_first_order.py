"""Both systems of the benchmark have the same multipliers and orbit."""

import numpy as np
import pytest

import solve
from tests.benchmarks.first_order import SPEED, pair


def test_both_systems_have_the_same_solution():
    second, first = (solve.periodic(one, SPEED) for one in pair(2))
    assert np.abs(first.multipliers - second.multipliers).max() < 1e-9
    assert first.statistics("q1").max_abs == pytest.approx(second.statistics("q1").max_abs, rel=1e-7)
