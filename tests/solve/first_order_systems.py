"""First-order and mixed systems for the tests, with multipliers from matrix exponentials."""

import numpy as np

from solve import FirstOrderSystem, MixedSystem, PeriodicSystem
from tests.solve.systems import random_matrices


def names(kind, count):
    return [f"{kind}{k + 1}" for k in range(count)]


def rotated(rng, N, speed=1.0, most=3):
    """Return A(phase, speed) for x = Q R(phase) z, where R rotates pairs of states 1 … `most` times per
    period and ż = A0 z, and the multipliers exp(eig(A0) T)."""
    K = np.zeros((N, N))
    for k in range(0, N - 1, 2):
        K[k, k + 1] = -(turns := int(rng.integers(1, most + 1)))
        K[k + 1, k] = turns
    Q = np.linalg.qr(rng.standard_normal((N, N)))[0]
    A0 = rng.standard_normal((N, N)) / np.sqrt(N) - rng.uniform(0, 1) * np.eye(N)
    values, vectors = np.linalg.eig(K)

    def A(phase, omega):
        waves = np.exp(np.outer(phase, values))[:, None, :]
        R = np.real(vectors * waves @ np.linalg.inv(vectors))
        return Q @ (omega * K + R @ A0 @ np.swapaxes(R, 1, 2)) @ Q.T

    return A, np.exp(2 * np.pi / speed * np.linalg.eigvals(A0).astype(complex))


def swaying(rng, N, amplitude):
    """Return A(phase, speed) at speed 1 for x = exp(S sin φ) z with a skew-symmetric S of the given amplitude
    and ż = A0 z, and the multipliers. All harmonics of A are nonzero."""
    S = rng.standard_normal((N, N))
    S = amplitude * (S - S.T) / 2
    A0 = 0.5 * rng.standard_normal((N, N)) - 0.3 * np.eye(N)
    values, vectors = np.linalg.eig(S)

    def A(phase, omega):
        waves = np.exp(np.outer(np.sin(phase), values))[:, None, :]
        R = np.real(vectors * waves @ np.linalg.inv(vectors))
        return np.cos(phase)[:, None, None] * S + R @ A0 @ np.swapaxes(R, 1, 2)

    return A, np.exp(2 * np.pi * np.linalg.eigvals(A0).astype(complex))


def with_load(A, size=None):
    """Return matrices A and a load b with one harmonic."""

    def matrices(phase, speed):
        states = A(phase, speed)
        return states, np.cos(phase)[:, None] * np.ones(states.shape[-1])

    return matrices


def first_order(A, N, **settings):
    return FirstOrderSystem(with_load(A), names("x", N), **settings)


def restated(seed, n):
    """Return a second-order system with n coordinates, the same system with 2n states, and the same system
    with its last coordinate and velocity as states."""
    matrices = random_matrices(seed, n)

    def by_states(phase, speed):
        M, C, K, d = matrices(phase, speed)
        A, b = np.zeros((len(phase), 2 * n, 2 * n)), np.zeros((len(phase), 2 * n))
        A[:, :n, n:], A[:, n:, :n], A[:, n:, n:] = np.eye(n), -np.linalg.solve(M, K), -np.linalg.solve(M, C)
        b[:, n:] = np.linalg.solve(M, d[..., None])[..., 0]
        return A, b

    def mixed(phase, speed):
        M, C, K, d = matrices(phase, speed)
        large = np.zeros((3, len(phase), n + 1, n + 1))
        M1, C1, K1 = large
        M1[:, :n, : n - 1], C1[:, :n, n], C1[:, :n, : n - 1] = M[..., :-1], M[..., -1], C[..., :-1]
        K1[:, :n, :n], K1[:, :n, n] = K, C[..., -1]
        C1[:, n, n - 1], K1[:, n, n] = 1.0, -1.0
        return M1, C1, K1, np.concatenate((d, 0 * d[:, :1]), axis=1)

    q = names("q", n)
    return (
        PeriodicSystem(matrices, q),
        FirstOrderSystem(by_states, [*q, *names("v", n)]),
        MixedSystem(mixed, q[:-1], [q[-1], f"v{n}"]),
    )


def error(result, exact):
    """Return the largest distance between multipliers and the exact ones, relative to the spectral radius."""
    from scipy.optimize import linear_sum_assignment

    found = np.nan_to_num(result.multipliers)
    distance = np.abs(found[:, None] - exact)
    rows, columns = linear_sum_assignment(distance)
    return distance[rows, columns].max() / np.abs(exact).max()


def orbit_difference(orbit, other, n):
    """Return the largest difference of the first n coordinates, relative to the largest value of each
    coordinate."""
    phase = np.linspace(0.0, 6.2, 63)
    q, better = orbit.at(phase)[:n], other.at(phase)[:n]
    return (np.abs(q - better).max(axis=1) / np.abs(better).max(axis=1)).max()
