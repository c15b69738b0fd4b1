"""Radau's step for several points in Numba: the loops of lanes.c with the points as innermost loop."""

import numba
import numpy as np

quick = numba.njit(error_model="numpy", fastmath={"contract"})


@quick
def subtract(rows, i, k, factor, start):
    """Compute rows[i, start:] -= factor rows[k, start:] for each lane."""
    for j in range(start, rows.shape[1]):
        for p in range(rows.shape[2]):
            rows[i, j, p] -= factor[p] * rows[k, j, p]


@quick
def build(n, h, e, A, A2, c, rows):
    """Build the stage system and its right-hand sides from the entries e (s, 3n² + n, lanes)."""
    s, lanes = e.shape[0], e.shape[2]
    for i in range(s):
        for a in range(n):
            for b in range(n):
                M, C, K = a * n + b, (n + a) * n + b, (2 * n + a) * n + b
                row = i * n + a
                for j in range(s):
                    damped, stiff = h * A[i, j], h * h * A2[i, j]
                    for p in range(lanes):
                        rows[row, j * n + b, p] = damped * e[i, C, p] + stiff * e[i, K, p]
                for p in range(lanes):
                    rows[row, i * n + b, p] += e[i, M, p]
                    rows[row, s * n + b, p] = -e[i, K, p]
                    rows[row, s * n + n + b, p] = -e[i, C, p] - h * c[i] * e[i, K, p]


@quick
def solve(order, rows, factor):
    """Replace the right-hand sides by the solutions, without row exchanges."""
    lanes = rows.shape[2]
    for k in range(order):
        for i in range(k + 1, order):
            for p in range(lanes):
                factor[p] = rows[i, k, p] / rows[k, k, p]
            subtract(rows, i, k, factor, k + 1)
    for k in range(order - 1, -1, -1):
        for i in range(k + 1, order):
            for p in range(lanes):
                factor[p] = rows[k, i, p]
            subtract(rows, k, i, factor, order)
        for p in range(lanes):
            factor[p] = 1 / rows[k, k, p]
        for j in range(order, rows.shape[1]):
            for p in range(lanes):
                rows[k, j, p] *= factor[p]


@quick
def follow(n, h, b, bA, rows, step, x, y):
    """Compute y = (map of the step) x for each lane."""
    s, lanes = len(b), x.shape[2]
    for a in range(n):
        for j in range(2 * n):
            for p in range(lanes):
                step[a, j, p] = (a == j) + h * (n + a == j)
                step[n + a, j, p] = n + a == j
            for i in range(s):
                for p in range(lanes):
                    step[a, j, p] += h * h * bA[i] * rows[i * n + a, s * n + j, p]
                    step[n + a, j, p] += h * b[i] * rows[i * n + a, s * n + j, p]
    y[:] = 0.0
    for i in range(2 * n):
        for j in range(2 * n):
            for k in range(2 * n):
                for p in range(lanes):
                    y[i, j, p] += step[i, k, p] * x[k, j, p]


@quick
def level(n, h, s, steps, table, coefficients, A, A2, b, bA, c):
    """Return Φ (groups, 2n, 2n, lanes) after all steps."""
    groups, columns, lanes = coefficients.shape
    Phi = np.zeros((groups, 2 * n, 2 * n, lanes))
    e, factor = np.empty((s, columns, lanes)), np.empty(lanes)
    rows = np.empty((s * n, s * n + 2 * n, lanes))
    step, y = np.empty((2 * n, 2 * n, lanes)), np.empty((2 * n, 2 * n, lanes))
    for group in range(groups):
        x = Phi[group]
        for i in range(2 * n):
            x[i, i] = 1.0
        for m in range(steps):
            for i in range(s):
                for r in range(columns):
                    for p in range(lanes):
                        e[i, r, p] = table[m * s + i, r] * coefficients[group, r, p]
            build(n, h, e, A, A2, c, rows)
            solve(s * n, rows, factor)
            follow(n, h, b, bA, rows, step, x, y)
            x[:] = y
    return Phi
