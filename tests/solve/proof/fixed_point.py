"""Monodromy matrices of M q″ + C q′ + K q = 0 from Taylor series in fixed-point integer arithmetic.

The code is independent of the package; it uses mpmath only for sines and cosines.
"""

import itertools
from collections.abc import Callable, Sequence

import mpmath
import numpy as np

BITS = 120
"""Bits behind the binary point; results are right to about 1e-28."""

_ORDER = 40


def fixed(x) -> int:
    return int(mpmath.nint(mpmath.ldexp(x, BITS)))


Term = tuple[int, np.ndarray, np.ndarray]


def trigonometric(terms: Sequence[Term]) -> Callable[[mpmath.mpf, mpmath.mpf], list]:
    """Return the Taylor coefficients in τ at φ + hτ of Σ_r A_r cos rφ + B_r sin rφ; `terms` are (r, A, B)
    with doubles A and B."""

    exact = [(r, _exact(A), _exact(B)) for r, A, B in terms]

    def series(phase, h):
        found = [0 * exact[0][1] for _ in range(_ORDER)]
        for r, A, B in exact:
            cosine, sine, scale = mpmath.cos(r * phase), mpmath.sin(r * phase), mpmath.mpf(1)
            # Derivatives by the angle: f, f′, −f, −f′, …
            value, slope = A * cosine + B * sine, B * cosine - A * sine
            for j in range(_ORDER if r else 1):
                found[j] = found[j] + (slope if j % 2 else value) * (-scale if j % 4 > 1 else scale)
                scale = scale * r * h / (j + 1)
        return [_fixed(x) for x in found]

    return series


def _exact(A) -> np.ndarray:
    return np.vectorize(mpmath.mpf, otypes=[object])(A)


def _fixed(A) -> np.ndarray:
    return np.vectorize(fixed, otypes=[object])(A)


def monodromy(M: Callable, C: Callable, K: Callable, nodes: Sequence[mpmath.mpf]) -> mpmath.matrix:
    """Return Φ (2n, 2n) over the nodes. M, C and K are functions of a phase and a step that return
    fixed-point Taylor coefficients (n, n)."""
    with mpmath.workprec(BITS + 40):
        n = len(M(nodes[0], mpmath.mpf(1))[0])
        one = 1 << BITS
        state = np.array([[one * int(i == j) for j in range(2 * n)] for i in range(2 * n)], dtype=object)
        for start, end in itertools.pairwise(nodes):
            state = _step(M, C, K, start, end - start, state)
        return mpmath.matrix([[mpmath.ldexp(mpmath.mpf(x), -BITS) for x in row] for row in state.tolist()])


def _step(M, C, K, start, h, state) -> np.ndarray:
    n = len(state) // 2
    m, c, k = M(start, h), C(start, h), K(start, h)
    h1, h2 = fixed(h), fixed(h * h)
    c, k = [(x * h1) >> BITS for x in c], [(x * h2) >> BITS for x in k]
    lead = mpmath.matrix([[mpmath.ldexp(mpmath.mpf(x), -BITS) for x in row] for row in m[0].tolist()])
    inverse = _fixed(np.array((lead**-1).tolist(), dtype=object).reshape(n, n))
    q = [state[:n], (state[n:] * h1) >> BITS]
    factors = np.arange(_ORDER).astype(object)[:, None, None]
    # Coefficients beside each other, the highest first, against solutions one above the other.
    parts = (m[:0:-1], c[::-1], k[::-1])
    rows = [np.hstack(part) for part in parts]
    for j in range(_ORDER - 2):
        solution = np.stack(q)
        rate = solution[1:] * factors[1 : j + 2]
        curvature = solution[2:] * (factors[2 : j + 2] * factors[1 : j + 1])
        columns = [part.reshape(-1, 2 * n) for part in (curvature, rate, solution[: j + 1])]
        force = sum(A[:, A.shape[1] - len(B) :] @ B for A, B in zip(rows, columns, strict=True) if len(B))
        q.append(-((inverse @ (force >> BITS)) >> BITS) // ((j + 2) * (j + 1)))
    value = sum(q[1:], q[0])
    rate = sum(j * x for j, x in enumerate(q))
    back = fixed(1 / h)
    return np.vstack((value, (rate * back) >> BITS))


def multipliers(Phi: mpmath.matrix) -> list:
    with mpmath.workprec(BITS):
        return list(mpmath.eig(Phi)[0])
