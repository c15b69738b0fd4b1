"""Closed chains in compiled code compared with NumPy, also for growing solutions and very different units."""

import numpy as np
import pytest

from solve.kernel.chain import closed, followed
from solve.period.eigenvalues import EPS, roundoff_growth
from solve.period.period_map import Steps, periodic_states, states_from
from tests.solve.kernel.test_lanes import needs_compiler
from tests.solve.references import closed_chain
from tests.solve.systems import swelling


def same(N, m, r, growth, unit=1.0):
    """Compare the period of m random maps whose solutions grow by the factor `growth` per step. unit: unit of
    the last state."""
    rng, units = np.random.default_rng(m), np.append(np.ones(N - 1), unit)
    A = np.eye(N) + rng.standard_normal((m, N, N)) * 0.3
    A[:, 0] *= growth
    A, b = A * units[:, None] / units, rng.standard_normal((m, N, r)) * units[:, None]
    computed, (theirs, _) = closed(A, b), periodic_states(Steps(A, b))
    assert computed is not None
    ours, condition = computed
    size = np.abs(theirs).max(axis=(0, 2))
    assert (np.abs(ours - theirs).max(axis=(0, 2)) <= 1e-11 * size).all()
    apart = np.abs(A @ ours[:-1] + b - ours[1:]).max(axis=(0, 2))
    assert (apart <= 1e-12 * np.abs(A @ ours[:-1]).max(axis=(0, 2))).all()
    assert np.isfinite(condition)


@needs_compiler
@pytest.mark.parametrize(("N", "m", "r"), [(2, 1, 1), (2, 40, 3), (6, 96, 1), (6, 33, 27), (8, 768, 9)])
def test_chains_match_for_any_number_of_steps_and_loads(N, m, r):
    same(N, m, r, growth=0.7)


@needs_compiler
def test_chains_match_for_growing_solutions_and_different_units():
    same(4, 64, 2, growth=3.0)
    same(4, 64, 2, growth=0.7, unit=1e9)


@needs_compiler
@pytest.mark.parametrize("m", [96, 128])
@pytest.mark.parametrize("decades", [9, 18])
def test_solution_that_is_large_within_the_period_is_accurate(m, decades):
    steps = swelling(m, decades)
    truth = closed_chain(steps.A, steps.b)
    computed = closed(steps.A, steps.b[..., None] * [1.0, -2.0])
    assert computed is not None
    states, condition = computed
    errors = np.abs(states[:-1, :, 1] + 2 * truth).max(axis=0) / np.abs(2 * truth).max(axis=0)
    assert errors.max() < min(1e-11, 10 * condition * EPS * roundoff_growth(m))


@needs_compiler
def test_every_vector_width_gives_the_same_solution(width):
    same(4, 50, 5, growth=0.7)


@needs_compiler
def test_chain_that_cannot_close_is_detected():
    states = closed(np.broadcast_to(np.eye(2), (8, 2, 2)), np.ones((8, 2, 1)))
    assert states is None or not states[1] < 1e14


@needs_compiler
def test_states_follow_from_the_first_state():
    rng = np.random.default_rng(3)
    A, start = rng.standard_normal((20, 4, 4)) / 2, rng.standard_normal(4) + 1j * rng.standard_normal(4)
    ours, theirs = followed(A, start[:, None]), states_from(Steps(A, np.zeros((20, 4), dtype=complex)), start)
    assert ours is not None
    assert np.allclose(ours[..., 0], theirs, rtol=1e-12, atol=1e-13 * np.abs(theirs).max())
