"""Proofs for constant coefficients with extreme units, speeds or periods or with nearly defective
multipliers, compared with matrix exponentials with hundreds of digits."""

import mpmath
import numpy as np
import pytest

pytest.importorskip("flint")

import solve

TURN = 2 * np.pi
DIGITS = 300

CASES = {
    "tiny units": ([[1e-120]], [[1e-121]], [[3e-120]], TURN, 1.0, "asymptotically stable"),
    "huge units": ([[1e130]], [[1e129]], [[3e130]], TURN, 1.0, "asymptotically stable"),
    "mixed units": (
        *([[1e60, 0], [0, 1e-60]], [[1e59, 0], [0, 1e-61]], [[2e60, 1e-3], [1e-3, 5e-60]]),
        *(TURN, 1.0, "asymptotically stable"),
    ),
    "defective": (np.eye(2), 0.2 * np.eye(2), [[1, 1], [0, 1]], TURN, 1.0, "asymptotically stable"),
    "nearly defective": (
        np.eye(2),
        0.2 * np.eye(2),
        [[1, 1], [1e-30, 1]],
        TURN,
        1.0,
        "asymptotically stable",
    ),
    "rational period": ([[1.0]], [[0.1]], [[2.0]], 0.1, 1.0, "asymptotically stable"),
    "low speed": ([[1.0]], [[0.1]], [[2.0]], TURN, 0.02, "asymptotically stable"),
    "high speed": ([[1.0]], [[0.1]], [[2.0]], TURN, 1e6, "asymptotically stable"),
    "negative mass": ([[-1.0]], [[-0.1]], [[-2.0]], TURN, 1.0, "asymptotically stable"),
    "nearly undamped": ([[1.0]], [[-(2.0**-70)]], [[1.3]], TURN, 1.0, "unstable"),
    "on the circle": ([[1.0]], [[0.0]], [[1.0]], TURN, 1.0, "undetermined"),
}
"""M, C, K, period, speed, and the verdict that follows from the exact exponents."""


def exponentials(M, C, K, period, speed):
    """Return the multipliers from the roots of the characteristic polynomial of the state matrix."""
    M, C, K = (mpmath.matrix(np.array(x, dtype=float).tolist()) for x in (M, C, K))
    n = M.rows
    A = mpmath.zeros(2 * n)
    A[:n, n:] = mpmath.eye(n)
    A[n:, :n], A[n:, n:] = -(M**-1) * K, -(M**-1) * C
    T = 2 * mpmath.pi if period == TURN else mpmath.mpf(period)
    return [mpmath.exp(x * T / speed) for x in mpmath.eig(A, left=False, right=False)]


@pytest.mark.parametrize("name", CASES)
def test_proofs_contain_the_multipliers_of_extreme_systems(name):
    *matrices, period, speed, verdict = CASES[name]
    M, C, K = (np.array(x, dtype=float) for x in matrices)

    def constant(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one * M, one * C, one * K, np.zeros((len(phase), len(M)))

    system = solve.PeriodicSystem(constant, [f"q{i}" for i in range(len(M))], period)
    proof = solve.prove(system, speed, orbit=False)
    with mpmath.workdps(DIGITS):
        exact = exponentials(M, C, K, period, speed)
        low, high = map(mpmath.mpf, proof.spectral_radius)
        slack = mpmath.mpf(10) ** (20 - DIGITS // 2)
        assert low - slack <= max(map(abs, exact)) <= high + slack
        discs = [*zip(proof.multipliers.tolist(), proof.radii.tolist(), proof.isolated.tolist(), strict=True)]
        assert all(any(abs(x - center) <= r for center, r, _ in discs) for x in exact)
        assert all(sum(abs(x - center) <= r for x in exact) == 1 for center, r, alone in discs if alone)
    assert proof.verdict == verdict
