"""Periodic solutions at many speeds on one grid, compared with single solutions."""

import numpy as np
import pytest

import solve
from solve.errors import MatricesError, StepsError, ValueOutOfBoundsError

SPEEDS = np.array([20.0, 40.0, 62.8])


def test_solutions_on_one_grid_match_single_solutions():
    model = solve.load("coupler")
    curves = solve.PeriodicCurves(model, solve.Radau(9), steps=128)
    solved = curves(SPEEDS)
    assert solved.q.shape == solved.coarse.shape == (3, model.n, 512)
    for number, speed in enumerate(SPEEDS):
        orbit = solve.periodic(model, float(speed), rtol=1e-10)
        expected = orbit.at(curves.phase)
        size = np.abs(expected).max(axis=1, keepdims=True)
        error = np.abs(solved.q[number] - expected) / size
        assert error.max() < 1e-7
        assert error.max() <= max((np.abs(solved.coarse[number] - expected) / size).max(), 1e-9)
        assert solved.radius_bound[number] >= orbit.spectral_radius * (1 - 1e-6)


def test_speeds_may_be_text():
    curves = solve.PeriodicCurves(solve.load("coupler"), steps=64)
    expected = curves(np.array([20.0, 40.0])).q
    for speeds in ([20.0, "40 rad/s"], "20:40:2 rad/s"):
        np.testing.assert_array_equal(curves(speeds).q, expected)
    with pytest.raises(ValueOutOfBoundsError, match="speed"):
        curves([-1.0])


def test_odd_step_counts_and_jumps_are_refused():
    with pytest.raises(StepsError, match="even"):
        solve.PeriodicCurves(solve.load("coupler"), steps=95)

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, one, one, one[:, 0]

    with pytest.raises(MatricesError, match="jump"):
        solve.PeriodicCurves(solve.PeriodicSystem(matrices, ["q"], breaks=(1.0,)))
