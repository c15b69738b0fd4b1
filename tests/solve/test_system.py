"""Periodic systems: samples, checks, and all kinds of invalid matrices."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from solve import PeriodicSystem, floquet, periodic
from solve.errors import MatricesError, ValueOutOfBoundsError
from solve.period.points import SinglePoint, affine, state_rate
from solve.system import check
from tests.solve.systems import cam, frozen_modes, random_matrices, random_system, seeds, system

PHASES = np.linspace(-9.0, 9.0, 83)


def oscillator(phase, speed):
    one = np.ones((len(phase), 1, 1))
    return one, 0.1 * one, 4.0 * one, np.cos(phase)[:, None]


def altered(**parts):
    """Return the oscillator with some of M, C, K and d replaced by functions of the phase."""

    def matrices(phase, speed):
        given = dict(zip("MCKd", oscillator(phase, speed), strict=True))
        return tuple((given | {name: part(phase) for name, part in parts.items()}).values())

    return system(matrices, 1)


def square(values):
    return np.asarray(values)[:, None, None]


@given(seeds, st.integers(1, 3), st.integers(7, 24), st.floats(0.5, 9.0))
@settings(max_examples=30, deadline=None)
def test_sufficient_samples_reproduce_the_system(seed, n, count, period):
    """The matrices are series up to harmonic 3, sampled at 7 or more uniform phases, odd or even in number,
    in any period."""
    matrices = random_matrices(seed, n)
    scale = 2 * np.pi / period
    nodes = np.arange(count) * (period / count)
    samples = matrices(scale * nodes, 1.0)
    computed = PeriodicSystem.from_samples(*samples, [f"q{i}" for i in range(n)], period).at(PHASES, 1.0)
    for ours, truth in zip(computed, matrices(scale * PHASES, 1.0), strict=True):
        np.testing.assert_allclose(ours, truth, rtol=0, atol=1e-12 * np.abs(truth).max())


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 8])
def test_interpolation_passes_through_the_samples(count):
    rng = np.random.default_rng(count)
    samples = [rng.standard_normal((count, 2, 2)) for _ in range(3)] + [rng.standard_normal((count, 2))]
    computed = PeriodicSystem.from_samples(*samples, ["a", "b"]).at(
        np.arange(count) * (2 * np.pi / count), 1.0
    )
    for ours, given_samples in zip(computed, samples, strict=True):
        np.testing.assert_allclose(ours, given_samples, rtol=0, atol=1e-14)


def test_highest_harmonic_of_even_sample_counts_is_a_cosine():
    ones = np.ones((4, 1, 1))
    K = square([1.0, -1.0, 1.0, -1.0]) + 3
    computed = PeriodicSystem.from_samples(ones, ones, K, np.ones((4, 1)), ["q"]).at(PHASES, 1.0)[2]
    np.testing.assert_allclose(computed[:, 0, 0], 3.0 + np.cos(2 * PHASES), rtol=0, atol=1e-13)


def test_orbit_from_samples_matches_the_function():
    speed, nodes = 20 * np.pi, np.arange(64) * (np.pi / 32)
    sampled = PeriodicSystem.from_samples(*cam().at(nodes, speed), ["q1", "q2", "q3"])
    ours, truth = periodic(sampled, speed), periodic(cam(), speed)
    np.testing.assert_allclose(
        ours.at(PHASES) / np.abs(truth.q).max(axis=1)[:, None],
        truth.at(PHASES) / np.abs(truth.q).max(axis=1)[:, None],
        rtol=0,
        atol=1e-7,
    )
    assert ours.spectral_radius == pytest.approx(truth.spectral_radius, rel=1e-7)


@pytest.mark.parametrize(
    "shapes",
    [
        [(4, 1, 1), (3, 1, 1), (4, 1, 1), (4, 1)],
        [(), (), (), ()],
        [(0, 1, 1), (0, 1, 1), (0, 1, 1), (0, 1)],
        [(4, 1, 1), (4, 1, 1), (4, 1, 1), ()],
    ],
)
def test_samples_of_different_counts_are_refused(shapes):
    with pytest.raises(
        MatricesError, match=r"samples of M, C, K, d have shapes .* give each the same first dimension"
    ):
        PeriodicSystem.from_samples(*(np.ones(shape) for shape in shapes), ["q"])


@pytest.mark.parametrize("K", [np.ones((4, 1, 1)) * 1j, "stiff", [[1.0], [2.0, 3.0]]])
def test_samples_that_are_not_real_numbers_are_refused(K):
    with pytest.raises(MatricesError, match="the samples are not four real arrays M, C, K, d"):
        PeriodicSystem.from_samples(np.ones((4, 1, 1)), np.ones((4, 1, 1)), K, np.ones((4, 1)), ["q"])


@pytest.mark.parametrize("period", [0.0, -1.0, np.nan])
def test_invalid_sample_period_is_refused(period):
    parts = np.ones((4, 1, 1)), np.ones((4, 1, 1)), np.ones((4, 1, 1)), np.ones((4, 1))
    with pytest.raises(ValueOutOfBoundsError, match=rf"period is {period}; allowed: a finite phase > 0"):
        PeriodicSystem.from_samples(*parts, ["q"], period=period)


def test_lists_and_integers_are_accepted_as_matrices():
    def listed(phase, speed):
        return tuple(part.tolist() for part in oscillator(phase, speed))

    def whole(phase, speed):
        one = np.ones((len(phase), 1, 1), dtype=int)
        return one, one, 3 * one, one[:, 0]

    assert periodic(system(listed, 1), 1.0).harmonics("q1")[0][1] == pytest.approx(1 / np.hypot(3.0, 0.1))
    np.testing.assert_allclose(periodic(system(whole, 1), 1.0).q, 1 / 3, rtol=1e-12)


@pytest.mark.parametrize(
    ("part", "value", "message"),
    [
        ("M", lambda p: np.ones((len(p), 2, 2)), r"M at 4 phases has shape \(4, 2, 2\); for 1 coord"),
        ("C", lambda p: np.ones((len(p), 1)), r"C at 4 phases has shape \(4, 1\); .* must be \(4, 1, 1\)"),
        ("K", lambda p: np.ones((1, 1)), r"K at 4 phases has shape \(1, 1\)"),
        ("d", lambda p: np.ones(len(p)), r"d at 4 phases has shape \(4,\); .* must be \(4, 1\)"),
        ("d", lambda p: np.ones((len(p), 1, 1)), r"d at 4 phases has shape \(4, 1, 1\)"),
        ("K", lambda p: square(np.full(len(p), np.nan)), "K has NaN or infinite entries at phase 0; check"),
        ("d", lambda p: np.where(p > 6, np.inf, 1.0)[:, None], "d has NaN or infinite entries at phase 6.28"),
        ("K", lambda p: square(4 + p), "K is not periodic: between phase 0 and 6.28319 it changes by 6.28"),
        ("d", lambda p: np.cos(p / 2)[:, None], "d is not periodic: .* give the correct period"),
        ("M", lambda p: square(0 * p), "M is singular: some coordinate has no inertia; give every"),
        ("C", lambda p: square(1j * p), "not four real arrays M, C, K, d: .*complex"),
        ("C", lambda p: square(["soft"] * len(p)), "not four real arrays M, C, K, d"),
    ],
)  # fmt: skip
def test_invalid_matrices_are_refused(part, value, message):
    with pytest.raises(MatricesError, match=message):
        periodic(altered(**{part: value}), 1.0)
    with pytest.raises(MatricesError, match=message):
        floquet(altered(**{part: value}), 1.0)


@pytest.mark.parametrize("given", [None, (1.0, 2.0), oscillator(PHASES, 1.0)[:3], 3.0])
def test_invalid_return_values_are_refused(given):
    with pytest.raises(MatricesError, match="the matrices are not four real arrays M, C, K, d: "):
        periodic(system(lambda phase, speed: given, 1), 1.0)


def test_error_for_scalar_functions_mentions_arrays_of_phases():
    def matrices(phase, speed):
        return np.eye(2), np.eye(2), (4 + np.cos(phase)) * np.eye(2), np.array([np.cos(phase), 1.0])

    with pytest.raises(ValueError, match="broadcast") as raised:
        periodic(system(matrices, 2), 1.0)
    assert any("for 4 phases at once" in note and "(4, 2, 2)" in note for note in raised.value.__notes__)


@pytest.mark.parametrize("part", ["K", "d"])
def test_solver_detects_nan_between_the_checked_phases(part):
    """The matrices are NaN only between 2.8 and 3.2, where no phase is checked beforehand."""

    def gap(phase):
        values = np.where(np.abs(phase - 3.0) < 0.2, np.nan, 1.0)
        return square(values) if part == "K" else values[:, None]

    for method in ("radau", "gauss", "newmark", "rk4"):
        with pytest.raises(
            MatricesError, match=rf"{part} has NaN or infinite entries at phase (2\.[89]|3\.[01])"
        ):
            periodic(altered(**{part: gap}), 1.0, method)


def test_two_coordinates_with_one_mass_are_singular():
    def shared(phase, speed):
        zero = np.zeros((len(phase), 2, 2))
        return zero + np.ones((2, 2)), zero, zero + np.eye(2), zero[:, 0]

    with pytest.raises(MatricesError, match="M is singular"):
        periodic(system(shared, 2), 1.0)


@pytest.mark.parametrize("scale", [1e-12, 1e12])
def test_small_and_large_masses_are_not_singular(scale):
    def scaled(phase, speed):
        one = np.ones((len(phase), 1, 1))
        M = np.zeros((len(phase), 2, 2)) + np.diag([scale, 1.0])
        return M, M * 0.3, M * 2.0, np.concatenate((one[:, 0], one[:, 0]), axis=1)

    stability = floquet(system(scaled, 2), 1.0)
    np.testing.assert_allclose(np.abs(stability.multipliers), np.exp(-0.3 * np.pi), rtol=1e-9)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"period": 0.0}, "period is 0.0; allowed: a finite phase > 0"),
        ({"period": np.nan}, "period is nan"),
        ({"period": -1.0}, r"period is -1\.0"),
        ({"breaks": (1.0, np.nan)}, r"breaks are \[1\.0, nan\]; allowed: finite phases"),
        ({"breaks": (np.inf,)}, "breaks are"),
        ({"breaks": 1.0}, "breaks is 1.0; allowed: sequence of float"),
        ({"breaks": "1"}, "breaks is '1'"),
        ({"breaks": None}, "breaks is None"),
    ],
)
def test_settings_out_of_bounds_are_refused(settings, message):
    with pytest.raises(ValueOutOfBoundsError, match=message):
        PeriodicSystem(oscillator, ["q"], **settings)


def test_breaks_and_coordinates_may_be_iterators():
    found = PeriodicSystem(oscillator, iter(["q"]), breaks=iter([1.0, 2.0]))  # type: ignore[arg-type]
    assert (found.coordinates, found.breaks) == (("q",), (1.0, 2.0))


@pytest.mark.parametrize("coordinates", [[], ["a", "a"], 3, None])
def test_duplicate_coordinate_names_are_refused(coordinates):
    words = r"give each of the n coordinates a different name|allowed: sequence of str"
    with pytest.raises(ValueOutOfBoundsError, match=words):
        PeriodicSystem(oscillator, coordinates)


@given(seeds, st.integers(1, 4), st.floats(0.3, 3.0))
@settings(max_examples=20, deadline=None)
def test_state_rate_and_frozen_eigenvalues_satisfy_eq_5(seed, n, speed):
    given_system = random_system(seed, n)
    phase = np.linspace(0.1, 6.0, 7)
    M, C, K, d = given_system.at(phase, speed)
    rate = state_rate(SinglePoint(given_system, speed), phase)[0]
    x = np.random.default_rng(seed).standard_normal((7, 2 * n))
    q, v, a = x[:, :n], x[:, n:], affine(rate, x)[:, n:]
    for k in range(7):
        np.testing.assert_allclose(
            rate[k, :, :-1] @ x[k] + rate[k, :, -1], [*v[k], *a[k]], rtol=0, atol=1e-10
        )
        left = speed**2 * M[k] @ a[k] + speed * C[k] @ v[k] + K[k] @ q[k]
        np.testing.assert_allclose(left, d[k], rtol=0, atol=1e-10)
    frozen = frozen_modes(given_system, speed, 5).eigenvalues()[0]
    phase = (np.arange(5) + 0.5) * (2 * np.pi / 5)
    M, C, K, _ = given_system.at(phase, speed)
    for k in range(5):
        for value in frozen[k]:
            pencil = value**2 * speed**2 * M[k] + value * speed * C[k] + K[k]
            size = abs(value) ** 2 * speed**2 * np.linalg.norm(M[k]) + np.linalg.norm(K[k])
            assert np.linalg.svd(pencil, compute_uv=False)[-1] < 1e-10 * size


def bladed(phase, speed):
    """Return a system with three blades, whose contributions to C and d cancel up to round-off."""
    one = np.ones((len(phase), 1, 1))
    cancels = sum(np.cos(phase + k * 2 * np.pi / 3) for k in range(3))
    return one, cancels[:, None, None], 4.5 * one, cancels[:, None]


def test_cancelling_terms_are_periodic_up_to_roundoff():
    orbit = periodic(PeriodicSystem(bladed, ["q"]), 1.0, "gauss", steps=16, rtol=0.9)
    assert np.abs(orbit.q).max() < 1e-12


@pytest.mark.parametrize("width", [1e-3, 1e-6, 1e-9])
def test_narrow_pulse_between_declared_breaks_is_periodic(width):
    """The pulse is half a cosine wave about phase 0, and its ends are declared breaks."""

    def pulsed(phase, speed):
        one = np.ones((len(phase), 1, 1))
        distance = np.mod(phase + np.pi, 2 * np.pi) - np.pi
        pulse = np.where(np.abs(distance) < width, np.cos(np.pi * distance / (2 * width)), 0.0)
        return one, 0.1 * one, 4.0 * one + pulse[:, None, None], np.ones((len(phase), 1))

    check(PeriodicSystem(pulsed, ["q"], breaks=(width, -width)), 1.0)


def test_small_nonperiodic_terms_are_refused():
    def aperiodic(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, 1e-8 * phase[:, None, None] * one, 4.0 * one, np.cos(phase)[:, None]

    with pytest.raises(MatricesError, match=r"C is not periodic: between phase 0 and 6\.28319"):
        check(PeriodicSystem(aperiodic, ["q"]), 1.0)


def test_function_may_modify_its_phase_argument():
    def matrices(phase, speed):
        phase %= 2 * np.pi
        one = np.ones((len(phase), 1, 1))
        return one, 0.1 * one, 4.0 * one, np.cos(phase)[:, None]

    def left_alone(phase, speed):
        return matrices(phase.copy(), speed)

    changed, same = (periodic(PeriodicSystem(each, ["q"]), 1.0) for each in (matrices, left_alone))
    np.testing.assert_array_equal(changed.q, same.q)


def test_attributes_set_after_a_solve_apply_to_later_solves():
    oscillator = random_system(3, 1)
    assert floquet(oscillator, "5 rad/s").system.labels.title == ""
    oscillator.labels = replace(oscillator.labels, title="set later")
    assert floquet(oscillator, "5 rad/s").system.labels.title == "set later"
    assert floquet(oscillator, "50 rpm").system.labels.title == "set later"
