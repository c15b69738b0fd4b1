"""Both systems of the benchmark have the same multipliers and orbit."""

import numpy as np
import pytest

import solve
from tests.benchmarks.first_order import SPEED, pair


def test_systems_with_and_without_states_are_the_same():
    second, first = (solve.periodic(one, SPEED) for one in pair(2))
    assert np.abs(first.multipliers - second.multipliers).max() < 1e-9
    assert first.statistics("q1").max_abs == pytest.approx(second.statistics("q1").max_abs, rel=1e-7)
