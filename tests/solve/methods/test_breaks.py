"""Jumps of the matrices: Meissner's equation against products of matrix exponentials."""

import numpy as np
import pytest
from scipy.linalg import expm

from solve import Newmark, Radau, RungeKutta4, periodic
from solve.errors import MatricesError
from solve.methods.gauss import Gauss
from solve.methods.hsu import Hsu
from tests.solve.systems import meissner, system
from tests.solve.witnesses import multiplier_error, slope

DELTA, EPSILON, ZETA, LOAD = 1.3, 0.7, 0.05, -0.4
JUMP, TURN = 0.8 * np.pi, 2 * np.pi
ORDERS = [
    (Newmark(0.5, 0.25), (800, 1200, 1600)),
    (Newmark(0.5, 0.0), (800, 1200, 1600)),
    (RungeKutta4(), (50, 75, 100)),
    (Radau(3), (50, 75, 100)),
    (Radau(5), (20, 30, 40)),
    (Radau(7), (10, 15, 20)),
    (Gauss(4), (50, 75, 100)),
    (Gauss(6), (20, 30, 40)),
]


def exponent(stiffness, load):
    """The generator of (q, q′, 1)."""
    return np.array([[0.0, 1.0, 0.0], [-stiffness, -2 * ZETA, load], [0.0, 0.0, 0.0]])


FIRST, SECOND = exponent(DELTA + EPSILON, 1.0), exponent(DELTA - EPSILON, LOAD)
PERIOD = expm(SECOND * (TURN - JUMP)) @ expm(FIRST * JUMP)
START = np.linalg.solve(np.eye(2) - PERIOD[:2, :2], PERIOD[:2, 2])


def states(phase):
    """(q, q′) of the periodic solution at phases in one turn: (2, k)."""
    at_jump = expm(FIRST * JUMP) @ [*START, 1.0]
    columns = [
        expm(FIRST * p) @ [*START, 1.0] if p < JUMP else expm(SECOND * (p - JUMP)) @ at_jump for p in phase
    ]
    return np.array(columns).T[:2]


PHASES = np.linspace(0.0, TURN, 401)[:-1]
TRUTH = states(PHASES)
EQUATION = meissner(DELTA, EPSILON, ZETA, LOAD)


@pytest.mark.parametrize(("rule", "steps"), ORDERS, ids=[repr(rule) for rule, _ in ORDERS])
def test_order_is_kept(rule, steps):
    orbits = [periodic(EQUATION, 1.0, rule, steps=m, rtol=0.5) for m in steps]
    multipliers = [multiplier_error(orbit.multipliers, np.linalg.eigvals(PERIOD[:2, :2])) for orbit in orbits]
    assert slope(steps, multipliers) == pytest.approx(rule.order, abs=0.15)
    curves = [np.linalg.norm(orbit.at(PHASES) - TRUTH[0]) for orbit in orbits]
    assert slope(steps, curves) == pytest.approx(rule.curve_order, abs=0.15)


@pytest.mark.parametrize("method", ["auto", "radau", "gauss", "hsu"])
def test_closed_form_to_rounding(method):
    orbit = periodic(EQUATION, 1.0, method, rtol=1e-12)
    assert multiplier_error(orbit.multipliers, np.linalg.eigvals(PERIOD[:2, :2])) < 1e-12
    np.testing.assert_allclose(orbit.at(PHASES)[0], TRUTH[0], rtol=0, atol=1e-12 * np.abs(TRUTH[0]).max())
    np.testing.assert_allclose(orbit.state(PHASES)[1][0], TRUTH[1], rtol=0, atol=1e-10)


def test_piecewise_constant_steps_are_exact_on_two_steps():
    orbit = periodic(EQUATION, 1.0, Hsu(), steps=2, rtol=0.5)
    assert multiplier_error(orbit.multipliers, np.linalg.eigvals(PERIOD[:2, :2])) < 1e-13
    np.testing.assert_allclose(orbit.q[0], [*states(orbit.phase[:-1])[0], START[0]], rtol=1e-13)


def test_jumps_are_nodes_and_the_acceleration_behind_them_is_that_of_the_next_piece():
    orbit = periodic(EQUATION, 1.0, "radau", steps=50)
    at = np.flatnonzero(np.isclose(orbit.phase, JUMP, atol=1e-12))
    assert len(at) == 1
    q, v = states([JUMP])[:, 0]
    assert orbit.qdd[0, at[0]] == pytest.approx(LOAD - 2 * ZETA * v - (DELTA - EPSILON) * q, abs=1e-9)


def pulse(phase, speed):
    """Stiffness and load raised between 0.3 and 0.7 of the turn: no jump at phase 0."""
    inside = (np.mod(phase, TURN) > 0.3 * TURN) & (np.mod(phase, TURN) < 0.7 * TURN)
    one = np.ones((len(phase), 1, 1))
    return one, 0.1 * one, np.where(inside, 2.0, 0.5)[:, None, None], np.where(inside, 1.0, 0.0)[:, None]


@pytest.mark.parametrize("rule", ["radau", "gauss", "newmark", "rk4"])
def test_jumps_inside_the_turn_alone(rule):
    steps = None if rule in {"radau", "gauss"} else 4000
    orbit = periodic(system(pulse, 1, breaks=(0.3 * TURN, 0.7 * TURN)), 1.0, rule, steps=steps)
    low, high = (np.array([[0.0, 1.0, 0.0], [-k, -0.1, k == 2.0], [0.0, 0.0, 0.0]]) for k in (0.5, 2.0))
    period = expm(low * 0.3 * TURN) @ expm(high * 0.4 * TURN) @ expm(low * 0.3 * TURN)
    start = np.linalg.solve(np.eye(2) - period[:2, :2], period[:2, 2])
    assert orbit.q[0, 0] == pytest.approx(start[0], rel=max(1e-11, 3 * orbit.error_estimate.orbit))
    assert multiplier_error(orbit.multipliers, np.linalg.eigvals(period[:2, :2])) < max(
        1e-11, 3 * orbit.error_estimate.multipliers
    )


def sawtooth(phase, speed):
    one = np.ones((len(phase), 1, 1))
    return one, 0.1 * one, (1.0 + 0.1 * phase)[:, None, None], one[:, 0]


def test_a_jump_where_the_turn_closes_is_refused_unless_it_is_a_break():
    with pytest.raises(
        MatricesError, match=r"K is not periodic: .* changes by 0.628; .* jump at 0 as a break"
    ):
        periodic(system(sawtooth, 1), 1.0)
    assert periodic(system(sawtooth, 1, breaks=(0.0,)), 1.0).error_estimate.orbit < 1e-8
