"""Barker's fourteen classes compared with Table 3.1 of the thesis and with the motion of the links."""

import doctest
import math

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from models.four_bar import barker
from models.four_bar.barker import (
    CLASSES,
    base_plane,
    classify,
    mobility,
    satisfies_grashof,
    solution_space,
)
from models.four_bar.linkage import Linkage

# Whole lengths: their sums are exact. One for each class of C. R. Barker, Mech. Mach. Theory 20 (1985).
EXAMPLES = {
    "GCCC": (6, 5, 7, 2),
    "GCRR": (2, 6, 5, 7),
    "GRCR": (5, 2, 6, 7),
    "GRRC": (7, 6, 2, 5),
    "RRR1": (3, 4, 2, 7),
    "RRR2": (7, 4, 2, 3),
    "RRR3": (2, 7, 3, 4),
    "RRR4": (3, 4, 7, 2),
    "CPCCC": (4, 6, 5, 3),
    "CPCRR": (3, 6, 5, 4),
    "CPRCR": (4, 3, 6, 5),
    "CPRRC": (5, 4, 3, 6),
    "CP2X": (2, 5, 2, 5),
    "CP3X": (4, 4, 4, 4),
}
LENGTHS = st.tuples(*[st.integers(1, 12)] * 4)


def movable(lengths) -> Linkage:
    assume(2 * max(lengths) < sum(lengths))
    return Linkage(*lengths)


def turns_fully(lengths, link: int) -> bool:
    """Whether the other links close the loop at every angle of this link relative to the frame."""
    own, frame = lengths[link - 1], lengths[3]
    first, second = (length for k, length in enumerate(lengths[:3], start=1) if k != link)
    gap = np.abs(frame - own * np.exp(1j * np.linspace(0, math.pi, 361)))
    return bool(np.all((gap <= first + second + 1e-9) & (gap >= abs(first - second) - 1e-9)))


def table_symbol(lengths) -> str:
    """Class according to Table 3.1 of the thesis, from the shortest and the longest link and from equal
    pairs."""
    shortest, p, q, longest = sorted(lengths)
    if shortest == longest:
        return "CP3X"
    if shortest == p and q == longest:
        return "CP2X"
    if shortest + longest > p + q:
        return {4: "RRR1", 1: "RRR2", 2: "RRR3", 3: "RRR4"}[lengths.index(longest) + 1]
    turns = {4: "CCC", 1: "CRR", 2: "RCR", 3: "RRC"}[lengths.index(shortest) + 1]
    return ("CP" if shortest + longest == p + q else "G") + turns


def test_there_are_fourteen_classes_and_each_has_an_example():
    assert [class_.number for class_ in CLASSES.values()] == list(range(1, 15))
    assert list(EXAMPLES) == list(CLASSES)


@pytest.mark.parametrize("symbol", EXAMPLES)
def test_example_linkage_has_its_class(symbol):
    computed = classify(Linkage(*EXAMPLES[symbol]))
    assert computed.symbol == symbol
    assert table_symbol(EXAMPLES[symbol]) == symbol
    assert satisfies_grashof(Linkage(*EXAMPLES[symbol])) == (not symbol.startswith("R"))


@given(LENGTHS)
@example((1, 4, 4, 7))
@example((4, 1, 7, 4))
def test_signs_of_three_sums_agree_with_the_table(lengths):
    assert classify(movable(lengths)).symbol == table_symbol(lengths)


@given(LENGTHS)
def test_letters_of_the_class_identify_fully_turning_links(lengths):
    """Classes with equal links are excluded, because their symbols have no such letters."""
    symbol = classify(movable(lengths)).symbol
    assume(not symbol.endswith("X"))
    letters = symbol[:3] if symbol.startswith("RRR") else symbol[-3:]
    turning = "".join("C" if turns_fully(lengths, link) else "R" for link in (1, 2, 3))
    assert turning == letters
    words = [word[0].upper() for word in CLASSES[symbol].name.split(" ")[-1].split("-")]
    assert "".join(words) == letters


@given(LENGTHS, st.floats(1e-3, 1e3))
def test_class_does_not_depend_on_the_size_of_the_linkage(lengths, size):
    linkage = movable(lengths)
    scaled = Linkage(*(size * length for length in lengths))
    assert classify(scaled) == classify(linkage)
    assert solution_space(scaled) == pytest.approx(solution_space(linkage))


@given(LENGTHS)
def test_cranks_of_the_class_turn_fully_without_change_points(lengths):
    linkage = movable(lengths)
    assert linkage.turns_fully == (classify(linkage).symbol in {"GCCC", "GCRR"})


def test_sums_that_differ_by_rounding_count_as_equal():
    assert 0.1 + 0.7 != 0.3 + 0.5
    linkage = Linkage(0.1, 0.3, 0.7, 0.5)
    assert classify(linkage).symbol == "CPCRR"
    assert not linkage.turns_fully


def test_thesis_linkage_is_crank_rocker():
    linkage = Linkage(0.170, 0.328, 0.525, 0.547)
    assert classify(linkage).symbol == "GCRR"
    assert base_plane(linkage) == pytest.approx((0.328 + 0.525 + 0.547) / 0.170 / math.sqrt(3))


def test_mobility_follows_from_the_number_of_links():
    """Section 3.2 of the thesis: a triangle is a structure, and an odd number of links cannot have mobility
    1."""
    assert mobility() == mobility(4, 4, 0) == 1
    assert mobility(3, 3) == 0
    assert mobility(6, 7) == 1
    assert mobility(2, 0, 1) == 2
    assert all(mobility(5, joints) != 1 for joints in range(12))


def test_documented_examples():
    assert doctest.testmod(barker).failed == 0
