"""Products by recursive doubling, and the cyclic system, compared with loops and one dense system."""

from functools import reduce

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from solve.period.eigenvalues import EPS, roundoff_growth
from solve.period.period_map import (
    BLOCKS,
    Steps,
    affine_period,
    monodromy,
    period,
    periodic_states,
    states_from,
)
from tests.solve.references import closed_chain
from tests.solve.systems import seeds, swelling

COUNTS = [1, 2, 3, 5, BLOCKS - 1, BLOCKS, BLOCKS + 1, 2 * BLOCKS, 2 * BLOCKS + 1, 777]


def chain(seed, m, N, *leading, size=0.9):
    rng = np.random.default_rng(seed)
    A = size * np.linalg.qr(rng.standard_normal((*leading, m, N, N)))[0]
    return Steps(A, rng.standard_normal((*leading, m, N)))


def marched(steps, start):
    states = [start]
    for A, b in zip(steps.A, steps.b, strict=True):
        states.append(A @ states[-1] + b)
    return np.array(states)


def dense(steps):
    """All states of the closed chain, from one linear system of order m N."""
    m, N = steps.b.shape
    whole = np.eye(m * N)
    for k, A in enumerate(steps.A):
        row = (k + 1) % m
        whole[row * N : (row + 1) * N, k * N : (k + 1) * N] -= A
    return np.linalg.solve(whole, np.roll(steps.b, 1, axis=0).ravel()).reshape(m, N)


@pytest.mark.parametrize("m", COUNTS)
def test_monodromy_is_the_product_last_step_leftmost(m):
    steps = chain(m, m, 4, size=1.0)
    product = reduce(lambda P, A: A @ P, steps.A)
    np.testing.assert_allclose(monodromy(steps), product, rtol=0, atol=1e-13)


@pytest.mark.parametrize("m", COUNTS)
def test_affine_period_and_states_equal_the_march(m):
    steps = chain(m, m, 3)
    start = np.array([1.0, -2.0, 0.5])
    states = marched(steps, start)
    period = affine_period(steps)
    np.testing.assert_allclose(period.A[0] @ start + period.b[0], states[-1], rtol=0, atol=1e-13)
    np.testing.assert_allclose(states_from(steps, start), states, rtol=0, atol=1e-13)


@pytest.mark.parametrize("m", [m for m in COUNTS if m < 100])
@pytest.mark.parametrize("N", [1, 2, 6])
def test_periodic_states_solve_the_closed_chain(m, N):
    steps = chain(m + N, m, N)
    states, condition = periodic_states(steps)
    truth = dense(steps)
    assert states.shape == (m + 1, N)
    assert np.array_equal(states[0], states[-1])
    np.testing.assert_allclose(states[:-1], truth, rtol=0, atol=1e-12 * np.abs(truth).max())
    # It is that of the least state, on which others act.
    sizes = np.abs(truth).max(axis=0)
    assert 0.5 <= condition < 100 * sizes.max() / sizes.min()


@given(seeds, st.integers(33, 300), st.floats(0.0, 14.0))
@settings(max_examples=40, deadline=None)
def test_growing_and_decaying_solutions_are_accurate(seed, m, decades):
    """One solution grows by `decades` powers of ten over the period, and another one decays by as much.
    Single shooting, chapter Eqs. (21) and (40), would lose the periodic solution."""
    rng = np.random.default_rng(seed)
    factor = 10.0 ** (decades / m)
    Q = np.linalg.qr(rng.standard_normal((m, 2, 2)))[0]
    A = np.roll(Q, -1, axis=0) @ np.diag([1.5 * factor, 0.5 / factor]) @ np.swapaxes(Q, 1, 2)
    steps = Steps(A, rng.standard_normal((m, 2)))
    truth = dense(steps)
    states, _ = periodic_states(steps)
    np.testing.assert_allclose(states[:-1], truth, rtol=0, atol=1e-11 * np.abs(truth).max())


@pytest.mark.parametrize("m", [96, 128, 777])
@pytest.mark.parametrize("decades", [4, 9, 13, 18])
def test_solution_that_is_large_within_the_period_is_accurate(m, decades):
    """Elimination alone would cause errors of the order of the round-off of the largest state, which grow
    from where states are small."""
    steps = swelling(m, decades)
    truth = closed_chain(steps.A, steps.b)
    assert np.abs(truth).max() > 10.0 ** (decades - 2) * np.abs(truth).max(axis=1).min()
    states, condition = periodic_states(steps)
    errors = np.abs(states[:-1] - truth).max(axis=0) / np.abs(truth).max(axis=0)
    assert errors.max() < 1e-11
    assert errors.max() < 10 * condition * EPS * roundoff_growth(m)
    columns, _ = periodic_states(Steps(steps.A, np.stack((steps.b, -2 * steps.b), axis=-1)))
    np.testing.assert_allclose(columns[:-1, :, 1], -2 * truth, rtol=0, atol=1e-11 * np.abs(truth).max())


@pytest.mark.parametrize("m", [1, 7, 100])
def test_multiplier_at_one_gives_an_infinite_condition(m):
    rotation = np.array([[0.0, -1.0], [1.0, 0.0]])
    A = np.array([rotation] * m)
    A[-1] = np.linalg.matrix_power(rotation.T, m - 1)
    states, condition = periodic_states(Steps(A, np.ones((m, 2))))
    assert np.isnan(states).all()
    assert condition == np.inf


@pytest.mark.parametrize("distance", [1e-3, 1e-6, 1e-9])
def test_condition_grows_as_a_multiplier_nears_one(distance):
    A = np.array([np.diag([1.0, 0.5])] * 40)
    A[-1, 0, 0] = 1.0 - distance
    _, condition = periodic_states(Steps(A, np.ones((40, 2))))
    assert 0.1 / distance < condition < 100 / distance


@pytest.mark.parametrize("m", [1, 33, 65])
def test_points_of_a_sweep_are_solved_as_each_alone(m):
    batch = chain(5, m, 3, 2, 4)
    states, condition = periodic_states(batch)
    products, ends = monodromy(batch), affine_period(batch).b
    for point in np.ndindex(2, 4):
        alone = Steps(batch.A[point], batch.b[point])
        truth, its_condition = periodic_states(alone)
        np.testing.assert_allclose(states[point], truth, rtol=0, atol=1e-13 * np.abs(truth).max())
        np.testing.assert_allclose(products[point], monodromy(alone), rtol=0, atol=1e-14)
        np.testing.assert_allclose(ends[point], affine_period(alone).b, rtol=0, atol=1e-13)
        assert condition[point] == pytest.approx(its_condition, rel=1e-10)


def test_zero_step_matrices_give_the_forced_state():
    states, condition = periodic_states(Steps(np.zeros((40, 2, 2)), np.ones((40, 2))))
    np.testing.assert_array_equal(states, np.ones((41, 2)))
    assert np.isfinite(condition)


@given(seeds, st.integers(33, 200), st.floats(-12.0, 12.0))
@settings(max_examples=40, deadline=None)
def test_accuracy_does_not_depend_on_units_of_the_states(seed, m, decades):
    """The unit of the second state is 10^decades times as large. Each state is as accurate as before."""
    steps = chain(seed, m, 2)
    units = np.array([1.0, 10.0**decades])
    plain, condition = periodic_states(steps)
    scaled, scaled_condition = periodic_states(Steps(steps.A * units / units[:, None], steps.b / units))
    np.testing.assert_allclose(scaled * units, plain, rtol=0, atol=1e-12 * np.abs(plain).max())
    assert scaled_condition < 10 * condition


@pytest.mark.parametrize("m", COUNTS)
def test_period_returns_product_and_periodic_states(m):
    steps = chain(m, m, 4, 3)
    Phi, states, condition = period(steps)
    np.testing.assert_array_equal(Phi, monodromy(steps))
    np.testing.assert_array_equal(states, periodic_states(steps)[0])
    np.testing.assert_array_equal(condition, periodic_states(steps)[1])


def test_overflow_at_one_point_does_not_change_others():
    steps = chain(1, 70, 2, 3)
    huge = Steps(steps.A.copy(), steps.b)
    huge.A[1] *= 1e10
    with np.errstate(all="ignore"):
        Phi, states, _ = period(huge)
    assert not np.isfinite(Phi[1]).all()
    np.testing.assert_array_equal(states[[0, 2]], period(steps)[1][[0, 2]])


@pytest.mark.parametrize("N", [4, 90])
def test_growth_by_many_powers_of_ten_costs_one_digit(N):
    """One state grows by 1e12 over the period, and others decay, in randomly rotating axes."""
    m, rng = 256, np.random.default_rng(N)
    axes = np.linalg.qr(rng.standard_normal((m, N, N)))[0]
    rates = np.exp(np.linspace(12 * np.log(10), -30, N) / m)
    A = np.roll(axes, -1, axis=0) * rates @ axes.swapaxes(1, 2)
    truth = rng.standard_normal((m, N))
    b = np.roll(truth, -1, axis=0) - np.einsum("kij,kj->ki", A, truth)
    states, _ = periodic_states(Steps(A, b))
    np.testing.assert_allclose(states[:-1], truth, rtol=0, atol=5e-12)
