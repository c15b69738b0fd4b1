"""Periodic systems from the control literature with known characteristic exponents."""

import numpy as np

import solve
from tests.foreign.wall import Case, Source, first_order, oscillator

VARGA = Source(
    "A. Varga",
    "PeriodicSystems.jl, test_pslifting.jl",
    "2022",
    "andreasvarga/PeriodicSystems.jl, test/test_pslifting.jl",
)
ZHOU_HAGIWARA = Source(
    "J. Zhou, T. Hagiwara, M. Araki",
    "Spectral characteristics and eigenvalues computation of the harmonic state operators in continuous-time "
    "periodic systems, Systems & Control Letters 53, 141-155",
    "2004",
    'as andreasvarga/PeriodicSystems.jl cites it; its test/test_pslifting.jl says "Zhou, Hagiwara SCL 2002"',
)


def fast_and_slow():
    """x' = [[0, 1], [-10 cos t, -24 - 10 sin t]] x, of which x1 is an oscillator: its exponents, rising."""
    system = oscillator(lambda t: 10 * np.cos(t), lambda t: 24 + 10 * np.sin(t))
    stability = solve.floquet(system, 1.0, rtol=1e-10, all_multipliers=True)
    return np.sort(stability.exponents.real)


def turning(t):
    """Return A (m, 2, 2) of Zhou and Hagiwara."""
    s, c = np.sin(2 * t), np.cos(2 * t)
    return np.moveaxis(np.array([[-1 - s**2, 2 - s * c], [-2 - s * c, -1 - c**2]]), -1, 0)


def turning_rate(t):
    s, c = np.sin(4 * t), np.cos(4 * t)
    return np.moveaxis(np.array([[-2 * s, -2 * c], [-2 * c, 2 * s]]), -1, 0)


def zhou_hagiwara(period):
    """Return the exponents, without those that are added, in descending order of the real part."""
    computed = solve.floquet(first_order(turning, turning_rate, period), 1.0, rtol=1e-10).exponents
    return computed[np.argsort(-computed.real)][:2]


SOUGHT = 1e-8
"""Relative to the largest exponent; Varga's tests ask for the same."""
PLACE = "test_liftings"

CASES = [
    Case(VARGA, PLACE, "q″ + (24 + 10 sin t)q′ + 10 cos t q = 0, fast exponent", "-24",
         lambda: fast_and_slow()[0], 24 * SOUGHT),
    Case(VARGA, PLACE, "the same, slow exponent", "0", lambda: fast_and_slow()[1], 24 * SOUGHT),
    Case(ZHOU_HAGIWARA, PLACE, "real part of the first exponent, period π/2", "-1",
         lambda: zhou_hagiwara(np.pi / 2)[0].real, SOUGHT),
    Case(ZHOU_HAGIWARA, PLACE, "real part of the second exponent, period π/2", "-2",
         lambda: zhou_hagiwara(np.pi / 2)[1].real, SOUGHT),
    Case(ZHOU_HAGIWARA, PLACE, "imaginary part of both, period π/2", "2",
         lambda: abs(zhou_hagiwara(np.pi / 2)[0].imag), SOUGHT),
    Case(ZHOU_HAGIWARA, PLACE, "imaginary part of both, period π", "0",
         lambda: zhou_hagiwara(np.pi)[0].imag, SOUGHT),
]  # fmt: skip
