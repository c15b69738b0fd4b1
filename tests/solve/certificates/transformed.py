"""Systems with solutions in closed form: y″ + C y′ + K y = f with constant C and K in periodic coordinates.

C and K are triangular, so that every mode has its own exponents. The coordinates q follow from y = S(φ) q
with periodic S (A. M. Lyapunov). For any W, M = W S, C = W (2S′ + C S), K = W (S″ + C S′ + K S) and d = W f.
The exponents do not change.
"""

from dataclasses import dataclass

import numpy as np

from solve import PeriodicSystem
from tests.solve.certificates.truth import PHASES, Truth


@dataclass(frozen=True)
class Modes:
    """Constant upper triangular C and K (n, n), and the load Re Σ f exp(iφ order) with `orders` (h,) and
    complex `f` (h, n). `defective` states whether a multiplier on the unit circle is defective."""

    C: np.ndarray
    K: np.ndarray
    orders: np.ndarray
    f: np.ndarray
    defective: bool = False

    @property
    def exponents(self) -> np.ndarray:
        """Roots (2n,) of λ² + c λ + k, without cancellation."""
        half, k = np.diag(self.C) / 2, np.diag(self.K)
        root = np.sqrt((half**2 - k).astype(complex))
        larger = -half - np.where(half < 0, -1.0, 1.0) * root
        return np.concatenate((larger, np.where(larger != 0, k / np.where(larger != 0, larger, 1.0), 0.0)))

    def load(self, phase):
        return np.real(np.exp(1j * np.outer(phase, self.orders)) @ self.f)

    def response(self, phase):
        """Return y (k, n)."""
        n = len(self.C)
        rates = 1j * self.orders[:, None, None]
        y = np.linalg.solve(rates**2 * np.eye(n) + rates * self.C + self.K, self.f[..., None])[..., 0]
        return np.real(np.exp(1j * np.outer(phase, self.orders)) @ y)


@dataclass(frozen=True)
class View:
    """Transformation S = I + Σ cos(kφ) A_k + sin(kφ) B_k with `waves` (2, H, n, n) and `units` (n,) of the
    coordinates.

    If `energetic`, W = Sᵀ and the equations are also scaled by the units, as in the principle of virtual
    work. Otherwise W = S⁻¹, so that M = I.
    """

    waves: np.ndarray
    units: np.ndarray
    energetic: bool

    @classmethod
    def random(cls, rng, n, depth=0.5, harmonics=3, diagonal=False, decades=0.0, energetic=True):
        waves = rng.standard_normal((2, harmonics, n, n)) / np.arange(1, harmonics + 1)[:, None, None]
        if diagonal:
            waves = waves * np.eye(n)
        waves *= depth / np.linalg.norm(waves, 2, axis=(2, 3)).sum()
        exponents = rng.permutation(np.linspace(-decades / 2, decades / 2, n)) if n > 1 else np.zeros(1)
        return cls(waves, 10.0**exponents, energetic)

    def at(self, phase):
        """Return S and its first two derivatives (k, n, n)."""
        orders = np.arange(1, self.waves.shape[1] + 1)
        angles = np.outer(phase, orders)
        c, s = np.cos(angles), np.sin(angles)
        A, B = self.waves

        def series(cosines, sines):
            return np.tensordot(cosines, A, 1) + np.tensordot(sines, B, 1)

        return (
            np.eye(len(self.units)) + series(c, s),
            series(-orders * s, orders * c),
            series(-(orders**2) * c, -(orders**2) * s),
        )


def transformed(modes: Modes, view: View):
    n, units = len(view.units), view.units

    def matrices(phase, Omega):
        S, S1, S2 = view.at(phase)
        parts = S, 2 * S1 + modes.C @ S, S2 + modes.C @ S1 + modes.K @ S
        f = modes.load(phase)[..., None]
        if view.energetic:
            W = np.swapaxes(S, 1, 2)
            M, C, K, d = (units[:, None] * (W @ part) for part in (*parts, f))
        else:
            M, C, K, d = (np.linalg.solve(S, part) / units[:, None] for part in (*parts, f))
            M = np.broadcast_to(np.diag(1 / units), M.shape)
        M, C, K = (part * units for part in (M, C, K))
        return M / Omega**2, C / Omega, K, d[..., 0]

    def truth():
        S, _, _ = view.at(PHASES)
        q = np.linalg.solve(S, modes.response(PHASES)[..., None])[..., 0] / units
        return Truth(2 * np.pi * modes.exponents, q.T, modes.defective)

    return PeriodicSystem(matrices, [f"q{k}" for k in range(1, n + 1)]), truth


def _load(rng, n, orders=(0, 1, 2)):
    orders = np.array(orders)
    return orders, rng.standard_normal((len(orders), n)) + 1j * rng.standard_normal((len(orders), n))


def _damping(rng, omega):
    """Return 2ζω of each mode: all modes are damped, one grows, or one or all are undamped."""
    c = 2 * omega * 10 ** rng.uniform(-3.0, -0.5, len(omega))
    case = rng.integers(4)
    if case == 1:
        c[rng.integers(len(c))] *= -1
    elif case == 2:
        c[rng.integers(len(c))] = 0.0
    elif case == 3 and rng.random() < 0.5:
        c[:] = 0.0
    return c


def scaled_units(rng, speed):
    """Return 2 to 4 coupled coordinates in units that differ by 10 to 28 powers of ten."""
    n = int(rng.integers(2, 5))
    omega = 10 ** rng.uniform(-0.7, 0.8, n)
    modes = Modes(np.diag(_damping(rng, omega)), np.diag(omega**2), *_load(rng, n))
    decades, energetic = rng.uniform(10.0, 28.0), bool(rng.integers(2))
    return transformed(modes, View.random(rng, n, decades=decades, energetic=energetic))


def one_way(rng, speed):
    """Return a system in which some coordinates drive others without reaction. The coupling is up to 1e18
    times their own stiffness."""
    n = int(rng.integers(2, 5))
    omega = 10 ** rng.uniform(-0.7, 0.8, n)
    C, K = np.diag(_damping(rng, omega)), np.diag(omega**2)
    size = 10 ** rng.uniform(0.0, 18.0)
    K += np.triu(rng.standard_normal((n, n)), 1) * size
    C += np.triu(rng.standard_normal((n, n)), 1) * np.sqrt(size)
    view = View.random(rng, n, diagonal=True, energetic=bool(rng.integers(2)))
    return transformed(Modes(C, K, *_load(rng, n)), view)


def nearly_defective(rng, speed):
    """Return two modes with one-way coupling and exponents that differ by 1e-10 to 1e-2 or are equal, or a
    mode that is equally close to critical damping."""
    n = int(rng.integers(2, 4))
    omega = 10 ** rng.uniform(-0.5, 0.7, n)
    delta = 0.0 if rng.random() < 0.15 else 10 ** rng.uniform(-10.0, -2.0)
    at_rest = rng.random() < 0.3
    c = 2 * omega * 10 ** rng.uniform(-3.0, -0.7, n) * (not at_rest)
    k = omega**2
    critical = not at_rest and rng.random() < 0.3
    if critical:
        c[0] = 2 * omega[0] * (1 + delta)
    k[1], c[1] = k[0] * (1 + delta), c[0]
    C, K = np.diag(c), np.diag(k)
    K[0, 1] = k[0] * 10 ** rng.uniform(-1.0, 1.0)
    if critical:
        K[0, 1], k[1] = 0.0, 1.3 * k[0]
        K[1, 1] = k[1]
    modes = Modes(C, K, *_load(rng, n), defective=bool(at_rest and delta == 0.0))
    return transformed(modes, View.random(rng, n, depth=rng.uniform(0.05, 0.5)))


def high_harmonics(rng, speed):
    """Return a system under a load with harmonics 200 to 500, with or without low harmonics."""
    n = int(rng.integers(1, 4))
    omega = 10 ** rng.uniform(-0.7, 1.0, n)
    c = 2 * omega * 10 ** rng.uniform(-3.0, -0.5, n)
    high = np.unique(rng.integers(201, 500, int(rng.integers(1, 4))))
    low = (0, 1, 2) if rng.random() < 0.5 else ()
    orders, f = _load(rng, n, (*low, *high))
    f[orders > 200] *= 10 ** rng.uniform(0.0, 3.0)
    modes = Modes(np.diag(c), np.diag(omega**2), orders, f)
    return transformed(modes, View.random(rng, n, depth=rng.uniform(0.0, 0.5)))


def stiff(rng, speed):
    """Return slow modes with modes of up to 1e5 times the speed that decay within a period and modes of up to
    1000 times the speed that do not, in rotating axes."""
    n = int(rng.integers(2, 5))
    omega = 10 ** rng.uniform(-0.7, 0.7, n)
    c = 2 * omega * 10 ** rng.uniform(-3.0, -0.5, n)
    fast = int(rng.integers(1, n))
    for k in range(fast):
        dies = rng.random() < 0.7
        omega[k] = 10 ** rng.uniform(2.0, 5.0 if dies else 3.0)
        decay = rng.uniform(2.0, 30.0) * omega[k] ** 0.5 if dies else rng.choice([0.0, 0.2])
        c[k] = decay / np.pi
    modes = Modes(np.diag(c), np.diag(omega**2), *_load(rng, n))
    return transformed(modes, View.random(rng, n, depth=rng.uniform(0.05, 0.5)))


BUILT = {
    "units": scaled_units,
    "one-way": one_way,
    "nearly defective": nearly_defective,
    "high harmonics": high_harmonics,
    "stiff, loose": stiff,
}
