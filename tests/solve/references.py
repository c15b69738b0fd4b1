"""Reference solutions by independent code."""

import mpmath
import numpy as np
from scipy.integrate import solve_ivp


def rate_matrices(system, phase, speed):
    """Return P (m, 2n, 2n) and f (m, 2n) of x′ = P x + f at the phases (m,), where derivatives are with
    respect to the phase, chapter Eq. (5)."""
    M, C, K, d = system.at(np.asarray(phase), speed)
    m, n = d.shape
    inverse = np.linalg.inv(M * speed**2)
    P = np.zeros((m, 2 * n, 2 * n))
    P[:, :n, n:] = np.eye(n)
    P[:, n:] = np.concatenate((-inverse @ K, -speed * inverse @ C), axis=2)
    return P, np.concatenate((np.zeros((m, n)), (inverse @ d[..., None])[..., 0]), axis=1)


class Shooting:
    """Integration of the matrix differential equation for [Φ | x] by DOP853, and the orbit by single
    shooting."""

    def __init__(self, system, speed, rtol=1e-13):
        N = 2 * system.n

        def rate(phase, y):
            P, f = rate_matrices(system, [phase], speed)
            change = P[0] @ y.reshape(N, N + 1)
            change[:, -1] += f[0]
            return change.ravel()

        start = np.eye(N, N + 1).ravel()
        ends = (0.0, system.period)
        self._run = solve_ivp(rate, ends, start, "DOP853", dense_output=True, rtol=rtol, atol=1e-14)
        self._shape = N, N + 1
        whole = self._run.y[:, -1].reshape(self._shape)
        self.Phi = whole[:, :-1]
        self.start = np.linalg.solve(np.eye(N) - self.Phi, whole[:, -1])

    def states(self, phase):
        """Return x = (q, dq/dphase) of the periodic solution at the phases (k,) as an array (2n, k)."""
        maps = self._run.sol(phase).T.reshape(-1, *self._shape)
        return (maps[:, :, :-1] @ self.start + maps[:, :, -1]).T

    @property
    def multipliers(self):
        return np.linalg.eigvals(self.Phi)


def relative_error(q, truth):
    """Return the largest max|error|/max|truth| over a revolution among the coordinates. Both arrays are (n,
    k)."""
    return float((np.abs(q - truth).max(axis=1) / np.abs(truth).max(axis=1)).max())


def multiplier_error(values, truth):
    """Return the largest distance to the nearest true multiplier, relative to the true spectral radius."""
    values, truth = np.asarray(values), np.asarray(truth)
    return float(np.abs(values[:, None] - truth).min(axis=1).max() / np.abs(truth).max())


def slope(steps, errors):
    """Return the order of convergence: the least-squares slope of log error versus log step length."""
    return float(-np.polyfit(np.log(steps), np.log(errors), 1)[0])


def closed_chain(A, b, digits=80):
    """Return the states (m, N) of x_{k+1} = A_k x_k + b_k with x_m = x_0, computed with the given number of
    digits."""
    with mpmath.workdps(digits):
        turn, end = mpmath.eye(b.shape[1]), mpmath.zeros(b.shape[1], 1)
        steps = [
            (mpmath.matrix(map_.tolist()), mpmath.matrix(load.tolist()))
            for map_, load in zip(A, b, strict=True)
        ]
        for map_, load in steps:
            turn, end = map_ * turn, map_ * end + load
        x = mpmath.lu_solve(mpmath.eye(b.shape[1]) - turn, end)
        states = []
        for map_, load in steps:
            states.append([float(value) for value in x])
            x = map_ * x + load
    return np.array(states)
