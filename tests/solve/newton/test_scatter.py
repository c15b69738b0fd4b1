"""Fractions of random initial states that lead to each orbit, compared with integration by SciPy."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import solve
from solve.errors import LinearModelError, ValueOutOfBoundsError
from tests.solve.newton.mechanisms import duffing, model_of

NUMBERS = {"zeta": 0.05, "k": 1.0, "alpha": 1.0, "f": 0.3}
SPEED = 1.4


@pytest.fixture(scope="module")
def scattered():
    return solve.scatter(model_of(duffing(), **NUMBERS), SPEED, 16, seed=3, spread=8.0)


def test_each_initial_state_leads_to_the_orbit_of_the_reference(scattered):
    def rate(t, y):
        q, v = y.reshape(2, -1)
        return np.concatenate((v, 0.3 * np.cos(SPEED * t) - 0.1 * v - q - q**3))

    period = 2 * np.pi / SPEED
    last = np.linspace(99, 100, 40) * period
    run = solve_ivp(
        rate, (0, last[-1]), scattered.starts.T.ravel(), "DOP853", t_eval=last, rtol=1e-8, atol=1e-8
    )
    reached = np.abs(run.y[: len(scattered.starts)]).max(axis=1)
    peaks = np.array([orbit.statistics("q").max_abs for orbit in scattered.orbits])
    assert len(peaks) == 2
    np.testing.assert_allclose(peaks[scattered.leads], reached, rtol=0.02)


def test_fractions_sum_to_one_in_descending_order(scattered):
    assert scattered.shares.sum() == pytest.approx(1.0)
    assert scattered.shares[0] >= scattered.shares[1] > 0
    assert [orbit.verdict for orbit in scattered.orbits] == ["asymptotically stable"] * 2


def test_same_seed_yields_the_same_initial_states(scattered):
    again = solve.scatter(model_of(duffing(), **NUMBERS), SPEED, 2, seed=3, spread=8.0)
    np.testing.assert_array_equal(again.starts, scattered.starts[:2])


def test_invalid_input_is_refused():
    model = model_of(duffing(), **NUMBERS)
    for given, words in (
        ({"count": 0}, "count is 0"),
        ({"seed": -1}, "seed is -1"),
        ({"spread": 0.0}, "spread"),
    ):
        with pytest.raises(ValueOutOfBoundsError, match=words):
            solve.scatter(model, SPEED, **given)
    with pytest.raises(LinearModelError, match="linear by construction"):
        solve.scatter(solve.load("four_bar"), 30.0, 2)
