"""Exact dynamic stiffness compared with the boundary-value problem solved to 40 digits and with Appendix
B."""

import mpmath
import numpy as np
import pytest
from scipy.optimize import brentq

from models.four_bar import published
from models.four_bar.published import AS_PRINTED, CORRECTED, Misprint
from solve.beams import dynamic_stiffness as exact

LENGTH, EI, EA, MU = 0.37, 2.3, 41.0, 0.9


def end_forces(omega, length=LENGTH, dps=40):
    """Return D of a beam: the differential equations are solved for unit end displacements."""
    with mpmath.workdps(dps):
        lam = mpmath.sqrt(mpmath.sqrt(mpmath.mpf(MU) / EI) * omega)
        beta = mpmath.sqrt(mpmath.mpf(MU) / EA) * omega
        L, D = mpmath.mpf(length), mpmath.zeros(6)

        def waves(x, order):
            signs = [(mpmath.sin, mpmath.cos)[order % 2], (mpmath.cos, mpmath.sin)[order % 2]]
            trig = [(1, 1, -1, -1)[order % 4], (1, -1, -1, 1)[order % 4]]
            hyper = [(mpmath.sinh, mpmath.cosh)[order % 2], (mpmath.cosh, mpmath.sinh)[order % 2]]
            circular = [s * f(lam * x) for s, f in zip(trig, signs, strict=True)]
            return [lam**order * each for each in (*circular, *(f(lam * x) for f in hyper))]

        ends = mpmath.matrix([waves(0, 0), waves(0, 1), waves(L, 0), waves(L, 1)])
        forces = mpmath.matrix([waves(0, 3), waves(0, 2), waves(L, 3), waves(L, 2)])
        signs = mpmath.diag([EI, -EI, -EI, EI])
        D[2:, 2:] = signs * forces * mpmath.inverse(ends)
        rod_ends = mpmath.matrix([[0, 1], [mpmath.sin(beta * L), mpmath.cos(beta * L)]])
        strain = [[beta, 0], [beta * mpmath.cos(beta * L), -beta * mpmath.sin(beta * L)]]
        D[:2, :2] = mpmath.diag([-EA, EA]) * mpmath.matrix(strain) * mpmath.inverse(rod_ends)
        return D


def array(matrix):
    return np.array(matrix.tolist(), dtype=float)


def end_masses(omega):
    """Return −∂D/∂ω² from a central difference with 60 digits."""
    with mpmath.workdps(60):
        square, step = mpmath.mpf(omega) ** 2, mpmath.mpf(10) ** -18
        above, below = (end_forces(mpmath.sqrt(square + s * step), dps=60) for s in (1, -1))
        return array((below - above) / (2 * step))


def numbers(omega):
    return LENGTH * (MU / EI) ** 0.25 * np.sqrt(omega), LENGTH * np.sqrt(MU / EA) * omega


def package_stiffness(omega):
    l, b = numbers(omega)  # noqa: E741
    weights = np.concatenate(
        (EI * exact.bending(l) / LENGTH**exact.BENDING_POWERS, EA / LENGTH * exact.axial(b))
    )
    return np.tensordot(weights, exact.patterns(), axes=1)


def package_mass(omega):
    l, b = numbers(omega)  # noqa: E741
    bending = MU * exact.bending_mass(l) * LENGTH ** (4.0 - exact.BENDING_POWERS)
    weights = np.concatenate((bending, MU * LENGTH * exact.axial_mass(b)))
    return np.tensordot(weights, exact.patterns(), axes=1)


def scaled_difference(computed, expected):
    size = np.sqrt(np.abs(np.diag(expected)))
    return np.abs((computed - expected) / np.outer(size, size)).max()


OMEGAS = (0.3, 3.0, 25.0, 170.0, 1200.0)


@pytest.mark.parametrize("omega", OMEGAS)
def test_end_forces_solve_the_differential_equations(omega):
    assert scaled_difference(package_stiffness(omega), array(end_forces(omega))) < 1e-12


@pytest.mark.parametrize("omega", OMEGAS)
def test_mass_matches_the_derivative_of_the_stiffness(omega):
    tolerance = 1e-7 if omega < 1 else 1e-10
    assert scaled_difference(package_mass(omega), end_masses(omega)) < tolerance


@pytest.mark.parametrize("omega", OMEGAS)
def test_corrected_appendix_b_matches_the_derivation(omega):
    l, b = numbers(omega)  # noqa: E741
    lam, beta = l / LENGTH, b / LENGTH
    D = published.dynamic_stiffness(published.stiffness_functions(lam, beta, LENGTH), EI, EA)
    assert scaled_difference(D, array(end_forces(omega))) < (1e-9 if omega < 1 else 1e-11)
    if omega > 1:
        M = MU * published.dynamic_stiffness(published.mass_functions(lam, beta, LENGTH), 1.0, 1.0)
        assert scaled_difference(M, end_masses(omega)) < 1e-9


STIFFNESS_MISPRINTS = {Misprint.ARGUMENTS: {1, 2, 3, 4, 5, 6}, Misprint.AXIAL_SIGNS: {7, 8}}
MASS_MISPRINTS = {
    Misprint.PRODUCTS: {1, 2, 3, 4, 5, 6},
    Misprint.RUN_TOGETHER: {2},
    Misprint.SHEAR_MASS: {5},
    Misprint.AXIAL_MASS: {7, 8},
}


def changed(functions, misprint):
    """Return the numbers of the functions that a misprint changes by more than 0.1 %."""
    printed, true = functions({misprint}), functions(CORRECTED)
    return {i + 1 for i in np.flatnonzero(np.abs(printed / true - 1) > 1e-3)}


@pytest.mark.parametrize("misprint", STIFFNESS_MISPRINTS, ids=lambda each: each.name)
def test_each_stiffness_misprint_affects_only_its_entries(misprint):
    def functions(misprints):
        return published.stiffness_functions(3.1, 1.7, LENGTH, misprints)

    assert changed(functions, misprint) == STIFFNESS_MISPRINTS[misprint]


@pytest.mark.parametrize("misprint", MASS_MISPRINTS, ids=lambda each: each.name)
def test_each_mass_misprint_affects_only_its_entries(misprint):
    def functions(misprints):
        return published.mass_functions(3.1, 1.7, LENGTH, misprints)

    assert changed(functions, misprint) == MASS_MISPRINTS[misprint]


def test_printed_functions_are_wrong_unless_dimensionless():
    for functions in (published.stiffness_functions, published.mass_functions):
        printed, true = functions(3.1, 1.7, LENGTH, AS_PRINTED), functions(3.1, 1.7, LENGTH)
        assert (np.abs(printed / true - 1) > 1e-3).all()


def test_zero_frequency_gives_static_stiffness_and_consistent_mass():
    cubic = published.cubic_stiffness(1.0)
    static = np.tensordot(exact.bending(np.array(0.0)), exact.patterns()[:6], axes=1)[2:, 2:]
    np.testing.assert_allclose(static, cubic, rtol=1e-14)
    np.testing.assert_allclose(exact.axial(np.array(0.0)), [1, -1], rtol=1e-14)
    np.testing.assert_allclose(exact.axial_mass(np.array(0.0)), [1 / 3, 1 / 6], rtol=1e-14)
    consistent = [-1 / 140, 1 / 105, -13 / 420, -11 / 210, 9 / 70, 13 / 35]
    np.testing.assert_allclose(exact.bending_mass(np.array(0.0)), consistent, rtol=1e-7)


def test_clamped_function_is_accurate_for_small_arguments():
    for l in (1e-5, 1e-3, 0.1, 0.9, 1.9, 2.1, 4.6):  # noqa: E741
        with mpmath.workdps(40):
            expected = float(mpmath.cosh(l) * mpmath.cos(l) - 1)
        assert float(exact.clamped(np.array(l))) == pytest.approx(expected, rel=1e-14)


def test_high_frequencies_cause_no_overflow():
    l = np.array([299.0, 301.0, 5000.0])  # noqa: E741
    functions = exact.bending(l)
    # A long beam's ends know each other only through cos l: sinh and cosh are alike.
    assert np.isfinite(functions).all()
    s, c = np.sin(l), np.cos(l)
    limits = (-l / c, -l * (s - c) / c, -(l**2) / c, l**2 * s / c, l**3 / c, -(l**3) * (s + c) / c)
    np.testing.assert_allclose(functions, np.stack(limits, axis=1), rtol=1e-9)


def test_interior_count_matches_clamped_beam_frequencies():
    roots = []
    for k in range(1, 9):
        centre = (k + 0.5) * np.pi
        roots.append(brentq(lambda x: np.cos(x) - 1 / np.cosh(x), centre - 0.2, centre + 0.2, xtol=1e-14))
    probe = np.sort(
        np.concatenate((np.linspace(0.01, 28, 800), np.array(roots) - 1e-6, np.array(roots) + 1e-6))
    )
    expected = (np.array(roots)[None, :] < probe[:, None]).sum(axis=1)
    np.testing.assert_array_equal(exact.interior_count(probe), expected)
    axial = np.linspace(0.05, 20, 333)
    rods = (np.arange(1, 8) * np.pi < axial[:, None]).sum(axis=1)
    np.testing.assert_array_equal(exact.interior_count(np.full(333, 0.5), axial), rods)


@pytest.mark.parametrize("number", [1e-9, 0.3, 4.0, 25.0, 400.0])
def test_shape_functions_satisfy_the_boundary_conditions_and_equation(number):
    ends = exact.bending_shapes(number, np.array([0.0, 1.0]))
    np.testing.assert_allclose(ends[:, [0, 2]], np.eye(2), atol=1e-9)
    np.testing.assert_allclose(ends[:, [1, 3]], 0, atol=1e-9)
    if 0.3 <= number <= 25:
        h = 1e-2 / max(number, 1)
        x = np.linspace(3 * h, 1 - 3 * h, 5)
        around = [exact.bending_shapes(number, x + k * h) for k in (-2, -1, 0, 1, 2)]
        fourth = (around[0] - 4 * around[1] + 6 * around[2] - 4 * around[3] + around[4]) / h**4
        np.testing.assert_allclose(fourth, number**4 * around[2], atol=2e-3 * number**4 + 1e-3)


def test_second_moment_of_the_crank_differs_from_its_section():
    true = published.crank_second_moment()
    assert true == pytest.approx(529.17e-12, abs=0.005e-12)
    assert published.crank_second_moment({Misprint.CRANK_SECOND_MOMENT}) == 520.47e-12
