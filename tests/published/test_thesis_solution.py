"""Claims of Section 2.2.2 and Chapter 6 of the thesis about their methods."""

from itertools import accumulate

import numpy as np
import pytest

import solve
from solve.errors import StepsError
from solve.studies.flops import algorithm_1, algorithm_2, fourier_series, time_marching

RANDOM = np.random.default_rng(6)
INTERVALS, STATES = 12, 4


def random_chain():
    """Return R_k and f_k of y_{k+1} = R_k y_k + f_k, a stable system over one period."""
    turns = [0.97 * np.linalg.qr(RANDOM.normal(size=(STATES, STATES)))[0] for _ in range(INTERVALS)]
    return turns, RANDOM.normal(size=(INTERVALS, STATES))


def printed_sum(turns, forces):
    """Return Σ (-1)^(k+1) G_1⁻¹ … G_k⁻¹ f_k of (6.29), where G_k = -R_k."""
    inverses = accumulate((np.linalg.inv(-R) for R in turns), np.matmul)
    return sum((-1) ** k * product @ f for k, (product, f) in enumerate(zip(inverses, forces, strict=True)))


@pytest.mark.parametrize("cycles", [1, 2, 3, 7])
def test_state_after_m_cycles_contains_the_mth_power(cycles):
    """Thesis 6.8, below Table 6.1. The printed expression [I - R⁻¹]⁻¹ [I - R^(m+1)] Σ is the state after m +
    1 cycles."""
    turns, forces = random_chain()
    y = np.zeros(STATES)
    for _ in range(cycles):
        for R, f in zip(turns, forces, strict=True):
            y = R @ y + f
    transition = np.linalg.multi_dot(turns[::-1])
    eye, total = np.eye(STATES), printed_sum(turns, forces)
    true, printed = (
        np.linalg.solve(
            eye - np.linalg.inv(transition), (eye - np.linalg.matrix_power(transition, power)) @ total
        )
        for power in (cycles, cycles + 1)
    )
    np.testing.assert_allclose(true, y, rtol=1e-9)
    assert np.abs(printed - y).max() > 1e-2 * np.abs(y).max()


def test_sum_6_24_requires_only_matrix_vector_products():
    """Thesis 6.6, "much more efficient" in reverse order. As printed, every term contains a separate product
    of matrices. In reverse order, each interval requires one matrix-vector product."""
    turns, forces = random_chain()
    inverses = [np.linalg.inv(-R) for R in turns]
    multiplications = {"printed": 0, "behind": 0}
    as_printed = np.zeros(STATES)
    for j in range(INTERVALS):
        product = np.eye(STATES)
        for inverse in inverses[: INTERVALS - j]:
            product = product @ inverse
            multiplications["printed"] += STATES**3
        as_printed += (-1) ** (j + INTERVALS - 1) * product @ forces[INTERVALS - 1 - j]
    behind = np.zeros(STATES)
    for inverse, f in zip(inverses[::-1], forces[::-1], strict=True):
        behind = inverse @ (f - behind)
        multiplications["behind"] += STATES**2
    np.testing.assert_allclose(as_printed, behind, rtol=1e-9)
    assert multiplications["printed"] == multiplications["behind"] * STATES * (INTERVALS + 1) / 2


@pytest.mark.parametrize("beta", [0.0, 1 / 6, 0.25])
def test_first_step_of_the_two_step_newmark_form_is_consistent(beta):
    """Equation (6.6.b) holds for γ = 1/2 and constant matrices. It is compared with a step of (6.5) and the
    equation of motion."""
    n, h = 3, 0.1
    M, C, K = (A @ A.T + n * np.eye(n) for A in RANDOM.normal(size=(3, n, n)))
    q0, v0, f0, f1 = RANDOM.normal(size=(4, n))
    a0 = np.linalg.solve(M, f0 - C @ v0 - K @ q0)
    ahead, rate = q0 + h * v0 + h**2 * (0.5 - beta) * a0, v0 + h / 2 * a0
    D = M + h / 2 * C + beta * h**2 * K
    q1 = ahead + beta * h**2 * np.linalg.solve(D, f1 - C @ rate - K @ ahead)
    back = (1 - 4 * beta) / 4 * h * C @ np.linalg.inv(M)
    P = M + h / 2 * C - (1 - 2 * beta) / 2 * h**2 * K - h**2 * back @ K
    Q = (M - h * back @ C) * h
    R = ((1 - 2 * beta) / 2 * np.eye(n) + back) * h**2
    np.testing.assert_allclose(D @ q1, P @ q0 + Q @ v0 + beta * h**2 * f1 + R @ f0, rtol=1e-12, atol=1e-13)


def radius(gamma, beta, angle, ratio):
    """Return the spectral radius of Newmark's amplification matrix for q̈ + 2ζ q̇ + q = 0, from (6.5)."""
    columns = []
    for q, v in np.eye(2):
        a = -2 * ratio * v - q
        ahead, rate = q + angle * v + angle**2 * (0.5 - beta) * a, v + angle * (1 - gamma) * a
        next_a = (-2 * ratio * rate - ahead) / (1 + 2 * gamma * angle * ratio + beta * angle**2)
        columns.append((ahead + beta * angle**2 * next_a, rate + gamma * angle * next_a))
    return np.abs(np.linalg.eigvals(np.transpose(columns))).max()


@pytest.mark.parametrize(("gamma", "beta"), [(0.5, 0.0), (0.5, 1 / 6), (0.6, 0.2), (0.7, 0.0)])
@pytest.mark.parametrize("ratio", [0.01, 0.2, 0.9])
def test_structural_damping_extends_newmark_steps_unless_gamma_is_half(gamma, beta, ratio):
    """Thesis 6.2.3. The stability limit is Hughes's ω Δt = [ζ(γ - ½) + sqrt(γ/2 - β + ζ²(γ - ½)²)]/(γ/2 -
    β)."""
    room, lean = gamma / 2 - beta, ratio * (gamma - 0.5)
    limit = (lean + np.sqrt(room + lean**2)) / room
    assert radius(gamma, beta, 0.999 * limit, ratio) < 1
    assert radius(gamma, beta, 1.001 * limit, ratio) > 1
    undamped = 1 / np.sqrt(room)
    assert limit == pytest.approx(undamped, rel=1e-12) if gamma == 0.5 else limit > undamped


@pytest.mark.slow
def test_marching_does_not_converge_without_damping():
    """Thesis 2.2.2, with conservative terms. After ten to twenty cycles, the transient is as large as after
    the first."""
    undamped = solve.load("four_bar", options={"terms": "full"}, zeta=0.0)
    transient = solve.transient(undamped, "62 rad/s", turns=20, rtol=1e-4)
    assert transient.reached is None
    assert transient.distances[10:].max() > 0.5 * transient.distances[0].max()


def test_runge_kutta_requires_smaller_steps_for_stiff_equations():
    """Thesis 2.2.2. At 30 rad/s, two thousand steps per period violate its stability limit of 2.83 for the
    highest frequency. With 180 steps, Newmark's average-acceleration method gives the deflection to 5 %."""
    model, name = solve.load("four_bar"), "follower_midpoint_deflection"
    with pytest.raises(StepsError, match="exceeds its stability limit"):
        solve.periodic(model, 30.0, "rk4", steps=2000, rtol=0.9)
    fine = solve.periodic(model, 30.0, rtol=1e-5).statistics(name).max_abs
    coarse = solve.periodic(model, 30.0, solve.Newmark(), steps=180, rtol=0.9).statistics(name).max_abs
    assert coarse == pytest.approx(fine, rel=0.05)


@pytest.mark.parametrize(("stiffer", "order"), [(1.0, 6), (100.0, 60)])
def test_bahgat_and_willmerts_inverse_is_singular_at_some_positions(stiffer, order):
    """Thesis 2.2.2. K - j²Ω²M is singular if a frequency equals jΩ: at 30 rad/s for j = 6 with steel links,
    and at ten times this harmonic with links a hundred times as stiff."""
    model = solve.load("four_bar", E=210e9 * stiffer)
    M, _, K, _ = model.at(np.arange(360) * (2 * np.pi / 360), 30.0)
    signs = np.linalg.slogdet(K - (order * 30.0) ** 2 * M)[0]
    assert len(set(signs)) == 2


def test_n_samples_do_not_determine_n_plus_1_coefficients():
    """Thesis 6.4, (6.13). The sine of order N/2 vanishes at all N instants, so that only N of the
    coefficients are determined. Harmonic balance gives (N + 1)n equations."""
    N = 12
    t, j = np.arange(N) / N, np.arange(N // 2 + 1)
    angles = 2 * np.pi * np.outer(t, j)
    columns = np.hstack((np.cos(angles), np.sin(angles[:, 1:])))
    assert columns.shape == (N, N + 1)
    assert np.linalg.matrix_rank(columns) == N
    assert np.abs(columns[:, -1]).max() < 1e-13


@pytest.mark.slow
def test_slow_speeds_require_more_harmonics():
    """Thesis 6.4 and 2.2.2 state "the speed has no effect on the computation". This holds only for a given
    number of harmonics."""
    model, turn = solve.load("four_bar"), np.linspace(0.0, 2 * np.pi, 1001)
    errors = []
    for speed in (20.0, 60.0):
        fine = solve.periodic(model, speed, rtol=1e-5).at(turn)
        series = solve.periodic(model, speed, "fourier", steps=45, rtol=0.9).at(turn)
        errors.append((np.abs(series - fine).max(axis=1) / np.abs(fine).max(axis=1)).max())
    assert errors[0] > 0.1
    assert errors[1] < 0.01


def test_condition_of_i_minus_r_grows_only_near_resonance():
    """Thesis 6.5. For an undamped oscillator with a load, the condition number of the closed system depends
    on ρ = exp(±2πi ω/Ω)."""

    def condition(omega):
        def matrices(phase, speed):
            one = np.ones((len(phase), 1, 1))
            return one, 0 * one, omega**2 * one, np.cos(phase)[:, None]

        return solve.periodic(solve.PeriodicSystem(matrices, ["q"]), 1.0, rtol=1e-6).condition

    assert condition(2.25) < 1e3
    assert condition(2.0 + 1e-5) > 1e3 * condition(2.25)


def critical_cycles(N, n, stored):
    """Return the smallest number of cycles with which marching requires more operations than algorithm 1."""
    return next(c for c in range(1, 1000) if time_marching(N, n, c, stored) > algorithm_1(N, n, stored))


@pytest.mark.parametrize("n", [3, 9, 10, 27, 50])
def test_cycle_limit_for_marching_matches_the_formula(n):
    """Thesis 6.8, from Table 6.1. The limit is 4n(1 + 1/N) + 2/(2n + 1) cycles with stored matrices and three
    cycles without."""
    N = 90
    assert critical_cycles(N, n, stored=True) == int(4 * n * (1 + 1 / N) + 2 / (2 * n + 1)) + 1
    assert critical_cycles(N, n, stored=False) == 4


def critical_harmonics(N, n):
    return next(h for h in range(1, 200) if fourier_series(N, n, h) > algorithm_1(N, n))


@pytest.mark.parametrize("n", [10, 50])
def test_harmonic_limit_for_fourier_series_matches_the_table(n):
    """Thesis 6.8, Table 6.3. The limit is 6 to 10 harmonics for 90 intervals and 10 to 15 for 720."""
    few, many = (critical_harmonics(N, n) for N in (90, 720))
    assert 6 < few <= 10 < many <= 15


@pytest.mark.parametrize("N", [90, 720])
def test_one_element_saves_most_of_the_operations(N):
    """Thesis 9.1, "a drastic saving in CPU time" by the corrected element. By Table 6.1, 9 degrees of freedom
    replace 36; the correction itself is not counted."""
    assert algorithm_1(N, 36) > 50 * algorithm_1(N, 9)


@pytest.mark.parametrize("count", [algorithm_1, algorithm_2])
@pytest.mark.parametrize("stored", [True, False])
def test_operations_are_linear_in_the_number_of_intervals(count, stored):
    """Thesis 6.8, about computing time."""
    first, second, third = (count(N, 9, stored) for N in (90, 180, 270))
    assert second - first == third - second
