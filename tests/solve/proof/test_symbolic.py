"""Proofs of systems whose matrices are user functions or samples."""

from fractions import Fraction

import mpmath
import numpy as np
import pytest

pytest.importorskip("flint")

import solve
from solve.errors import LinearModelError
from solve.proof.balls import arb, precision
from solve.proof.enclosure import equation_of
from solve.proof.instructions import Instructions
from solve.proof.symbolic import linearised
from tests.solve.proof.test_prove import exact_trace

DELTA, EPSILON, ZETA = 1.3, 0.4, 0.03


def mathieu(phase, speed):
    """Return Mathieu's equation. Only the product zeta sqrt(delta) is rounded to a double."""
    one = np.ones((len(phase), 1, 1))
    stiffness = DELTA + EPSILON * np.cos(2 * phase)
    return one, 2 * ZETA * np.sqrt(DELTA) * one, stiffness[:, None, None], np.cos(2 * phase)[:, None]


def sampled():
    phases = np.arange(16) * np.pi / 16
    return solve.PeriodicSystem.from_samples(*mathieu(phases, 1.0), ["q"], period=np.pi)


@pytest.mark.parametrize(
    ("system", "width"), [(solve.PeriodicSystem(mathieu, ["q"], np.pi), 1e-18), (sampled(), 1e-15)]
)
def test_functions_and_samples_match_the_generated_model(system, width):
    """The coefficients of the samples are rounded."""
    found = solve.prove(system, 1.0)
    assert found.verdict == "asymptotically stable"
    low, high = found.spectral_radius
    with mpmath.workdps(40):
        trace = exact_trace(DELTA, EPSILON, ZETA)
        damping = 2 * mpmath.mpf(ZETA) * mpmath.sqrt(mpmath.mpf(DELTA))
        radius = max(map(abs, mpmath.polyroots([1, -trace, mpmath.exp(-damping * mpmath.pi)])))
        # The damping is a rounded product.
        assert mpmath.mpf(low) - mpmath.mpf(2e-16) < radius < mpmath.mpf(high) + mpmath.mpf(2e-16)
        assert mpmath.mpf(high) - mpmath.mpf(low) < mpmath.mpf(width)
    assert found.true_error["orbit"] <= found.result.error_estimate.orbit


def test_period_of_a_function_is_proved():
    assert (
        "continued periodically" not in solve.prove(solve.PeriodicSystem(mathieu, ["q"], np.pi), 1.0).assumed
    )


def test_symbolic_function_equals_the_numerical_function():
    """The operations include the remainder, powers and reflected operations."""

    def matrices(phase, speed):
        x = phase[:, None, None]
        K = 3 + np.abs(np.sin(x)) ** 3 - np.arctan2(np.sin(x), 2 + np.cos(x)) / (1 + np.exp(-np.cos(x)))
        C = (
            2.0 ** np.sin(x) * speed
            + np.mod(x, 1.5)
            - np.arcsin(np.sin(x) / 2)
            + np.sqrt(2 + np.tanh(np.sin(x)))
        )
        return np.ones_like(x), C, K, (1 / (2 + np.cos(phase)))[:, None] % 0.3

    system, phases = solve.PeriodicSystem(matrices, ["q"]), np.array([0.3, 1.4, 4.0])
    function = linearised(system)
    for at, values in enumerate(zip(*system.at(phases, 1.7), strict=True)):
        for symbolic, exact in zip(function(phases[at], 1.7, []), values, strict=True):
            assert float(symbolic) == pytest.approx(float(exact.ravel()[0]), rel=1e-14)
    with precision(100):
        m, r = equation_of(system, 1.7, False).at(arb(phases[0]), None)
        assert m[0, 0].is_finite()
        assert r[0, 1].is_finite()


def stiffness(function):
    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, 0.1 * one, function(phase)[:, None, None], np.zeros((len(phase), 1))

    return solve.PeriodicSystem(matrices, ["q"])


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda phase: np.where(phase < np.pi, 2.0, 3.0), "has no truth value"),
        (lambda phase: np.where(phase == 0, 2.0, 3.0), "has no truth value"),
        (lambda phase: np.maximum(np.cos(phase), 0.5), "has no truth value"),
        (lambda phase: np.interp(phase, [0, 7], [2, 2]), "cannot be evaluated at symbolic phases"),
        (lambda phase: 2 + np.sin(phase) * np.mean(np.cos(phase)), "depend on other phases"),
        (lambda phase: 2 + np.cos(phase) * (1 + 0.0j), "cannot be evaluated at symbolic phases"),
        (lambda phase: 2 + np.cos(phase) * np.longdouble("0.1"), "is not a number of double precision"),
        (lambda phase: 2 + np.log1p(np.cos(phase) ** 2), "log1p"),
        (lambda phase: phase.astype(float), "cannot be evaluated at symbolic phases"),
    ],
)
def test_operations_without_an_exact_meaning_are_refused(function, message):
    with pytest.raises(LinearModelError, match=message):
        linearised(stiffness(function))


def test_proof_with_jumps_of_a_function_contains_the_closed_form():
    """Meissner's equation is written with the integer part of the phase. The trace is that of a product of
    two rotations."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        w = 1 + np.floor(phase)[:, None, None]
        return one, 0 * one, w**2 * one, np.zeros((len(phase), 1))

    found = solve.prove(solve.PeriodicSystem(matrices, ["q"], 2.0, breaks=[0.0, 1.0]), 1.0, orbit=False)
    a, b, c, d = np.cos(1), np.sin(1), np.cos(2), np.sin(2)
    assert sum(found.multipliers).real == pytest.approx(2 * a * c - 2.5 * b * d, abs=1e-13)
    assert "continued periodically" in found.assumed


def test_harmonics_of_samples_are_selected_for_each_entry():
    """The large coupling terms must not suppress the varying stiffness of the coordinate with small
    entries."""
    phases, zero = np.arange(16) * np.pi / 8, np.zeros((16, 2, 2))
    M, C, K = zero.copy(), zero.copy(), zero.copy()
    M[:, 0, 0], C[:, 0, 0], K[:, 0, 0] = 1e17, 5e15, 7e16
    M[:, 1, 1], C[:, 1, 1], K[:, 1, 1] = 1, 0.01, 0.25 + 0.2 * np.cos(phases)
    system = solve.PeriodicSystem.from_samples(M, C, K, np.zeros((16, 2)), ["x", "q"])
    found = solve.prove(system, 1.0, orbit=False)
    assert found.verdict == found.result.verdict == "unstable"


@pytest.mark.parametrize(
    ("function", "exact"),
    [
        (lambda x: 5 * (0.2 * x), 5 * Fraction(0.2)),
        (lambda x: 0.1 * (0.7 * x), Fraction(0.1) * Fraction(0.7)),
        (lambda x: (x / 5) / 0.2, Fraction(1, 5) / Fraction(0.2)),
    ],
)
def test_constants_are_not_combined_in_double_precision(function, exact):
    instructions = Instructions.from_function(linearised(stiffness(lambda phase: function(np.cos(phase)))))
    with precision(200):
        values, _ = instructions([[arb(0)], [arb(1)], []])
        ((_, _, value),) = values[2]
        assert abs(value - arb(exact.numerator) / exact.denominator) < arb(2) ** -190


def test_symbolic_speed_can_multiply_arrays():
    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        K = speed**2 * one + (speed * np.cos(phase))[:, None, None] + speed % (2 * one) + speed**one
        return one, 0.1 * one, K, 0 * phase[:, None]

    system, phases = solve.PeriodicSystem(matrices, ["q"]), np.array([0.3])
    assert float(linearised(system)(0.3, 1.7, [])[2]) == pytest.approx(
        float(system.at(phases, 1.7)[2][0, 0, 0])
    )


@pytest.mark.parametrize(
    ("matrices", "message"),
    [
        (lambda one: (one, one, one), "cannot be evaluated"),
        (lambda one: (one, np.nan * one, one, one[:, 0]), "is not a number of double precision"),
        (lambda one: (one, (1 + 0j) * one, one, one[:, 0]), "is not a number of double precision"),
        (lambda one: (np.tile(one, (1, 2, 2)), one, one, one[:, 0]), "cannot be evaluated"),
    ],
)
def test_unsuitable_arrays_are_refused(matrices, message):
    system = solve.PeriodicSystem(lambda phase, speed: matrices(np.ones((len(phase), 1, 1))), ["q"])
    with pytest.raises(LinearModelError, match=message):
        linearised(system)


def test_input_matrix_is_ignored():
    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, 0.1 * one, 4 * one, one[:, 0], one

    assert linearised(solve.PeriodicSystem(matrices, ["q"], inputs=["u"])).n_out() == 4


def test_matrices_for_the_first_phase_only_are_refused():
    with pytest.raises(LinearModelError, match="depend on other phases"):
        linearised(stiffness(lambda phase: 2 + 0 * phase + np.cos(phase[0])))


def test_jump_of_an_angle_is_treated_as_a_remainder():
    """The polar angle of a point on a circle, from atan2, jumps by 2π."""
    angle = stiffness(lambda phase: 2 + 0.1 * np.arctan2(np.sin(phase), np.cos(phase)))
    rest = stiffness(lambda phase: 2 + 0.1 * (phase - 2 * np.pi * np.floor(phase / (2 * np.pi) + 0.5)))
    angle.breaks = rest.breaks = (np.pi,)
    one, other = (solve.prove(each, 1.0, orbit=False) for each in (angle, rest))
    assert np.abs(one.multipliers - other.multipliers).max() < (one.radii + other.radii).max() + 1e-14
    assert one.radii.max() < 1e-12
