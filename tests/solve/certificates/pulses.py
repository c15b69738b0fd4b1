"""Systems with narrow pulses of stiffness, damping and load, whose edges are declared as breaks."""

import numpy as np

from solve import PeriodicSystem
from tests.solve.certificates.truth import integrated


def pulsed(rng, speed):
    """Return a system of 1 to 3 coordinates with one or two rectangular or parabolic pulses. Their widths are
    from T/30 to T/30 000. The area of each is large enough to change a multiplier significantly."""
    n = int(rng.integers(1, 4))
    omega, zeta = 10 ** rng.uniform(-0.7, 0.9, n), 10 ** rng.uniform(-3.0, -0.7, n)
    V = np.linalg.qr(rng.standard_normal((n, n)))[0]
    damped = rng.random() < 0.75
    K0, C0 = V @ np.diag(omega**2) @ V.T, V @ np.diag(2 * zeta * omega * damped) @ V.T
    count = int(rng.integers(1, 3))
    places = np.sort(rng.uniform(0.2, 2.9, count)) + np.pi * np.arange(count)
    widths = 2 * np.pi * 10 ** rng.uniform(-4.5, -1.5, count)
    height = rng.uniform(0.1, 1.0, count) / widths
    bump = rng.standard_normal((count, n, n))
    bump = (bump + np.swapaxes(bump, 1, 2)) / (2 * n)
    kick, mean, wave = rng.standard_normal((count, n)), rng.standard_normal(n), rng.standard_normal((2, n))
    arc, damping = bool(rng.integers(2)), damped * rng.uniform(0.0, 0.3, count)
    edges = np.concatenate((places, places + widths))

    def matrices(phase, Omega):
        turned = np.remainder(phase, 2 * np.pi)
        x = 2 * (turned[:, None] - places) / widths - 1
        pulse = np.where(np.abs(x) < 1, height * (1.5 * (1 - x**2) if arc else 1.0), 0.0)
        one = np.ones((len(phase), 1, 1))
        C = C0 + np.einsum("pc,c->p", pulse, damping)[:, None, None] * np.eye(n)
        d = mean + np.cos(phase)[:, None] * wave[0] + np.sin(2 * phase)[:, None] * wave[1] + pulse @ kick
        return one * np.eye(n) / Omega**2, C / Omega, K0 + np.tensordot(pulse, bump, 1), d

    system = PeriodicSystem(matrices, [f"q{k}" for k in range(1, n + 1)], breaks=tuple(np.sort(edges)))
    return system, lambda: integrated(system, speed)
