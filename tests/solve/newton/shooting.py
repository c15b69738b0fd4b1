"""Shooting with SciPy's DOP853 and the variational equations: folds, period doublings and torus
bifurcations."""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve


def settled(acceleration, speed, start, periods, p):
    """State after a number of periods of q̈ = acceleration(φ, q, q̇, p)."""
    n = len(start) // 2

    def rate(t, x):
        return np.append(x[n:], acceleration(speed * t, x[:n], x[n:], p))

    last = 2 * np.pi * periods / speed
    return solve_ivp(rate, (0, last), start, "DOP853", rtol=1e-10, atol=1e-10).y[:, -1]


def period_map(acceleration, jacobian, speed, start, periods, p):
    """Return the state after some periods, and its derivatives with respect to the initial state. `jacobian`
    returns ∂q̈/∂(q, q̇) (n, 2n)."""
    n = len(start) // 2

    def rate(t, y):
        x, Phi = y[: 2 * n], y[2 * n :].reshape(2 * n, 2 * n)
        A = np.vstack((np.eye(2 * n)[n:], jacobian(speed * t, x[:n], x[n:], p)))
        return np.concatenate((x[n:], acceleration(speed * t, x[:n], x[n:], p), (A @ Phi).ravel()))

    first = np.append(start, np.eye(2 * n).ravel())
    run = solve_ivp(rate, (0, 2 * np.pi * periods / speed), first, "DOP853", rtol=3e-14, atol=1e-14)
    return run.y[: 2 * n, -1], run.y[2 * n :, -1].reshape(2 * n, 2 * n)


def located(residual, mapped, start, p):
    """Return parameter and state of an orbit with residual(Φ) = 0. `mapped(x, p)` returns what `period_map`
    returns."""

    def equations(z):
        after, Phi = mapped(z[:-1], z[-1])
        return np.append(after - z[:-1], residual(Phi))

    found, _, flag, text = fsolve(equations, np.append(start, p), full_output=True, xtol=1e-13)
    assert flag == 1 or np.abs(equations(found)).max() < 1e-11, text
    return found[-1], found[:-1]


def fold(Phi):
    return np.linalg.det(Phi - np.eye(len(Phi)))


def doubling(Phi):
    return np.linalg.det(Phi + np.eye(len(Phi)))


def torus(Phi):
    """|ρ| - 1 for the complex pair nearest to the unit circle."""
    moduli = np.abs([rho for rho in np.linalg.eigvals(Phi) if abs(rho.imag) > 1e-9])
    return moduli[np.abs(moduli - 1).argmin()] - 1
