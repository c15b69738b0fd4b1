"""Accurate orbits with false multipliers and other misleading results: each of them has a warning."""

from functools import cache

import numpy as np
import pytest
from scipy.linalg import expm

from solve import Newmark, PeriodicSystem, Radau, floquet, load, periodic
from solve.errors import StepsError
from solve.methods.choice import METHODS, chosen
from solve.methods.gauss import Gauss
from tests.solve.certificates.population import member
from tests.solve.certificates.trials import matched_error
from tests.solve.certificates.truth import PHASES
from tests.solve.references import Shooting, multiplier_error, relative_error
from tests.solve.systems import cam, constant, frozen_modes, random_system, system

KEEPING = [name for name in METHODS if name != "auto" and not chosen(name).l_stable]
DENSE = ("fourier", "hill", "bahgat-willmert")
UNRESOLVED = "leave stiff modes unresolved"
SLOW = 100 * np.pi / 30


def turning_beam(ratio=60.0, damping=0.02):
    """Return the softest bending mode and the stiffest axial mode of a beam that rotates with the phase, in
    fixed axes. The stiff mode decays within the period. A method that does not damp it couples it with the
    soft mode."""
    stiffness, loss = np.diag([3.3**2, (3.3 * ratio) ** 2]), np.diag([3.3, 3.3 * ratio]) * 2 * damping

    def matrices(phase, speed):
        c, s = np.cos(phase), np.sin(phase)
        R = np.moveaxis(np.array([[c, -s], [s, c]]), -1, 0)
        K, C = (R @ each @ np.swapaxes(R, 1, 2) for each in (stiffness, loss))
        eye = np.broadcast_to(np.eye(2), K.shape)
        return eye, C, K, np.tile([0.0, -9.81], (len(phase), 1))

    return system(matrices, 2)


CASES = {"cam at 100 rpm": (cam("1"), SLOW), "turning beam": (turning_beam(), 1.0)}


@pytest.fixture(scope="module")
def truths():
    return {name: floquet(*case, Radau(13), rtol=1e-11) for name, case in CASES.items()}


def test_every_method_without_stiff_damping_is_tested():
    """A newly registered method is tested without further changes."""
    assert set(METHODS) - set(KEEPING) == {"auto", "radau"}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize(
    ("method", "steps"),
    # Eigenvalue problems over all orders take seconds on more steps.
    [(name, m) for name in KEEPING for m in ((33,) if name in DENSE else (33, 61, 101))],
)
def test_unresolved_stiff_modes_are_flagged_and_false_multipliers_estimated(method, case, steps, truths):
    given, speed = CASES[case]
    if method == "rk4":
        with pytest.raises(StepsError, match=r"or a method without a stability limit \(radau\)"):
            floquet(given, speed, method, steps=steps, rtol=0.9)
        return
    stability = floquet(given, speed, method, steps=steps, rtol=0.9)
    flagged = [text for text in stability.warnings if UNRESOLVED in text]
    assert len(flagged) == 1, stability.warnings
    assert "use radau" in flagged[0]
    error = matched_error(stability.multipliers, truths[case].multipliers)
    assert error <= 10 * stability.error_estimate.multipliers


@pytest.mark.parametrize("case", CASES)
def test_l_stable_method_needs_no_flag(case, truths):
    given, speed = CASES[case]
    stability = floquet(given, speed, "radau", rtol=1e-6)
    assert matched_error(stability.multipliers, truths[case].multipliers) < 1e-6
    assert stability.warnings == []


def test_gauss_flags_a_spurious_multiplier_of_the_slow_cam():
    """At order 12 with 100 steps, |ρ| = 0.185 is computed instead of 1.466125e-7, although the error of the
    orbit is only 4e-4."""
    given = cam("1")
    truth = periodic(given, SLOW, "radau", rtol=1e-10)
    orbit = periodic(given, SLOW, Gauss(12), steps=100, rtol=0.9)
    assert relative_error(orbit.at(PHASES), truth.at(PHASES)) < 4e-4
    assert truth.spectral_radius == pytest.approx(1.466125e-7, rel=1e-6)
    assert orbit.spectral_radius == pytest.approx(0.185, abs=5e-4)
    assert orbit.error_estimate.multipliers > 1.0
    assert any(UNRESOLVED in text for text in orbit.warnings)
    assert any("the multipliers to" in text for text in orbit.warnings)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["fourier", "hill"])
def test_series_without_a_resonant_harmonic_report_their_error(method):
    """For the cam at 600 rpm, series with 96 and 128 harmonics agree to 1e-7, but both lack the resonant
    harmonic 353."""
    given, speed = cam("1"), 20 * np.pi
    truth = periodic(given, speed, "gauss", rtol=1e-10)
    orbit = periodic(given, speed, method, rtol=1e-6)
    error = relative_error(orbit.at(PHASES), truth.at(PHASES))
    assert 1e-6 < error <= 10 * orbit.error_estimate.orbit
    assert any("gives the orbit to" in text for text in orbit.warnings)


def test_piecewise_constant_steps_cause_growth_in_a_rotating_beam():
    """Every frozen step is exact and damped. Their product grows because the modes rotate between steps."""
    stability = floquet(turning_beam(), 1.0, "hsu", steps=101, rtol=0.9)
    assert stability.verdict == "undetermined"  # within its own error estimate nothing more is known
    assert stability.spectral_radius > 1e3
    assert stability.error_estimate.multipliers > 1e3
    assert abs(stability.liouville) < 1e-9  # the volume is right all the same


@pytest.mark.parametrize("method", ["modal"])
def test_more_steps_are_not_advised_for_an_approximation(method):
    (text,) = (t for t in floquet(turning_beam(), 1.0, method, rtol=0.9).warnings if UNRESOLVED in t)
    assert text.endswith("use radau")


def undamped_stiff():
    """Return a slow mode with a mode that is 200 times as fast. Both are undamped: every |ρ| is 1."""
    return constant(np.eye(2), np.zeros((2, 2)), np.diag([1.7, 4e4]), lambda phase: np.ones((len(phase), 2)))


@pytest.mark.parametrize("method", ["radau", "rk4"])
def test_artificially_damped_modes_give_a_warning(method):
    """L-stable methods damp fast modes: the multipliers on two grids agree, although both are wrong."""
    steps = {"radau": 64, "rk4": 600}[method]
    stability = floquet(undamped_stiff(), 1.0, method, steps=steps, rtol=1e-3)
    assert (np.abs(stability.multipliers) > 0.1).sum() == 2
    assert stability.error_estimate.multipliers > 0.5
    assert any("the multipliers to" in text for text in stability.warnings)
    assert stability.liouville < -1.0
    refined = floquet(undamped_stiff(), 1.0, method, rtol=1e-6)
    np.testing.assert_allclose(np.abs(refined.multipliers), 1.0, rtol=0, atol=1e-6)
    assert refined.unresolved == 0
    assert abs(refined.liouville) < 1e-5


def test_accidental_agreement_of_two_grids_is_not_accepted():
    """Newmark's method underestimates the frequency of an undamped mode. On 32 and 64 steps, the phase errors
    per period are such that the multipliers of both grids agree to 1e-3, but each has an error of 1.3."""
    given = member(275)
    truth = floquet(given.system, given.speed, Radau(13), rtol=1e-13)
    for rtol in (1e-1, 1e-2, 1e-3):
        stability = floquet(given.system, given.speed, "newmark", rtol=rtol)
        error = matched_error(stability.multipliers, truth.multipliers)
        assert error <= 10 * stability.error_estimate.multipliers
        assert error <= rtol


@pytest.mark.parametrize(
    ("method", "steps"),
    [
        (Newmark(0.5, 0.0), 400),
        (Newmark(0.5, 1 / 6), 400),
        (Newmark(0.5, 0.25), 400),
        (Gauss(4), 100),
        (Gauss(6), 50),
        (Gauss(10), 20),
    ],
)
def test_phase_error_of_a_mode_follows_the_phase_constant(method, steps):
    omega = 3.3
    free = constant([[1.0]], [[0.0]], [[omega**2]], lambda phase: np.ones((len(phase), 1)))
    stability = floquet(free, 1.0, method, steps=steps)
    exact = 2 * np.pi * omega
    late = np.angle(np.exp(1j * exact) / stability.multipliers[0])
    late = min(abs(late), abs(np.angle(np.exp(1j * exact) / stability.multipliers[1])))
    assert late == pytest.approx(
        method.phase_constant * steps * (exact / steps) ** (method.order + 1), rel=4e-2
    )
    assert method.in_phase(steps, late) == pytest.approx(exact, rel=1e-2)


@pytest.mark.parametrize(("speed", "method"), [("50 rpm", "auto"), ("60 rpm", "gauss")])
def test_liouville_agrees_with_tiny_multipliers_within_their_errors(speed, method):
    """Products of steps lose multipliers below 1e-100; the computed multipliers do not."""
    found = floquet(load("cam"), speed, method)
    assert min(abs(found.multipliers)) < 1e-60
    assert 0 < abs(found.liouville) < found.multiplier_errors.sum() < 1
    coarse = floquet(load("cam"), speed, steps=32, rtol=0.9)
    assert f"owing to {coarse.unresolved} unresolved multipliers" in str(coarse)


@pytest.mark.parametrize("method", ["auto", "radau", "gauss", "hsu", "newmark", "rk4"])
def test_residual_condition_and_liouville_are_reported(method):
    given = random_system(2, 2)
    coarse, fine = (periodic(given, 1.0, method, steps=m, rtol=0.9) for m in (60, 240))
    assert 1.0 <= fine.condition < 1e3
    for of in ("residual", "liouville"):
        before, after = (abs(getattr(each, of)) for each in (coarse, fine))
        assert after < before / 3 or after < 1e-12, (of, before, after)


@pytest.mark.parametrize("method", ["fourier", "hill"])
def test_methods_without_steps_report_no_liouville_check(method):
    assert np.isnan(floquet(random_system(2, 2), 1.0, method, steps=31, rtol=0.9).liouville)


def limits():
    """Return the methods with a stability limit and the limit of h ω_max for an undamped mode."""
    return [
        (Newmark(0.5, 0.0), 2.0),
        (Newmark(0.5, 1 / 12), np.sqrt(6.0)),
        (Newmark(0.5, 1 / 6), np.sqrt(12.0)),
        (Newmark(0.7, 0.1), 2.0),
        (chosen("rk4"), np.sqrt(8.0)),
    ]


@pytest.mark.parametrize(("method", "limit"), limits(), ids=[f"{m}" for m, _ in limits()])
def test_steps_beyond_the_stability_limit_are_refused(method, limit):
    """The largest ω_max of the period decides: the stiffness varies between 0.5 and 1.5 times its mean."""

    def matrices(phase, speed):
        K = (1e4 * (1.0 + 0.5 * np.cos(phase)))[:, None, None]
        return np.ones_like(K), 0 * K, K, np.ones((len(phase), 1))

    given = system(matrices, 1)
    least = 2 * np.pi * np.sqrt(1.5e4) / limit
    with pytest.raises(StepsError, match=rf"{method.name} with .* exceeds its stability limit; use at least"):
        floquet(given, 1.0, method, steps=int(0.99 * least), rtol=0.9)
    assert np.isfinite(floquet(given, 1.0, method, steps=int(1.01 * least) + 1, rtol=0.9).spectral_radius)


@pytest.mark.parametrize("name", KEEPING)
def test_every_method_states_the_frequencies_that_it_resolves(name):
    """With one step fewer than the fastest mode requires, a flag or an error results. Enough steps cause
    neither."""
    fast = 20.0
    given = constant(
        np.eye(2), 0.1 * np.eye(2), np.diag([1.7, fast**2]), lambda phase: np.ones((len(phase), 2))
    )
    enough = int(np.ceil(frozen_modes(given, 1.0).phase_advance[0] / chosen(name).follows)) | 1
    assert not any(UNRESOLVED in text for text in floquet(given, 1.0, name, steps=enough, rtol=0.9).warnings)
    assert any(UNRESOLVED in text for text in floquet(given, 1.0, name, steps=enough - 3, rtol=0.9).warnings)


@pytest.mark.parametrize(("lobes", "modulation", "stiffness"), [(8, 20.0, 1e6), (16, 3.0, 1e12)])
def test_damping_that_varies_with_many_harmonics_does_not_stabilise(lobes, modulation, stiffness):
    """By Liouville's formula, the stiff mode grows by exp(0.02 π), however its damping varies."""

    def matrices(phase, speed):
        M = np.broadcast_to(np.eye(2), (len(phase), 2, 2))
        C, K = np.zeros((2, len(phase), 2, 2))
        C[:, 0, 0], K[:, 0, 0] = 0.05, 2 + 0.3 * np.cos(phase)
        C[:, 1, 1], K[:, 1, 1] = -0.02 + modulation * np.cos(lobes * phase), stiffness
        return M, C, K, np.stack((np.cos(phase), np.sin(phase)), axis=1)

    found = periodic(system(matrices, 2), 1.0, rtol=1e-6)
    assert found.verdict in ("unstable", "undetermined")
    if found.verdict == "unstable":
        assert found.spectral_radius == pytest.approx(np.exp(0.02 * np.pi), rel=1e-5)
    else:
        assert not found.error_estimate.multipliers < 0.2


@cache
def toothed(teeth):
    """Return an oscillator whose stiffness varies `teeth` times per revolution, and its exact solution."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        K = 0.4 + 0.3 * np.cos(teeth * phase)[:, None, None]
        return one, 0.1 * one, K, (1.0 + np.cos(phase))[:, None]

    given = system(matrices, 1)
    return given, Shooting(given, 1.0)


@pytest.mark.parametrize(
    ("name", "rtol", "teeth"),
    [
        pytest.param(*each, teeth, marks=pytest.mark.slow if (each[0], teeth) == ("hill", 96) else ())
        for each in (
            ("rk4", 1e-3),
            ("hsu", 1e-2),
            ("newmark", 1e-2),
            ("fourier", 1e-6),
            ("hill", 1e-6),
            ("auto", 1e-6),
        )
        for teeth in (32, 48, 96)
    ],
)
def test_ripple_aliased_equally_on_all_grids_is_detected(name, rtol, teeth):
    """With 16, 24 and 48 evenly spaced samples, cos 48φ is aliased to 1. A series with few harmonics does not
    contain it."""
    given, truth = toothed(teeth)
    orbit = periodic(given, 1.0, name, rtol=rtol)
    errors = (
        relative_error(orbit.at(PHASES), truth.states(PHASES)[:1]),
        multiplier_error(orbit.multipliers, truth.multipliers),
    )
    assert max(errors) <= rtol
    fixed = periodic(given, 1.0, name, steps=teeth // 4 + 1, rtol=rtol)
    error = relative_error(fixed.at(PHASES), truth.states(PHASES)[:1])
    assert error <= 10 * fixed.error_estimate.orbit


def jumping(stiffness, load):
    """Return q″ + 0.1 q′ + k q = d, where k and d jump without a declared break."""

    def matrices(phase, speed):
        turned = np.remainder(phase, 2 * np.pi)
        one = np.ones((len(phase), 1, 1))
        return one, 0.1 * one, stiffness(turned)[:, None, None] * one, load(turned)[:, None]

    return PeriodicSystem(matrices, ["q"])


def test_jump_at_the_period_end_requires_no_break():
    """The coefficient is a sawtooth. Every period begins with a jump."""
    given = jumping(lambda turned: 4.0 + 0 * turned, lambda turned: turned / (2 * np.pi))
    orbit = periodic(given, 1.0, rtol=1e-6)
    k = np.arange(1, 5000)
    answer = 1 / (4 - k**2 + 0.1j * k)
    q = 0.125 + np.real(np.exp(1j * np.outer(PHASES, k)) @ (1j / (np.pi * k) * answer))
    assert orbit.steps < 1000
    assert np.abs(orbit.at(PHASES)[0] - q).max() < 1e-6


@pytest.mark.parametrize("at", [1.9383, 2.0, 5.0007])
@pytest.mark.parametrize("steps", [None, 256])
def test_jumps_within_and_at_the_period_end_do_not_cancel(at, steps):
    given = jumping(lambda turned: 4.0 + 0.5 * (turned > at), np.cos)
    stability = floquet(given, 1.0, Gauss(), steps=steps, rtol=1e-5)
    truth = np.abs(np.linalg.eigvals(step_matrix(4.5, 2 * np.pi - at) @ step_matrix(4.0, at))).max()
    error = abs(stability.spectral_radius / truth - 1)
    assert error <= 10 * stability.error_estimate.multipliers


def step_matrix(stiffness, length):
    return expm(np.array([[0.0, 1.0], [-stiffness, -0.1]]) * length)


@pytest.mark.parametrize(
    ("method", "steps", "stiffness", "damping"),
    [("gauss", 20, 20411.2, 2.14e-4), ("gauss", 50, 2916.96, 6.02e-4), ("newmark", 6, 15.0377, 0.0133)],
)
def test_unresolved_modes_are_not_reported_as_resonances(method, steps, stiffness, damping):
    """Their computed multipliers may lie anywhere on the unit circle, even near +1."""
    K = [[2.3, 0.3], [0.3, stiffness]]
    given = constant(np.eye(2), damping * np.eye(2), K, lambda phase: 1 + np.cos(phase)[:, None] * np.ones(2))
    orbit = periodic(given, 1.0, method, steps=steps, rtol=0.5)
    assert orbit.error_estimate.multipliers == np.inf
    assert orbit.warnings
