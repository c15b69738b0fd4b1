"""Claims of chapter and paper about their figures: harmonics, sidebands, profiles, and both methods."""

import functools

import numpy as np
import pytest

import solve

TURN = np.linspace(0.0, 2 * np.pi, 2001)
TEETH = 14
"""Of the pinion, chapter Table 3."""
ERRORS_MM = {
    "1": (0.0015, 0.0035, 0.0027, 0.0011, 0.0005, 0.0013),
    "2": (0.010, 0.003, 0.0018, 0.0011, 0.0009, 0.0003),
}
"""Chapter Table 5, e1 to e6."""


@functools.cache
def orbit(model, speed, case=None):
    return solve.periodic(solve.load(model, case=case), speed, rtol=1e-9)


def orders(model, speed, case, name):
    """Return the amplitudes of harmonics of the shaft frequency without the mean: entry k is harmonic k +
    1."""
    return orbit(model, speed, case).harmonics(name)[0][1:]


def strongest(amplitudes, count):
    return {int(k) + 1 for k in np.argsort(amplitudes)[::-1][:count]}


def test_coupler_midpoint_has_first_and_second_harmonic():
    """Paper § 3. The third harmonic is below 1 % of the first."""
    computed = orders("coupler", "62.8 rad/s", None, "midpoint_deflection")
    assert strongest(computed, 2) == {1, 2}
    assert computed[2:].max() < 0.01 * computed[0]


def test_higher_coupler_modes_are_small_compared_with_the_first():
    """Paper § 3. By Table 2 of the paper, they are 3.3 % and 0.4 % of the first mode at 600 rpm."""
    first, *higher = (orbit("coupler", "600 rpm").statistics(name).max_abs for name in ("q1", "q2", "q3"))
    assert [each / first for each in higher] == pytest.approx([0.0090 / 0.2750, 0.0011 / 0.2750], rel=0.05)


@pytest.mark.parametrize("case", ["1", "2"])
def test_slow_cam_has_harmonics_1_3_and_5(case):
    """Chapter § 4.1, Fig. 4. Each exceeds 10 % of the largest; for profile 2, harmonic 9 does too."""
    computed = orders("cam", "100 rpm", case, "q3")
    large = {int(k) + 1 for k in np.flatnonzero(computed > 0.1 * computed.max())}
    assert large == ({1, 3, 5} if case == "1" else {1, 3, 5, 9})


@pytest.mark.parametrize("case", ["1", "2"])
def test_motion_of_the_fast_cam_has_over_twenty_harmonics(case):
    """Chapter § 4.1, Figs. 5 and 6. More than 20 harmonics exceed 10 % of the largest; at 100 rpm, at most
    four."""
    computed = orders("cam", "600 rpm", case, "q3")
    assert np.count_nonzero(computed > 0.1 * computed.max()) > 20


@pytest.mark.parametrize("case", ["1", "2"])
def test_cam_error_grows_faster_than_its_load(case):
    """Chapter § 4.1, "more serious at high speeds". At six times the speed, the inertia force is 36 times as
    large."""
    slow, fast = (orbit("cam", speed, case).statistics("q3") for speed in ("100 rpm", "600 rpm"))
    assert (fast.max - fast.min) / (slow.max - slow.min) > 36


def test_cam_profile_changes_the_vibration():
    """Chapter §§ 4.1 and 4.3. The peak-to-peak values differ by at least half of the smaller one."""
    for model, speed, name in (("cam", "100 rpm", "q3"), ("manipulator", "50 rpm", "q2")):
        size = [
            computed.max - computed.min
            for computed in (orbit(model, speed, case).statistics(name) for case in ("1", "2"))
        ]
        assert size[1] > 1.5 * size[0]


@pytest.mark.parametrize("case", ["1", "2"])
def test_manipulator_motion_has_odd_harmonics(case):
    """Chapter § 4.3, Figs. 18 and 19: Ω, 3Ω and 5Ω. For profile 2 and the printed numbers, the harmonics next
    to the natural frequency of q2, sqrt(k2/m2) = 16.4 Ω, are larger than these."""
    computed = orders("manipulator", "50 rpm", case, "q2")
    assert computed[1::2].max() < 1e-3 * computed.max()
    assert computed[[0, 2, 4]].min() > 0.1 * computed.max()
    assert strongest(computed, 3) == ({1, 3, 5} if case == "1" else {13, 15, 17})


def lines(case):
    return orbit("gear_pair", "1800 rpm", case).harmonics("transmission_error_rate")[0]


def test_gear_sidebands_follow_tooth_errors():
    """Chapter § 4.2, Fig. 10. The stiffness couples only harmonics whose orders differ by multiples of the
    number of teeth. The sidebands at ±i of every meshing line are therefore proportional to e_i, and the
    meshing lines do not change."""
    first, second = lines("1"), lines("2")
    for meshing in TEETH * np.arange(1, 4):
        assert second[meshing] == pytest.approx(first[meshing], rel=1e-6)
        for i, (one, two) in enumerate(zip(*ERRORS_MM.values(), strict=True), start=1):
            for line in (meshing - i, meshing + i):
                assert second[line] / first[line] == pytest.approx(two / one, rel=1e-6)


def test_gear_sidebands_are_larger_in_case_2():
    """Chapter § 4.2. Those at ±30 and ±150 Hz are larger. Those at ±60, ±90 and ±180 Hz are not, because
    their e_i are smaller."""
    first, second = lines("1"), lines("2")
    for meshing in (TEETH, 2 * TEETH):
        for i, larger in ((1, True), (2, False), (3, False), (5, True), (6, False)):
            for line in (meshing - i, meshing + i):
                assert (second[line] > first[line]) == larger


@pytest.mark.parametrize(
    ("model", "speed", "steps", "within"),
    [
        ("coupler", "600 rpm", 1000, 1e-6),
        ("coupler", "1500 rpm", 400, 1e-4),
        ("gear_pair", "1800 rpm", 20_000, 1e-4),
        ("cam", "100 rpm", 20_000, 1e-4),
    ],
)
def test_both_methods_agree_with_sufficiently_fine_steps(model, speed, steps, within):
    """Paper § 3 with its steps of 1e-4 s, and chapter § 4. The largest difference of any coordinate over a
    period is compared."""
    average = solve.Newmark(gamma=1 / 2, beta=1 / 6 if model == "coupler" else 1 / 4)
    computed = [
        solve.periodic(solve.load(model), speed, method, steps=steps, rtol=0.5).at(TURN)
        for method in (average, "rk4")
    ]
    error = np.abs(computed[0] - computed[1]).max(axis=1) / np.abs(computed[1]).max(axis=1)
    assert error.max() < within
