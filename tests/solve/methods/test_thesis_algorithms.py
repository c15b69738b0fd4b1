"""Algorithms 1 and 2 of the thesis (sections 6.5 and 6.6), hand-coded: both yield the period map."""

import numpy as np
import pytest

from solve import Newmark, floquet, periodic
from solve.methods.march import March
from tests.solve.systems import random_system

SPEED, STEPS = 1.3, 90


def newmark_step(system, phase, h, gamma=0.5, beta=0.25):
    """R and f of y_{k+1} = R y_k + f with y = (q, q̇), from Eq. (6.5) and the equation of motion at both
    ends."""
    n = system.n
    (M0, M1), (C0, C1), (K0, K1), (d0, d1) = system.at(np.array([phase, phase + h * SPEED]), SPEED)
    eye, zero = np.eye(n), np.zeros((n, n))
    y = np.hstack((np.eye(2 * n), np.zeros((2 * n, 1))))
    a0 = np.linalg.solve(M0, np.hstack((-K0, -C0, d0[:, None])))
    ahead = np.block([[eye, h * eye], [zero, eye]]) @ y
    ahead[:n] += h**2 * (0.5 - beta) * a0
    ahead[n:] += h * (1 - gamma) * a0
    load = np.zeros((n, 2 * n + 1))
    load[:, -1] = d1
    a1 = np.linalg.solve(M1 + gamma * h * C1 + beta * h**2 * K1, load - C1 @ ahead[n:] - K1 @ ahead[:n])
    ahead[:n] += h**2 * beta * a1
    ahead[n:] += h * gamma * a1
    return ahead[:, :-1], ahead[:, -1]


def steps_of(system):
    h = system.period / SPEED / STEPS
    return [newmark_step(system, k * h * SPEED, h) for k in range(STEPS)]


def march(chain, y):
    for R, f in chain:
        y = R @ y + f
    return y


def algorithm_1(chain):
    """Integrate the identity and the state of rest over one period. The second period starts from Eq.
    (6.18)."""
    N = len(chain[0][1])
    columns = [march([(R, 0 * f) for R, f in chain], column) for column in np.eye(N)]
    transition = np.array(columns).T
    y = np.linalg.solve(np.eye(N) - transition, march(chain, np.zeros(N)))
    states = [y]
    for R, f in chain:
        states.append(R @ states[-1] + f)
    return np.array(states).T, transition


def algorithm_2(chain):
    """Invert G_k = -R_k one by one: y_1 follows from Eq. (6.24), whose sum is evaluated backwards, and the
    others from Eq. (6.25)."""
    N = len(chain[0][1])
    inverses = [np.linalg.inv(-R) for R, _ in chain]
    product, total = np.eye(N), np.zeros(N)
    for inverse, (_, f) in zip(reversed(inverses), reversed(chain), strict=True):
        total = inverse @ (f - total)
        product = inverse @ product
    sign = (-1) ** len(chain)
    y = np.linalg.solve(np.eye(N) - sign * product, total)
    states = [y]
    for inverse, (_, f) in zip(reversed(inverses), reversed(chain), strict=True):
        states.append(inverse @ (f - states[-1]))
    return np.array(states[::-1]).T, np.linalg.inv(sign * product)


@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_both_algorithms_equal_the_period_map(n):
    system = random_system(n, n)
    chain = steps_of(system)
    orbit = periodic(system, SPEED, Newmark(), steps=STEPS, rtol=0.9)
    (first, transition), (second, inverted) = algorithm_1(chain), algorithm_2(chain)
    scale = np.abs(first).max(axis=1, keepdims=True)
    np.testing.assert_allclose(first[:, -1], first[:, 0], rtol=0, atol=1e-12 * scale.max())
    np.testing.assert_allclose(second / scale, first / scale, rtol=0, atol=1e-9)
    np.testing.assert_allclose(inverted, transition, rtol=0, atol=1e-9 * np.abs(transition).max())
    ours = np.concatenate((orbit.q, orbit.qd))
    np.testing.assert_allclose(ours / scale, first / scale, rtol=0, atol=1e-11)
    computed = np.poly(floquet(system, SPEED, Newmark(), steps=STEPS, rtol=0.9).multipliers)
    np.testing.assert_allclose(computed, np.poly(np.linalg.eigvals(transition)), rtol=0, atol=1e-10)


def test_algorithm_1_does_not_depend_on_the_initial_state():
    """Eq. (6.19): the initial state of the first period is arbitrary."""
    system = random_system(2, 2)
    chain = steps_of(system)
    states, transition = algorithm_1(chain)
    initial = np.array([3.0, -1.0, 0.5, 2.0])
    start = np.linalg.solve(np.eye(4) - transition, march(chain, initial) - transition @ initial)
    np.testing.assert_allclose(start, states[:, 0], rtol=0, atol=1e-12 * np.abs(states).max())


def test_marching_converges_to_the_direct_algorithm():
    system = random_system(2, 2)
    chain = steps_of(system)
    states, transition = algorithm_1(chain)
    y, left = np.zeros(4), []
    for _ in range(41):
        left.append(np.linalg.norm(y - states[:, 0]))
        y = march(chain, y)
    radius = np.abs(np.linalg.eigvals(transition)).max()
    assert left[40] / left[20] == pytest.approx(radius**20, rel=0.5)
    marched = periodic(system, SPEED, March(tolerance=1e-10), steps=STEPS, rtol=0.9)
    np.testing.assert_allclose(marched.q[:, 0], states[:2, 0], rtol=0, atol=1e-9 * np.abs(states[:2]).max())


def test_two_step_recursion_matches_newmark_for_one_coordinate():
    """Eq. (6.6.a), the two-step form with γ = 1/2 for constant matrices: D q_{k+1} = B q_k - F q_{k-1} + β h²
    [f_{k+1} + (1/β - 2) f_k + f_{k-1}]."""
    M, C, K, beta, h = 1.3, 0.2, 4.0, 0.25, 0.05
    D, F = M + h / 2 * C + beta * h**2 * K, M - h / 2 * C + beta * h**2 * K
    B = 2 * M - (1 - 2 * beta) * h**2 * K
    force = np.cos(h * np.arange(400))
    q, v, a = [0.0], 0.0, force[0] / M
    for k in range(399):
        ahead, rate = q[-1] + h * v + h**2 * (0.5 - beta) * a, v + h / 2 * a
        a = (force[k + 1] - C * rate - K * ahead) / D
        q.append(ahead + h**2 * beta * a)
        v = rate + h / 2 * a
    q = np.array(q)
    left = D * q[2:]
    right = B * q[1:-1] - F * q[:-2] + beta * h**2 * (force[2:] + (1 / beta - 2) * force[1:-1] + force[:-2])
    np.testing.assert_allclose(left, right, rtol=0, atol=1e-13)
