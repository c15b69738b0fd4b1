"""Accuracy that simple shooting loses, false multipliers due to rounding, and resonance."""

import numpy as np
import pytest
from scipy.linalg import expm

from solve import floquet, periodic, sweep
from solve.errors import ResonanceError
from tests.solve.references import Shooting, relative_error
from tests.solve.systems import cam, constant, random_system, system

METHODS = ["auto", "radau", "gauss"]


def rotated(K, load):
    """Return an undamped system with M = I and two modes with stiffnesses K in rotated coordinates."""
    R = np.array([[0.6, -0.8], [0.8, 0.6]])
    return constant(np.eye(2), np.zeros((2, 2)), R @ np.diag(K) @ R.T, load), R @ np.diag(K) @ R.T


def two_waves(phase):
    return np.column_stack((np.cos(phase), np.sin(2 * phase)))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("decades", [13, 30, 100])
def test_large_growth_does_not_affect_the_periodic_solution(method, decades):
    growth = decades * np.log(10.0) / (2 * np.pi)
    given, K = rotated([-(growth**2), 2.0], two_waves)
    orbit = periodic(given, 1.0, method, rtol=1e-11)
    D1, D2 = np.linalg.solve(K - np.eye(2), [1.0, 0.0]), np.linalg.solve(K - 4 * np.eye(2), [0.0, 1.0])
    phase = np.linspace(0.0, 2 * np.pi, 50)
    truth = np.outer(D1, np.cos(phase)) + np.outer(D2, np.sin(2 * phase))
    np.testing.assert_allclose(orbit.at(phase), truth, rtol=0, atol=1e-10 * np.abs(truth).max())
    assert orbit.spectral_radius == pytest.approx(10.0**decades, rel=1e-9 * decades)
    assert orbit.verdict == "unstable"


def test_single_shooting_loses_accuracy():
    """Direct solution of (I - Φ) x0 = c with |ρ| = 1e13 gives x0 with an error above 1e-6. The cyclic system
    avoids this."""
    growth = 13 * np.log(10.0) / (2 * np.pi)
    given, K = rotated([-(growth**2), 2.0], two_waves)
    D1 = np.linalg.solve(K - np.eye(2), [1.0, 0.0])
    assert np.abs(Shooting(given, 1.0).start[:2] - D1).max() > 1e-6


@pytest.mark.parametrize("method", METHODS)
def test_multipliers_of_1e_170_are_as_accurate_as_the_steps(method):
    """The system has a slow mode and a double root at -62: exp(-124π) = 1e-169."""
    given = constant(
        np.eye(2), np.diag([0.1, 124.0]), np.diag([1.3, 62.0**2]), lambda phase: np.ones((len(phase), 2))
    )
    stability = floquet(given, 1.0, method, rtol=1e-9)
    np.testing.assert_allclose(np.abs(stability.multipliers[:2]), np.exp(-0.1 * np.pi), rtol=1e-8)
    known = stability.multiplier_errors[2:]
    small = np.abs(stability.multipliers[2:] / np.exp(-124 * np.pi) - 1)
    assert (np.isnan(known) | (small <= 10 * known)).all()
    assert stability.unresolved == np.isnan(known).sum()


@pytest.mark.parametrize("method", ["radau", "gauss"])
def test_very_small_multipliers_are_resolved(method):
    """Both multipliers are far below 1: exp(2πλ) with λ = -33 and -91."""
    roots = np.array([-33.0, -91.0])
    given = constant(np.eye(1), [[-roots.sum()]], [[roots.prod()]], lambda phase: np.ones((len(phase), 1)))
    stability = floquet(given, 1.0, method, rtol=1e-9)
    assert stability.unresolved == 0
    assert stability.spectral_radius == pytest.approx(np.exp(-66 * np.pi), rel=1e-7)
    errors = np.abs(stability.multipliers / np.exp(2 * np.pi * roots) - 1)
    assert (errors <= 10 * stability.multiplier_errors).all()
    assert stability.verdict == "asymptotically stable"


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("rtol", [1e-2, 1e-6])
def test_error_covers_a_spectral_radius_far_below_roundoff(method, rtol):
    """With λ = -50 ± 10i, |ρ| = |exp(2πλ)| = 1e-137."""
    given = constant(np.eye(1), [[100.0]], [[2600.0]], lambda phase: np.ones((len(phase), 1)))
    stability = floquet(given, 1.0, method, rtol=rtol)
    truth = np.exp(-100 * np.pi)
    assert abs(stability.spectral_radius - truth) <= 10 * stability.error_estimate.multipliers * truth


def swelling(detuned, damping):
    """Return two modes in axes rotated by 0.3 rad, with negative stiffness, and therefore growing solutions,
    in part of the period."""
    first, second, depth = 71.0, 41.0 + detuned, 0.47
    R = np.array([[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]])
    C, K = (
        R @ np.diag(each) @ R.T for each in ([142 * damping, 2 * damping * second], [first**2, second**2])
    )

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        moving = np.cos(phase)[:, None, None] * depth * first**2 * np.eye(2)
        return one * np.eye(2), one * C, K + moving, np.column_stack((np.cos(phase), 1 + np.sin(phase)))

    return system(matrices, 2)


@pytest.mark.parametrize("detuned", [0.0, -3.0, -7.0])
@pytest.mark.parametrize("damping", [0.2, 0.28])
def test_error_estimate_covers_growth_within_a_period(detuned, damping):
    """Loads of 1 cause orbits of 10^5 and more. The engines and grids with different steps agree."""
    given, phase = swelling(detuned, damping), np.linspace(0.0, 2 * np.pi, 400)
    finest = periodic(given, 1.0, "radau", steps=1024)
    assert np.abs(finest.at(phase)).max() > 1e5
    for engine in ("numpy", "auto"):
        for requested in ({"rtol": 1e-6}, {"steps": 384}, {"steps": 512}):
            orbit = periodic(given, 1.0, engine=engine, **requested)
            error = relative_error(orbit.at(phase), finest.at(phase))
            assert error <= 10 * (orbit.error_estimate.orbit + finest.error_estimate.orbit)
            assert orbit.error_estimate.orbit < 1e-6


@pytest.mark.parametrize("engine", ["numpy", "auto"])
@pytest.mark.parametrize(("damping", "stiffness"), [(-6, 10), (-12, 40), (-20, 100)])
def test_decaying_response_is_accurate_although_all_solutions_grow(damping, stiffness, engine):
    """All solutions grow. The periodic solution therefore decays to zero after the push, although the map
    grows."""
    end = 0.5
    A = np.array([[0.0, 1.0, 0.0], [-stiffness, -damping, 1.0], [0.0, 0.0, 0.0]])
    pushed, free = expm(A * end), expm(A[:2, :2] * (2 * np.pi - end))
    start = np.linalg.solve(np.eye(2) - free @ pushed[:2, :2], free @ pushed[:2, 2])
    phase = np.linspace(0.0, end, 20)
    truth = np.array([(expm(A * at) @ [*start, 1.0])[0] for at in phase])

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        push = np.where(np.mod(phase, 2 * np.pi) < end, 1.0, 0.0)[:, None]
        return one, damping * one, stiffness * one, push

    orbit = periodic(system(matrices, 1, breaks=(0.0, end)), 1.0, rtol=1e-6, engine=engine)
    # Of the truth, too, rounding leaves less the more solutions grow.
    assert relative_error(orbit.at(phase), truth[None]) <= 10 * orbit.error_estimate.orbit + 1e-9
    assert orbit.error_estimate.orbit < 1e-6


@pytest.mark.parametrize("n", [1, 2, 5])
def test_all_multipliers_have_errors(n):
    for damping in (0.01, 1.0, 30.0):
        given = constant(
            np.eye(n),
            damping * np.diag(np.arange(1, n + 1)),
            np.eye(n),
            lambda phase: np.ones((len(phase), n)),
        )
        stability = floquet(given, 1.0, "radau", rtol=1e-6)
        roots = np.concatenate([np.roots([1.0, damping * k, 1.0]) for k in range(1, n + 1)])
        truth = 2 * np.pi * roots[np.argsort(-roots.real)]
        errors = np.abs(np.real(stability.exponents) * 2 * np.pi - np.real(truth))
        known = stability.multiplier_errors
        assert len(stability.multipliers) == len(known) == 2 * n
        assert stability.unresolved == np.isnan(known).sum()
        assert (np.isnan(known) | (errors <= 10 * known + 1e-12)).all()


def oscillator(damping, stiffness):
    return constant([[1.0]], [[damping]], [[stiffness]], lambda phase: np.cos(phase)[:, None])


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("damping", "stiffness"), [(0.0, 1.0), (0.0, 4.0)], ids=["resonance", "second harmonic"]
)
def test_multiplier_at_one_is_refused_for_orbits_and_warned_otherwise(method, damping, stiffness):
    given = oscillator(damping, stiffness)
    with pytest.raises(ResonanceError, match=r"a Floquet multiplier is at \+1"):
        periodic(given, 1.0, method)
    stability = floquet(given, 1.0, method)
    assert np.abs(stability.multipliers - 1).min() < 1e-9
    assert any("equals +1 within its error (resonance" in text for text in stability.warnings)


@pytest.mark.parametrize("method", ["fourier", "hill", "bahgat-willmert"])
@pytest.mark.parametrize("stiffness", [1.0, 4.0])
def test_harmonic_balance_methods_refuse_resonance(method, stiffness):
    with pytest.raises(ResonanceError, match="change the speed"):
        periodic(oscillator(0.0, stiffness), 1.0, method)


@pytest.mark.parametrize("damping", [1e-6, 1e-5, 1e-4])
def test_near_resonance_gives_a_warning_with_the_distance(damping):
    """q = sin(φ)/c, and |ρ - 1| = 1 - exp(-πc)."""
    orbit = periodic(oscillator(damping, 1.0), 1.0)
    assert orbit.statistics("q1").max == pytest.approx(1 / damping, rel=1e-8)
    distance = -np.expm1(-np.pi * damping)
    assert orbit.distance_from_one == pytest.approx(distance, rel=1e-6)
    assert any(f"a multiplier is only {distance:.1e} from +1" in text for text in orbit.warnings)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("damping", [1e-7, 1e-9, 1e-11])
def test_estimate_includes_accuracy_lost_near_resonance(method, damping):
    orbit = periodic(oscillator(damping, 1.0), 1.0, method, rtol=1e-12)
    error = abs(orbit.statistics("q1").max * damping - 1)
    assert error <= 10 * orbit.error_estimate.orbit
    assert 1e-16 / damping < orbit.error_estimate.orbit < 1e-14 / damping
    assert any("at the attainable accuracy gives the orbit to" in text for text in orbit.warnings)


def test_system_away_from_resonance_gives_no_warning():
    assert periodic(oscillator(0.1, 2.0), 1.0).warnings == []


def test_resonance_of_a_modulated_system_is_detected():
    """On Mathieu's a_2 curve, a solution of period 2π exists (φ = 2t), and I - Φ is singular."""
    from scipy.special import mathieu_a

    boundary = mathieu_a(2, 0.5)

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        stiffness = (boundary - np.cos(2 * phase))[:, None, None]
        return one, 0 * one, stiffness, np.cos(2 * phase)[:, None]

    stability = floquet(system(matrices, 1, period=np.pi), 1.0, rtol=1e-11)
    assert np.abs(stability.multipliers - 1).max() < 1e-5
    assert stability.distance_from_one < 1e-5


@pytest.mark.parametrize("method", ["rk4", "newmark", "hsu", "fourier", *METHODS])
@pytest.mark.parametrize("steps", [None, 200])
def test_all_methods_refuse_exact_resonance(method, steps):
    """The equation is q″ + q = cos φ. The error of a method must not be mistaken for damping."""
    with pytest.raises(ResonanceError, match=r"a Floquet multiplier is at \+1"):
        periodic(oscillator(0.0, 1.0), 1.0, method, steps=steps, rtol=1e-6)


@pytest.mark.parametrize("method", ["rk4", "newmark"])
def test_system_near_resonance_is_solved(method):
    orbit = periodic(oscillator(1e-3, 1.0), 1.0, method, rtol=1e-4)
    assert orbit.statistics("q1").max == pytest.approx(1e3, rel=2e-4)


@pytest.mark.parametrize("steps", [None, 1000, 4000, 16_000, 64_000])
def test_estimate_includes_roundoff_of_many_steps(steps):
    orbit = periodic(oscillator(1e-9, 1.0), 1.0, "rk4", steps=steps)
    phase = np.linspace(0.0, 2 * np.pi, 777)
    error = np.abs(orbit.at(phase)[0] - 1e9 * np.sin(phase)).max() / 1e9
    assert error <= 10 * orbit.error_estimate.orbit


@pytest.mark.parametrize("rpm", [1, 3, 5])
def test_unresolved_multipliers_cause_no_refinement(rpm):
    """At 5 rpm, |ρ| of the cam is about 1e-137, which products of the step maps do not resolve."""
    orbit = periodic(cam(), f"{rpm} rpm")
    assert (len(orbit.multipliers), orbit.unresolved, orbit.spectral_radius) == (6, 6, 0.0)
    assert orbit.verdict == "asymptotically stable"
    assert orbit.steps < 5000
    assert orbit.error_estimate.orbit <= 1e-8
    assert any("all multipliers are below the round-off" in text for text in orbit.warnings)


def circle(weak):
    """Return three coordinates in a closed chain. Two of them are driven by weak couplings, so that their
    sizes are 1, weak and weak²."""
    K = np.diag([0.3, 2.0, 5.0])
    K[1, 0], K[2, 1], K[0, 2] = weak, weak, 1.0
    return np.eye(3), np.diag([0.1, 0.2, 0.3]), K, np.diag([1.0, weak, weak**2])


@pytest.mark.parametrize("engine", ["compiled", "numpy"])
@pytest.mark.parametrize("weak", [1e-3, 1e-5, 1e-7])
def test_weakly_driven_coordinates_are_accurate(weak, engine):
    M, C, K, units = circle(weak)
    given = constant(M, C, K, lambda phase: np.outer(np.cos(phase), [1.0, 0.0, 0.0]))
    orbit, phase = periodic(given, 1.0, rtol=1e-9, engine=engine), np.linspace(0.0, 2 * np.pi, 50)
    stiffness = np.linalg.inv(units) @ (K - M + 1j * C) @ units
    amplitudes = units @ np.linalg.solve(stiffness, [1.0, 0.0, 0.0])
    truth = np.real(np.outer(amplitudes, np.exp(1j * phase)))
    error = np.abs(orbit.at(phase) - truth).max(axis=1) / np.abs(amplitudes)
    assert error.max() <= 10 * orbit.error_estimate.orbit <= 1e-8
    assert error.max() < 1e-11


@pytest.mark.parametrize("engine", ["compiled", "numpy"])
@pytest.mark.parametrize("detuned", [1e-5, 1e-7, 1e-9, 1e-11])
@pytest.mark.parametrize("rtol", [1e-3, 1e-4, 1e-6])
def test_roundoff_is_relative_to_the_size_with_a_tuned_absorber(detuned, rtol, engine):
    k, damping = 1.0 + detuned, np.diag([0.1, 1e-12])
    K = np.array([[3.0 + k, -k], [-k, k]])
    given = constant(np.eye(2), damping, K, lambda phase: np.outer(np.cos(phase), [1.0, 0.0]))
    orbit, phase = periodic(given, 1.0, rtol=rtol, engine=engine), np.linspace(0.0, 2 * np.pi, 50)
    # q2 = k q1 / (k - 1 + i damping), by hand: a solver would lose the digits of q1 that it is about.
    own = (k - 1) + 1j * damping[1, 1]
    first = own / ((K[0, 0] - 1 + 1j * damping[0, 0]) * own - k**2)
    truth = np.real(first * np.exp(1j * phase))
    error = np.abs(orbit.at(phase)[0] - truth).max() / abs(first)
    assert error <= 10 * orbit.error_estimate.orbit


@pytest.mark.parametrize("engine", ["compiled", "numpy"])
@pytest.mark.parametrize(
    ("detuned", "unit"), [(-1.5e-11, 1e-7), (6e-12, 1e-8), (-8e-12, 4e-8), (2e-11, 1e-9)]
)
@pytest.mark.parametrize(("speed", "stiffness"), [(3.0, 20.0), (2.0, 45.0)])
def test_errors_with_an_undamped_absorber_in_small_units_are_honest(speed, stiffness, detuned, unit, engine):
    """The mass has a displacement far below its terms, but five digits of it are accurate."""
    k, scale = speed**2 * (1 + detuned), np.diag([1.0, unit])
    M, C, K = np.diag([2.0, 1.0]), np.diag([0.3, 0.0]), np.array([[stiffness + k, -k], [-k, k]])
    M, C, K = (scale @ A @ scale for A in (M, C, K))
    given = constant(M, C, K, lambda phase: np.outer(np.cos(phase), [1.0, 0.0]))
    orbit, phase = periodic(given, speed, engine=engine), np.linspace(0.0, 2 * np.pi, 50)
    own = k - speed**2
    first = own / ((K[0, 0] - 2 * speed**2 + 0.3j * speed) * own - k**2)
    truth = np.real(first * np.exp(1j * phase))
    error = np.abs(orbit.at(phase)[0] - truth).max() / abs(first)
    assert error <= 10 * orbit.error_estimate.orbit <= 0.1


@pytest.mark.parametrize("engine", ["compiled", "numpy"])
@pytest.mark.parametrize("units", [(1.0, 1.0, 1.0, 1.0), (1e-3, 1.0, 1e2, 1e-4)])
@pytest.mark.parametrize("stiffness", [0.7, 5.0, 40.0])
def test_coordinates_loaded_only_by_a_mass_at_rest_meet_the_tolerance(stiffness, units, engine):
    """The absorber q2 keeps q1 at rest. The coordinates q3 and q4 are a chain from q1 to the ground, with a
    stiffness that varies over the period."""
    springs = np.array([[4.0, -1.0, 0, 0], [-1.0, 1.0, 0, 0], [0, 0, 3.0, 0], [0, 0, 0, 2.0]])
    chain = np.array([[1.0, 0, -1, 0], [0, 0, 0, 0], [-1, 0, 2, -1], [0, 0, -1, 1]])
    scale, dampers = np.array(units), 0.1 * springs
    dampers[:2, 1] = dampers[1] = 0.0

    def matrices(phase, speed):
        one, wave = np.ones((len(phase), 1, 1)), 1 + 0.4 * np.cos(2 * phase)[:, None, None]
        K = springs + stiffness * wave * chain
        load = np.outer(np.cos(phase), [1.0, 0.0, 0.0, 0.0])
        return *(scale[:, None] * A * scale for A in (one * np.eye(4), one * dampers, K)), load * scale

    orbit = periodic(system(matrices, 4), 1.0, rtol=1e-8, engine=engine)
    q = np.abs(orbit.q * scale[:, None]).max(axis=1)
    assert q[1] == pytest.approx(1.0, rel=1e-8)
    assert q[[0, 2, 3]].max() < 1e-11
    assert orbit.error_estimate.orbit <= 1e-8


FAR = 2.0 ** np.array([-20, 0, 20])
UNITS = {"as an energy has them": (FAR, FAR), "of equations": (FAR, 1.0), "of both": (FAR, 1 / FAR)}
"""By what equations and coordinates of three are divided, in powers of 2: entries lose no digit."""


@pytest.fixture(params=UNITS)
def in_units(request):
    """Return a system, the same system in other units, and the factors of its coordinates."""
    (rows, columns), given = UNITS[request.param], random_system(0, 3)

    def matrices(phase, speed):
        M, C, K, d = given.at(phase, speed)
        return (*((rows * (part * columns).swapaxes(1, 2)).swapaxes(1, 2) for part in (M, C, K)), rows * d)

    return given, system(matrices, 3), np.broadcast_to(columns, 3)


@pytest.mark.parametrize("engine", ["compiled", "numpy"])
@pytest.mark.parametrize("method", ["radau", "gauss"])
def test_units_of_equations_and_coordinates_do_not_affect_accuracy(in_units, method, engine):
    given, other, columns = in_units
    computed, again = (periodic(each, 1.0, method, rtol=1e-11, engine=engine) for each in (given, other))
    phase = np.linspace(0.0, 2 * np.pi, 50)
    truth, q = computed.at(phase), columns[:, None] * again.at(phase)
    assert (np.abs(q - truth).max(axis=1) <= 1e-13 * np.abs(truth).max(axis=1)).all()
    np.testing.assert_allclose(
        again.multipliers, computed.multipliers, rtol=0, atol=2e-14 * computed.spectral_radius
    )
    assert again.steps == computed.steps


@pytest.mark.parametrize("method", ["fourier", "hill"])
def test_units_do_not_affect_accuracy_of_harmonic_balance(in_units, method):
    given, other, columns = in_units
    computed, again = (periodic(each, 1.0, method, steps=21) for each in (given, other))
    phase = np.linspace(0.0, 2 * np.pi, 50)
    truth, q = computed.at(phase), columns[:, None] * again.at(phase)
    assert (np.abs(q - truth).max(axis=1) <= 1e-13 * np.abs(truth).max(axis=1)).all()


@pytest.mark.parametrize("engine", ["compiled", "numpy"])
def test_units_do_not_affect_accuracy_of_small_multipliers(in_units, engine):
    computed, again = (
        floquet(unit, 1.0, rtol=1e-10, engine=engine, all_multipliers=True) for unit in in_units[:2]
    )
    np.testing.assert_allclose(again.multipliers, computed.multipliers, rtol=1e-13)


@pytest.mark.parametrize("engine", ["compiled", "numpy"])
def test_units_do_not_affect_accuracy_of_batches(in_units, engine):
    given, other, columns = in_units
    speeds = np.linspace(0.8, 1.2, 9)
    computed, again = (sweep(each, speeds, "radau", rtol=1e-11, engine=engine) for each in (given, other))
    np.testing.assert_allclose(again.spectral_radius, computed.spectral_radius, rtol=1e-13)
    for name, column in zip(given.coordinates, columns, strict=True):
        np.testing.assert_allclose(column * again.figures(name), computed.figures(name), rtol=1e-12)
