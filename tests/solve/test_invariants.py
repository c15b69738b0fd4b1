"""Properties of all periodic systems, whatever their matrices."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from solve import Newmark, floquet, periodic
from tests.solve.references import Shooting, multiplier_error, relative_error
from tests.solve.systems import canonical_undamped, meissner, random_matrices, random_system, seeds, system

METHODS = st.sampled_from(["radau", "gauss"])
PHASES = np.linspace(0.0, 2 * np.pi, 61)
sizes = st.integers(1, 4)
few = settings(max_examples=30, deadline=None)


@given(seeds, sizes, st.floats(0.5, 2.0), METHODS)
@settings(max_examples=12, deadline=None)
def test_orbit_and_multipliers_equal_dop853_shooting(seed, n, speed, method):
    system = random_system(seed, n)
    truth = Shooting(system, speed)
    orbit = periodic(system, speed, method, rtol=1e-10)
    q, v = np.split(truth.states(PHASES), 2)
    assert relative_error(orbit.at(PHASES), q) < 1e-9
    assert relative_error(orbit.state(PHASES)[1], speed * v) < 1e-8
    assert multiplier_error(orbit.multipliers, truth.multipliers) < 1e-9


@given(seeds, sizes, st.floats(0.5, 2.0), METHODS)
@few
def test_multipliers_satisfy_liouvilles_formula(seed, n, speed, method):
    """log |det Φ| = -∫ tr(M⁻¹C) dt over one period."""
    system = random_system(seed, n)

    def trace(phase):
        M, C, _, _ = system.at(np.array([phase]), speed)
        return np.trace(np.linalg.solve(M[0], C[0]))

    integral = quad(trace, 0.0, 2 * np.pi, epsabs=1e-13, epsrel=1e-13)[0] / speed
    stability = floquet(system, speed, method, rtol=1e-11)
    assert stability.unresolved == 0
    logarithms = np.log(np.abs(stability.multipliers))
    lost = np.exp(logarithms.max() - logarithms.min())
    assert logarithms.sum() == pytest.approx(-integral, abs=1e-10 * (1 + abs(integral)) * lost)


@given(seeds, sizes, METHODS)
@few
def test_multipliers_of_a_canonical_undamped_system_are_reciprocal(seed, n, method):
    values = floquet(canonical_undamped(seed, n), 1.0, method, rtol=1e-11).multipliers
    assert len(values) == 2 * n
    for value in values:
        sensitivity = max(1.0, np.abs(values).max() ** 2)
        distance = np.abs(values - 1 / value).min()
        assert distance < 1e-5 * sensitivity  # a double multiplier splits by the root of an error
    assert np.prod(values) == pytest.approx(1.0, abs=1e-8 * np.abs(values).max() ** 2)


@given(seeds, sizes, st.floats(-3.0, 3.0), METHODS)
@few
def test_orbit_is_linear_in_the_load(seed, n, factor, method):
    first, second = random_matrices(seed, n), random_matrices(seed + 1, n)

    def loaded(load):
        return system(lambda phase, speed: (*first(phase, speed)[:3], load(phase, speed)), n)

    def both(phase, speed):
        return first(phase, speed)[3] + factor * second(phase, speed)[3]

    q1, q2, q = (
        periodic(loaded(load), 1.0, method, steps=64, rtol=0.5).at(PHASES)
        for load in (lambda *x: first(*x)[3], lambda *x: second(*x)[3], both)
    )
    scale = np.abs(q1).max() + abs(factor) * np.abs(q2).max()
    np.testing.assert_allclose(q, q1 + factor * q2, rtol=0, atol=1e-12 * scale)


@given(seeds, sizes, st.floats(0.0, 2 * np.pi), METHODS)
@few
def test_shifted_phase_origin_only_shifts_the_orbit(seed, n, shift, method):
    matrices = random_matrices(seed, n)
    here = periodic(system(matrices, n), 1.0, method, rtol=1e-11)
    there = periodic(system(lambda phase, speed: matrices(phase + shift, speed), n), 1.0, method, rtol=1e-11)
    assert relative_error(there.at(PHASES), here.at(PHASES + shift)) < 1e-9
    assert multiplier_error(there.multipliers, here.multipliers) < 1e-9


@given(seeds, sizes, st.sampled_from(["radau", "gauss", "newmark", "rk4", "hsu"]))
@few
def test_orbit_closes_and_repeats(seed, n, method):
    orbit = periodic(random_system(seed, n), 1.0, method, steps=100, rtol=0.5)
    for part in (orbit.q, orbit.qd, orbit.qdd):
        np.testing.assert_array_equal(part[:, 0], part[:, -1])
    np.testing.assert_allclose(
        orbit.at(PHASES + 6 * np.pi), orbit.at(PHASES), rtol=0, atol=1e-12 * np.abs(orbit.q).max()
    )
    approach = orbit.at(2 * np.pi - np.array([1e-9]))[:, 0]
    np.testing.assert_allclose(approach, orbit.q[:, 0], rtol=0, atol=1e-7 * np.abs(orbit.q).max())


@given(seeds, sizes, st.floats(-8.0, 8.0), st.floats(-4.0, 4.0), METHODS)
@few
def test_units_of_force_and_coordinates_only_scale_the_orbit(seed, n, force, length, method):
    """Rows are multiplied by 10^force, and coordinate i has the unit 10^(length i)."""
    matrices = random_matrices(seed, n)
    units = 10.0 ** (length * np.arange(n))

    def rescaled(phase, speed):
        M, C, K, d = matrices(phase, speed)
        return (*(10.0**force * A * units for A in (M, C, K)), 10.0**force * d)

    plain = periodic(system(matrices, n), 1.0, method, rtol=1e-10)
    scaled = periodic(system(rescaled, n), 1.0, method, rtol=1e-10)
    assert relative_error(scaled.at(PHASES) * units[:, None], plain.at(PHASES)) < 1e-8
    assert multiplier_error(scaled.multipliers, plain.multipliers) < 1e-8


@given(seeds, sizes, st.floats(0.2, 5.0), METHODS)
@few
def test_rescaled_time_does_not_change_the_orbit_versus_phase(seed, n, factor, method):
    """The speed, 1/C, 1/√K and √M are multiplied by the same factor, and so are the rates."""
    matrices = random_matrices(seed, n)

    def faster(phase, speed):
        M, C, K, d = matrices(phase, speed / factor)
        return M / factor**2, C / factor, K, d

    plain = periodic(system(matrices, n), 1.3, method, steps=64, rtol=0.5)
    quick = periodic(system(faster, n), 1.3 * factor, method, steps=64, rtol=0.5)
    for power, (ours, theirs) in enumerate(zip(quick.state(PHASES), plain.state(PHASES), strict=True)):
        np.testing.assert_allclose(
            ours, factor**power * theirs, rtol=0, atol=1e-9 * factor**power * np.abs(theirs).max()
        )
    assert quick.time[-1] == pytest.approx(plain.time[-1] / factor)
    np.testing.assert_allclose(quick.exponents.real, factor * plain.exponents.real, rtol=1e-8, atol=1e-10)


@given(seeds, sizes)
@few
def test_two_newmark_methods_agree_within_their_errors(seed, n):
    system = random_system(seed, n)
    first, second = (
        periodic(system, 1.0, Newmark(0.5, beta), steps=m, rtol=0.5) for beta, m in ((0.25, 400), (0.0, 600))
    )
    allowed = first.error_estimate.orbit + second.error_estimate.orbit
    assert relative_error(first.at(PHASES), second.at(PHASES)) < 3 * allowed


@pytest.mark.parametrize("method", ["radau", "gauss", "rk4", "newmark"])
def test_residual_is_the_defect_of_the_equation_of_motion(method):
    """The residual is recomputed from the orbit at the midpoints of the steps, row by row."""
    given = random_system(5, 3)
    orbit = periodic(given, 1.0, method, steps=40, rtol=0.5)
    phase = (orbit.phase[:-1] + orbit.phase[1:]) / 2
    q, qd, qdd = orbit.state(phase)
    worst = 0.0
    M, C, K, d = given.at(phase, 1.0)
    for row in range(3):
        terms = [[A[k, row] @ x[:, k] for k in range(40)] for A, x in ((M, qdd), (C, qd), (K, q))]
        left = np.abs(np.sum(terms, axis=0) - d[:, row]).max()
        worst = max(worst, left / max(np.abs(terms).max(), np.abs(d[:, row]).max()))
    assert orbit.residual == pytest.approx(worst, rel=1e-10)
    assert 0 < orbit.residual < 0.1


def test_multipliers_over_two_periods_are_squares():
    """The matrices of Mathieu's equation have period π."""

    def mathieu(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, 0.2 * one, (2.0 + np.cos(2 * phase))[:, None, None], np.ones((len(phase), 1))

    short, long = (floquet(system(mathieu, 1, period=k * np.pi), 1.0, rtol=1e-11) for k in (1, 2))
    assert multiplier_error(short.multipliers**2, long.multipliers) < 1e-9
    assert short.period == pytest.approx(long.period / 2)
    assert short.exponents.real.max() == pytest.approx(long.exponents.real.max(), rel=1e-9)


def test_jump_does_not_contribute_to_the_residual():
    assert periodic(meissner(), 1.0, rtol=1e-10).residual < 1e-8
