"""The steady states of the four-bar from this package and from SciPy agree."""

import numpy as np
import pytest

import solve
from tests.benchmarks.four_bar import RTOL, SPEEDS, STRESS, Marching, map_of_stress, model, start_of


def test_periodic_state_repeats_after_a_period_of_radau():
    orbit = solve.periodic(model(1), 30.0, rtol=RTOL)
    start = start_of(orbit)
    after = Marching(orbit.system, 30.0, RTOL).turn(start)
    scale = np.abs(start).reshape(2, -1).max(axis=1).repeat(orbit.system.n)
    assert (np.abs(after - start) / scale).max() < 1e-3


@pytest.mark.slow
def test_stress_map_reaches_its_accuracy():
    computed = map_of_stress(2)
    for speed, stress in zip(SPEEDS, computed.figures(STRESS), strict=False):
        reference = solve.periodic(model(3), float(speed), rtol=1e-8).statistics(STRESS).max_abs
        assert stress == pytest.approx(reference, rel=10 * RTOL)
