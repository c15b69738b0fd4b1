"""All methods, one test a claim: order, L-stability, jumps, refusals, and the contract of a method.

A new method takes a row of MEASURED, or stands among those that have no order, and all of this holds it.
"""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import expm

from solve import Gauss, Newmark, Radau, RungeKutta4, chart, floquet, load, periodic
from solve.batch.family import SPEED, SystemFamily
from solve.batch.tables import Sampled
from solve.errors import MatricesError, ResonanceError, StepsError
from solve.kernel.engines import COMPILED, NUMPY
from solve.methods.bahgat_willmert import BahgatWillmert
from solve.methods.choice import METHODS
from solve.methods.fourier import Fourier
from solve.methods.hill import Hill
from solve.methods.hsu import Hsu
from solve.methods.march import March
from solve.methods.method import OneStep
from solve.methods.modal import Modal
from solve.period.grid import Grid
from solve.period.points import SinglePoint, Tables
from tests.solve.methods.meissner import EQUATION, MULTIPLIERS, TURN, generator, states
from tests.solve.references import Shooting, multiplier_error, relative_error, slope
from tests.solve.systems import constant, frozen_modes, random_system, system

SYSTEM = random_system(4, 2)
PHASES = np.linspace(0.0, TURN, 1001)
INSIDE = np.linspace(0.0, TURN, 401)[:-1]

MEASURED = [  # the method, its order, steps at which multipliers show it; curve's order and steps
    (Newmark(0.5, 1 / 4), 2, (128, 192, 256), 2, (128, 192, 256)),
    (Newmark(0.5, 1 / 6), 2, (128, 192, 256), 2, (128, 192, 256)),
    (Newmark(0.5, 0.0), 2, (128, 192, 256), 2, (128, 192, 256)),
    (Newmark(0.25, 1 / 6), 1, (512, 768, 1024), 1, (512, 768, 1024)),
    (Newmark(0.75, 0.5), 1, (512, 768, 1024), 1, (512, 768, 1024)),
    (March(1e-12), 2, (128, 192, 256), 2, (128, 192, 256)),
    (RungeKutta4(), 4, (64, 96, 128), 4, (64, 96, 128)),
    (Hsu(), 2, (128, 192, 256), 2, (128, 192, 256)),
    (Radau(3), 3, (96, 128, 192), 3, (96, 128, 192)),
    (Radau(5), 5, (32, 48, 64), 5, (32, 48, 64)),
    (Radau(7), 7, (24, 32, 48), 7, (24, 32, 48)),
    (Radau(9), 9, (20, 28, 40), 8, (32, 40, 48)),
    (Radau(11), 11, (14, 18, 24), 9, (14, 18, 24)),
    (Radau(13), 13, (12, 14, 16), 10, (10, 12, 14)),
    (Gauss(4), 4, (64, 96, 128), 4, (64, 96, 128)),
    (Gauss(6), 6, (32, 48, 64), 6, (32, 48, 64)),
    (Gauss(8), 8, (24, 32, 48), 7, (32, 48, 64)),
    (Gauss(10), 10, (16, 20, 28), 8, (20, 24, 28)),
    (Gauss(12), 12, (12, 14, 16), 9, (14, 16, 18)),
    (Gauss(14), 14, (10, 11, 12), 10, (10, 12, 14)),
    (Gauss(16), 16, (9, 10), 11, (8, 10)),
]
BEHIND_JUMPS = [
    (Newmark(0.5, 0.25), (800, 1200, 1600)),
    (Newmark(0.5, 0.0), (800, 1200, 1600)),
    (RungeKutta4(), (50, 75, 100)),
    (Radau(3), (50, 75, 100)),
    (Radau(5), (20, 30, 40)),
    (Radau(7), (10, 15, 20)),
    (Gauss(4), (50, 75, 100)),
    (Gauss(6), (20, 30, 40)),
]
SPECTRAL = [Fourier(), Hill()]
APPROXIMATIONS = [Modal(), BahgatWillmert()]
EVERY = [*(method for method, *_ in MEASURED), *SPECTRAL, *APPROXIMATIONS]
STEPPING = [method for method in EVERY if isinstance(method, OneStep)]
ALIKE = [method for method in EVERY if isinstance(method, Newmark) and method != Newmark()]
"""They take as many steps as the one beside them until they refuse."""
DENSE = [method for method in EVERY if not isinstance(method, OneStep)]


def parametrised_by(methods):
    return pytest.mark.parametrize("method", methods, ids=repr)


def test_every_method_and_order_is_tested():
    assert {type(method) for method in EVERY} == {METHODS[name] for name in METHODS if name != "auto"}
    assert {method.order for method in EVERY if isinstance(method, Radau)} == set(range(3, 14, 2))
    assert {method.order for method in EVERY if isinstance(method, Gauss)} == set(range(4, 17, 2))


# Order


@pytest.fixture(scope="module")
def truth():
    return Shooting(SYSTEM, 1.0)


def solution(method, steps, equation=SYSTEM):
    return [periodic(equation, 1.0, method, steps=m, rtol=0.9) for m in steps]


measured = pytest.mark.parametrize(
    ("method", "order", "steps", "curve_order", "curve_steps"),
    MEASURED,
    ids=[repr(row[0]) for row in MEASURED],
)


@measured
def test_order_at_the_nodes(method, order, steps, curve_order, curve_steps, truth):
    errors = [multiplier_error(orbit.multipliers, truth.multipliers) for orbit in solution(method, steps)]
    assert slope(steps, errors) == pytest.approx(order, abs=0.15)
    assert method.order == order


@measured
def test_order_of_the_continuous_curve(method, order, steps, curve_order, curve_steps, truth):
    q = truth.states(PHASES)[:2]
    errors = [np.linalg.norm(orbit.at(PHASES) - q) for orbit in solution(method, curve_steps)]
    assert slope(curve_steps, errors) == pytest.approx(curve_order, abs=0.15)
    assert method.curve_order == curve_order


def peaked():
    """System whose matrices have harmonics proportional to 0.38^k: analytic, but not a trigonometric
    polynomial."""

    def matrices(phase, speed):
        peak = (1.0 / (1.25 - np.cos(phase)))[:, None, None]
        one = np.ones_like(peak)
        return one, 0.3 * one, 2.0 + 0.2 * peak, peak[:, 0]

    return system(matrices, 1)


@parametrised_by(SPECTRAL)
def test_errors_of_spectral_methods_converge_exponentially(method):
    """The logarithm of the error decreases in proportion to the number of steps, so that its slope in a
    logarithmic plot increases."""
    truth = periodic(peaked(), 1.0, Radau(13), rtol=1e-13)
    steps = np.array([11, 19, 27, 35])
    computed = solution(method, map(int, steps), peaked())
    for errors in (
        [relative_error(orbit.at(PHASES), truth.at(PHASES)) for orbit in computed],
        [multiplier_error(orbit.multipliers, truth.multipliers) for orbit in computed],
    ):
        slopes = -np.diff(np.log(errors)) / np.diff(np.log(steps))
        assert (np.diff(slopes) > 0).all(), slopes
        assert slopes[-1] > 12
        rates = -np.diff(np.log(errors)) / np.diff(steps)
        assert rates.max() < 1.5 * rates.min(), rates


@parametrised_by(APPROXIMATIONS)
def test_approximate_methods_do_not_converge_and_report_their_error(method, truth):
    steps, q = (101, 151, 201), truth.states(PHASES)[:2]
    computed = solution(method, steps)
    errors = [relative_error(orbit.at(PHASES), q) for orbit in computed]
    assert slope(steps, errors) == pytest.approx(0.0, abs=0.15)
    for orbit, error in zip(computed, errors, strict=True):
        assert orbit.error_estimate.orbit == pytest.approx(error, rel=0.05)
    warned = periodic(SYSTEM, 1.0, method, steps=61).warnings
    assert any(f"{method.name} is an approximation that gives the orbit to" in text for text in warned)


# L-stability


def rotating_stiff_mode():
    """System with a soft mode and a stiff one, which oscillates by 1e4 rad per period and decays in 6e-4 of
    the period. Their directions rotate with the phase, so that the rest of the stiff mode excites the soft
    one."""

    def matrices(phase, speed):
        angle = phase + 0.7 * np.sin(phase)
        c, s = np.cos(angle), np.sin(angle)
        R = np.moveaxis(np.array([[c, -s], [s, c]]), -1, 0)
        C, K = (R @ np.diag(values) @ np.swapaxes(R, 1, 2) for values in ([0.1, 1e3], [2.3, 1e8]))
        return np.broadcast_to(np.eye(2), R.shape), C, K, np.ones((len(phase), 2))

    return system(matrices, 2)


@parametrised_by(STEPPING)
def test_stiff_modes_are_damped_only_by_l_stable_methods(method):
    """With 48 steps, ω h = 1300. L-stable methods damp two multipliers to zero, and the other multipliers are
    correct."""
    equation = rotating_stiff_mode()
    truth = floquet(equation, 1.0, Radau(13), rtol=1e-8)
    assert truth.unresolved == 2
    solutions = method.solutions(SinglePoint(equation, 1.0), Grid.uniform(48, TURN), False)
    values = np.sort(np.abs(np.linalg.eigvals(solutions.Phi[0])))[::-1]
    damped = values[2] < 1e-9 and values[0] == pytest.approx(truth.spectral_radius, rel=0.05)
    assert damped == method.l_stable


# Jumps


@pytest.mark.parametrize(("method", "steps"), BEHIND_JUMPS, ids=[repr(method) for method, _ in BEHIND_JUMPS])
def test_order_is_retained_after_jumps(method, steps):
    orbits = solution(method, steps, EQUATION)
    multipliers = [multiplier_error(orbit.multipliers, MULTIPLIERS) for orbit in orbits]
    assert slope(steps, multipliers) == pytest.approx(method.order, abs=0.15)
    curves = [np.linalg.norm(orbit.at(INSIDE) - states(INSIDE)[0]) for orbit in orbits]
    assert slope(steps, curves) == pytest.approx(method.curve_order, abs=0.15)


@pytest.mark.parametrize("method", ["auto", "radau", "gauss", "hsu"])
def test_jumps_are_solved_to_round_off(method):
    orbit, truth = periodic(EQUATION, 1.0, method, rtol=1e-13), states(INSIDE)
    assert multiplier_error(orbit.multipliers, MULTIPLIERS) < 1e-12
    np.testing.assert_allclose(orbit.at(INSIDE)[0], truth[0], rtol=0, atol=1e-12 * np.abs(truth[0]).max())
    np.testing.assert_allclose(orbit.state(INSIDE)[1][0], truth[1], rtol=0, atol=1e-10)


def pulse(phase, speed):
    """System whose stiffness and load are increased from 0.3 to 0.7 of the period. There is no jump at phase
    0."""
    inside = (np.mod(phase, TURN) > 0.3 * TURN) & (np.mod(phase, TURN) < 0.7 * TURN)
    one = np.ones((len(phase), 1, 1))
    return one, 0.1 * one, np.where(inside, 2.0, 0.5)[:, None, None], np.where(inside, 1.0, 0.0)[:, None]


@parametrised_by(STEPPING)
def test_jumps_inside_the_period_only(method):
    low, high = generator(0.5, 0.1, 0.0), generator(2.0, 0.1, 1.0)
    period = expm(low * 0.3 * TURN) @ expm(high * 0.4 * TURN) @ expm(low * 0.3 * TURN)
    start = np.linalg.solve(np.eye(2) - period[:2, :2], period[:2, 2])
    steps = None if isinstance(method, Radau | Gauss) else 4000
    orbit = periodic(system(pulse, 1, breaks=(0.3 * TURN, 0.7 * TURN)), 1.0, method, steps=steps)
    assert orbit.q[0, 0] == pytest.approx(start[0], rel=max(1e-11, 3 * orbit.error_estimate.orbit))
    multipliers = multiplier_error(orbit.multipliers, np.linalg.eigvals(period[:2, :2]))
    assert multipliers < max(1e-11, 3 * orbit.error_estimate.multipliers)


@parametrised_by(DENSE)
@pytest.mark.parametrize("solve_it", [periodic, floquet])
def test_jumps_are_refused_with_the_remedy(method, solve_it):
    with pytest.raises(
        MatricesError, match=rf"{method.name} requires matrices without jumps, .* use radau or gauss"
    ):
        solve_it(EQUATION, 1.0, method)


# Refusals


def oscillator(omega):
    return constant([[1.0]], [[0.0]], [[omega**2]], lambda phase: np.cos(phase)[:, None])


@parametrised_by(EVERY)
@pytest.mark.parametrize("steps", [0, -3, 2.5])
def test_invalid_step_counts_are_refused(method, steps):
    with pytest.raises(StepsError, match="allowed: whole numbers of at least 1; omit steps"):
        periodic(SYSTEM, 1.0, method, steps=steps)


@parametrised_by(STEPPING)
def test_fewer_steps_than_breaks_are_refused(method):
    with pytest.raises(StepsError, match="steps is 1; allowed: whole numbers of at least 2"):
        periodic(EQUATION, 1.0, method, steps=1)


@parametrised_by(EVERY)
def test_too_many_steps_are_refused(method):
    """For a method that converges, the limit also includes the finer grid of the error estimate."""
    most = method.most_steps(SYSTEM.n) // (2 if method.converges else 1)
    with pytest.raises(
        StepsError, match=rf"{method.name} takes at most {most} steps .* 2 coordinates; given: {most + 1}"
    ):
        periodic(SYSTEM, 1.0, method, steps=most + 1)


@parametrised_by(EVERY)
def test_least_steps_are_stable_and_fewer_are_refused(method):
    equation = oscillator(40.3)
    (least,) = method.least_steps(frozen_modes(equation, 1.0))
    if least > 1:
        with pytest.raises(
            StepsError,
            match=rf"{method.name} with {least - 1} steps .* at least {least} steps, or .*\(radau\)",
        ):
            floquet(equation, 1.0, method, steps=int(least) - 1)
    solutions = method.solutions(SinglePoint(equation, 1.0), Grid.uniform(int(least), TURN), False)
    if not method.warnings:
        assert np.abs(np.linalg.eigvals(solutions.Phi[0])).max() < 1 + 1e-9


AT_RESONANCE = {
    March: (StepsError, "the transient does not decay within 1000000 periods .* use a periodic method"),
    BahgatWillmert: (
        ResonanceError,
        "harmonic 1 of the load equals an undamped natural frequency at some fixed phase",
    ),
}


@pytest.mark.parametrize(
    ("method", "steps"),
    [
        *((method, 200) for method in EVERY),
        *(pytest.param(method, None, marks=[pytest.mark.slow] * (method in ALIKE)) for method in EVERY),
    ],
    ids=repr,
)
def test_resonance_is_refused(method, steps):
    """For q″ + q = cos φ, the error of a method must not act as damping."""
    refusal, reason = AT_RESONANCE.get(type(method), (ResonanceError, r"a Floquet multiplier is at \+1"))
    with pytest.raises(refusal, match=reason):
        periodic(oscillator(1.0), 1.0, method, steps=steps, rtol=1e-6)


@pytest.mark.parametrize("method", [name for name in METHODS if name != "bahgat-willmert"])
def test_points_without_matrices_fail_individually(method):
    """With the second length of the coupler, the crank cannot turn fully."""
    coupler, speeds, lengths = load("coupler", modes=1), {"speed": [62.0, 63.0]}, {"l2": [0.05, 0.7]}
    computed = chart(coupler, speeds, lengths, method=method, rtol=1e-2)
    assert np.isfinite(computed.spectral_radius).tolist() == [[True, True], [False, False]]
    assert any("the crank cannot turn fully" in text for text in computed.warnings)


# The contract


@parametrised_by(EVERY)
def test_method_attributes_are_consistent(method):
    assert method.spectral == (method.order == method.curve_order == math.inf)
    assert method.converges == (method.order > 0) == (method.curve_order > 0)
    assert method.curve_order <= method.order
    assert method.follows > 0
    assert method.l_stable == isinstance(method, Radau)
    assert all(isinstance(text, str) for text in method.warnings)
    assert bool(method.warnings) == (isinstance(method, Newmark) and method.gamma < 0.5)


class Watched(SinglePoint):
    """Point that records the phases at which its matrices are evaluated."""

    def __init__(self, system, speed):
        super().__init__(system, speed)
        self.phases: list[np.ndarray] = []

    def tables(self, phase) -> Tables:
        self.phases.append(np.ravel(phase))
        return super().tables(phase)


@parametrised_by(EVERY)
def test_samples_are_equidistant_if_the_method_declares_it(method):
    point = Watched(SYSTEM, 1.0)
    method.solutions(point, Grid.uniform(31, TURN), True)
    requested = np.unique(np.round(np.mod(np.concatenate(point.phases), TURN), 9) % round(TURN, 9))
    gaps = np.diff([*requested, requested[0] + TURN])
    assert (np.ptp(gaps) < 1e-6) == method.samples_evenly


@parametrised_by(EVERY)
def test_step_limits_and_phase_errors_are_monotonic(method):
    most = [method.most_steps(n) for n in (1, 2, 8, 40)]
    assert all(isinstance(count, int) and count > 1 for count in most)
    assert all(more >= fewer for more, fewer in pairwise(most))
    for engine in (NUMPY, COMPILED):
        sizes = [method.bytes_a_step(n, orbit, engine) for orbit in (False, True) for n in (1, 2, 8)]
        assert min(sizes) > 0
        assert sizes[:3] == sorted(sizes[:3])
        assert all(with_orbit >= without for without, with_orbit in zip(sizes[:3], sizes[3:], strict=True))
    soft, stiff = (method.least_steps(frozen_modes(oscillator(omega), 1.0)) for omega in (1.0, 400.0))
    assert soft.shape == (1,)
    assert np.issubdtype(soft.dtype, np.integer)
    assert 1 <= soft[0] <= stiff[0]
    few, many = method.in_phase(np.array([64, 128]), 0.1)
    assert 0 < few <= many
    if np.isfinite(few):
        assert many / few == pytest.approx(2 ** (method.order / (method.order + 1)))


@parametrised_by(EVERY)
@pytest.mark.parametrize("orbit", [True, False])
def test_batched_points_equal_single_points_exactly(method, orbit):
    """No point depends on its neighbours, even if one of them has no matrices."""
    speeds = np.array([[0.7], [1.0], [np.nan], [2.0]])
    points = Sampled(SystemFamily(SYSTEM, [SPEED]), speeds)
    grid = Grid.uniform(21, TURN)
    together = method.solutions(points, grid, orbit)
    assert len(together) == len(speeds)
    assert list(together.failures) == [2]
    assert isinstance(together.failures[2], MatricesError)
    assert (together.curve is not None) == orbit
    for at in (0, 1, 3):
        alone, among = method.solutions(points[np.array([at])], grid, orbit), together[np.array([at])]
        assert not alone.failures
        assert alone.grid.steps == among.grid.steps
        assert alone.notes == among.notes
        for name in ("Phi", "condition", "defect", "rounding"):
            np.testing.assert_array_equal(getattr(alone, name), getattr(among, name))
        if orbit:
            np.testing.assert_array_equal(alone.curve.coefficients, among.curve.coefficients)
        if alone.steps is not None:
            np.testing.assert_array_equal(alone.steps.A, among.steps.A)
            np.testing.assert_array_equal(alone.steps.b, among.steps.b)
