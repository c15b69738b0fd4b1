"""Programs that a user might write for the cam at 600 rpm: loops over steps, and shooting with SciPy.

Each program evaluates the matrices of chapter Eq. (64) at one phase at a time and returns phases (k,), q (3,
k) and the multipliers.
"""

import numpy as np
from scipy.integrate import solve_bvp, solve_ivp

SPEED = 20 * np.pi
PERIOD = 2 * np.pi / SPEED
I1, M2, M3, F = 0.12, 28.0, 50.0, 100.0
K1, K2, K3, C1, C2, C3 = 8e4, 8.2e8, 2.6e8, 18.5, 1400.0, 1200.0
ORDERS = np.arange(1, 13)
LAW = np.array([0.22165, 0, 0.05560, 0, -0.01706, 0, 0, 0, 0, 0, 0, 0])


def matrices(t):
    """Return M, C, K and d at one time, chapter Eqs. (64), (65)."""
    cosines, sines = np.cos(ORDERS * SPEED * t), np.sin(ORDERS * SPEED * t)
    U1, U2, U3 = LAW @ cosines, -(LAW * ORDERS) @ sines, -(LAW * ORDERS**2) @ cosines
    m = M2 + M3
    M = np.array([[I1 + m * U1**2, m * U1, M3 * U1], [m * U1, m, M3], [M3 * U1, M3, M3]])
    C = np.array(
        [[C1 + 2 * m * SPEED * U1 * U2, 0, 0], [2 * m * SPEED * U2, C2, 0], [2 * M3 * SPEED * U2, 0, C3]]
    )
    K = np.array(
        [
            [K1 + F * U2 + m * SPEED**2 * (U1 * U3 + U2**2), 0, 0],
            [m * SPEED**2 * U3, K2, 0],
            [M3 * SPEED**2 * U3, 0, K3],
        ]
    )
    d = np.array([-F * U1 - m * SPEED**2 * U1 * U2, -F - m * SPEED**2 * U2, -F - M3 * SPEED**2 * U2])
    return M, C, K, d


def state_matrices(t):
    """Return P and f of chapter Eq. (5)."""
    M, C, K, d = matrices(t)
    inverse = np.linalg.inv(M)
    P = np.block([[np.zeros((3, 3)), np.eye(3)], [-inverse @ K, -inverse @ C]])
    return P, np.concatenate((np.zeros(3), inverse @ d))


def runge_kutta_loop(steps):
    """Solve chapter Eqs. (17)-(21) step by step, with corrected coefficients of (18) and (19)."""
    h = PERIOD / steps
    A, b = [], []
    for i in range(steps):
        P0, f0 = state_matrices(i * h)
        Pm, fm = state_matrices(i * h + h / 2)
        P1, f1 = state_matrices(i * h + h)
        A.append(
            np.eye(6)
            + (
                h * (P0 + 4 * Pm + P1)
                + h**2 * (Pm @ P0 + Pm @ Pm + P1 @ Pm)
                + h**3 / 2 * (Pm @ Pm @ P0 + P1 @ Pm @ Pm)
                + h**4 / 4 * P1 @ Pm @ Pm @ P0
            )
            / 6
        )
        b.append(
            (
                h * (f0 + 4 * fm + f1)
                + h**2 * (Pm @ f0 + Pm @ fm + P1 @ fm)
                + h**3 / 2 * (Pm @ Pm @ f0 + P1 @ Pm @ fm)
                + h**4 / 4 * P1 @ Pm @ Pm @ f0
            )
            / 6
        )
    return closed(A, b)


def newmark_loop(steps, gamma=0.5, beta=0.25):
    """Solve chapter Eqs. (29)-(40) with the map of size 3n step by step."""
    h, one, zero = PERIOD / steps, np.eye(3), np.zeros((3, 3))
    D = np.block([[one, h * one, h**2 * (0.5 - beta) * one], [zero, one, (1 - gamma) * h * one]])
    T = np.block([[one, zero, beta * h**2 * one], [zero, one, gamma * h * one], [zero, zero, one]])
    A, b = [], []
    for i in range(1, steps + 1):
        M, C, K, d = matrices(i * h)
        inverse = np.linalg.inv(M + gamma * h * C + h**2 * beta * K)
        A.append(T @ np.vstack((D, -inverse @ np.hstack((K, C)) @ D)))
        b.append(T @ np.concatenate((np.zeros(6), inverse @ d)))
    return closed(A, b)


def closed(A, b):
    """Return the periodic states, chapter Eqs. (20), (21), and their q."""
    N = len(b[0])
    product, c = np.eye(N), np.zeros(N)
    for step, load in zip(A, b, strict=True):
        product, c = step @ product, step @ c + load
    x = [np.linalg.solve(np.eye(N) - product, c)]
    for step, load in zip(A, b, strict=True):
        x.append(step @ x[-1] + load)
    return np.linspace(0.0, 2 * np.pi, len(x)), np.array(x)[:, :3].T, np.linalg.eigvals(product)


def dop853_shooting(rtol):
    """Integrate the matrix equation of [Φ | x] by a single solve_ivp, and solve by single shooting."""

    def rate(t, y):
        P, f = state_matrices(t)
        change = P @ y.reshape(6, 7)
        change[:, 6] += f
        return change.ravel()

    t = np.linspace(0.0, PERIOD, 2001)
    start = np.eye(6, 7).ravel()
    y = solve_ivp(rate, (0.0, PERIOD), start, "DOP853", t_eval=t, rtol=rtol, atol=rtol * 1e-3).y
    maps = y.T.reshape(-1, 6, 7)
    Phi, c = maps[-1, :, :6], maps[-1, :, 6]
    x = maps[:, :, :6] @ np.linalg.solve(np.eye(6) - Phi, c) + maps[:, :, 6]
    return SPEED * t, x[:, :3].T, np.linalg.eigvals(Phi)


def boundary_values(tol, nodes=1000):
    """Solve for the periodic orbit by solve_bvp, which gives no multipliers."""

    def rate(t, x):
        parts = [state_matrices(each) for each in t]
        P, f = (np.array(part) for part in zip(*parts, strict=True))
        return (np.einsum("kij,jk->ki", P, x) + f).T

    def jacobian(t, x):
        return np.moveaxis([state_matrices(each)[0] for each in t], 0, -1)

    def closing(start, end):
        return start - end

    t = np.linspace(0.0, PERIOD, nodes + 1)
    solution = solve_bvp(
        rate, closing, t, np.zeros((6, len(t))), fun_jac=jacobian, tol=tol, max_nodes=100_000
    )
    return SPEED * solution.x, solution.y[:3], np.empty(0)
