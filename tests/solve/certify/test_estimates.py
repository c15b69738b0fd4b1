"""Error estimates compared with true errors: at most ten times too small, not absurdly large."""

import tracemalloc

import numpy as np
import pytest

from solve import Newmark, Radau, floquet, periodic
from solve.certify.comparison import differences
from solve.errors import StepsError, ValueOutOfBoundsError
from solve.methods.choice import chosen
from solve.methods.gauss import Gauss
from solve.period.frozen import frozen
from solve.period.grid import Grid
from solve.period.points import SinglePoint
from tests.solve.references import Shooting, multiplier_error, relative_error
from tests.solve.systems import cam, constant, random_system

PHASES = np.linspace(0.0, 2 * np.pi, 801)
FLOOR = 1e-12
"""Error of the reference solutions."""
BY_TOLERANCE = [
    ("auto", (1e-3, 1e-6, 1e-10)),
    (Radau(3), (1e-3, 1e-6)),
    (Radau(5), (1e-3, 1e-8)),
    ("radau", (1e-3, 1e-10)),
    ("gauss", (1e-3, 1e-10)),
    ("rk4", (1e-3, 1e-8)),
    ("newmark", (1e-2, 1e-4)),
    (Newmark(0.6, 0.3), (1e-2,)),
    ("hsu", (1e-2, 1e-4)),
]
BY_STEPS = [
    (Radau(3), 40), (Radau(5), 24), ("radau", 12), (Gauss(4), 40), ("gauss", 10), ("rk4", 60), ("hsu", 60),
    ("newmark", 100), (Newmark(0.75, 0.5), 400),
]  # fmt: skip


@pytest.fixture(scope="module")
def references():
    systems = [random_system(seed, 1 + seed % 4) for seed in range(8)]
    return [(system, Shooting(system, 1.0)) for system in systems]


def honest(error, estimate):
    assert error <= 10 * estimate + FLOOR, f"true error {error:.2e}, estimated {estimate:.2e}"
    if error > FLOOR:
        assert estimate <= 1000 * error, f"true error {error:.2e}, estimated {estimate:.2e}"


@pytest.mark.parametrize("steps", [30, 60, 64, 100, 128])
def test_differences_do_not_depend_on_steps_of_the_reference(steps):
    """The more accurate orbit has fewer steps than the other one, in some cases a fraction of them."""
    point = SinglePoint(random_system(2, 2), 1.0)
    coarse, fine, finer = (
        method.solutions(point, Grid.uniform(count, point.period), True, "compiled")
        for method, count in ((Radau(3), steps), (Radau(13), 16), (Radau(13), steps))
    )
    one, other = (differences(coarse, each, frozen(point), "compiled") for each in (fine, finer))
    np.testing.assert_allclose(one, other, rtol=1e-3)


def judge(orbit, q, multipliers):
    honest(relative_error(orbit.at(PHASES), q), orbit.error_estimate.orbit)
    honest(multiplier_error(orbit.multipliers, multipliers), orbit.error_estimate.multipliers)


@pytest.mark.parametrize(("method", "tolerances"), BY_TOLERANCE, ids=[str(m) for m, _ in BY_TOLERANCE])
def test_errors_are_within_tolerance_and_estimate(method, tolerances, references):
    for system, truth in references:
        q = truth.states(PHASES)[: system.n]
        for rtol in tolerances:
            orbit = periodic(system, 1.0, method, rtol=rtol)
            assert max(orbit.error_estimate) <= rtol
            judge(orbit, q, truth.multipliers)


@pytest.mark.parametrize(("method", "steps"), BY_STEPS, ids=[f"{m}, {n} steps" for m, n in BY_STEPS])
def test_estimate_on_a_given_grid_covers_the_error(method, steps, references):
    for system, truth in references:
        orbit = periodic(system, 1.0, method, steps=steps, rtol=0.5)
        assert orbit.steps == steps
        judge(orbit, truth.states(PHASES)[: system.n], truth.multipliers)


@pytest.mark.parametrize("case", ["1", "2"])
@pytest.mark.parametrize(
    "rpm", [100, 300, 1500, *(pytest.param(rpm, marks=pytest.mark.slow) for rpm in (200, 600))]
)
def test_estimates_for_the_stiff_cam(case, rpm):
    """The reference is Gauss's method of order 12, which is not among the tested methods."""
    system, speed = cam(case), f"{rpm} rpm"
    truth = periodic(system, speed, Gauss(12), rtol=1e-11)
    q = truth.at(PHASES)
    for method, rtol in (("radau", 1e-3), ("radau", 1e-6), ("radau", 1e-9), ("auto", 1e-6), ("rk4", 1e-3)):
        orbit = periodic(system, speed, method, rtol=rtol)
        assert max(orbit.error_estimate) <= rtol
        judge(orbit, q, truth.multipliers)


def test_estimate_above_the_tolerance_gives_a_warning():
    orbit = periodic(random_system(1, 2), 1.0, "newmark", steps=40, rtol=1e-6)
    text = next(text for text in orbit.warnings if "not to rtol" in text)
    assert text.startswith("newmark with 40 steps gives the orbit to ")
    assert (
        f"{orbit.error_estimate.orbit:.1e} and the multipliers to {orbit.error_estimate.multipliers:.1e}"
        in text
    )
    assert periodic(random_system(1, 2), 1.0, "newmark", steps=40, rtol=0.9).warnings == []


def test_unattainable_tolerance_gives_a_warning():
    orbit = periodic(cam(), "600 rpm", rtol=1e-14)
    assert 1e-14 < orbit.error_estimate.orbit < 1e-11
    assert any("at the attainable accuracy gives the orbit to" in text for text in orbit.warnings)


def stiff(growth):
    """A slow damped mode and a mode that is 1000 times as fast and decays or grows slowly."""
    K = np.diag([1.0, 1e6])
    return constant(np.eye(2), np.diag([0.5, -2 * growth]), K, lambda phase: np.ones((len(phase), 2)))


@pytest.mark.parametrize("method", ["auto", "radau", "gauss"])
@pytest.mark.parametrize(
    ("growth", "verdict"), [(5e-3, "unstable"), (-5e-4, "asymptotically stable"), (0.0, "stable")]
)
def test_verdict_includes_a_persistent_stiff_mode(method, growth, verdict):
    """L-stable methods damp modes that they do not resolve. The true |ρ| is exp(2π growth)."""
    stability = floquet(stiff(growth), 1.0, method, rtol=1e-6)
    assert stability.spectral_radius == pytest.approx(np.exp(2 * np.pi * growth), rel=1e-5)
    assert stability.verdict == verdict


def test_too_few_steps_for_a_stiff_mode_give_a_warning():
    for method in ("radau", "gauss", "newmark"):
        stability = floquet(stiff(5e-3), 1.0, method, steps=64, rtol=1e-3)
        assert stability.error_estimate.multipliers > 1e-2
        assert stability.warnings


@pytest.mark.parametrize("method", ["newmark", "gauss", "rk4", "hsu"])
def test_unresolved_stiff_modes_give_a_warning(method):
    """At 100 rpm, the phase of the fastest mode of the cam advances by 16 000 rad per revolution."""
    steps = {"rk4": 6000}.get(method, 400)
    stability = floquet(cam(), "100 rpm", method, steps=steps, rtol=0.5)
    assert any("leave stiff modes unresolved" in text and "use radau" in text for text in stability.warnings)
    assert not any("unresolved" in text for text in floquet(cam(), "100 rpm", "radau", rtol=1e-6).warnings)


@pytest.mark.parametrize("steps", [0, -3, 1.5, np.nan])
def test_invalid_step_counts_are_refused(steps):
    with pytest.raises(StepsError, match=rf"steps is {steps!r}; allowed: whole numbers of at least 1; omit"):
        periodic(random_system(1, 2), 1.0, steps=steps)


@pytest.mark.parametrize("steps", ["8", True])
def test_step_counts_that_are_not_numbers_are_refused(steps):
    with pytest.raises(ValueOutOfBoundsError, match=rf"steps is {steps!r}; allowed: whole numbers"):
        periodic(random_system(1, 2), 1.0, steps=steps)


def test_steps_beyond_the_memory_limit_are_refused():
    with pytest.raises(
        StepsError, match=r"at most \d+ steps .* given: 1000000000; use fewer, raise --limit, or"
    ):
        periodic(random_system(1, 2), 1.0, "newmark", steps=10**9)


@pytest.mark.parametrize("method", ["newmark", "rk4", "radau", Gauss(16)])
@pytest.mark.parametrize("n", [3, 6])
def test_peak_memory_matches_the_bound(method, n):
    """The finer grid has twice the given number of steps. The bound is accurate within a factor of 2.5."""
    given, steps, rule = random_system(3, n), 1000, chosen(method)
    periodic(given, 1.0, rule, steps=steps, rtol=0.9)
    tracemalloc.start()
    periodic(given, 1.0, rule, steps=steps, rtol=0.9)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak <= 1.25 * rule.bytes_a_step(n) * 2 * steps
    assert peak >= 0.4 * rule.bytes_a_step(n) * 2 * steps


@pytest.mark.parametrize("n", [27, 90])
def test_step_limits_permit_the_steps_of_large_systems(n):
    """The flexible four-bar linkage with 3 and 10 elements per link requires 384 and 512 steps at 30
    rad/s."""
    rule = Radau()
    assert rule.most_steps(n) >= 512
    assert rule.most_steps(n) * rule.bytes_a_step(n) <= 2**31


def test_floquet_result_has_no_orbit_error():
    stability = floquet(random_system(1, 2), 1.0)
    assert np.isnan(stability.error_estimate.orbit)
    orbit = periodic(random_system(1, 2), 1.0)
    np.testing.assert_allclose(stability.multipliers, orbit.multipliers, rtol=1e-10)


def tuned_absorber():
    """Absorber at its own frequency, which balances the whole force: q1 = 0 up to round-off, and q2 = -cos
    φ."""
    K = np.array([[3.0, -1.0], [-1.0, 1.0]])
    return constant(
        np.eye(2), np.zeros((2, 2)), K, lambda phase: np.column_stack((np.cos(phase), np.zeros(len(phase))))
    )


def test_mass_at_rest_does_not_cause_endless_refinement():
    orbit = periodic(tuned_absorber(), 1.0)
    assert orbit.steps <= 128
    assert orbit.warnings == []
    assert orbit.statistics("q1").max_abs < 1e-12
    np.testing.assert_allclose(orbit.at(PHASES)[1], -np.cos(PHASES), rtol=0, atol=1e-12)


@pytest.mark.parametrize("engine", ["compiled", "numpy"])
@pytest.mark.parametrize("method", ["gauss", "radau"])
@pytest.mark.parametrize("steps", [33, 64, 100, 192, 1024, 4096])
def test_tuned_absorber_is_solved_exactly_with_any_step_count(method, steps, engine):
    orbit = periodic(tuned_absorber(), 1.0, method, steps=steps, engine=engine)
    assert orbit.warnings == []
    assert orbit.error_estimate.orbit < 1e-11
