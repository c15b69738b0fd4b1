"""Discs that contain eigenvalues, and verdicts from them."""

import pytest

pytest.importorskip("flint")

from solve.period.multipliers import VERDICTS
from solve.proof.balls import acb, arb, arb_mat, precision
from solve.proof.enclosure import discs_of
from solve.proof.spectrum import multipliers, verdict

PLACES = [(0.97, 0.2), (0.5, 0.0), (-1e-7, 0.0), (2e-25, 1e-25), (3e-56, 0.0)]
"""Real and imaginary parts of eigenvalues; those with an imaginary part have their conjugates beside."""


with precision(200):
    THREE_FIFTHS, FOUR_FIFTHS = arb(3) / 5, arb(4) / 5


def with_eigenvalues(places, radius=0.0):
    """Return a full matrix with these eigenvalues, whose entries are widened by a radius."""
    size = sum(2 if imaginary else 1 for _, imaginary in places)
    blocks, at = arb_mat(size, size), 0
    for real, imaginary in places:
        blocks[at, at] = 1 * real
        if imaginary:
            blocks[at, at + 1], blocks[at + 1, at] = 1 * imaginary, -1 * imaginary
            blocks[at + 1, at + 1] = 1 * real
        at += 2 if imaginary else 1
    X = arb_mat([[arb(1) / (1 + i + j) + (i == j) for j in range(size)] for i in range(size)])
    made = X * blocks * X.inv()
    return arb_mat([[entry + arb(0, radius) for entry in row] for row in made.table()])


def exact(places):
    return [
        acb(real, sign * imaginary) for real, imaginary in places for sign in ((1, -1) if imaginary else (1,))
    ]


def test_isolated_discs_contain_one_eigenvalue_each():
    with precision(500):
        computed = multipliers(with_eigenvalues(PLACES, 1e-100))
        assert [each.count for each in computed] == [1] * 7
        for value in exact(PLACES):
            near = [each for each in computed if abs(each.center - value) <= each.radius]
            assert len(near) == 1
        assert computed[-1].radius < 1e-20 * abs(computed[-1].center)


def test_discs_of_real_eigenvalues_have_real_centers():
    with precision(300):
        computed = multipliers(with_eigenvalues(PLACES, 1e-60))
        real = [each for each in computed if each.isolated and each.center.imag.is_zero()]
        assert len(real) >= 2
        assert any(abs(each.center - 0.5) <= each.radius for each in real)


def test_disc_containing_another_disc_is_not_isolated():
    """The second disc is wide and contains the first one, which scaling isolates."""
    with precision(100):
        computed = multipliers(arb_mat([[0, arb(0, 0.9)], [arb(0, 1e-3), arb(1, 0.199)]]))
        assert [each.isolated for each in computed] == [each.radius < 0.1 for each in computed]
        assert not all(each.isolated for each in computed)


@pytest.mark.parametrize(("distance", "alone"), [(2.0**-70, 2), (2.0**-40, 4)])
def test_isolated_disc_contains_one_multiplier(distance, alone):
    with precision(300):
        third = arb(1) / 3
        places = [(0.6, 0.3), (third + distance, 0.0), (third, 0.0)]
        computed = multipliers(with_eigenvalues(places, 1e-80))
        assert all(each.isolated for each in computed)
        centers, radii, isolated = discs_of(computed)
        assert isolated.sum() == alone
        for center, radius in zip(centers[isolated].tolist(), radii[isolated].tolist(), strict=True):
            assert sum(bool(abs(value - center) <= radius) for value in exact(places)) == 1


def test_eigenvalues_closer_than_the_width_share_a_disc():
    with precision(300):
        computed = multipliers(with_eigenvalues(PLACES, 1e-40))
        counts = {each.count for each in computed}
        assert sum(each.count for each in computed) == 7
        assert counts == {1} or max(counts) <= 3
        for value in exact(PLACES):
            assert any(abs(each.center - value) <= each.radius for each in computed)


@pytest.mark.parametrize("radius", [0.0, 1e-30])
def test_defective_eigenvalues_share_a_disc(radius):
    with precision(200):
        X = arb_mat([[2, 1, 0], [1, 3, 1], [0, 1, 2]])
        jordan = arb_mat([[0.5, 1, 0], [0, 0.5, 0], [0, 0, -0.25]])
        Phi = X * jordan * X.inv()
        Phi = arb_mat([[entry + arb(0, radius) for entry in row] for row in Phi.table()])
        computed = multipliers(Phi)
        pair = next(each for each in computed if each.count > 1)
        assert abs(pair.center - 0.5) <= pair.radius
        assert sum(each.count for each in computed) == 3


@pytest.mark.parametrize(
    ("places", "conservative", "message"),
    [
        ([(0.9, 0.3)], False, "asymptotically stable"),
        ([(1.0000000001, 0.0), (0.2, 0.0)], False, "unstable"),
        ([(THREE_FIFTHS, FOUR_FIFTHS)], True, "stable"),
        ([(THREE_FIFTHS, FOUR_FIFTHS)], False, "undetermined"),
        ([(-1.0, 0.0), (0.2, 0.0)], False, "undetermined"),
    ],
)
def test_verdict_follows_from_the_discs(places, conservative, message):
    with precision(120):
        Phi = with_eigenvalues(places, 1e-25)
        assert VERDICTS[verdict(Phi, multipliers(Phi), conservative)] == message


def test_norm_or_trace_gives_the_verdict_of_defective_matrices():
    """Discs of a nearly defective matrix are wider than their distance from the unit circle."""
    with precision(53):
        for value, message in ((0.99, "asymptotically stable"), (1.01, "unstable")):
            Phi = arb_mat([[value, 1], [1e-12, value]])
            Phi = arb_mat([[entry + arb(0, 1e-10) for entry in row] for row in Phi.table()])
            computed = multipliers(Phi)
            assert VERDICTS[verdict(Phi, computed, False)] == message
