"""Periodic systems for the tests. Of the code under test, only PeriodicSystem is used."""

import numpy as np
from hypothesis import strategies as st

from solve import PeriodicSystem
from solve.period.frozen import PHASES, frozen
from solve.period.period_map import Steps
from solve.period.points import SinglePoint

CAM = {
    "I1": 0.12, "m2": 28.0, "m3": 50.0, "F": 100.0,
    "k1": 8e4, "k2": 8.2e8, "k3": 2.6e8, "c1": 18.5, "c2": 1400.0, "c3": 1200.0,
}  # fmt: skip
CAM_LAW = {
    "1": {1: 0.22165, 3: 0.05560, 5: -0.01706},
    "2": {1: 0.22206, 3: 0.08539, 5: 0.00518, 7: -0.00373, 9: 0.00345, 11: -0.00182},
}
ORDERS = np.arange(1, 4)

seeds = st.integers(min_value=0, max_value=2**32 - 1)


def system(matrices, n, **settings):
    return PeriodicSystem(matrices, [f"q{i}" for i in range(1, n + 1)], **settings)


def constant(M, C, K, force):
    """Return constant M, C and K (n, n) with the load d = force(phase), (m, n)."""
    n = len(M)

    def matrices(phase, speed):
        return (*(np.broadcast_to(A, (len(phase), n, n)) for A in (M, C, K)), force(phase))

    return system(matrices, n)


def amplitudes(rng, count, size):
    """Return random coefficients (6, count), of magnitude `size`, of cos φ, cos 2φ and cos 3φ and then of the
    sines."""
    return (size * rng.standard_normal((2, 3, count)) / ORDERS[:, None]).reshape(6, count)


def spd(rng, n, low, high):
    """Return a random symmetric matrix with eigenvalues between `low` and `high`."""
    Q = np.linalg.qr(rng.standard_normal((n, n)))[0]
    return Q @ np.diag(rng.uniform(low, high, n)) @ Q.T


def random_matrices(seed, n, modulation=0.15):
    """Return smoothly varying M, C, K and d of a damped system at speed 1, for derivatives with respect to
    time."""
    rng = np.random.default_rng(seed)
    means = [spd(rng, n, *bounds).ravel() for bounds in ((1.0, 2.0), (0.1, 0.5), (1.0, 20.0))]
    parts = [amplitudes(rng, n * n, modulation * size / n) for size in (0.5, 0.5, 2.0)]
    columns = np.concatenate((*parts, amplitudes(rng, n, 1.0)), axis=1)
    mean = np.concatenate((*means, rng.standard_normal(n)))

    def matrices(phase, speed):
        angles = np.outer(phase, ORDERS)
        entries = mean + np.concatenate((np.cos(angles), np.sin(angles)), axis=1) @ columns
        M, C, K = np.moveaxis(entries[:, :-n].reshape(-1, 3, n, n), 1, 0)
        return (M + np.swapaxes(M, 1, 2)) / 2, C, K, entries[:, -n:]

    return matrices


def random_system(seed, n, **settings):
    return system(random_matrices(seed, n), n, **settings)


def cam_matrices(case="1", **changed):
    """Chapter Eq. (64) with Tables 1 and 2, hand-coded."""
    p = CAM | changed
    k, a = (np.array(part) for part in zip(*CAM_LAW[case].items(), strict=True))

    def matrices(phase, speed):
        angles = np.outer(phase, k)
        cosines, sines = np.cos(angles), np.sin(angles)
        U1, U2, U3 = cosines @ a, -sines @ (k * a), -cosines @ (k**2 * a)
        m, m3, one, zero = p["m2"] + p["m3"], p["m3"], np.ones_like(phase), np.zeros_like(phase)
        M = [
            [p["I1"] + m * U1**2, m * U1, m3 * U1],
            [m * U1, m * one, m3 * one],
            [m3 * U1, m3 * one, m3 * one],
        ]
        C = [
            [p["c1"] + 2 * m * speed * U1 * U2, zero, zero],
            [2 * m * speed * U2, p["c2"] * one, zero],
            [2 * m3 * speed * U2, zero, p["c3"] * one],
        ]
        K = [
            [p["k1"] + p["F"] * U2 + m * speed**2 * (U1 * U3 + U2**2), zero, zero],
            [m * speed**2 * U3, p["k2"] * one, zero],
            [m3 * speed**2 * U3, zero, p["k3"] * one],
        ]
        d = [
            -p["F"] * U1 - m * speed**2 * U1 * U2,
            -p["F"] - m * speed**2 * U2,
            -p["F"] - m3 * speed**2 * U2,
        ]
        M, C, K = (np.moveaxis(np.array(A), -1, 0) for A in (M, C, K))
        return M, C, K, np.array(d).T

    return matrices


def cam(case="1", **changed):
    return system(cam_matrices(case, **changed), 3)


def canonical_undamped(seed, n):
    """Return a system with C = dM/dt and symmetric K: the equations of ½ q̇ᵀM(t)q̇ - ½ qᵀK(t)q, whose flow is
    symplectic."""
    rng = np.random.default_rng(seed)
    M0, K0 = spd(rng, n, 1.0, 2.0), spd(rng, n, 0.5, 8.0)
    A, B = (rng.uniform(-0.2, 0.2) * spd(rng, n, 0.5, 1.0) for _ in range(2))
    G, H = (rng.uniform(-1.0, 1.0) * spd(rng, n, 0.5, 1.0) for _ in range(2))

    def matrices(phase, speed):
        c, s = np.cos(phase)[:, None, None], np.sin(phase)[:, None, None]
        M, rate = M0 + A * c + B * s, speed * (B * c - A * s)
        return M, rate, K0 + G * c + H * s, np.ones((len(phase), n))

    return system(matrices, n)


def meissner(delta=1.3, epsilon=0.7, zeta=0.05, load=1.0):
    """Return a system with the stiffness delta + epsilon during the first 0.4 of the period and delta -
    epsilon during the rest. The load is 1 in the first interval and `load` in the second. The jumps are at 0
    and at 0.4 of the period."""
    jump = 0.8 * np.pi

    def matrices(phase, speed):
        first = np.mod(phase, 2 * np.pi) < jump
        one = np.ones((len(phase), 1, 1))
        K = np.where(first, delta + epsilon, delta - epsilon)[:, None, None]
        return one, 2 * zeta * one, K, np.where(first, 1.0, load)[:, None]

    return system(matrices, 1, breaks=(0.0, jump))


def chain_of(method, system, speed, grid):
    """Return the affine maps A (m, N, N) and b (m, N) of the steps of a method."""
    steps = method.discretise(SinglePoint(system, speed), grid).steps
    return Steps(steps.A[0], steps.b[0])


def frozen_modes(system, speed, phases=PHASES):
    """Return the modes of a system with frozen coefficients."""
    return frozen(SinglePoint(system, speed), phases)


def swelling(m, decades):
    """Return a chain of m steps. Some solutions grow by a number of powers of ten in its middle third, in
    rotating directions, and decay by the same number in the last third."""
    rng = np.random.default_rng(m)
    turned = np.linalg.qr(rng.standard_normal((m, 4, 4)))[0]
    rates = np.zeros(m)
    rates[m // 3 : 2 * m // 3], rates[2 * m // 3 :] = 1.0, -1.0
    rates *= decades * np.log(10) / (m // 3)
    factors = np.exp(np.stack((rates, 0.8 * rates, -np.abs(rates), np.full(m, -3.0 / m)), axis=-1))
    A = np.roll(turned, -1, axis=0) * factors[:, None, :] @ np.swapaxes(turned, 1, 2)
    return Steps(0.99 * A, rng.standard_normal((m, 4)))
