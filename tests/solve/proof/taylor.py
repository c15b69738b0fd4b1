"""Periodic orbits of Duffing's equation by Taylor series in mpmath: q̈ + 2ζ q̇ + k q + α q³ = f cos Ωt."""

from functools import cache

import mpmath

_ORDER, _STEPS = 27, 36


@cache
def duffing_orbit(zeta, k, alpha, f, speed, start, digits=22):
    """Return q and q̇ at phase 0 of the orbit near an initial state, and its monodromy matrix in terms of
    time derivatives."""
    numbers = {"zeta": zeta, "k": k, "alpha": alpha, "f": f}
    with mpmath.workdps(digits + 10):
        values = {name: mpmath.mpf(value) for name, value in numbers.items()}
        state, omega = mpmath.matrix([mpmath.mpf(x) for x in start]), mpmath.mpf(speed)
        for _ in range(8):
            end, Phi = _period(values, omega, state)
            change = mpmath.lu_solve(Phi - mpmath.eye(2), end - state)
            state = state - change
            if mpmath.norm(change) < mpmath.mpf(10) ** -digits:
                return state, Phi
    raise AssertionError("Newton's iteration does not converge")


def _period(values, omega, state):
    h, Phi = 2 * mpmath.pi / omega / _STEPS, mpmath.eye(2)
    for step in range(_STEPS):
        q, columns = _series(values, omega, step * h, state, Phi)
        state = mpmath.matrix(_at_end(q, h))
        Phi = mpmath.matrix([*zip(*(_at_end(u, h) for u in columns), strict=True)])
    return state, Phi


def _series(values, omega, t, state, Phi):
    """Return the Taylor coefficients of q and of its derivatives u with respect to the initial state."""
    zeta, k, alpha, f = (values[name] for name in ("zeta", "k", "alpha", "f"))
    q = [state[0], state[1]]
    columns = [[Phi[0, j], Phi[1, j]] for j in range(2)]
    for m in range(_ORDER):
        squares = [sum(q[i] * q[s - i] for i in range(s + 1)) for s in range(m + 1)]
        cube = sum(squares[s] * q[m - s] for s in range(m + 1))
        load = f * omega**m / mpmath.factorial(m) * mpmath.cos(omega * t + m * mpmath.pi / 2)
        q.append((load - 2 * zeta * (m + 1) * q[m + 1] - k * q[m] - alpha * cube) / ((m + 1) * (m + 2)))
        for u in columns:
            force = 3 * alpha * sum(squares[s] * u[m - s] for s in range(m + 1))
            u.append((-2 * zeta * (m + 1) * u[m + 1] - k * u[m] - force) / ((m + 1) * (m + 2)))
    return q, columns


def _at_end(c, h):
    value = sum(x * h**m for m, x in enumerate(c))
    return value, sum(m * x * h ** (m - 1) for m, x in enumerate(c) if m)
