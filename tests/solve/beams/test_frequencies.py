"""Frequencies compared with characteristic equations, their count, and convergence rates of the elements."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from solve.beams.assembly import Positions
from solve.beams.frequencies import count_below, exact_frequencies, lowest_frequencies, modes
from tests.solve.beams.frames import beam, beams

STILL = np.zeros(1)

CHARACTERISTIC = {
    ("clamped", "free"): lambda x: np.cos(x) + 1 / np.cosh(x),
    ("clamped", "pinned"): lambda x: np.tan(x) - np.tanh(x),
    ("clamped", "clamped"): lambda x: np.cos(x) - 1 / np.cosh(x),
    ("pinned", "pinned"): np.sin,
    ("free", "free"): lambda x: np.cos(x) - 1 / np.cosh(x),
    ("pinned", "free"): lambda x: np.tan(x) - np.tanh(x),
}
AXIAL = {
    ("clamped", "free"): 0.5, ("clamped", "pinned"): 1, ("clamped", "clamped"): 1,
    ("pinned", "pinned"): 1, ("free", "free"): 1, ("pinned", "free"): 0.5,
}  # fmt: skip
RIGID = {("free", "free"): 3, ("pinned", "free"): 1}


def closed_form(ends, EA, count):
    """Return frequencies of a beam with EI = µ = L = 1, for bending and stretching, from the characteristic
    equations."""
    grid = np.arange(0.5, 60, 0.05)
    function = CHARACTERISTIC[ends]
    values = function(grid)
    jumps = np.flatnonzero((values[:-1] * values[1:] < 0) & (abs(values[:-1] - values[1:]) < 5))
    bending = [brentq(function, grid[i], grid[i + 1], xtol=1e-14) ** 2 for i in jumps]
    first = AXIAL[ends]
    rod = [(first + k) * np.pi * np.sqrt(EA) for k in range(count)]
    return np.sort([0.0] * RIGID.get(ends, 0) + bending + rod)[:count]


@pytest.mark.parametrize("ends", CHARACTERISTIC, ids="-".join)
@pytest.mark.parametrize("EA", [300.0, 1e4])
@pytest.mark.parametrize("parts", [1, 2])
def test_frequencies_match_the_characteristic_equation(ends, EA, parts):
    positions = Positions(beam(*ends, "dynamic", parts, EA=EA), STILL)
    np.testing.assert_allclose(exact_frequencies(positions, 8)[0], closed_form(ends, EA, 8), rtol=1e-11)


@pytest.mark.parametrize("ends", CHARACTERISTIC, ids="-".join)
def test_finite_element_frequencies_converge_from_above(ends):
    expected = closed_form(ends, 1e4, 6)
    positions = Positions(beam(*ends, "cubic", 16, EA=1e4), STILL)
    computed = lowest_frequencies(*positions.matrices(), 6)[0]
    np.testing.assert_allclose(computed, expected, rtol=2e-3)
    assert (computed >= expected * (1 - 1e-9)).all()


BENDING = {"cubic": (8, 4), "internal": (8, 8), "curvature": (8, 8)}
STRETCHING = {"cubic": (8, 2), "internal": (4, 4), "curvature": (8, 2)}
"""For each element a number of elements, and the order at which the error falls when it is doubled."""


def slope(kind, count, exact, EA, mode):
    """Return the observed order of the relative error of a cantilever's frequency between `count` and 2
    `count` elements."""
    errors = []
    for each in (count, 2 * count):
        positions = Positions(beam("clamped", "free", kind, each, angle=0.0, EA=EA), STILL)
        errors.append(lowest_frequencies(*positions.matrices(), mode)[0][-1] / exact - 1)
    return np.log2(errors[0] / errors[1])


@pytest.mark.parametrize("kind", BENDING)
def test_bending_frequencies_converge_at_the_theoretical_rate(kind):
    """The errors of ω are proportional to h^{2(p − 1)}, where h is the element length and p the degree of the
    shape functions."""
    count, order = BENDING[kind]
    exact = closed_form(("clamped", "free"), 1e4, 3)[2]
    assert slope(kind, count, exact, 1e4, 3) == pytest.approx(order, abs=0.15)


@pytest.mark.parametrize("kind", STRETCHING)
def test_axial_frequencies_converge_at_the_theoretical_rate(kind):
    """The errors of ω are proportional to h^{2p}, where h is the element length and p the degree of the shape
    functions."""
    count, order = STRETCHING[kind]
    EA = 1e-3
    assert slope(kind, count, np.pi / 2 * np.sqrt(EA), EA, 1) == pytest.approx(order, abs=0.15)


def test_modes_are_orthogonal_and_of_unit_mass():
    positions = Positions(beam("clamped", "free", "internal", 3), STILL)
    M, K = positions.matrices()
    computed = modes(M, K)
    omega, phi = computed.frequencies[0, :7], computed.vectors[0, :, :7]
    np.testing.assert_allclose(phi.T @ M[0] @ phi, np.eye(7), atol=1e-9)
    np.testing.assert_allclose(phi.T @ K[0] @ phi, np.diag(omega**2), atol=1e-9 * K.max())
    np.testing.assert_allclose(lowest_frequencies(M, K, 7)[0], omega, rtol=1e-12)


def test_double_frequencies_are_found_twice():
    """Two equal cantilevers are connected only through the wall."""
    links = [("one", "A", "B", "", "b"), ("two", "A", "C", "", "c")]
    positions = Positions(beams(links, ["A"], 1.0, [0.0, 1.0], "dynamic"), STILL)
    once = closed_form(("clamped", "free"), 1e4, 3)
    np.testing.assert_allclose(exact_frequencies(positions, 6)[0], np.repeat(once, 2), rtol=1e-11)


def test_frequencies_at_which_no_joint_moves_are_found():
    """Two equal collinear beams have three supports and clamped outer ends. In some modes, the middle joint
    does not move."""
    links = [("one", "A", "B", "", "w"), ("two", "B", "C", "w", "")]
    positions = Positions(beams(links, ["A", "B", "C"], 1.0, [0.2, 0.2], "dynamic", EA=1e6), STILL)
    assert positions.n == 1
    clamped = closed_form(("clamped", "clamped"), 1e6, 3)
    pinned = closed_form(("clamped", "pinned"), 1e6, 3)
    expected = np.sort(np.concatenate((clamped, pinned)))
    np.testing.assert_allclose(exact_frequencies(positions, 6)[0], expected, rtol=1e-11)


def frame(draw):
    """Return a random bent cantilever of three links, with a brace to the ground."""
    angles = [draw(st.floats(0.1, 1.4)), draw(st.floats(-1.4, 1.4)), draw(st.floats(-3.0, 3.0))]
    lengths = [draw(st.floats(0.4, 2.0)) for _ in range(3)]
    EI = [draw(st.floats(0.3, 3.0)) for _ in range(3)]
    return angles, lengths, EI, draw(st.booleans())


@st.composite
def frames(draw):
    return frame(draw)


def beams_of(stated, kind, count=1):
    angles, lengths, EI, welded = stated
    joint = ("w", "w") if welded else ("p", "q")
    links = [("one", "A", "B", "", joint[0]), ("two", "B", "C", joint[1], "c"), ("three", "C", "D", "c", "d")]
    tip = np.cumsum(np.array(lengths) * np.exp(1j * np.array(angles)))[1]
    brace = ("brace", "A", "C", "r", "s", False)
    return Positions(
        beams(
            [*links, brace],
            ["A"],
            [*lengths, abs(tip)],
            [*angles, np.angle(tip)],
            kind,
            count,
            EA=2e3,
            EI=[*EI, 1.0],
            masses={"B": 0.3, "D": 0.1},
        ),
        STILL,
    )


@settings(max_examples=25, deadline=None)
@given(frames())
def test_frequency_count_matches_a_fine_mesh(stated):
    exact, fine = beams_of(stated, "dynamic"), beams_of(stated, "internal", 6)
    many = lowest_frequencies(*fine.matrices(), 12)[0]
    computed = exact_frequencies(exact, 8)[0]
    np.testing.assert_allclose(computed, many[:8], rtol=1e-4, atol=1e-2)
    # A frame may be free to turn: at the frequency 0 there is nothing to count.
    apart = (many[1:] > 1.01 * many[:-1]) & (many[:-1] > 0)
    between = np.sqrt(many[:-1] * many[1:])[apart][:8]
    counts = count_below(exact, np.zeros(len(between), dtype=int), between)
    np.testing.assert_array_equal(counts, (many[None, :] < between[:, None]).sum(axis=1))


@settings(max_examples=15, deadline=None)
@given(frames(), st.integers(2, 4))
def test_subdivision_of_exact_elements_does_not_change_frequencies(stated, parts):
    whole, divided = beams_of(stated, "dynamic"), beams_of(stated, "dynamic", parts)
    np.testing.assert_allclose(
        exact_frequencies(divided, 8), exact_frequencies(whole, 8), rtol=1e-9, atol=1e-3
    )


def test_frequencies_at_many_positions_equal_single_positions():
    links = [("one", "A", "B", "", "p"), ("two", "B", "C", "q", "c")]
    turning = beams(
        links, ["A"], [1.0, 0.6], [lambda p: p, lambda p: 3 * p], "dynamic", EA=2e3, masses={"B": 1.0}
    )
    phases = np.linspace(0, 3, 7)
    together = exact_frequencies(Positions(turning, phases), 5)
    alone = [exact_frequencies(Positions(turning, phases[i : i + 1]), 5)[0] for i in range(7)]
    np.testing.assert_allclose(together, alone, rtol=1e-12, atol=1e-9)
