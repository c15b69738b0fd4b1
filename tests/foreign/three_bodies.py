"""Triangular points of the restricted three-body problem, from energies in the rotating frame."""

from functools import cache

import solve
from derive import Mechanism, rate, sqrt
from tests.foreign.wall import Case, Source

SZEBEHELY = Source(
    "V. Szebehely (after E. J. Routh)",
    "Theory of Orbits, Academic Press, New York, stability of the triangular points: 27 μ(1 − μ) = 1",
    "1967",
    "closed form",
)


def mechanism():
    body = Mechanism("three_bodies", "Small body near the point that makes an equal triangle with two others")
    x, y = body.coordinates(x=("m", "along the line of the two"), y=("m", "across it"))
    a, m = body.parameters(a=("m", "distance of the two", "> 0"), m=("kg", "small body", "> 0"))
    mu = body.parameter("mu", "1", "share of the smaller in the mass of both", "> 0, < 0.5")
    n = body.speed
    X, Y = a * (1 - 2 * mu) / 2 + x, a * sqrt(3) / 2 + y
    to_larger, to_smaller = sqrt((X + mu * a) ** 2 + Y**2), sqrt((X - (1 - mu) * a) ** 2 + Y**2)
    body.kinetic = m * ((rate(x) - n * Y) ** 2 + (rate(y) + n * X) ** 2) / 2
    body.potential = -m * n**2 * a**3 * ((1 - mu) / to_larger + mu / to_smaller)
    return body


@cache
def model():
    return solve.load(mechanism, a=1, m=1, mu=0.03)


def routh():
    """Return the mass fraction at which the point becomes unstable, by bisection between 0.03 and 0.05."""
    low, high = 0.03, 0.05
    while high - low > 1e-11:
        middle = (low + high) / 2
        stable = solve.floquet(model().varied({"mu": middle}), 1.0, rtol=1e-11).spectral_radius < 1 + 1e-8
        low, high = (middle, high) if stable else (low, middle)
    return low


CASES = [Case(SZEBEHELY, "Routh's value", "μ at which L4 becomes unstable", "0.0385208965", routh, slow=True)]
