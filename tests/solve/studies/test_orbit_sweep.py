"""Sweeps of nonlinear orbits: agreement with single orbits, and failed points."""

from concurrent.futures import Executor

import numpy as np
import pytest

import solve
from solve.errors import ValueOutOfBoundsError
from tests.solve.newton.mechanisms import duffing, model_of

NUMBERS = {"zeta": 0.05, "k": 1.0, "alpha": 1.0, "f": 0.3}


def test_orbits_continue_those_of_their_neighbours():
    """Between the folds at 1.324 and 1.780 rad/s, two stable orbits coexist."""
    model, speeds = model_of(duffing(), **NUMBERS), np.linspace(1.2, 1.9, 15)
    up, down = (solve.sweep(model, each, rtol=1e-6, nonlinear=True) for each in (speeds, speeds[::-1]))
    rising, falling = (found.figures("q")[::step] for found, step in ((up, 1), (down, -1)))
    assert (rising[3:12] > 2 * falling[3:12]).all()
    np.testing.assert_allclose(rising[[0, -1]], falling[[0, -1]], rtol=1e-5)
    orbit = solve.nonlinear(model, 1.2, rtol=1e-6)
    assert rising[0] == pytest.approx(orbit.statistics("q").max_abs, rel=1e-5)


def test_interrupted_sweep_resumes_from_its_store(tmp_path):
    model = model_of(duffing(), **NUMBERS)
    first = solve.sweep(model, [1.0, 1.1], rtol=1e-5, nonlinear=True, store=tmp_path / "kept")
    again = solve.sweep(model, [1.0, 1.1], rtol=1e-5, nonlinear=True, store=tmp_path / "kept")
    np.testing.assert_array_equal(first.figures("q"), again.figures("q"))


def test_point_without_an_orbit_states_the_reason():
    """The linear oscillator is undamped and driven at its natural frequency. It has no orbit."""
    model = model_of(duffing(), zeta=0.0, k=1.0, alpha=0.0, f=0.3)
    found = solve.sweep(model, [0.7, 1.0], rtol=1e-5, nonlinear=True)
    assert [point.error is None for point in found.points] == [True, False]
    assert np.isnan(found.figures("q")[1])
    assert "no periodic orbit" in found.points[1].error


def test_multiple_processes_are_refused():
    with pytest.raises(ValueOutOfBoundsError, match="in one process; omit the executor"):
        solve.sweep(model_of(duffing(), **NUMBERS), [1.0], executor=Executor(), nonlinear=True)
