"""Random systems whose proofs are compared with an independent integration: smooth systems, and systems with
a short bump."""

import math
from dataclasses import dataclass
from functools import cache

import mpmath
import numpy as np

import solve
from derive import Mechanism, cos, exp, rate, sin
from solve.proof.result import Proof
from tests.solve.proof.fixed_point import BITS, fixed, monodromy, multipliers, trigonometric

SEED = 42
DIGITS = 10
_STEPS = 40


@cache
def smooth_mechanism(n: int) -> Mechanism:
    """Return a mechanism with M = M0 + M1 cos φ, K = K0 + K1 cos φ + K2 sin 2φ, C = C0 + C1 sin φ and loads F
    cos φ."""
    made = Mechanism(f"random{n}", "Random smooth system")
    names = {f"q{i}": ("m", "deflection") for i in range(n)}
    q = made.coordinates(**names)
    units = {"M": ("kg", "mass"), "C": ("N s/m", "damping"), "K": ("N/m", "stiffness")}
    matrix = {}
    for name in ("M0", "M1", "C0", "C1", "K0", "K1", "K2"):
        upper = {f"{name}_{i}{j}": units[name[0]] for i in range(n) for j in range(i, n)}
        symbols = dict(zip(upper, made.parameters(**upper), strict=True))
        matrix[name] = [[symbols[f"{name}_{min(i, j)}{max(i, j)}"] for j in range(n)] for i in range(n)]
    loads = made.parameters(**{f"F_{i}": ("N", "load") for i in range(n)})
    phase = made.phase

    def form(name, v):
        return sum(matrix[name][i][j] * v[i] * v[j] for i in range(n) for j in range(n)) / 2

    v = [rate(each) for each in q]
    made.kinetic = form("M0", v) + form("M1", v) * cos(phase)
    made.potential = form("K0", q) + form("K1", q) * cos(phase) + form("K2", q) * sin(2 * phase)
    made.dissipation = form("C0", v) + form("C1", v) * sin(phase)
    for load, each in zip(loads, q, strict=True):
        made.force(load * cos(phase), along=each)
    return made


def symmetric(rng, n, size):
    A = rng.uniform(-size, size, (n, n))
    return (A + A.T) / 2


@dataclass(frozen=True)
class Case:
    """System at 1 rad/s with its true monodromy matrix."""

    name: str
    system: solve.Model
    Phi: mpmath.matrix

    def proof(self, digits: int = DIGITS) -> Proof:
        return solve.prove(self.system, 1.0, digits=digits, orbit=False)


def smooth(number: int) -> Case:
    """Return one of the random smooth systems."""
    rng = np.random.default_rng([SEED, number])
    n = 1 + number % 3
    strong = rng.uniform(0.1, 1.2)
    drawn = {
        "M0": np.eye(n) + symmetric(rng, n, 0.2),
        "M1": symmetric(rng, n, 0.25),
        "C0": rng.uniform(0.0, 0.15) * np.eye(n) + symmetric(rng, n, 0.04),
        "C1": symmetric(rng, n, 0.1),
        "K0": np.diag(rng.uniform(0.3, 7.0, n)) + symmetric(rng, n, 0.5),
        "K1": symmetric(rng, n, strong),
        "K2": symmetric(rng, n, strong),
    }
    values = {
        f"{name}_{i}{j}": float(A[i, j]) for name, A in drawn.items() for i in range(n) for j in range(i, n)
    }
    values |= {f"F_{i}": 1.0 for i in range(n)}
    system, zero = solve.load(smooth_mechanism(n), **values), np.zeros((n, n))
    with mpmath.workprec(BITS + 40):
        nodes = [2 * mpmath.pi * k / _STEPS for k in range(_STEPS + 1)]
        Phi = monodromy(
            trigonometric([(0, drawn["M0"], zero), (1, drawn["M1"], zero)]),
            # d/dφ of M adds M′ = −M1 sin φ to the damping.
            trigonometric([(0, drawn["C0"], zero), (1, zero, drawn["C1"]), (1, zero, -drawn["M1"])]),
            trigonometric([(0, drawn["K0"], zero), (1, drawn["K1"], zero), (2, zero, drawn["K2"])]),
            nodes,
        )
    return Case(f"smooth {number}", system, Phi)


_BUMP_STEPS, _GRADING = 3, 6
"""Steps per width of the bump, and distances from it per step."""

WIDTH = 2 * math.pi / 5000
"""Width of the bump: a five-thousandth of the period."""


@cache
def bump_mechanism() -> Mechanism:
    """Return the mechanism q″ + c q′ + (k + b exp(−(1 − cos(φ − p))/w²)) q = 0."""
    made = Mechanism("bump", "Stiffness with a bump")
    (q,) = made.coordinates(q=("m", "deflection"))
    m, c, k, b, p, w, F = made.parameters(
        m=("kg", "mass"),
        c=("N s/m", "damping"),
        k=("N/m", "stiffness"),
        b=("N/m", "height"),
        p=("1", "place"),
        w=("1", "width"),
        F=("N", "load"),
    )
    made.kinetic, made.dissipation = m * rate(q) ** 2 / 2, c * rate(q) ** 2 / 2
    made.potential = (k + b * exp(-(1 - cos(made.phase - p)) / w**2)) * q**2 / 2
    made.force(F * cos(made.phase), along=q)
    return made


def bump(number: int) -> Case:
    """Return a system with a bump at a random phase, whose impulse makes the motion unstable."""
    place = float(np.random.default_rng([SEED, 1000 + number]).uniform(0.2, 6.0))
    height = 4.0 / (WIDTH * math.sqrt(2 * math.pi))
    values = {"m": 1.0, "c": 0.02, "k": 3.9, "b": height, "p": place, "w": WIDTH, "F": 1.0}
    with mpmath.workprec(BITS + 40):
        one, zero = np.array([[1.0]]), np.array([[0.0]])
        Phi = monodromy(
            trigonometric([(0, one, zero)]),
            trigonometric([(0, 0.02 * one, zero)]),
            lambda phase, h: _bump_series(phase, h, place, height),
            _graded(place),
        )
    return Case(f"bump at {place:.4f}", solve.load(bump_mechanism(), **values), Phi)


def _bump_series(phase, h, place, height):
    """Return the Taylor coefficients of k + b e^g from g′ e^g = (e^g)′, where g = −(1 − cos(φ − p))/w²."""
    square, x = mpmath.mpf(WIDTH) ** 2, phase - mpmath.mpf(place)
    count = len(trigonometric([(0, np.zeros((1, 1)), np.zeros((1, 1)))])(phase, h))
    g = [h**j / mpmath.factorial(j) * mpmath.cos(x + j * mpmath.pi / 2) / square for j in range(count)]
    e = [mpmath.exp(g[0] - 1 / square)]
    for j in range(1, count):
        e.append(sum(i * g[i] * e[j - i] for i in range(1, j + 1)) / j)
    constant = [mpmath.mpf(3.9)] + [mpmath.mpf(0)] * (count - 1)
    return [
        np.array([[fixed(a + mpmath.mpf(height) * b)]], dtype=object)
        for a, b in zip(constant, e, strict=True)
    ]


def _graded(place):
    """Return nodes that are dense near the bump."""
    end, phase, nodes = 2 * mpmath.pi, mpmath.mpf(0), [mpmath.mpf(0)]
    while phase < end:
        # Past the bump the distance grows with the step; before it, it shrinks.
        distance = abs(phase - place)
        phase = min(end, phase + min(0.1, max(WIDTH / _BUMP_STEPS, float(distance) / _GRADING)))
        nodes.append(phase)
    return nodes


def contradictions(case: Case, proof: Proof) -> list[str]:
    """Return the statements of a proof that the true monodromy matrix contradicts."""
    with mpmath.workprec(BITS):
        exact, found = multipliers(case.Phi), []
        radius = max(abs(rho) for rho in exact)
        discs = [*zip(proof.multipliers.tolist(), proof.radii.tolist(), proof.isolated.tolist(), strict=True)]
        for rho in exact:
            if not any(abs(rho - center) <= r for center, r, _ in discs):
                found.append(f"multiplier {mpmath.nstr(rho, 20)} is in no disc")
        for center, r, isolated in discs:
            if isolated and sum(abs(rho - center) <= r for rho in exact) != 1:
                found.append(f"the isolated disc about {center} does not contain one multiplier")
        low, high = map(mpmath.mpf, proof.spectral_radius)
        if not low <= radius <= high:
            found.append(f"spectral radius {mpmath.nstr(radius, 20)} is not in {proof.spectral_radius}")
        if proof.verdict == "asymptotically stable" and radius >= 1:
            found.append("stability is proved of an unstable system")
        if proof.verdict == "unstable" and radius <= 1:
            found.append("instability is proved of a stable system")
        return found
