"""Newmark's map of order 2n compared with a separate implementation of the chapter's map of order 3n, Eqs.
(28)–(40)."""

from functools import reduce

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from solve import Newmark, floquet, periodic
from solve.errors import StepsError, ValueOutOfBoundsError
from solve.period.grid import Grid
from solve.period.period_map import monodromy
from tests.solve.systems import cam, chain_of, constant, frozen_modes, random_system, seeds


def printed_maps(system, speed, steps, gamma, beta):
    """Maps A_i (3n, 3n) and b_i of x_i = A_i x_{i-1} + b_i, Eqs. (29)–(38), where x = (q, q′, q″) with
    derivatives with respect to the phase."""
    n, h = system.n, system.period / steps
    one, zero = np.eye(n), np.zeros((n, n))
    D = np.block([[one, h * one, h**2 * (0.5 - beta) * one], [zero, one, (1 - gamma) * h * one]])
    T = np.block([[one, zero, beta * h**2 * one], [zero, one, gamma * h * one], [zero, zero, one]])
    A, b = [], []
    for M, C, K, d in zip(*system.at(np.arange(1, steps + 1) * h, speed), strict=True):
        M, C = speed**2 * M, speed * C
        S, H = M + gamma * h * C + beta * h**2 * K, np.hstack((K, C))
        A.append(T @ np.vstack((D, -np.linalg.solve(S, H @ D))))
        b.append(T @ np.concatenate((np.zeros(2 * n), np.linalg.solve(S, d))))
    return A, b


def shooting(A, b):
    """States (m, 3n) at the nodes from Eqs. (39) and (40), with the product in the sequence A_m … A_1."""
    product = reduce(lambda P, step: step @ P, A)
    end = reduce(lambda x, step: step[0] @ x + step[1], zip(A, b, strict=True), np.zeros(len(product)))
    x = [np.linalg.solve(np.eye(len(product)) - product, end)]
    for step, load in zip(A[:-1], b[:-1], strict=True):
        x.append(step @ x[-1] + load)
    return np.array(x), product


parameters = st.tuples(st.floats(0.25, 1.0), st.floats(0.0, 0.5))


@given(seeds, st.integers(1, 4), st.floats(0.7, 3.0), st.integers(40, 120), parameters)
@settings(max_examples=60, deadline=None)
def test_map_of_order_2n_equals_the_map_of_order_3n(seed, n, speed, steps, parameters):
    gamma, beta = parameters
    system, rule = random_system(seed, n), Newmark(gamma, beta)
    A, b = printed_maps(system, speed, steps, gamma, beta)
    x, product = shooting(A, b)

    orbit = periodic(system, speed, rule, steps=steps, rtol=0.5)
    q, v, a = (part.T for part in np.split(x, 3, axis=1))
    for ours, theirs in ((orbit.q, q), (orbit.qd, speed * v), (orbit.qdd, speed**2 * a)):
        np.testing.assert_allclose(ours[:, :-1], theirs, rtol=0, atol=1e-12 * np.abs(theirs).max())

    core = np.poly(monodromy(chain_of(rule, system, speed, Grid.uniform(steps, system.period))))
    scale = np.abs(np.linalg.eigvals(product)).max() ** np.arange(3 * n + 1)
    np.testing.assert_allclose(
        np.poly(product) / scale, np.concatenate((core, np.zeros(n))) / scale, rtol=0, atol=1e-11
    )


@given(seeds, st.integers(1, 4), parameters)
@settings(max_examples=30, deadline=None)
def test_newmark_step_is_equivalent_to_the_printed_step(seed, n, parameters):
    """D A_1 = B D: z = D x determines the step, and A_1 has n additional eigenvalues, all zero."""
    gamma, beta = parameters
    system = random_system(seed, n)
    h = system.period / 40
    one, zero = np.eye(n), np.zeros((n, n))
    D = np.block([[one, h * one, h**2 * (0.5 - beta) * one], [zero, one, (1 - gamma) * h * one]])
    A = printed_maps(system, 1.0, 40, gamma, beta)[0][0]
    B = chain_of(Newmark(gamma, beta), system, 1.0, Grid.uniform(40, system.period)).A[0]
    np.testing.assert_allclose(B @ D, D @ A, rtol=0, atol=1e-13)
    assert np.linalg.matrix_rank(A, tol=1e-10) == 2 * n


def test_printed_sequence_of_the_product_is_wrong():
    """Eqs. (39) and (40) print A_1 … A_m. The resulting initial state differs from the state after one
    period."""
    system = random_system(3, 2)
    A, b = printed_maps(system, 1.0, 200, 0.5, 0.25)
    end = reduce(lambda x, step: step[0] @ x + step[1], zip(A, b, strict=True), np.zeros(6))
    closing = {}
    for order, product in (
        ("A_1 … A_m", reduce(np.matmul, A)),
        ("A_m … A_1", reduce(lambda P, step: step @ P, A)),
    ):
        start = np.linalg.solve(np.eye(6) - product, end)
        after = reduce(lambda x, step: step[0] @ x + step[1], zip(A, b, strict=True), start)
        closing[order] = np.linalg.norm(after - start) / np.linalg.norm(start)
    assert closing["A_m … A_1"] < 1e-12
    assert closing["A_1 … A_m"] > 0.05


def oscillator(omega):
    return constant(np.eye(1), np.zeros((1, 1)), np.array([[omega**2]]), lambda phase: np.cos(phase)[:, None])


def spectral_radius_of_a_step(rule, angle):
    """Spectral radius for an undamped oscillator with ω h = `angle`."""
    step = Grid(np.array([0.0, angle, 2 * angle]), np.zeros(2, dtype=bool))
    return np.abs(np.linalg.eigvals(chain_of(rule, oscillator(1.0), 1.0, step).A[0])).max()


@pytest.mark.parametrize("angle", [1e-3, 1.0, 10.0, 1e4])
def test_average_acceleration_conserves_energy_at_any_step(angle):
    assert spectral_radius_of_a_step(Newmark(0.5, 0.25), angle) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(("beta", "limit"), [(0.0, 2.0), (1 / 12, np.sqrt(6.0)), (1 / 6, np.sqrt(12.0))])
def test_stability_limit(beta, limit):
    rule = Newmark(0.5, beta)
    assert spectral_radius_of_a_step(rule, 0.999 * limit) == pytest.approx(1.0, abs=1e-9)
    assert spectral_radius_of_a_step(rule, 1.001 * limit) > 1.01
    assert rule.least_steps(frozen_modes(oscillator(40.0), 1.0)) == np.ceil(40.0 * 2 * np.pi / limit)


def test_steps_beyond_the_stability_limit_are_refused_with_the_remedy():
    with pytest.raises(StepsError, match=r"newmark with 60 steps .* at least 73 steps"):
        periodic(oscillator(40.0), 1.0, Newmark(0.5, 1 / 6), steps=60)


@pytest.mark.parametrize("beta", [1 / 6, 0.25, 0.5])
def test_gamma_below_one_half_adds_energy(beta):
    """An undamped mode grows at the rate (1/2 - γ) ω² h/2, which is ω² h/8 for γ = 1/4."""
    h = 1e-3
    growth = np.log(spectral_radius_of_a_step(Newmark(0.25, beta), h)) / h
    assert growth == pytest.approx(h / 8, rel=1e-3)


def test_gamma_below_one_half_gives_a_warning():
    warned = floquet(oscillator(1.3), 1.0, Newmark(0.25, 1 / 6), steps=500).warnings
    assert any("gamma = 0.25 < 1/2" in text and "adds energy" in text for text in warned)
    fair = floquet(oscillator(1.3), 1.0, Newmark(0.5, 1 / 6), steps=500).warnings
    assert not any("gamma" in text for text in fair)


def test_parameters_of_the_chapter_let_the_slow_cam_grow():
    """γ = 1/4, β = 1/6 and 20 000 steps at 100 rpm: a multiplier exceeds 1 by less than its error, whereas it
    is below 1 for γ = 1/2 and in truth. Neither method resolves the fastest modes, so that their errors are
    infinite."""
    steps = {"steps": 20_000, "rtol": 0.5}
    chosen = floquet(cam("1"), "100 rpm", Newmark(0.25, 1 / 6), **steps)
    assert chosen.spectral_radius > 1
    assert chosen.verdict == "undetermined"
    assert any("gamma" in text for text in chosen.warnings)
    usual = floquet(cam("1"), "100 rpm", Newmark(0.5, 0.25), **steps)
    assert usual.spectral_radius < 1
    assert (usual.verdict, usual.error_estimate.multipliers) == ("undetermined", np.inf)


@pytest.mark.parametrize(
    ("gamma", "beta", "named"), [(-0.1, 0.25, "gamma"), (1.5, 0.25, "gamma"), (0.5, np.nan, "beta")]
)
def test_parameters_out_of_bounds_are_refused(gamma, beta, named):
    with pytest.raises(ValueOutOfBoundsError, match=rf"{named} of newmark is .*; allowed: 0 … 1"):
        Newmark(gamma, beta)
