"""Coefficients and stage equations of collocation in Nyström form, for the Gauss and Radau methods.

At the fractions c_i of a step of length h, the stage accelerations a_i and the stage values v_i = v + h Σ
A_ij a_j and q_i = q + h c_i v + h² Σ (A²)_ij a_j satisfy the equation of motion. This is one linear system of
size s n per step, without an inverse of M (E. Hairer, G. Wanner, Solving Ordinary Differential Equations II,
IV.5). The second-order form is exactly equivalent to the method applied to the first-order system for q and
q′."""

from dataclasses import dataclass
from functools import cache, cached_property
from itertools import product

import numpy as np

from solve.arrays import Array, solved
from solve.kernel.library import Constants
from solve.period.curve import Curve
from solve.period.period_map import Steps

_STEP_BY_STEP = 18
"""Number of coordinates above which the systems of the steps are solved one after another, in place and in
LAPACK's memory order. Measured time, relative to solving many steps in one call: 0.7 with 24 coordinates, 0.6
with 108, about 1 with 15 to 18, and 1/0.6 with 9."""

_INFINITE = 1e25
"""Modulus above which hλ counts as infinite. Powers up to the twelfth are representable."""

_SYSTEMS = 2**19
"""Size in bytes of the stage systems that are solved in one call. They fit into the processor's cache."""


@dataclass(frozen=True)
class Collocation:
    """Collocation method with nodes c (s,) in (0, 1]."""

    c: tuple[float, ...]

    @cached_property
    def _legendre(self) -> Array:
        """Shifted Legendre polynomials P_0 … P_s on [0, 1], evaluated at the s nodes (s, s+1).

        If powers of the nodes were used instead, A would lose three digits at s = 8."""
        return np.polynomial.legendre.legvander(2 * np.array(self.c) - 1, len(self.c))

    @cached_property
    def A(self) -> Array:
        """Runge–Kutta matrix (s, s): integrals of the Lagrange polynomials from 0 to c_i, for each node
        c_i."""
        P, k = self._legendre, np.arange(1, len(self.c))
        integrals = np.column_stack((np.array(self.c), (P[:, k + 1] - P[:, k - 1]) / (4 * k + 2)))
        return integrals @ np.linalg.inv(P[:, :-1])

    @cached_property
    def b(self) -> Array:
        """Weights (s,): integrals of the Lagrange polynomials from 0 to 1."""
        return np.linalg.inv(self._legendre[:, :-1])[0]

    @cached_property
    def stiffly_accurate(self) -> bool:
        """Whether the end of the step is a stage."""
        return self.c[-1] == 1.0

    @cached_property
    def curve_nodes(self) -> tuple[float, ...]:
        """Fractions of the step at which the curve has the accelerations of the solution.

        The end of the step is added only if s ≥ 3: the quadrature must be exact for the curve, so that the
        integral of the curve agrees with the step."""
        return (0.0, *self.c) if self.stiffly_accurate or len(self.c) < 3 else (0.0, *self.c, 1.0)

    @cached_property
    def weights(self) -> Constants:
        """Mapping from names in the compiled kernels to coefficients of the method."""
        A, b = self.A, self.b
        found = {"A": A, "A2": A @ A, "b": b, "bA": b @ A, "c": np.array(self.c), "powers": self.curve_powers}
        return Constants((name, np.ascontiguousarray(part)) for name, part in found.items())

    def bytes_a_step(self, n: int) -> int:
        """Memory in bytes per step for n coordinates. It includes stage accelerations, maps and their
        products, and the same data of the coarser grid. If steps are solved in one call, it also includes
        samples and right-hand sides."""
        s = len(self.c)
        kept = s * n * (2 * n + 1) + 16 * n**2
        together = s * (3 * n**2 + n) + s * n * (2 * n + 1) + 4 * n**2
        return 8 * (kept + (together if n < _STEP_BY_STEP else 0))

    def stability_function(self, z: Array) -> Array:
        """Stability function R(z) = 1 + z bᵀ(1 − zA)⁻¹e (…) with z = hλ. A step multiplies a mode with
        eigenvalue λ by this factor (E. Hairer, G. Wanner, Solving ODEs II, Eq. (IV.3.2))."""
        above, below = self._stability
        z = np.where(np.abs(z) < _INFINITE, z, -_INFINITE)
        return _polynomial(above, z) / _polynomial(below, z)

    @cached_property
    def _stability(self) -> tuple[Array, Array]:
        """Coefficients (s+1,) of the numerator det(1 − zA + z e bᵀ) and of the denominator det(1 − zA) of R,
        highest power first."""
        above, below = (np.real(np.poly(part))[::-1] for part in (self.A - self.b, self.A))
        return above, below

    @cached_property
    def curve_powers(self) -> Array:
        """Matrix (D, 2 + nodes) that maps data of a step to coefficients of powers of θ. The data are q, h v,
        and h² times the accelerations at the nodes of the curve."""
        nodes = np.array(self.curve_nodes)
        k = np.arange(len(nodes))
        acceleration = np.linalg.inv(nodes[:, None] ** k)
        powers = np.zeros((len(nodes) + 2, len(nodes) + 2))
        powers[0, 0] = powers[1, 1] = 1.0
        powers[2:, 2:] = acceleration / ((k + 1) * (k + 2))[:, None]
        return powers

    @cached_property
    def rate_powers(self) -> Array:
        """Matrix (D, 1 + nodes) like `curve_powers`, for first-order coordinates. The data are q, and h times
        the rates at the nodes of the curve. The coefficient of the highest power is zero."""
        powers = np.zeros_like(self.curve_powers)[:, 1:]
        powers[0, 0] = 1.0
        powers[1:-1, 1:] = self.curve_powers[2:, 2:] * np.arange(2, len(powers))[:, None]
        return powers

    def stage_accelerations(self, h: Array, M: Array, C: Array, K: Array, d: Array) -> Array:
        """Stage accelerations (P, m, s, n, 2n+r) as affine functions of (q, v) at the start of the step and
        of r loads.

        h (m,): step lengths. M, C, K (P, m, s, n, n) and d (P, m, s, n, r), or (P, m, s, n) for one load:
        matrices and loads at the stages."""
        P, m, s, n = d.shape[:4]
        a = np.empty((P, m, s * n, 2 * n + d[0, 0, 0, 0].size))
        (self._solve_together if n < _STEP_BY_STEP else self._solve_step_by_step)(a, h, M, C, K, d)
        return a.reshape(P, m, s, n, -1)

    def _solve_together(self, a: Array, h: Array, M: Array, C: Array, K: Array, d: Array) -> None:
        """Write the stage accelerations into a (P, m, s n, 2n+r). Many steps are solved in one call, which is
        efficient for small systems."""
        P, m, s, n = d.shape[:4]
        # The number of steps per chunk does not depend on the number of points, so that round-off is
        # reproducible.
        steps = min(m, max(1, _SYSTEMS // (8 * (s * n) ** 2)))
        some = max(1, _SYSTEMS // (8 * (s * n) ** 2 * steps))
        for first, start in product(range(0, P, some), range(0, m, steps)):
            part = np.s_[first : first + some, start : start + steps]
            system = self._stage_systems(h[part[1]], M[part], C[part], K[part])
            loads = d[part].reshape(*system.shape[:3], -1)
            right = np.concatenate((system[..., s * n :], loads), axis=-1)
            a[part] = solved(system[..., : s * n], right)
        # Convert h² times the accelerations to accelerations, and coefficients of h v to coefficients of v.
        a[..., :n] /= h[:, None, None] ** 2
        a[..., n : 2 * n] /= h[:, None, None]

    def _solve_step_by_step(self, a: Array, h: Array, M: Array, C: Array, K: Array, d: Array) -> None:
        """Write the stage accelerations into a (P, m, s n, 2n+r), with one in-place factorisation per step
        for all right-hand sides."""
        # Importing SciPy's LAPACK interface takes longer than many commands.
        from scipy.linalg.lapack import dgesv  # pyright: ignore[reportAttributeAccessIssue]

        P, m, s, n = d.shape[:4]
        loads = d.reshape(P, m, s * n, -1)
        # Rows of this array are LAPACK's columns: the system, then right-hand sides for q, h v and the loads.
        columns = np.empty((s * n + a.shape[-1], s * n))
        blocks, terms = columns[: (s + 2) * n].reshape(s + 2, n, s, n), np.empty((s, 3, n, n))
        for point, step in product(range(P), range(m)):
            at, size = (point, step), h[step]
            for term, part in enumerate((M, C, K)):
                np.multiply(size**term, np.swapaxes(part[at], 1, 2), out=terms[:, term])
            products = (self.stage_weights @ terms.reshape(s, 3, n * n)).reshape(s, s + 2, n, n)
            blocks[:] = np.moveaxis(products, 0, 2)
            columns[(s + 2) * n :] = loads[at].T
            _, _, x, singular = dgesv(
                columns[: s * n].T, columns[s * n :].T, overwrite_a=True, overwrite_b=True
            )
            x[:, :n] /= size**2
            x[:, n : 2 * n] /= size
            a[at] = np.nan if singular else x

    def _stage_systems(self, h: Array, M: Array, C: Array, K: Array) -> Array:
        """Matrices (P, m, s n, s n + 2n) of the equations for the stage accelerations: the system matrix,
        followed by the matrices that multiply q and h v.

        All of them are linear combinations of M, hC and h²K with constant weights."""
        P, m, s, n = M.shape[:4]
        h = h[:, None, None]
        system = np.empty((P, m, s, n, s + 2, n))
        for i in range(s):
            rows = np.concatenate((M[:, :, i], h * C[:, :, i], h**2 * K[:, :, i]), axis=-1)
            products = rows.reshape(P, m * n, 3 * n) @ _of_rows(self, i, n)
            system[:, :, i] = products.reshape(P, m, n, s + 2, n)
        return system.reshape(P, m, s * n, (s + 2) * n)

    @cached_property
    def stage_weights(self) -> Array:
        """Weights (s, s + 2, 3) of M, hC and h²K in the equations of the s stages. The second axis contains
        the s stage accelerations, q and h v, by which the matrices are multiplied."""
        s, A = len(self.c), self.A
        rows = np.zeros((s, 3, s + 2))
        rows[:, 0, :s] = np.eye(s)
        rows[:, 1, :s], rows[:, 2, :s] = A, A @ A
        rows[:, 2, s], rows[:, 1, s + 1], rows[:, 2, s + 1] = -1.0, -1.0, -np.array(self.c)
        return np.ascontiguousarray(rows.swapaxes(1, 2))

    def steps(self, h: Array, a: Array, first_order: int = 0) -> Steps:
        """Affine maps of (q, v) over the steps h (m,) from stage accelerations (P, m, s, n, N+1)."""
        maps = self.maps(h, a, first_order)
        return Steps(maps[..., :-1], maps[..., -1])

    def maps(self, h: Array, a: Array, first_order: int = 0) -> Array:
        """Affine maps (P, m, N, N+r) from the state (q, v) at the start of a step, and r loads, to the state
        at its end.

        a (P, m, s, n, N+r): stage accelerations. For the last `first_order` coordinates, they are rates."""
        P, m, s, n = a.shape[:4]
        p, N = n - first_order, 2 * n - first_order
        weights = np.stack((self.b @ self.A, self.b))
        maps = (weights @ a.reshape(P, m, s, -1)).reshape(P, m, 2, n, -1)
        maps *= np.stack((h**2, h), axis=1)[:, :, None, None]
        maps = maps.reshape(P, m, 2 * n, -1)
        if first_order:
            maps = np.concatenate((maps[:, :, :p], maps[:, :, n + p :], maps[:, :, n : n + p]), axis=2)
        maps[..., :N] += np.eye(N)
        maps[..., range(p), range(n, N)] += h[:, None]
        return maps

    def curve(self, nodes: Array, x: Array, a_start: Array, a: Array, a_end: Array) -> Curve:
        """Piecewise polynomials through the states x (P, m+1, N) at the nodes, with accelerations a_start (P,
        m, n) and a_end (P, m, n) at the starts and ends of the steps, and a (P, m, s, n) at the stages."""
        n, p = a.shape[-1], x.shape[-1] - a.shape[-1]
        h = np.diff(nodes)[:, None]
        accelerations = [a_start, *np.moveaxis(a, 2, 0), a_end][: len(self.curve_nodes)]
        data = [x[:, :-1, :p], h * x[:, :-1, n:], *(h**2 * part[..., :p] for part in accelerations)]
        curve = Curve.from_steps(nodes, np.stack(data, axis=-1), self.curve_powers)
        if p == n:
            return curve
        data = [x[:, :-1, p:n], *(h * part[..., p:] for part in accelerations)]
        return curve.joined(Curve.from_steps(nodes, np.stack(data, axis=-1), self.rate_powers))


def _polynomial(coefficients: Array, x: Array) -> Array:
    """Values (…) of a polynomial at x, by Horner's scheme. Coefficients are in order of decreasing powers."""
    first, *others = coefficients.tolist()
    value = np.full(x.shape, first, dtype=x.dtype)
    for coefficient in others:
        value *= x
        value += coefficient
    return value


def lagrange(nodes: Array, theta: Array) -> Array:
    """Lagrange polynomials of k nodes, evaluated at θ (Q,), as an array (Q, k)."""
    k = len(nodes)
    others = ~np.eye(k, dtype=bool)
    factors = np.where(others, theta[:, None, None] - nodes, 1.0)
    return (factors / np.where(others, nodes[:, None] - nodes, 1.0)).prod(axis=2)


@cache
def _of_rows(method: Collocation, stage: int, n: int) -> Array:
    """Weights (3n, (s + 2) n) that convert rows of M, hC and h²K, placed side by side, to the equations of a
    stage."""
    return np.kron(method.stage_weights[stage].T, np.eye(n))
