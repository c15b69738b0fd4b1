"""Oscillator under a load with two harmonics, and its response in closed form."""

from functools import cache

import solve
from derive import Mechanism, cos, rate

MASS, DAMPING, STIFFNESS = 2.0, 0.3, 9.0


def oscillator():
    """Oscillator m q̈ + c q̇ + k q = p1 cos φ + p2 cos 3φ, with the load as an output."""
    made = Mechanism("oscillator", "Oscillator with two harmonics of load")
    (q,) = made.coordinates(q=("m", "displacement"))
    m, c, k = made.parameters(
        m=("kg", "mass", "> 0"), c=("N s/m", "damping", ">= 0"), k=("N/m", "spring", "> 0")
    )
    p1, p2 = made.parameters(p1=("N", "first harmonic"), p2=("N", "third harmonic"))
    load = p1 * cos(made.phase) + p2 * cos(3 * made.phase)
    made.kinetic, made.potential, made.dissipation = m * rate(q) ** 2 / 2, k * q**2 / 2, c * rate(q) ** 2 / 2
    made.force(load, along=q)
    made.output("load", load, "N", "load")
    return made


@cache
def loaded():
    return solve.load(oscillator(), m=MASS, c=DAMPING, k=STIFFNESS, p1=1.0, p2=0.0)


def response(speed, m=MASS, c=DAMPING, k=STIFFNESS):
    """Complex amplitude of q for a unit load."""
    return 1 / (k - m * speed**2 + 1j * c * speed)
