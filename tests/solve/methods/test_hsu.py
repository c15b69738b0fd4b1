"""Piecewise-constant transition matrices compared with Meissner's closed forms (sections 7.2.2 and 7.2.3 of
the thesis)."""

from itertools import combinations
from math import prod

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from solve import Radau, floquet, periodic
from solve.methods.hsu import Hsu
from tests.solve.references import multiplier_error, relative_error
from tests.solve.systems import constant, seeds, spd, system

TURN = 2 * np.pi


def meissner(frequencies, lengths):
    """System y″ + ν_i² y = 0 on intervals of the given lengths, which sum to the period (Eq. (7.10) of the
    thesis)."""
    ends = np.cumsum(lengths)

    def matrices(phase, speed):
        piece = np.searchsorted(ends, np.mod(phase, TURN), side="right")
        one = np.ones((len(phase), 1, 1))
        squares = np.square(frequencies)[np.minimum(piece, len(ends) - 1)]
        return one, 0 * one, squares[:, None, None], np.zeros((len(phase), 1))

    return system(matrices, 1, breaks=(0.0, *ends[:-1]))


def pieces(frequencies, lengths):
    angles = np.multiply(frequencies, lengths)
    return np.cos(angles), np.sin(angles)


def V(*frequencies):
    """Factor ½(v_i/v_k + v_k/v_i), or its generalisation with every second frequency in the denominator."""
    ratio = prod(frequencies[1::2]) / prod(frequencies[0::2])
    return (ratio + 1 / ratio) / 2


def J2(v, lengths):
    """Meissner's function for two intervals, Eq. (7.11) of the thesis."""
    C, S = pieces(v, lengths)
    return C[0] * C[1] - V(v[0], v[1]) * S[0] * S[1]


def J3(v, lengths):
    """Meissner's function for three intervals, Eq. (7.11) of the thesis."""
    C, S = pieces(v, lengths)
    return (
        C[0] * C[1] * C[2]
        - V(v[0], v[1]) * S[0] * S[1] * C[2]
        - V(v[0], v[2]) * S[0] * S[2] * C[1]
        - V(v[1], v[2]) * S[1] * S[2] * C[0]
    )


def JN(v, lengths):
    """Meissner's function for any number of intervals: half the trace of the product of the transition
    matrices, expanded. A term contains the sines of an even number of intervals and the cosines of the
    others; the signs alternate."""
    C, S = pieces(v, lengths)
    every = range(len(v))
    return sum(
        (-1) ** (size // 2)
        * V(*(v[i] for i in turning))
        * prod(S[i] if i in turning else C[i] for i in every)
        for size in range(0, len(v) + 1, 2)
        for turning in combinations(every, size)
    )


def random_intervals(seed, count):
    rng = np.random.default_rng(seed)
    shares = rng.uniform(0.5, 1.5, count)
    return list(rng.uniform(0.2, 3.0, count)), list(TURN * shares / shares.sum())


def test_general_form_includes_the_printed_ones():
    for seed in range(5):
        assert JN(*random_intervals(seed, 2)) == pytest.approx(J2(*random_intervals(seed, 2)), abs=1e-14)
        assert JN(*random_intervals(seed, 3)) == pytest.approx(J3(*random_intervals(seed, 3)), abs=1e-14)
    v, lengths = [1.3], [TURN]
    assert JN(v, lengths) == pytest.approx(np.cos(1.3 * TURN), abs=1e-14)


@pytest.mark.parametrize("method", ["hsu", Radau(13), "gauss"])
@pytest.mark.parametrize("count", [2, 3, 4, 6])
@pytest.mark.parametrize("seed", range(3))
def test_meissners_functions_are_half_the_sum_of_the_multipliers(method, count, seed):
    v, lengths = random_intervals(seed, count)
    stability = floquet(meissner(v, lengths), 1.0, method, rtol=1e-13)
    J = JN(v, lengths)
    scale = max(1.0, abs(J))
    assert abs(stability.multipliers.sum().real / 2 - J) < 1e-12 * scale
    assert stability.multipliers.prod().real == pytest.approx(1.0, abs=1e-11 * scale**2)
    assert stability.stable == (abs(J) <= 1)


@given(seeds, st.integers(1, 4), st.floats(0.2, 5.0), st.integers(1, 30))
@settings(max_examples=40, deadline=None)
def test_constant_coefficients_are_exact_on_any_grid(seed, n, speed, steps):
    rng = np.random.default_rng(seed)
    M, C, K = spd(rng, n, 0.5, 2.0), spd(rng, n, 0.05, 0.5), spd(rng, n, 0.5, 30.0)
    constants = rng.standard_normal(n)
    state = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    given = constant(M, C, K, lambda phase: np.tile(constants, (len(phase), 1)))
    orbit = periodic(given, speed, "hsu", steps=steps, rtol=0.9)
    truth = np.linalg.eigvals(expm(state * TURN / speed))
    assert multiplier_error(orbit.multipliers, truth) < 1e-11
    np.testing.assert_allclose(orbit.q, np.tile(np.linalg.solve(K, constants)[:, None], steps + 1), rtol=1e-9)


def test_order_of_the_orbit_between_the_nodes():
    """For Meissner's equation with a constant load, the nodes are exact, so that only the error of the curve
    remains."""
    v, lengths = [1.3, 0.6], [0.8 * np.pi, 1.2 * np.pi]
    unloaded = meissner(v, lengths)
    loaded = system(
        lambda phase, speed: (*unloaded.at(phase, speed)[:3], np.ones((len(phase), 1))),
        1,
        breaks=unloaded.breaks,
    )
    truth = periodic(loaded, 1.0, Radau(13), rtol=1e-12)
    phases = np.linspace(0.0, TURN, 301)
    orbit = periodic(loaded, 1.0, Hsu(), steps=60, rtol=0.9)
    np.testing.assert_allclose(orbit.q[:, :-1], truth.at(orbit.phase[:-1]), rtol=0, atol=1e-11)
    assert relative_error(orbit.at(phases), truth.at(phases)) < 1e-7
