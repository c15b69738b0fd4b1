"""Second population of random periodic systems, which was not used to tune error estimates. The features of
its matrices differ from those of `population`, and most lie at undeclared phases.

System k depends only on `SEED` and k; the seven kinds alternate. Every system has random modes W and natural
frequencies ω (in units of the speed), with the mean values M = WᵀW and K = Wᵀ diag(ω²) W. The matrices are
sums of constants, three harmonics and further functions of the phase, each with its own coefficient matrix.
Speeds are 10^U(-1, 2) rad/s and units of the coordinates 10^U(-1, 1), where U(a, b) is evenly distributed
between a and b. In three of five systems, the mean damping of every mode is positive. One in five has no
damping (C = 0, M constant, K symmetric), and one in five has a mode with negative damping.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.interpolate import CubicSpline

from solve import PeriodicSystem
from tests.solve.certificates.population import HARMONICS, Member
from tests.solve.certificates.truth import integrated

SEED = 20261126
SIZE = 2000
TURN = 2 * np.pi
NODES = 14
"""Nodes in each panel of the reference solution: sufficient for a mode with a phase advance of 1.5 rad per
panel."""


@dataclass(frozen=True)
class Modes:
    """Modes and coefficients of a system.

    `omega` (n,) are the natural frequencies, `W` (n, n) the modes and `zeta` (n,) the damping ratios.
    `damped` is False if C = 0. `parts` are the coefficients of M, C, K (1 + 2H, n, n) and d (1 + 2H, n): the
    means, then the cosine and sine coefficients.
    """

    omega: np.ndarray
    W: np.ndarray
    zeta: np.ndarray
    damped: bool
    parts: tuple[np.ndarray, ...]

    @property
    def scales(self) -> np.ndarray:
        """Sizes (2n,) of q and q′ in a vibration of the fastest mode, as powers of 2, which cause no
        round-off."""
        unit = 1 / np.linalg.norm(self.W, axis=0)
        return 2.0 ** np.round(np.log2(np.concatenate((unit / self.omega.max(), unit))))


def kind_of(index: int) -> str:
    return KINDS[index % len(KINDS)]


def member(index: int) -> Member:
    kind, rng = kind_of(index), np.random.default_rng((SEED, index))
    speed = float(10 ** rng.uniform(-1.0, 2.0))
    modes, changes, signals, breaks, panels = MAKERS[kind](rng)
    system = _system(modes, changes, signals, breaks)
    truth = partial(integrated, system, speed, nodes=NODES, scales=modes.scales, **panels)
    return Member(index, kind, speed, system, truth)


def bumps(rng):
    """One or two undeclared bumps exp(-2 sin²((φ - a)/2)/σ²) in K, in C or in both, and in three of ten
    systems also in d. A narrow bump is Gaussian. The standard deviations σ are 2π · 10^U(-3.7, -1.5), from
    1/5000 to 1/32 of the period. The areas of 10^U(-1.3, 0.2) change the state by between a few per cent and
    its own size."""
    modes = _modes(rng, int(rng.integers(1, 4)), _top(rng))
    count = int(rng.integers(1, 3))
    places, sigma = rng.uniform(0.0, TURN, count), TURN * 10 ** rng.uniform(-3.7, -1.5, count)
    area = 10 ** rng.uniform(-1.3, 0.2, count)
    where = int(rng.integers(1, 4)) if modes.damped else 1
    kick = area / modes.omega.max()
    in_load = rng.random() < 0.3
    changes = _changes(rng, modes, C=area * (where >= 2), K=kick * (where != 2), d=kick * in_load)

    def signals(phase):
        away = np.sin((phase[:, None] - places) / 2)
        return np.exp(-2 * (away / sigma) ** 2) / (sigma * np.sqrt(TURN))

    edges = places[:, None] + sigma[:, None] * np.arange(-9, 10)
    return modes, changes, signals, (), {"edges": edges.ravel()}


def kinks(rng):
    """Kinks of K, C and d at one to four undeclared phases a: |sin(φ - a)|, which has a second kink half a
    period later, |sin((φ - a)/2)|, or piecewise linear interpolation of random values."""
    modes = _modes(rng, int(rng.integers(1, 4)), _top(rng))
    count, shape = int(rng.integers(1, 5)), int(rng.integers(3))
    places = np.sort(rng.uniform(0.0, TURN, count))
    values = rng.uniform(-1.0, 1.0, (count, count))
    if count == 1:
        shape %= 2
    C, K, d = _sizes(rng, count, (0.4, -2.5, -0.7), (0.8, -2.0, -0.3), (1.0, -1.0, 0.5))
    changes = _changes(rng, modes, C=C, K=K, d=d)

    def signals(phase):
        if shape == 2:
            return np.stack([np.interp(phase, places, value, period=TURN) for value in values], axis=1)
        away = phase[:, None] - places
        return np.abs(np.sin(away / 2 if shape else away))

    edges = places if shape else np.concatenate((places, places + np.pi))
    return modes, changes, signals, (), {"edges": edges}


def ripples(rng):
    """One to three harmonics of orders 100 to 480 in d and K, of relative amplitudes 10^U(-5, -1)."""
    modes = _modes(rng, int(rng.integers(1, 4)), _top(rng))
    count = int(rng.integers(1, 4))
    orders, angles = rng.integers(100, 481, count), rng.uniform(0.0, TURN, count)
    K, d = 10 ** rng.uniform(-5.0, -1.0, (2, count))
    changes = _changes(rng, modes, K=K * (rng.random() < 0.7), d=d)

    def signals(phase):
        return np.cos(phase[:, None] * orders + angles)

    return modes, changes, signals, (), {"longest": 2.5 / orders.max()}


def crossing(rng):
    """Two to four weakly coupled modes at 20 to 200 times the speed. Their frozen frequencies vary by 8 to 22
    %, each with a different phase, so that they cross. The damping ratios are 10^U(-4, 0); the smallest is at
    most 0.01."""
    n = int(rng.integers(2, 5))
    centre = 10 ** rng.uniform(np.log10(26.0), np.log10(145.0)) * rng.uniform(0.96, 1.04, n)
    zeta = 10 ** rng.uniform(-4.0, 0.0, n)
    zeta[rng.integers(n)] = 10 ** rng.uniform(-4.0, -2.0)
    depth = 10 ** rng.uniform(-4.0, -2.0)
    modes = _modes(rng, n, omega=centre, zeta=zeta, depth=depth, growing=(-4.0, -2.5))
    swing, places = rng.uniform(0.08, 0.22, n), rng.uniform(0.0, TURN) + TURN * np.arange(n) / n
    alone = modes.W[:, :, None] * modes.W[:, None, :]
    coupling = _changes(rng, modes, K=10 ** rng.uniform(-4.0, -2.0, 1))
    none = np.zeros((n, n, n))
    C = np.concatenate((none, (2 * modes.zeta * centre)[:, None, None] * alone))
    K = np.concatenate((centre[:, None, None] ** 2 * alone, none))
    changes = (np.zeros((2 * n, n, n)), C, K, np.zeros((2 * n, n)))

    def signals(phase):
        frequency = 1 + swing * np.cos(phase[:, None] - places)
        return np.concatenate((frequency**2 - 1, frequency - 1, np.ones((len(phase), 1))), axis=1)

    both = [np.concatenate(pair) for pair in zip(changes, coupling, strict=True)]
    return modes, both, signals, (), {}


def tables(rng):
    """Loads, and in every other system the stiffness, from tables of 64 to 512 samples with noise of a
    relative size of 10^U(-4, -1), interpolated by periodic cubic splines with undeclared knots."""
    n = int(rng.integers(1, 4))
    modes = _modes(rng, n, _top(rng), depth=rng.uniform(0.02, 0.3) * rng.integers(2))
    samples = int(10 ** rng.uniform(np.log10(64.0), np.log10(512.99)))
    knots = rng.uniform(0.0, TURN / samples) + TURN * np.arange(samples + 1) / samples
    angles = np.outer(knots[:-1], np.arange(1, HARMONICS + 1))
    values = np.concatenate((np.cos(angles), np.sin(angles)), axis=1)
    values = values @ rng.standard_normal((2 * HARMONICS, n + 1)) / np.sqrt(2 * HARMONICS)
    values += 10 ** rng.uniform(-4.0, -1.0) * rng.standard_normal(values.shape)
    curve = CubicSpline(knots, np.concatenate((values, values[:1])), bc_type="periodic")
    stiffness = 10 ** rng.uniform(-2.0, -0.3) * rng.integers(2)
    first = np.arange(n + 1) == 0
    return modes, _changes(rng, modes, K=stiffness * first, d=1.0 - first), curve, (), {"edges": knots}


def jumps(rng):
    """Two to six declared jumps of M, C, K and d, two of which are 2π · 10^U(-9, -3) apart. One system in
    four jumps at phase 0. Between the jumps, the matrices are constant or smooth."""
    modes = _modes(rng, int(rng.integers(1, 4)), _top(rng), depth=rng.uniform(0.02, 0.3) * rng.integers(2))
    count = int(rng.integers(2, 7))
    breaks = np.sort(rng.uniform(0.1, 6.1, count - 1))
    if rng.random() < 0.25:
        breaks[0] = 0.0
    breaks = np.sort(np.append(breaks, rng.choice(breaks) + TURN * 10 ** rng.uniform(-9.0, -3.0)))
    stiffness, load = (0.8, -2.0, -0.3), (1.0, -1.0, 0.5)
    M, C, K, d = _sizes(rng, count, (0.4, -2.0, -1.0), (0.5, -2.0, -0.7), stiffness, load)
    changes = _changes(rng, modes, M=M, C=C, K=K, d=d)

    def signals(phase):
        piece = np.searchsorted(breaks, np.remainder(phase, TURN), side="right") % count
        return np.eye(count)[piece]

    return modes, changes, signals, breaks, {}


def twenty(rng):
    """Random Fourier series of three harmonics for twenty coordinates. Up to three modes have damping ratios
    of 10^U(-5, -3), and up to three others of 0.3 to 1."""
    n = 20
    zeta = 10 ** rng.uniform(-3.0, -0.5, n)
    light, heavy = rng.integers(0, 4, 2)
    zeta[:light] = 10 ** rng.uniform(-5.0, -3.0, light)
    zeta[n - heavy :] = rng.uniform(0.3, 1.0, heavy)
    modes = _modes(rng, n, 10.0, zeta=zeta, depth=10 ** rng.uniform(-3.0, -0.5))
    none = _changes(rng, modes, d=np.zeros(0))
    return modes, none, lambda phase: np.zeros((len(phase), 0)), (), {}


MAKERS = {each.__name__: each for each in (bumps, kinks, ripples, crossing, tables, jumps, twenty)}
"""Each function returns the modes, the coefficients (k, …) of M, C, K and d that are multiplied by signals
(m, k) of the phase, these signals, the breaks, and the panel arguments of the reference solution."""

KINDS = tuple(MAKERS)


def _top(rng):
    """Return the largest natural frequency, in units of the speed, of a soft or moderately stiff system."""
    return float(rng.choice([6.0, 60.0]))


def _sizes(rng, count, *ranges):
    """Return `count` values 10^U(a, b) with the probability p, otherwise zeros, for each range (p, a, b)."""
    size = 10 ** np.array([rng.uniform(*ends, count) for _, *ends in ranges])
    return size * (rng.random((len(ranges), 1)) < [[probability] for probability, *_ in ranges])


def _modes(rng, n, top=6.0, omega=None, zeta=None, depth=None, growing=(-3.0, -1.3)):
    """Return random modes.

    Unless given, ω lies between 0.15 and `top`, and ζ is 10^U(-3, -0.5). The harmonics of each of M, C and K
    have spectral norms with the sum `depth`; those of the load are as large as its mean. With zero depth,
    there are no harmonics. `growing` are a and b of the negative damping ratio -10^U(a, b).
    """
    W = np.linalg.qr(rng.standard_normal((n, n)))[0] * 10 ** rng.uniform(-1.0, 1.0, n)
    omega = 10 ** rng.uniform(np.log10(0.15), np.log10(top), n) if omega is None else omega
    zeta = 10 ** rng.uniform(-3.0, -0.5, n) if zeta is None else zeta
    depth = rng.uniform(0.02, 0.3) if depth is None else depth
    case = rng.choice(["damped", "undamped", "growing"], p=[0.6, 0.2, 0.2])
    damped = bool(case != "undamped")
    zeta = zeta * damped
    if case == "growing":
        zeta[rng.integers(n)] = -(10 ** rng.uniform(*growing))
    G = rng.standard_normal((n, n))
    G = damped * 0.2 * (G - G.T) / np.sqrt(n)
    C = W.T @ (np.diag(2 * zeta * omega) + G) @ W
    stiffness = omega[:, None] * W
    means = W.T @ W, C, stiffness.T @ stiffness, rng.standard_normal(n) @ stiffness
    size = np.full(2 * HARMONICS, depth / (2 * HARMONICS))
    load = np.full(2 * HARMONICS, float(depth > 0))
    waves = _changes(rng, Modes(omega, W, zeta, damped, ()), M=size, C=size, K=size, d=load)
    parts = (np.concatenate((mean[None], wave)) for mean, wave in zip(means, waves, strict=True))
    return Modes(omega, W, zeta, damped, tuple(parts))


def _changes(rng, modes, M=0.0, C=0.0, K=0.0, d=0.0):
    """Return random coefficients of M, C, K (k, n, n) with the spectral norms M, C and K, and of d (k, n)
    with the sizes d (k,), in units of the modes. Without damping, C and M are zero and K is symmetric."""
    M, C, K, d = np.broadcast_arrays(*(np.atleast_1d(each) for each in (M, C, K, d)))
    n, W, stiffness = len(modes.omega), modes.W, modes.omega[:, None] * modes.W

    def matrix(size, unit, symmetric):
        S = rng.standard_normal((len(size), n, n))
        S = S + np.swapaxes(S, 1, 2) if symmetric else S
        return unit.T @ (S * (size / np.linalg.norm(S, 2, axis=(1, 2)))[:, None, None]) @ unit

    return (
        matrix(M * modes.damped, W, symmetric=True),
        matrix(C * modes.damped, W, symmetric=False),
        matrix(K, stiffness, symmetric=not modes.damped),
        d[:, None] * rng.standard_normal((len(d), n)) @ stiffness,
    )


def _system(modes, changes, signals, breaks):
    """Return the system of the modes with the changes (k, …) multiplied by the signals (m, k) of the
    phase."""
    parts = [np.concatenate(pair) for pair in zip(modes.parts, changes, strict=True)]

    def matrices(phase, Omega):
        angles = np.outer(phase, np.arange(1, HARMONICS + 1))
        one = np.ones((len(phase), 1))
        factors = np.concatenate((one, np.cos(angles), np.sin(angles), signals(phase)), axis=1)
        M, C, K, d = (np.tensordot(factors, part, 1) for part in parts)
        # All parts are by phase at the member's own speed; the contract is by time.
        return M / Omega**2, C / Omega, K, d

    return PeriodicSystem(matrices, [f"q{k}" for k in range(1, len(modes.omega) + 1)], breaks=tuple(breaks))
