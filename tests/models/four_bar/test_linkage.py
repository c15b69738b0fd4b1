"""Rigid motion: closure, branches, derivatives, transmission angle, ranges; misprints in the thesis."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.four_bar.linkage import BRANCHES, Linkage, LinkageError, transmission_warnings
from solve.errors import UnknownNameError, ValueOutOfBoundsError
from tests.models.four_bar.cranks import THESIS, cranks
from tests.models.four_bar.multibody import free_bodies

OFF = np.array([0.0, 0.003, -0.003])
"""Offset of the initial guess of the reference."""

TURN = np.arange(360) * (2 * math.pi / 360)
ANGLES = st.floats(-10.0, 10.0)
# Mass, centre and J do not matter for the motion, but select the points of the reference.
BODIES = ((1.0, 0.05, 0.02, 0.1), (1.0, 0.1, -0.03, 0.1), (1.0, 0.2, 0.01, 0.1))


def closure(linkage: Linkage, t1: float) -> float:
    """Gap of the loop of Eq. (3.4) of the thesis, relative to the sum of the lengths."""
    t1, t2, t3 = linkage.motion(t1).t
    L1, L2, L3, L4 = linkage.lengths
    x = L1 * math.cos(t1) + L2 * math.cos(t2) - L3 * math.cos(t3) - L4
    y = L1 * math.sin(t1) + L2 * math.sin(t2) - L3 * math.sin(t3)
    return math.hypot(x, y) / sum(linkage.lengths)


@given(cranks(), ANGLES)
def test_loop_closes(linkage, t1):
    assert closure(linkage, t1) < 1e-14


@pytest.mark.parametrize("branch", BRANCHES)
def test_loop_closes_for_crank_with_limited_range(branch):
    linkage = Linkage(0.4, 0.328, 0.525, 0.547, branch)
    least, greatest = linkage.crank_range
    for t1 in np.linspace(least, greatest, 50)[1:-1]:
        assert closure(linkage, t1) < 1e-14
        assert closure(linkage, -t1) < 1e-14


@given(cranks(), ANGLES)
def test_b_is_left_of_ac_for_the_open_branch(linkage, t1):
    motion = linkage.motion(t1)
    A, B = motion.position(1, linkage.L1), motion.position(2, linkage.L2)
    left_of = np.imag(np.conj(linkage.L4 - A) * (B - A))
    assert left_of * BRANCHES[linkage.branch] > 0


@given(cranks(), ANGLES)
def test_branches_are_mirror_images_about_the_ground_line(linkage, t1):
    other = Linkage(*linkage.lengths, "crossed" if linkage.branch == "open" else "open")
    here, there = linkage.motion(t1, 2.0, 3.0), other.motion(-t1, -2.0, -3.0)
    np.testing.assert_allclose(np.exp(1j * here.t), np.exp(-1j * there.t), atol=1e-12)
    np.testing.assert_allclose(here.omega, -there.omega, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(here.alpha, -there.alpha, rtol=1e-9, atol=1e-9)


@given(cranks(), ANGLES, st.floats(-50, 50), st.floats(-500, 500))
def test_velocities_and_accelerations_are_the_derivatives(linkage, t1, omega1, alpha1):
    motion = linkage.motion(t1, omega1, alpha1)
    bodies = free_bodies(linkage.lengths, BODIES, (t1, omega1, alpha1), 0.0, motion.t + OFF)
    np.testing.assert_allclose(np.exp(1j * motion.t), np.exp(1j * bodies.q[:, 2]), atol=1e-11)
    scale = omega1**2 + abs(alpha1) + 1.0
    for k, (_, X, Y, _) in enumerate(BODIES):
        point = complex(X, Y)
        for values, ours in (
            (bodies.q, motion.position(k + 1, point)),
            (bodies.qd, motion.velocity(k + 1, point)),
            (bodies.qdd, motion.acceleration(k + 1, point)),
        ):
            # Both sides divide by sin γ, which costs each some digits.
            np.testing.assert_allclose(ours, complex(*values[k, :2]), rtol=1e-10, atol=1e-11 * scale)
        assert motion.omega[k] == pytest.approx(bodies.qd[k, 2], rel=1e-10, abs=1e-11 * scale)
        assert motion.alpha[k] == pytest.approx(bodies.qdd[k, 2], rel=1e-10, abs=1e-11 * scale)


def test_crank_angles_in_an_array_equal_single_ones():
    linkage = Linkage(*THESIS)
    angles = TURN.reshape(4, 90)
    together = linkage.motion(angles, 30.0, 5.0)
    assert together.t.shape == together.alpha.shape == (3, 4, 90)
    for index in ((0, 0), (1, 7), (3, 89)):
        alone = linkage.motion(angles[index], 30.0, 5.0)
        np.testing.assert_allclose(together.alpha[:, *index], alone.alpha, rtol=1e-13)
    nodes = np.linspace(0.0, linkage.L2, 5)[:, None]
    assert linkage.motion(TURN).acceleration(2, nodes).shape == (5, 360)


def half_angle(a: float, b: float, c: float) -> list[float]:
    """Both angles t with a cos t + b sin t = c."""
    root = math.sqrt(a**2 + b**2 - c**2)
    return [2 * math.atan2(b + sign * root, a + c) for sign in (1, -1)]


@pytest.mark.parametrize("t1", [0.3, 1.0, 2.0, 4.0, 5.5])
def test_freudensteins_equations_hold_as_corrected_and_not_as_printed(t1):
    """Eqs. (3.5) and (3.7) of the thesis: (3.7) prints -K1 cos t2 instead of +K1 cos t2."""
    L1, L2, L3, L4 = THESIS
    K1, K2, K4 = L4 / L1, L4 / L3, L4 / L2
    K3 = (L1**2 - L2**2 + L3**2 + L4**2) / (2 * L1 * L3)
    K5 = (L3**2 - L4**2 - L1**2 - L2**2) / (2 * L1 * L2)
    both = [Linkage(*THESIS, branch).motion(t1).t for branch in BRANCHES]
    for _, t2, t3 in both:
        assert K1 * math.cos(t3) - K2 * math.cos(t1) + K3 == pytest.approx(math.cos(t1 - t3), abs=1e-13)
        assert K4 * math.cos(t1) + K1 * math.cos(t2) + K5 == pytest.approx(math.cos(t1 - t2), abs=1e-13)
        printed = K4 * math.cos(t1) - K1 * math.cos(t2) + K5 - math.cos(t1 - t2)
        assert abs(printed) == pytest.approx(2 * K1 * abs(math.cos(t2)))
        assert abs(printed) > 1e-2
    roots = half_angle(math.cos(t1) - K1, math.sin(t1), K3 - K2 * math.cos(t1))
    ours = np.sort_complex(np.exp(1j * np.array([t3 for *_, t3 in both])))
    np.testing.assert_allclose(ours, np.sort_complex(np.exp(1j * np.array(roots))), atol=1e-13)


def test_accelerations_of_b_agree_as_corrected_only():
    """Eq. (3.13) of the thesis prints sin t1 instead of sin t2 in two places."""
    linkage, omega1 = Linkage(*THESIS), 30.0
    motion = linkage.motion(TURN, omega1)
    (t1, t2, _), omega2, alpha2 = motion.t, motion.omega[1], motion.alpha[1]
    L1, L2, *_ = THESIS
    crank = -L1 * omega1**2 * np.exp(1j * t1)
    corrected = crank - L2 * omega2**2 * np.exp(1j * t2) + L2 * alpha2 * (-np.sin(t2) + 1j * np.cos(t2))
    printed_x = crank.real - L2 * omega2**2 * np.cos(t2) - L2 * alpha2 * np.sin(t1)
    printed_y = crank.imag - L2 * omega2**2 * np.sin(t1) + L2 * alpha2 * np.cos(t2)
    ours = motion.acceleration(3, linkage.L3)
    largest = np.abs(ours).max()
    np.testing.assert_allclose(ours, corrected, atol=1e-12 * largest)
    assert np.abs(printed_x - ours.real).max() > 0.5 * largest
    assert np.abs(printed_y - ours.imag).max() > 0.2 * largest


def test_mechanical_advantage_agrees_as_corrected_only():
    """Eq. (3.1) of the thesis prints L4 sin β instead of L1 sin β, which is 3.2 times too small."""
    linkage = Linkage(*THESIS)
    motion = linkage.motion(TURN)
    gamma, beta = motion.t[2] - motion.t[1], motion.t[0] - motion.t[1]
    corrected = linkage.L3 * np.sin(gamma) / (linkage.L1 * np.sin(beta))
    printed = linkage.L3 * np.sin(gamma) / (linkage.L4 * np.sin(beta))
    np.testing.assert_allclose(linkage.mechanical_advantage(TURN), corrected, rtol=1e-11)
    np.testing.assert_allclose(printed / corrected, 0.170 / 0.547)


@given(cranks(), ANGLES)
def test_transmission_angle_lies_between_the_links_at_b(linkage, t1):
    motion = linkage.motion(t1)
    A, B = motion.position(1, linkage.L1), motion.position(3, linkage.L3)
    between = abs(np.angle((A - B) / (linkage.L4 - B)))
    assert linkage.transmission_angle(t1) == pytest.approx(between, abs=1e-9)


@given(cranks())
def test_extremes_of_the_transmission_angle(linkage):
    """Compared with Eq. (3.10) of the thesis, and with all other crank angles."""
    L1, L2, L3, L4 = linkage.lengths
    extremes = linkage.transmission_extremes()
    for gamma, sign in ((extremes.min, 1), (extremes.max, -1)):
        cosine = (L2**2 + L3**2 + sign * 2 * L1 * L4 - L1**2 - L4**2) / (2 * L2 * L3)
        assert math.cos(gamma) == pytest.approx(cosine, abs=1e-12)
    over_the_turn = linkage.transmission_angle(TURN)
    assert extremes.min <= over_the_turn.min() + 1e-12
    assert extremes.max >= over_the_turn.max() - 1e-12
    np.testing.assert_allclose(
        linkage.transmission_angle([extremes.min_position, extremes.max_position]), extremes[::2]
    )


def test_thesis_linkage_has_advised_transmission_angles():
    """Section 3.5 of the thesis: smallest at t1 = 0, largest at 180°, within 40° … 140°."""
    linkage = Linkage(*THESIS)
    extremes = linkage.transmission_extremes()
    assert (extremes.min_position, extremes.max_position) == (0.0, math.pi)
    assert math.radians(40) < extremes.min < extremes.max < math.radians(140)
    assert transmission_warnings(linkage) == []


def test_poor_transmission_angle_gives_a_warning():
    (warning,) = transmission_warnings(Linkage(0.5, 0.6, 0.55, 0.2))
    least = math.acos((0.6**2 + 0.55**2 - (0.5 - 0.2) ** 2) / (2 * 0.6 * 0.55))
    assert f"from {math.degrees(least):.2f}°" in warning
    assert "40°–140°" in warning


@given(cranks())
def test_follower_velocity_is_zero_at_dead_points(linkage):
    over_the_turn = linkage.motion(np.linspace(0, 2 * math.pi, 721)).omega[2]
    if not linkage.dead_points:
        assert np.all(np.sign(over_the_turn) == np.sign(over_the_turn[0]))
        return
    motion = linkage.motion(linkage.dead_points)
    np.testing.assert_allclose(motion.omega[2], 0.0, atol=1e-6)
    distance = np.abs(motion.position(3, linkage.L3))
    np.testing.assert_allclose(distance, [linkage.L1 + linkage.L2, linkage.L2 - linkage.L1], rtol=1e-9)
    assert np.count_nonzero(np.diff(np.sign(over_the_turn))) == 2


@pytest.mark.parametrize("branch", BRANCHES)
@pytest.mark.parametrize(
    "lengths",
    [(0.4, 0.328, 0.525, 0.547), (0.547, 0.328, 0.525, 0.6), (0.5, 0.9, 0.4, 0.6), (1.0, 0.4, 0.5, 0.3)],
)
def test_linkage_closes_only_within_the_crank_range(lengths, branch):
    linkage = Linkage(*lengths, branch)
    least, greatest = linkage.crank_range
    assert not linkage.turns_fully
    for t1 in np.linspace(-3.14, 3.14, 92):
        d = abs(linkage.L4 - linkage.L1 * np.exp(1j * t1))
        closes = abs(linkage.L2 - linkage.L3) < d < linkage.L2 + linkage.L3
        assert closes == (least < abs(t1) < greatest)
        if closes:
            linkage.motion(t1)
        else:
            with pytest.raises(LinkageError, match=r"does not close at t1 = .*allowed: .*°"):
                linkage.motion(t1)


def test_coupler_and_follower_in_line_leave_the_motion_undetermined():
    linkage = Linkage(0.4, 0.328, 0.525, 0.547)
    assert linkage.transmission_angle(linkage.crank_range) == pytest.approx([0.0, math.pi], abs=1e-5)
    with pytest.raises(LinkageError, match="in line"):
        linkage.motion(linkage.crank_range[0])
    with pytest.raises(LinkageError, match="at t1 = 180° coupler and follower lie in line"):
        Linkage(1, 1, 1, 1).motion(math.pi)


@pytest.mark.parametrize(
    ("lengths", "spans"),
    [
        ((0.4, 0.328, 0.525, 0.547), (0.197, 0.853)),
        ((0.5, 0.9, 0.4, 0.6), (0.5,)),
        ((1.0, 0.4, 0.5, 0.3), (0.9,)),
    ],
)
def test_impossible_full_revolution_is_rejected(lengths, spans):
    """spans: distances AC at which coupler and follower are in line, folded and stretched."""
    linkage = Linkage(*lengths)
    L1, _, _, L4 = lengths
    ends = [math.degrees(math.acos((L1**2 + L4**2 - d**2) / (2 * L1 * L4))) for d in spans]
    message = "collinear at t1 = " + " and ".join(f"±{end:.4g}°" for end in ends) + ";"
    for refused in (linkage.require_full_turn, linkage.transmission_extremes, lambda: linkage.dead_points):
        with pytest.raises(LinkageError, match="the crank cannot turn fully") as caught:
            refused()
        assert message in str(caught.value)


def test_change_point_is_not_full_revolution():
    with pytest.raises(LinkageError, match="collinear at t1 = 0° and ±180°"):
        Linkage(1, 2, 1, 2).require_full_turn()


@pytest.mark.parametrize("wrong", [0.0, -0.1, math.nan, math.inf])
@pytest.mark.parametrize("name", ["L1", "L2", "L3", "L4"])
def test_lengths_that_are_not_positive_are_refused(name, wrong):
    lengths = {**dict(zip(("L1", "L2", "L3", "L4"), THESIS, strict=True)), name: wrong}
    with pytest.raises(ValueOutOfBoundsError, match=f"{name} is .*allowed: a length > 0"):
        Linkage(**lengths)


@pytest.mark.parametrize("lengths", [(1.0, 0.3, 0.3, 0.3), (0.1, 0.6, 0.2, 0.3), (0.3, 0.6, 0.1, 0.2)])
def test_link_as_long_as_sum_of_others_is_rejected(lengths):
    with pytest.raises(LinkageError, match="no movable linkage can be assembled"):
        Linkage(*lengths)


def test_other_invalid_input_is_refused():
    with pytest.raises(UnknownNameError, match="unknown branch 'opened'; did you mean 'open'"):
        Linkage(*THESIS, "opened")
    with pytest.raises(LinkageError, match="t1 = nan"):
        Linkage(*THESIS).motion(math.nan)
