"""Random periodic systems, the same in every run: the population that judges the error estimates.

System k of the population depends on `SEED` and k alone. The four kinds take turns: damped or
undamped, soft (natural frequencies to 6 times the speed) or stiff (to 120 times).
"""

from dataclasses import dataclass

import numpy as np

from solve import PeriodicSystem

SEED = 20241
SIZE = 500
HARMONICS = 3


@dataclass(frozen=True)
class Member:
    """One system of the population and the speed (rad/s) at which it is solved."""

    index: int
    damped: bool
    stiff: bool
    speed: float
    system: PeriodicSystem


def member(index):
    """M, C, K, d as Fourier series of three harmonics, of 1 to 6 coordinates in units of their own.

    Means: M = WᵀW and K = Wᵀ diag(ω²) W. Undamped systems are those of an energy, C = Ṁ and M, K
    symmetric; damped ones have modal damping, gyroscopic and circulatory parts, all of them varying.
    """
    rng = np.random.default_rng((SEED, index))
    n, speed = int(rng.integers(1, 7)), float(10 ** rng.uniform(-1.0, 2.0))
    damped, stiff = index % 2 == 0, index % 4 >= 2
    omega = 10 ** rng.uniform(np.log10(0.15), np.log10(120.0 if stiff else 6.0), n)
    W = np.linalg.qr(rng.standard_normal((n, n)))[0] * 10 ** rng.uniform(-1.0, 1.0, n)
    depth = rng.uniform(0.02, 0.3)

    def varying(left, right, symmetric):
        """Harmonics (2, H, n, n) of leftᵀ S right with a spectral norm of all S together below `depth`."""
        S = rng.standard_normal((2, HARMONICS, n, n))
        S = S + np.swapaxes(S, 2, 3) if symmetric else S
        S *= depth / np.linalg.norm(S, 2, axis=(2, 3)).sum()
        return left.T @ S @ right

    inertia, stiffness = W, omega[:, None] * W
    M, dM = W.T @ W, varying(inertia, inertia, symmetric=True)
    K, dK = stiffness.T @ stiffness, varying(stiffness, stiffness, symmetric=not damped)
    zeta = 10 ** rng.uniform(-3.0, -0.5, n)
    G = rng.standard_normal((n, n))
    C = inertia.T @ (np.diag(2 * zeta * omega) + 0.2 * (G - G.T)) @ inertia
    dC = varying(inertia, inertia, symmetric=False)
    d = W.T @ (omega * rng.standard_normal(n))
    dd = rng.standard_normal((2, HARMONICS, n)) @ stiffness

    def matrices(phase, Omega):
        angles = np.outer(phase, np.arange(1, HARMONICS + 1))
        cosines, sines = np.cos(angles), np.sin(angles)

        def series(mean, harmonics):
            return mean + np.tensordot(cosines, harmonics[0], 1) + np.tensordot(sines, harmonics[1], 1)

        orders = np.arange(1, HARMONICS + 1)[:, None, None]
        slope = np.tensordot(cosines, orders * dM[1], 1) - np.tensordot(sines, orders * dM[0], 1)
        rates = series(C, dC) if damped else slope
        # Everything above is by phase at the member's own speed; the contract is by time.
        return series(M, dM) / Omega**2, rates / Omega, series(K, dK), series(d, dd)

    system = PeriodicSystem(matrices, [f"q{k}" for k in range(1, n + 1)])
    return Member(index, damped, stiff, speed, system)
