"""Reproducible population of random periodic systems on which error estimates and verdicts are tested.

System k depends only on `SEED` and k. The first half are random Fourier series of four alternating kinds. The
others have solutions in closed form (`transformed`) or contain narrow pulses (`pulses`).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from solve import PeriodicSystem
from tests.solve.certificates.pulses import pulsed
from tests.solve.certificates.transformed import BUILT
from tests.solve.certificates.truth import Truth, integrated

SEED = 20241
SIZE = 1000
HALF = SIZE // 2
HARMONICS = 3

SERIES = ("damped soft", "undamped soft", "damped stiff", "undamped stiff")
FURTHER = {**BUILT, "pulses": pulsed}
KINDS = (*SERIES, *FURTHER)


@dataclass(frozen=True)
class Member:
    """System of the population, the speed (rad/s) at which it is solved, and a function that returns its
    reference solution."""

    index: int
    kind: str
    speed: float
    system: PeriodicSystem
    truth: Callable[[], Truth]

    @property
    def n(self) -> int:
        return self.system.n

    @property
    def formula(self) -> bool:
        """Whether the reference solution is a formula. The matrices of the system are then rounded values."""
        return self.kind in BUILT


def kind_of(index: int) -> str:
    """Return the kind of a member. Kinds alternate; each half of the population has its own."""
    if index < HALF:
        return SERIES[index % len(SERIES)]
    return list(FURTHER)[(index - HALF) % len(FURTHER)]


def member(index: int) -> Member:
    kind, rng = kind_of(index), np.random.default_rng((SEED, index))
    if kind in FURTHER:
        speed = float(10 ** rng.uniform(-1.0, 2.0))
        system, truth = FURTHER[kind](rng, speed)
        return Member(index, kind, speed, system, truth)
    system, speed = _series(rng, "stiff" in kind, kind.startswith("damped"))
    return Member(index, kind, speed, system, lambda: integrated(system, speed))


def _series(rng, stiff, damped):
    """Return a system whose M, C, K and d are Fourier series of three harmonics, for 1 to 6 coordinates with
    different units, and its speed.

    The natural frequencies are up to 6 times the speed in soft and up to 120 times the speed in stiff
    systems. The means are M = WᵀW and K = Wᵀ diag(ω²) W. Undamped systems follow from an energy: C = Ṁ, with
    M and K symmetric. Damped systems have varying modal damping, gyroscopic and circulatory terms.
    """
    n, speed = int(rng.integers(1, 7)), float(10 ** rng.uniform(-1.0, 2.0))
    omega = 10 ** rng.uniform(np.log10(0.15), np.log10(120.0 if stiff else 6.0), n)
    W = np.linalg.qr(rng.standard_normal((n, n)))[0] * 10 ** rng.uniform(-1.0, 1.0, n)
    depth = rng.uniform(0.02, 0.3)

    def varying(left, right, symmetric):
        """Return harmonics (2, H, n, n) of leftᵀ S right, where the sum of the spectral norms of S is below
        `depth`."""
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

    return PeriodicSystem(matrices, [f"q{k}" for k in range(1, n + 1)]), speed
