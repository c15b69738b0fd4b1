"""Closed branches, found from scattered initial states, compared with shooting."""

from math import sqrt

import numpy as np
import pytest

import solve
from solve.errors import NoOrbitError, ValueOutOfBoundsError
from tests.solve.newton.mechanisms import duffing, model_of, tuned_absorber
from tests.solve.newton.shooting import fold, located, period_map

DUFFING = {"zeta": 0.05, "k": 1.0, "alpha": 1.0, "f": 10.0}


def duffing_map(x, speed, periods):
    """Map of Duffing's oscillator, with the results of `period_map`."""

    def acceleration(phase, q, v, _):
        return DUFFING["f"] * np.cos(phase) - 2 * DUFFING["zeta"] * v - q - q**3

    def jacobian(phase, q, v, _):
        return np.array([[-1 - 3 * q[0] ** 2, -2 * DUFFING["zeta"]]])

    return period_map(acceleration, jacobian, speed, x, periods, None)


@pytest.fixture(scope="module")
def subharmonic():
    """Branches of Duffing's oscillator through the orbits of two initial states: one with a third of the
    load's frequency (A. H. Nayfeh, D. T. Mook, Nonlinear Oscillations, 4.1.3), and one with the same
    frequency."""
    model = model_of(duffing(), **DUFFING)
    scattered = solve.scatter(model, 6.0, 4, spread=12, periods=3)
    assert sorted(orbit.periods for orbit in scattered.orbits) == [1, 3]
    return solve.branch(model, (3.5, 10.5), start=scattered, rtol=1e-7)


def test_subharmonic_branch_is_closed_with_folds_from_shooting(subharmonic):
    (number,) = subharmonic.closed
    which = np.flatnonzero(subharmonic.numbers == number)
    assert subharmonic.ended == ""
    assert set(subharmonic.counts[which]) == {3}
    assert subharmonic.values[which[0]] == subharmonic.values[which[-1]] == 6.0
    np.testing.assert_array_equal(subharmonic.figures[which[0]], subharmonic.figures[which[-1]])
    last = max(subharmonic.folds, key=lambda point: point["speed"])
    at = which[int(subharmonic.values[which].argmax())]
    curve, zero = subharmonic.curve(at), np.zeros(1)
    start = np.array([curve(zero)[0, 0], last["speed"] * curve(zero, 1)[0, 0]])
    exact, _ = located(fold, lambda x, speed: duffing_map(x, speed, 3), start, last["speed"])
    assert last["speed"] == pytest.approx(exact, rel=1e-7)


def test_branch_from_inside_its_range_reaches_both_ends(subharmonic):
    (number,) = {*subharmonic.numbers} - {*subharmonic.closed}
    which = subharmonic.numbers == number
    values = subharmonic.values[which]
    assert (values[0], values[-1]) == (3.5, 10.5)
    assert (np.diff(values) > 0).all()
    orbit = solve.nonlinear(model_of(duffing(), **DUFFING), 10.5)
    assert subharmonic.peaks[which][-1, 0] == pytest.approx(orbit.statistics("q").max_abs, rel=1e-6)


def test_orbits_on_one_branch_are_followed_once():
    """Between the folds, both stable orbits of Duffing's oscillator are on one branch."""
    model = model_of(duffing(), zeta=0.05, k=1.0, alpha=1.0, f=0.3)
    scattered = solve.scatter(model, 1.4, 8, spread=8)
    assert len(scattered.orbits) == 2
    found = solve.branch(model, (0.9, 2.2), start=scattered)
    assert (set(found.numbers), found.closed, len(found.folds)) == ({0}, [], 2)


def test_initial_states_of_other_equations_are_refused():
    model = model_of(duffing(), zeta=0.2, k=1.0, alpha=1.0, f=0.3)
    scattered = solve.scatter(model, 0.5, 4)
    for other, speeds, words in (
        (model_of(duffing(), zeta=0.1, k=1.0, alpha=1.0, f=0.3), (0.4, 0.6), "other parameter values"),
        (model, (0.6, 0.9), "allowed: values between 5.72958 rpm"),
    ):
        with pytest.raises(ValueOutOfBoundsError, match=words):
            solve.branch(other, speeds, start=scattered)
    with pytest.raises(ValueOutOfBoundsError, match="omit 'begin'"):
        solve.branch(model, (0.4, 0.6), start=scattered, begin=0.5)
    object.__setattr__(scattered, "orbits", [])
    with pytest.raises(NoOrbitError, match="no motion from the scattered starting points settled"):
        solve.branch(model, (0.4, 0.6), start=scattered)


@pytest.mark.slow
def test_isolated_resonance_of_tuned_absorber_equals_shooting():
    """A published resonance of this absorber, tuned by the equal-peak method, which no sweep reaches."""
    e = 0.05
    root = sqrt(4 + 3 * e)
    k2 = 8 * e * (16 + 23 * e + 9 * e**2 + 2 * (2 + e) * root)
    k2 /= 3 * (1 + e) ** 2 * (64 + 80 * e + 27 * e**2)
    numbers = {"m1": 1.0, "m2": e, "F": 0.15, "c1": 0.002, "k1": 1.0, "k2": k2, "n1": 1.0}
    numbers |= {"c2": sqrt(k2 * e * (8 + 9 * e - 4 * root) / (4 * (1 + e))), "n2": 2 * e**2 / (1 + 4 * e)}
    model = model_of(tuned_absorber(), **numbers)
    scattered = solve.scatter(model, 1.8, 6, spread=40)
    found = solve.branch(model, (0.8, 3.0), start=scattered, rtol=1e-6)
    (number,) = found.closed
    assert found.peaks[found.numbers == number, 0].min() > 1.2
    assert found.peaks[(found.numbers != number) & (found.values > 1.5), 0].max() < 0.2
    c1, c2, n2 = numbers["c1"], numbers["c2"], numbers["n2"]

    def acceleration(phase, q, v, _):
        y, w = q[0] - q[1], v[0] - v[1]
        f = c2 * w + k2 * y + n2 * y**3
        return np.array([numbers["F"] * np.cos(phase) - c1 * v[0] - q[0] - q[0] ** 3 - f, f / e])

    def jacobian(phase, q, v, _):
        stiff = k2 + 3 * n2 * (q[0] - q[1]) ** 2
        rows = [[-1 - 3 * q[0] ** 2 - stiff, stiff, -c1 - c2, c2], [stiff / e, -stiff / e, c2 / e, -c2 / e]]
        return np.array(rows)

    last = max(
        (point for point in found.folds if point["branch"] == number), key=lambda point: point["speed"]
    )
    at = int(np.flatnonzero((found.values == last["speed"]) & found.turns)[0])
    curve, zero = found.curve(at), np.zeros(1)
    start = np.append(curve(zero)[:, 0], last["speed"] * curve(zero, 1)[:, 0])

    def mapped(x, speed):
        return period_map(acceleration, jacobian, speed, x, 1, None)

    exact, _ = located(fold, mapped, start, last["speed"])
    assert last["speed"] == pytest.approx(exact, rel=1e-6)


def test_branch_of_zero_orbits_is_not_closed():
    """All orbits are equal, and the branch is followed in both directions."""
    found = solve.branch(
        solve.load("mathieu", epsilon=0.2), 1.0, over="delta=0.5:0.7", begin=0.6, points=20, rtol=1e-3
    )
    assert found.closed == []
    assert sorted(found.values[[0, -1]]) == [0.5, 0.7]
