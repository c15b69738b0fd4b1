"""Floquet modes keep their identity through crossings and veerings."""

import numpy as np
import pytest

import solve
from solve.errors import MissingValueError, StepsError, UnknownNameError, ValueOutOfBoundsError
from solve.studies.mode_vectors import ModeVectors
from tests.solve.studies.planted_modes import Planted, pair

SPEEDS = np.linspace(0.613, 1.409, 9)
GAPS = [0.3, 0.1, 0.03, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 3e-7, 1e-9, 1e-11, 0.0]
QUICK = 1e-2, 1e-5, 1e-11, 0.0


def followed(planted):
    return solve.follow_modes(planted.system(), SPEEDS)


def values_agree(result, planted):
    """Check at every speed that the exponents are those of the constant system, up to multiples of the
    speed."""
    for row, speed in enumerate(SPEEDS):
        for exponent in result.exponents[row]:
            difference = exponent - np.append(planted.exponents(speed), planted.exponents(speed).conj())
            turns = np.round(difference.imag / speed)
            assert np.abs(difference - 1j * turns * speed).min() < 1e-6


def ends(result, planted):
    """Return, for each mode, the ranks of its exponent among the ascending exponents at both ends."""
    places = []
    for row in (0, -1):
        truth = planted.exponents(SPEEDS[row])
        every = np.concatenate((truth, truth.conj()))
        difference = result.exponents[row][:, None] - every
        turns = np.round(difference.imag / SPEEDS[row])
        places.append(np.abs(difference - 1j * turns * SPEEDS[row]).argmin(axis=1) % planted.n)
    return np.array(places).T


@pytest.mark.parametrize(
    ("gap", "rotating"),
    [
        pytest.param(gap, rotating, marks=[] if rotating and gap in QUICK else pytest.mark.slow)
        for gap in GAPS
        for rotating in (True, False)
    ],
)
def test_modes_are_never_swapped_without_a_warning(gap, rotating):
    planted = pair(gap, seed=int(-np.log10(gap + 1e-12)), rotating=rotating)
    result = followed(planted)
    values_agree(result, planted)
    places = ends(result, planted)
    keeps_order = (places[:, 0] == places[:, 1]).all()
    kinds = {meeting.kind for meeting in result.meetings if set(meeting.modes) == {"1", "2"}}
    if gap > result.resolution:
        assert keeps_order
        assert not result.ambiguous
        if gap < 0.1:
            (veering,) = (meeting for meeting in result.meetings if meeting.kind == "veering")
            assert veering.gap == pytest.approx(gap, rel=0.1)
            assert veering.value == pytest.approx(planted.meeting(0, 1)[0], abs=0.01)
    else:
        assert not keeps_order
        assert "crossing" in kinds


@pytest.mark.parametrize(("gap", "kind"), [(0.02, "veering"), (0.002, "crossing")])
def test_coupling_above_the_damping_difference_causes_veering(gap, kind):
    """Modes with growth rates -0.005 and -0.01 exchange their vectors if the gap is at least the difference,
    0.005."""
    result = followed(pair(gap, seed=3, damping=(0.01, 0.02)))
    assert [meeting.kind for meeting in result.meetings] == [kind]
    order = np.argsort(-result.damping, axis=1)[[0, -1]]
    assert (order[0] == order[1]).all() == (kind == "crossing")


@pytest.mark.parametrize("gaps", [(1e-2, 1e-4, 1e-5), (0.0, 1e-3, 0.0)])
def test_three_modes_keep_their_identity_where_they_meet(gaps):
    """The modes keep their order if all pairs are coupled. If the first is not coupled to the others, it
    crosses both."""
    frequencies = np.array([[3.0, 0.8], [3.05, 0.1], [3.1, -0.6]])
    couplings = {(0, 1): gaps[0], (1, 2): gaps[1], (0, 2): gaps[2]}
    planted = Planted(frequencies, np.full(3, 0.03), couplings)
    result = followed(planted)
    values_agree(result, planted)
    expected = {0: 0, 1: 1, 2: 2} if all(gaps) else {0: 2, 1: 0, 2: 1}
    assert dict(ends(result, planted).tolist()) == expected
    assert not result.ambiguous


def test_modes_locked_in_a_combination_resonance_are_ambiguous():
    """Without damping, there is a combination resonance at the speed ω1 + ω2 = 3. There, both modes have an
    exponent that grows and one that decays."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        K = one * np.diag([1.0, 4.0])
        K[:, 0, 1] = K[:, 1, 0] = 0.4 * np.cos(phase)
        return one * np.eye(2), 0 * K, K, np.zeros((len(phase), 2))

    result = solve.follow_modes(solve.PeriodicSystem(matrices, ["a", "b"]), np.linspace(2.7, 3.3, 13))
    (pair_found,) = {pair.modes for pair in result.ambiguous}
    assert pair_found == ("1", "2")
    assert [pair.kind for pair in result.ambiguous] == ["locked"]
    assert result.ambiguous[0].low < 2.86 < 3.14 < result.ambiguous[0].high
    growing = np.abs(result.exponents.real).max(axis=1) > 1e-3
    assert growing.any()
    assert not growing[[0, -1]].any()
    assert any("undetermined" in warning for warning in result.warnings)
    # Before and after, each mode is near its own frequency.
    np.testing.assert_allclose(result.frequencies[[0, -1]], [[1.0, 2.0]] * 2, atol=0.03)


def test_real_multipliers_of_one_mode_do_not_end_its_track():
    """Near ω = Ω/2, the mode of Mathieu's equation is locked with its own conjugate. Its track continues
    beyond."""
    system = solve.load("mathieu", delta=1.0, epsilon=0.3, zeta=0.01)
    result = solve.follow_modes(system, np.linspace(0.8, 1.2, 21))
    assert result.labels == ["1"]
    assert not result.ambiguous
    np.testing.assert_allclose(result.frequencies[[0, -1], 0], 1.0, atol=0.04)
    assert result.damping.min() < 0 < result.damping[0, 0]


def test_equal_uncoupled_oscillators_are_followed_as_a_group():
    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1)) * np.eye(2)
        return one, 0.1 * one, (4.0 + speed) * one, np.zeros((len(phase), 2))

    result = solve.follow_modes(solve.PeriodicSystem(matrices, ["a", "b"]), [1.0, 1.3, 1.7])
    assert not result.ambiguous
    expected = np.sqrt(4.0 + np.array([1.0, 1.3, 1.7]) - 0.05**2)
    np.testing.assert_allclose(result.frequencies, np.tile(expected[:, None], 2), rtol=1e-7)


def test_participations_match_those_in_rotating_coordinates():
    """A mode that is constant in the rotating frame has the harmonics ±1 of both coordinates, each with a
    participation of a quarter."""
    result = followed(pair(0.0, seed=5))
    main = list(result.harmonics).index(0)
    np.testing.assert_allclose(result.participation[0, :, :, main], 0.25, atol=0.02)
    np.testing.assert_allclose(result.participation.sum(axis=(2, 3)), 1.0, atol=0.01)


def test_harmonic_powers_match_those_of_given_waves():
    """The mode is p = (e^{2iφ} + e^{-iφ}/2, e^{-8iφ}) at 24 nodes; the inertias are 1 and 3."""
    nodes = np.arange(24) * 2 * np.pi / 24
    parts = np.stack((np.exp(2j * nodes) + 0.5 * np.exp(-1j * nodes), np.exp(-8j * nodes)), axis=1)[
        :, :, None
    ]
    modes = ModeVectors(
        1.0, nodes, np.full(24, 1 / 24), np.zeros(1), np.zeros(1), parts, np.array([1.0, 3.0])
    )
    expected = [[[0.0, 0.25, 0.0, 1.0], [3.0, 0.0, 0.0, 0.0]]]
    np.testing.assert_allclose(modes.power(np.array([-8, -1, 0, 2])), expected, atol=1e-14)


def test_modes_are_followed_versus_a_parameter():
    system = solve.load("mathieu", delta=1.3, epsilon=0.1, zeta=0.05)
    result = solve.follow_modes(system, 1.0, over="delta=1.2:1.8:4")
    assert result.over == "delta"
    np.testing.assert_allclose(result.frequencies[:, 0], np.sqrt(result.values), atol=0.02)


def test_speeds_without_a_solution_are_listed():
    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, 0.1 * one, one * (np.nan if speed == 2.0 else 4.0), np.zeros((len(phase), 1))

    result = solve.follow_modes(solve.PeriodicSystem(matrices, ["q"]), [1.0, 2.0, 3.0])
    assert np.isnan(result.frequencies[1, 0])
    np.testing.assert_allclose(result.frequencies[[0, 2], 0], np.sqrt(4 - 0.0025), rtol=1e-7)
    assert any("no result at" in warning for warning in result.warnings)


def test_invalid_arguments_are_refused():
    mathieu = solve.load("mathieu", delta=1.3, epsilon=0.1)
    with pytest.raises(ValueOutOfBoundsError, match="at least two"):
        solve.follow_modes(mathieu, [1.0])
    with pytest.raises(StepsError, match="radau or gauss"):
        solve.follow_modes(mathieu, [1.0, 2.0], method="newmark")
    with pytest.raises(ValueOutOfBoundsError, match="one speed"):
        solve.follow_modes(mathieu, [1.0, 2.0], over="delta=1:2:3")
    with pytest.raises(UnknownNameError):
        solve.follow_modes(mathieu, 1.0, over="nope=1:2:3")
    with pytest.raises((MissingValueError, ValueOutOfBoundsError)):
        solve.follow_modes(mathieu)


def test_modes_of_a_first_order_system_are_followed():
    """The equation is ẏ = A y in rotating coordinates. The eigenvalues of A are constant."""
    A = np.array([[0.0, 1.0, 0.0], [-9.0, -0.1, 1.0], [0.3, 0.0, -2.0]])

    def matrices(phase, speed):
        c, s, zero = np.cos(phase), np.sin(phase), 0 * phase
        S = np.array([[c, s, zero], [-s, c, zero], [zero, zero, zero + 1]]).transpose(2, 0, 1)
        dS = np.array([[-s, c, zero], [-c, -s, zero], [zero, zero, zero]]).transpose(2, 0, 1)
        return np.swapaxes(S, 1, 2) @ (A @ S - speed * dS), np.zeros((len(phase), 3))

    speeds = [1.0, 1.3, 1.9]
    result = solve.follow_modes(solve.FirstOrderSystem(matrices, ["a", "b", "c"]), speeds)
    truth = np.linalg.eigvals(A)
    for speed, exponents in zip(speeds, result.exponents, strict=True):
        for exponent in exponents:
            difference = exponent - truth
            turns = np.round(difference.imag / speed)
            assert np.abs(difference - 1j * turns * speed).min() < 1e-8
    assert len(result.labels) == 2


def test_unresolved_harmonics_are_reported():
    """At low speeds, the modes of the cam have several hundred harmonics."""
    result = solve.follow_modes(solve.load("cam"), "100:110:2 rpm", steps=128)
    assert any("128 steps do not resolve the harmonics of all modes" in text for text in result.warnings)
    assert not followed(pair(1e-2, seed=2)).warnings


def test_unrefined_ranges_are_reported(monkeypatch):
    monkeypatch.setattr("solve.studies.follow_modes._ADDED", 1)
    result = followed(pair(1e-4, seed=2))
    (sentence,) = (text for text in result.warnings if "modes are not identified from" in text)
    assert sentence.endswith("give closer values or a smaller range")


def test_shifts_beyond_the_nodes_cause_no_numpy_warning():
    """The mode has a frequency of 400 times the speed. This number halves between the two speeds."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1)) * np.eye(2)
        return one, 0.02 * one, one @ np.diag([400.0**2, 1.0]), np.zeros((len(phase), 2))

    result = solve.follow_modes(solve.PeriodicSystem(matrices, ["a", "b"]), [1.0, 2.0])
    assert result.frequencies.shape == (2, len(result.labels))
