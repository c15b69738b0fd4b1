"""CasADi programs that a user might write: its integrator for the matrix equation, and accumulated steps.

Both are built before timing, as users would do. Each returns phases (k,), q (3, k) and the multipliers.
"""

import functools

import casadi as ca
import numpy as np

from tests.benchmarks.peers import C1, C2, C3, I1, K1, K2, K3, LAW, M2, M3, ORDERS, PERIOD, SPEED, F


def rate(t, y):
    """d/dt of [Φ | x] (6, 7), chapter Eqs. (5), (64), (65)."""
    angle = SPEED * t
    terms = [(float(a), int(k)) for a, k in zip(LAW, ORDERS, strict=True) if a]
    U1 = sum(a * ca.cos(k * angle) for a, k in terms)
    U2 = -sum(a * k * ca.sin(k * angle) for a, k in terms)
    U3 = -sum(a * k**2 * ca.cos(k * angle) for a, k in terms)
    m, w = M2 + M3, SPEED
    M = ca.vertcat(
        ca.horzcat(I1 + m * U1**2, m * U1, M3 * U1), ca.horzcat(m * U1, m, M3), ca.horzcat(M3 * U1, M3, M3)
    )
    C = ca.vertcat(
        ca.horzcat(C1 + 2 * m * w * U1 * U2, 0, 0),
        ca.horzcat(2 * m * w * U2, C2, 0),
        ca.horzcat(2 * M3 * w * U2, 0, C3),
    )
    K = ca.vertcat(
        ca.horzcat(K1 + F * U2 + m * w**2 * (U1 * U3 + U2**2), 0, 0),
        ca.horzcat(m * w**2 * U3, K2, 0),
        ca.horzcat(M3 * w**2 * U3, 0, K3),
    )
    d = ca.vertcat(-F * U1 - m * w**2 * U1 * U2, -F - m * w**2 * U2, -F - M3 * w**2 * U2)
    force = ca.horzcat(ca.DM.zeros(3, 6), d) - K @ y[:3, :] - C @ y[3:, :]
    return ca.vertcat(y[3:, :], ca.solve(M, force))


@functools.cache
def _integrator(rtol, nodes):
    t, y = ca.SX.sym("t"), ca.SX.sym("y", 42)
    ode = ca.vec(rate(t, ca.reshape(y, 6, 7)))
    times = np.linspace(0.0, PERIOD, nodes + 1)
    options = {"reltol": rtol, "abstol": 1e-3 * rtol, "max_num_steps": 1_000_000}
    return ca.integrator("turn", "cvodes", {"t": t, "x": y, "ode": ode}, 0.0, times[1:], options)


def cvodes(rtol, nodes=500):
    """The variable-order integrator of SUNDIALS, and single shooting."""
    start = np.eye(6, 7).ravel(order="F")
    ends = _integrator(rtol, nodes)(x0=start)["xf"].full()
    return closed(np.column_stack((start, ends)))


@functools.cache
def _accumulated(steps):
    h = PERIOD / steps
    t, y = ca.SX.sym("t"), ca.SX.sym("y", 6, 7)
    k1 = rate(t, y)
    k2 = rate(t + h / 2, y + h / 2 * k1)
    k3 = rate(t + h / 2, y + h / 2 * k2)
    k4 = rate(t + h, y + h * k3)
    end = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    step = ca.Function("advance", [ca.vec(y), t], [ca.vec(end)])
    return step.mapaccum("turn", steps)


def mapaccum(steps):
    """Runge–Kutta 4 accumulated over the steps, and single shooting."""
    start = np.eye(6, 7).ravel(order="F")
    times = np.arange(steps) * (PERIOD / steps)
    return closed(np.column_stack((start, _accumulated(steps)(start, times).full())))


def closed(states):
    """Return the orbit of [Φ | x] at the nodes, (42, k)."""
    maps = states.T.reshape(-1, 7, 6).transpose(0, 2, 1)
    Phi, c = maps[-1, :, :6], maps[-1, :, 6]
    x = maps[:, :, :6] @ np.linalg.solve(np.eye(6) - Phi, c) + maps[:, :, 6]
    return np.linspace(0.0, 2 * np.pi, len(x)), x[:, :3].T, np.linalg.eigvals(Phi)
