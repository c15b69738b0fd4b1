"""python -m tests.benchmarks.jax_sweep (where JAX is installed): the cam at 200 speeds by RK4.

The matrices of chapter Eq. (64) are functions of the phase and the speed. One scan over 9300 steps computes
[Φ | x]; `vmap` applies it to all speeds. The program is compiled, with float64 and one thread. Orbits follow
from the closed affine map and a second scan.
"""

import statistics
import time

import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)

I1, M2, M3, F = 0.12, 28.0, 50.0, 100.0
K1, K2, K3, C1, C2, C3 = 8e4, 8.2e8, 2.6e8, 18.5, 1400.0, 1200.0
ORDERS, LAW = jnp.array([1.0, 3.0, 5.0]), jnp.array([0.22165, 0.05560, -0.01706])
STEPS = 9300
SPEEDS = jnp.linspace(300, 900, 200) * jnp.pi / 30


def rate(phase, speed, y):
    """dy/dphase of y = [Φ | x] (6, 7)."""
    U1 = jnp.sum(LAW * jnp.cos(ORDERS * phase))
    U2 = -jnp.sum(LAW * ORDERS * jnp.sin(ORDERS * phase))
    U3 = -jnp.sum(LAW * ORDERS**2 * jnp.cos(ORDERS * phase))
    m, w = M2 + M3, speed
    M = jnp.array([[I1 + m * U1**2, m * U1, M3 * U1], [m * U1, m, M3], [M3 * U1, M3, M3]])
    C = jnp.array([[C1 + 2 * m * w * U1 * U2, 0, 0], [2 * m * w * U2, C2, 0], [2 * M3 * w * U2, 0, C3]])
    K = jnp.array(
        [
            [K1 + F * U2 + m * w**2 * (U1 * U3 + U2**2), 0, 0],
            [m * w**2 * U3, K2, 0],
            [M3 * w**2 * U3, 0, K3],
        ]
    )
    d = jnp.array([-F * U1 - m * w**2 * U1 * U2, -F - m * w**2 * U2, -F - M3 * w**2 * U2])
    force = -K @ y[:3] - w * C @ y[3:]
    force = force.at[:, 6].add(d)
    return jnp.concatenate((y[3:], jnp.linalg.solve(w**2 * M, force)))


def step(speed, y, phase):
    h = 2 * jnp.pi / STEPS
    k1 = rate(phase, speed, y)
    k2 = rate(phase + h / 2, speed, y + h / 2 * k1)
    k3 = rate(phase + h / 2, speed, y + h / 2 * k2)
    k4 = rate(phase + h, speed, y + h * k3)
    return y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def largest(speed):
    """Return max|q| (3,) of the periodic solution and |Φ| at one speed."""
    phases = jnp.arange(STEPS) * (2 * jnp.pi / STEPS)
    scan = lambda y, phase: (step(speed, y, phase), y)  # noqa: E731
    end, maps = jax.lax.scan(scan, jnp.eye(6, 7), phases)
    start = jnp.linalg.solve(jnp.eye(6) - end[:, :6], end[:, 6])
    states = maps[:, :, :6] @ start + maps[:, :, 6]
    return jnp.abs(states[:, :3]).max(axis=0), end[:, :6]


def main() -> None:
    run = jax.jit(jax.vmap(largest))
    q, Phi = (part.block_until_ready() for part in run(SPEEDS))
    times = []
    for _ in range(5):
        start = time.process_time()
        jax.block_until_ready(run(SPEEDS))
        times.append(time.process_time() - start)
    radius = np.abs(np.linalg.eigvals(np.asarray(Phi))).max(axis=1)
    print(f"JAX vmap RK4, {len(SPEEDS)} speeds, {STEPS} steps: {statistics.median(times):.3f} s")
    print(f"at 600 rpm: max|q3| {float(q[100, 2]):.6e} (nearest speed), |ρ| {radius[100]:.8f}")


if __name__ == "__main__":
    main()
