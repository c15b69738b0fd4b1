"""Breaks of the matrices for all methods: positions on the grid, and required breaks."""

import numpy as np
import pytest

from solve import periodic
from solve.errors import MatricesError
from solve.methods.hsu import Hsu
from tests.solve.methods.meissner import (
    DELTA,
    EPSILON,
    EQUATION,
    JUMP,
    LOAD,
    MULTIPLIERS,
    START,
    ZETA,
    states,
)
from tests.solve.references import multiplier_error
from tests.solve.systems import system


def test_piecewise_constant_steps_are_exact_on_two_steps():
    orbit = periodic(EQUATION, 1.0, Hsu(), steps=2, rtol=0.5)
    assert multiplier_error(orbit.multipliers, MULTIPLIERS) < 1e-13
    np.testing.assert_allclose(orbit.q[0], [*states(orbit.phase[:-1])[0], START[0]], rtol=1e-13)


def test_jump_is_a_node_with_the_acceleration_after_it():
    orbit = periodic(EQUATION, 1.0, "radau", steps=50)
    at = np.flatnonzero(np.isclose(orbit.phase, JUMP, atol=1e-12))
    assert len(at) == 1
    q, v = states([JUMP])[:, 0]
    assert orbit.qdd[0, at[0]] == pytest.approx(LOAD - 2 * ZETA * v - (DELTA - EPSILON) * q, abs=1e-9)


def sawtooth(phase, speed):
    one = np.ones((len(phase), 1, 1))
    return one, 0.1 * one, (1.0 + 0.1 * phase)[:, None, None], one[:, 0]


def test_jump_at_phase_zero_must_be_declared_as_a_break():
    with pytest.raises(
        MatricesError, match=r"K is not periodic: .* changes by 0.628; .* jump at 0 as a break"
    ):
        periodic(system(sawtooth, 1), 1.0)
    assert periodic(system(sawtooth, 1, breaks=(0.0,)), 1.0).error_estimate.orbit < 1e-8
