"""Periodic Riccati equations, compared with SciPy, known solutions and integration; maps of single steps."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import block_diag, solve_continuous_are, solve_discrete_are

import solve
from solve.methods.gauss import Gauss
from solve.studies.control import maps
from tests.solve.studies.control_systems import (
    A0,
    B0,
    PHASES,
    constant,
    in_rotating_frame,
    random_system,
    rotation,
    slope_of,
    varying,
)


@pytest.mark.parametrize("N", [1, 2, 5, 8])
def test_solutions_of_constant_systems_match_scipy(N):
    rng = np.random.default_rng(N)
    A, B, C = (rng.normal(size=shape) for shape in ((N, N), (N, 2), (2, N)))
    Q, R = np.diag(rng.uniform(0.5, 2.0, N)), np.diag([2.0, 0.5])
    X = solve_continuous_are(A, B, Q, R)
    found = solve.lqr(constant(A, B, C), 1.0, Q, R)
    assert np.abs(found.riccati(PHASES) - X).max() <= 1e-12 * np.abs(X).max() * np.linalg.cond(X)
    assert np.allclose(found.gain(PHASES), np.linalg.solve(R, B.T @ X), rtol=1e-9)
    P = solve_continuous_are(A.T, C.T, Q, R)
    filtered = solve.kalman(constant(A, B, C), 1.0, Q, R)
    assert np.abs(filtered.riccati(PHASES) - P).max() <= 1e-12 * np.abs(P).max() * np.linalg.cond(P)
    rates = np.linalg.eigvals(A - P @ C.T @ np.linalg.solve(R, C)).real
    moduli = np.sort(np.exp(2 * np.pi * rates))[::-1]
    assert np.abs(np.abs(filtered.multipliers) - moduli).max() < 1e-8 * moduli[0]


@pytest.mark.parametrize("breaks", [(), (0.0, 0.3, 0.31, 2.0)])
def test_solution_matches_the_published_one_of_johansson(breaks):
    found = solve.lqr(in_rotating_frame(breaks), 1.0, np.eye(2), np.eye(1), rtol=1e-10)
    P, X = rotation(PHASES), solve_continuous_are(A0, B0, np.eye(2), np.eye(1))
    exact = P @ X @ np.swapaxes(P, 1, 2)
    assert np.abs(found.riccati(PHASES) - exact).max() <= found.error_estimate * np.abs(X).max()
    assert found.error_estimate < 1e-10
    assert found.residual < 1e-9
    # Multipliers of the closed loop are those of the constant one: half a revolution of the frame is -1.
    rates = np.linalg.eigvals(A0 - B0 @ B0.T @ X)
    moduli = np.sort(np.abs(np.exp(rates * np.pi)))[::-1]
    assert np.allclose(np.abs(found.multipliers), moduli, rtol=1e-6)


@pytest.mark.parametrize("breaks", [(), (0.0, 0.3, 0.31, 2.0)])
def test_filter_in_the_rotating_frame_matches_the_known_solution(breaks):
    C, A = np.array([[3.0, 1.0]]), in_rotating_frame().equations_at

    def matrices(phase, speed):
        rows, k = C @ np.swapaxes(rotation(phase), 1, 2), len(phase)
        return A(phase, speed)[0], np.zeros((k, 2)), np.zeros((k, 2, 1)), rows, np.zeros((k, 1, 1))

    system = solve.FirstOrderSystem(matrices, ["x0", "x1"], np.pi, breaks, ["u0"], ["y0"])
    found = solve.kalman(system, 1.0, np.eye(2), np.eye(1), rtol=1e-10)
    P = solve_continuous_are(A0.T, C.T, np.eye(2), np.eye(1))
    exact = rotation(PHASES) @ P @ np.swapaxes(rotation(PHASES), 1, 2)
    assert np.abs(found.riccati(PHASES) - exact).max() <= found.error_estimate * np.abs(P).max()
    assert found.error_estimate < 1e-10


def riccati_integrated(A, B, Q, R, period, X):
    """Return X one period earlier, integrated by SciPy. A, Q and R are constant; the input matrix B depends
    on time."""
    N = len(X)

    def slope(t, x):
        X, b = x.reshape(N, N), B(t)
        return (A(t).T @ X + X @ A(t) - X @ b @ np.linalg.solve(R, b.T) @ X + Q).ravel()

    run = solve_ivp(
        lambda tau, x: slope(period - tau, x), (0, period), X.ravel(), method="DOP853", rtol=1e-11, atol=1e-9
    )
    return run.y[:, -1].reshape(N, N)


RATE = 0.00103448


SATELLITE = np.array(
    [
        [0, 0, 5.318064566757217e-02, 0],
        [0, 0, 0, 5.318064566757217e-02],
        [-1.352134256362805e-03, 0, 0, -7.099273035392090e-02],
        [0, -7.557182037479544e-04, 3.781555288420663e-02, 0],
    ]
)


def test_solution_of_pittelkaus_satellite_is_periodic():
    def B(phase):
        columns = [0 * phase, 0 * phase, 0.1389735e-6 * np.sin(phase), -0.3701336e-7 * np.cos(phase)]
        return np.stack(columns, axis=-1)[..., None]

    satellite = varying(lambda phase: np.broadcast_to(SATELLITE, (len(phase), 4, 4)), B)
    Q, R = np.diag([2.0, 1.0, 0.0, 0.0]), np.array([[1e-11]])
    found = solve.lqr(satellite, RATE, Q, R, rtol=1e-9)
    assert found.residual < 1e-8
    assert found.stable
    X, period = found.riccati(0.0)[0], 2 * np.pi / RATE
    earlier = riccati_integrated(lambda t: SATELLITE, lambda t: B(RATE * t), Q, R, period, X)
    assert np.abs(earlier - X).max() < 1e-7 * np.abs(X).max()


def test_periodic_difference_equation_matches_that_of_a_cyclic_system():
    """Example 2 of J. J. Hench, A. J. Laub, IEEE Trans. Automat. Contr. 39 (1994) 1197-1210, with R = 1."""
    A = np.array(
        [
            [[-3, 2, 9], [0, 0, -4], [3, -2, 3]],
            [[6, -3, 0], [4, -2, 2], [2, -1, 4]],
            [[2, -3, -3], [4, -15, -3], [-2, 9, 1]],
        ],
        dtype=float,
    )
    B = np.array([[1, 1, 0], [0, 1, 0], [0, 1, 1]], dtype=float)
    G, H = B[:, :, None] * B[:, None], np.eye(3)[:, :, None] * np.eye(3)[:, None]
    X = maps.periodic_solution(maps.Maps(A, G, H))
    cyclic, inputs = np.zeros((9, 9)), np.zeros((9, 3))
    for k in range(3):
        after = slice(3 * ((k + 1) % 3), 3 * ((k + 1) % 3) + 3)
        cyclic[after, 3 * k : 3 * k + 3], inputs[after, k] = A[k], B[k]
    exact = solve_discrete_are(cyclic, inputs, block_diag(*H), np.eye(3))
    for k in range(3):
        block = exact[3 * k : 3 * k + 3, 3 * k : 3 * k + 3]
        assert np.abs(X[k] - block).max() < 1e-9 * np.abs(exact).max()


def test_solution_with_jumps_is_periodic():
    A = np.array([[[0.0, 1.0], [-1.0, 0.1]], [[0.0, 1.0], [2.0, 0.0]]])
    b = np.array([[0.0], [1.0]])

    def at(phase):
        return A[(np.mod(phase, 2 * np.pi) > 2.0).astype(int)]

    found = solve.lqr(
        varying(at, lambda p: np.broadcast_to(b, (len(p), 2, 1)), breaks=(0, 2.0)),
        1.0,
        {"x0": 1.0},
        {"u0": 2.0},
    )
    X, Q, R = found.riccati(0.0)[0], np.diag([1.0, 0.0]), np.array([[2.0]])
    middle = riccati_integrated(lambda t: A[1], lambda t: b, Q, R, 2 * np.pi - 2.0, X)
    assert np.abs(middle - found.riccati(2.0)[0]).max() < 1e-9
    assert np.abs(riccati_integrated(lambda t: A[0], lambda t: b, Q, R, 2.0, middle) - X).max() < 1e-9


def residual_of(system, found, N):
    """Return the largest residual of the Riccati equation, with X′ by differences, relative to X."""
    phase = np.linspace(0.05, 6.2, 23)
    A, _, B, *_ = system.equations_at(phase, 1.0)
    X = found.riccati(phase)
    left = (
        slope_of(found, phase)
        + np.swapaxes(A, 1, 2) @ X
        + X @ A
        - X @ B @ np.swapaxes(B, 1, 2) @ X
        + np.eye(N)
    )
    return np.abs(left).max() / np.abs(X).max()


@pytest.mark.parametrize("seed", range(4))
def test_residual_of_random_systems_is_small(seed):
    system, N = random_system(seed, most=6)
    found = solve.lqr(system, 1.0, np.eye(N), np.eye(2))
    assert residual_of(system, found, N) < 1e-6
    assert found.error_estimate < 1e-8
    assert found.stable
    accurate = solve.lqr(system, 1.0, np.eye(N), np.eye(2), rtol=1e-12)
    phase = np.linspace(0.0, 2 * np.pi, 97)
    X = accurate.riccati(phase)
    size = np.sqrt(np.einsum("kii->ki", X).max(axis=0))
    error = np.abs((found.riccati(phase) - X) / size / size[:, None]).max()
    assert found.error_estimate / 10 < error < found.error_estimate
    assert np.linalg.eigvalsh(found.riccati(PHASES)).min() > 0


@pytest.mark.slow
@pytest.mark.parametrize("first", range(0, 100, 20))
def test_residuals_of_a_hundred_random_systems_are_small(first):
    for seed in range(first, first + 20):
        system, N = random_system(1000 + seed)
        found = solve.lqr(system, 1.0, np.eye(N), np.eye(2))
        assert residual_of(system, found, N) < 1e-6, seed
        assert found.error_estimate < 1e-8, seed
        assert found.stable, seed


def random_steps():
    """Return A, E and Q of 3 steps with 5 stages each, for 3 positions and velocities and 2 inputs."""
    rng, p = np.random.default_rng(1), 3
    A, Q = 0.2 * rng.normal(size=(2, 3, 8, 2 * p, 2 * p))
    E = 0.2 * rng.normal(size=(3, 8, 2 * p, 2))
    A[..., :p, :], E[..., :p, :] = 0, 0
    A[..., range(p), range(p, 2 * p)] = rng.uniform(0.1, 0.3, p)
    return A, E, Q + np.swapaxes(Q, 2, 3)


def test_mechanical_steps_equal_those_of_general_systems(monkeypatch):
    A, E, _ = random_steps()
    method = Gauss(16).stages
    general = maps._response(A, E, method)
    assert np.abs(maps._mechanical_response(A, E, method) - general).max() < 1e-14
    monkeypatch.setattr(maps, "factorised", lambda *_: None)
    assert np.abs(maps._mechanical_response(A, E, method) - general).max() < 1e-14
    assert maps._is_mechanical(A.reshape(-1, 6, 6), E.reshape(-1, 6, 2))
    assert not maps._is_mechanical(A.reshape(-1, 6, 6), np.ones((24, 6, 2)))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_steps_match_collocation_of_states_and_costates(sign):
    A, E, Q = random_steps()
    weights, (m, s, N, _) = Gauss(16).stages, E.shape
    of_start, gramian, cost, _ = maps._condensed(maps._response(A, E, weights), Q, weights.b, sign)
    for step in range(m):
        # Unknowns are states and costates at the stages and the costate at the start.
        x0, last, end = np.eye(N, 2 * N), np.eye(N, 2 * N, N), s * N
        left, right = np.zeros(((2 * s + 1) * N,) * 2), np.zeros(((2 * s + 1) * N, 2 * N))
        G = sign * E[step] @ np.swapaxes(E[step], 1, 2)
        at = [slice(k * N, k * N + N) for k in range(2 * s + 1)]
        for i in range(s):
            left[at[i], at[i]], right[at[i]] = np.eye(N), x0
            left[at[s + i], at[s + i]], left[at[s + i], at[-1]] = np.eye(N), -np.eye(N)
            for j in range(s):
                a = weights.A[i, j]
                left[at[i], at[j]] -= a * A[step, j]
                left[at[i], at[s + j]] += a * G[j]
                left[at[s + i], at[s + j]] += a * A[step, j].T
                left[at[s + i], at[j]] += a * Q[step, j]
        left[at[-1], at[-1]], right[at[-1]] = np.eye(N), last
        for j in range(s):
            left[at[-1], at[s + j]] = -weights.b[j] * A[step, j].T
            left[at[-1], at[j]] = -weights.b[j] * Q[step, j]
        solved = np.linalg.solve(left, right)
        stages, costates = solved[:end].reshape(s, N, -1), solved[end:-N].reshape(s, N, -1)
        rates = A[step] @ stages - G @ costates
        state = x0 + np.einsum("s,sij->ij", weights.b, rates)
        assert np.allclose(state, np.hstack((of_start[step], -gramian[step])), atol=1e-13)
        assert np.allclose(solved[-N:], np.hstack((cost[step], of_start[step].T)), atol=1e-13)
