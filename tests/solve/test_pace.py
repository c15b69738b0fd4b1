"""Estimates from two grids of any ratio, held against errors that follow a known power of the steps."""

import numpy as np
import pytest

from solve.certify.estimates import not_followed
from solve.certify.pace import (
    FARTHEST,
    Pace,
    estimated,
    fallen,
    finished,
    onward,
    rung,
    rungs_above,
    sure_powers,
    times_more,
)
from solve.methods.fourier import Fourier
from solve.methods.gauss import Gauss
from solve.methods.method import Solutions
from solve.methods.newmark import Newmark
from solve.methods.radau import Radau
from solve.period.curve import Curve
from solve.period.grid import Grid


def pace_of(coarsest, coarse, fine):
    return Pace(fine, fine / coarse, coarse / coarsest)


def test_rungs_are_twos_and_threes():
    rungs = [rung(1)]
    while rungs[-1] < 1000:
        rungs.append(rung(rungs[-1] + 1))
    assert rungs == [8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768, 1024]
    assert [rung(steps) for steps in rungs] == rungs
    every = np.arange(1, 1025)
    assert rungs_above(every).tolist() == [rung(steps) for steps in every.tolist()]


@pytest.mark.parametrize("power", [1.0, 2.0, 4.0, 9.0])
@pytest.mark.parametrize("steps", [(16, 24, 32), (16, 24, 48), (16, 32, 64), (24, 32, 48)])
def test_estimates_follow_the_power_of_the_steps(power, steps):
    errors = np.array([float(m) ** -power for m in steps])
    pace = pace_of(*steps)
    found, before = -np.diff(errors)[::-1, None] * np.ones(2)
    estimate = estimated(found, before, pace, np.array([10.0, 10.0]))
    np.testing.assert_array_less(errors[2] / 2, estimate)
    np.testing.assert_array_less(estimate, 3 * errors[2])
    assert not finished(found, before, estimate, estimate / 2, pace)
    assert finished(found, before, estimate, estimate, pace)


@pytest.mark.parametrize(
    ("method", "powers"),
    [(Gauss(10), [4.0, 5.0]), (Newmark(), [1.0, 1.0]), (Radau(9), [4.0, 4.5]), (Fourier(), [1.0, 1.0])],
)
def test_errors_surely_fall_with_half_the_order_or_the_first_power(method, powers):
    assert sure_powers(method).tolist() == powers


def test_two_grids_finish_where_the_errors_that_they_surely_have_are_wanted_ones():
    pace, unknown, wanted = Pace(24, 1.5), np.full(2, np.inf), np.full(2, 1e-6)
    for difference, enough in ((6e-6, True), (7e-6, False)):
        errors = fallen(np.full(2, difference), pace, sure_powers(Gauss(10))[1])
        assert finished(np.full(2, difference), unknown, errors, wanted, pace) == enough


def test_differences_that_no_longer_fall_are_rounding():
    pace, wanted = pace_of(32, 64, 128), np.full(2, 1e-13)
    noise = np.array([3e-13, 2e-13])
    assert finished(noise, noise, noise, wanted, pace)
    assert not finished(1e6 * noise * 10, 1e6 * noise * 10, noise, wanted, pace)


@pytest.mark.parametrize("power", [6.0, 8.0])
def test_the_next_grid_goes_as_far_as_errors_usually_fall(power):
    """Those of order 10 that fall with the power 6 or more are low enough after as many times the steps."""
    pace, orders, wanted = Pace(64, 64 / 48), np.array([10.0, 10.0]), np.full((1, 2), 1e-6)
    for error in 1e-6, 3e-6, 1e-5:
        found = np.full((1, 2), error * ((64 / 48) ** power - 1))
        (times,) = times_more(found, wanted, pace, orders)
        assert 1 < times < FARTHEST
        assert error * times**-power < 1e-6
    assert times_more(found * 1e6, wanted, pace, orders) == [FARTHEST]
    assert times_more(np.full((1, 2), np.nan), wanted, pace, orders) == [FARTHEST]


def test_next_grids_are_rungs_within_the_most():
    times = np.array([1.0, 1.5, 1.9, 3.0])
    assert onward(48, times, 10_000).tolist() == [64, 96, 96, 192]
    assert onward(48, times, 100).tolist() == [64, 96, 96, 96]
    assert onward(48, times, 50).tolist() == [64, 64, 64, 64]


def test_two_grids_that_meet_by_chance_are_not_believed():
    errors = np.array([24.0, 32.0, 48.0]) ** -8
    pace, order = pace_of(24, 32, 48), np.array([8.0, 8.0])
    before, chance = np.full(2, errors[0] - errors[1]), np.full(2, 1e-6 * errors[2])
    assert np.all(estimated(chance, before, pace, order) > 0.999 * errors[2])


def test_curves_that_the_first_grid_does_not_follow_pass_over_the_next():
    """16 steps: a wave a step, and an eighth of one."""
    nodes = np.linspace(0, 2 * np.pi, 17)

    def solutions(order):
        angle = order * (nodes + 0.1)
        q, v, a = np.cos(angle), -order * np.sin(angle), -(order**2) * np.cos(angle)
        parts = (part[None, :, None] for part in (q, v, a[:-1], a[1:]))
        curve = Curve.quintic(nodes, *parts)
        return Solutions(Grid.uniform(16, 2 * np.pi), np.eye(2)[None], curve, np.ones(1))

    assert not_followed(solutions(16)).tolist() == [True]
    assert not_followed(solutions(2)).tolist() == [False]
