"""Beam elements compared with their definition, quadrature, scikit-fem, and Appendix A of the thesis."""

from functools import cache
from types import ModuleType

import numpy as np
import pytest
import sympy
from numpy.polynomial import Polynomial

from derive.beam import (
    AXIAL,
    BENDING,
    ELEMENTS,
    FAMILIES,
    HERMITE,
    LINEAR,
    QUADRATIC,
    Family,
    beam_elements_text,
    overlap,
)
from models.four_bar import published
from models.four_bar.published import Misprint

NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)
XI, WEIGHTS = (NODES + 1) / 2, WEIGHTS / 2


@cache
def generated() -> ModuleType:
    module = ModuleType("beam_elements")
    exec(beam_elements_text("0" * 64, "beam_elements"), module.__dict__)
    return module


NAMES = [family.name for family in FAMILIES]
BENDS = [family.name for family in FAMILIES if family.strain == BENDING]


def table(family: str, name: str) -> np.ndarray:
    return np.array(generated().FAMILIES[family][name], dtype=float)


def values(family: str, derivative: int = 0) -> np.ndarray:
    """Shape functions or their derivatives at the quadrature points, (k, points)."""
    polynomials = [Polynomial(row) for row in table(family, "shapes")]
    return np.array([(p.deriv(derivative) if derivative else p)(XI) for p in polynomials])


def quadrature(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    return (left * WEIGHTS) @ right.T


@pytest.mark.parametrize("name", NAMES)
def test_each_shape_function_belongs_to_one_freedom(name):
    for i, row in enumerate(table(name, "shapes")):
        at_freedoms = [
            (Polynomial(row).deriv(order) if order else Polynomial(row))(at)
            for order, at in generated().FAMILIES[name]["freedoms"]
        ]
        np.testing.assert_allclose(at_freedoms, np.eye(len(at_freedoms))[i], atol=1e-13)


@pytest.mark.parametrize("name", NAMES)
def test_tables_are_the_integrals_of_the_shape_functions(name):
    strain = generated().FAMILIES[name]["strain"]
    N, B = values(name), values(name, strain)
    np.testing.assert_allclose(table(name, "mass"), quadrature(N, N), atol=1e-13)
    np.testing.assert_allclose(table(name, "stiffness"), quadrature(B, B), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(table(name, "loads"), quadrature(np.stack((XI**0, XI)), N), atol=1e-13)
    powers = XI ** np.arange(table(name, "strains").shape[1])[:, None]
    np.testing.assert_allclose(table(name, "strains") @ powers, B, atol=1e-11)


@pytest.mark.parametrize("name", BENDS)
def test_geometric_stiffness_is_the_integral_of_the_slopes(name):
    slope = values(name, 1)
    np.testing.assert_allclose(table(name, "geometric"), quadrature(slope, slope), rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("element", ELEMENTS, ids=lambda element: element.name)
def test_coupling_is_the_integral_of_axial_times_transverse_shapes(element):
    stated = generated().ELEMENTS[element.name]
    expected = quadrature(values(stated["axial"]), values(stated["bending"]))
    np.testing.assert_allclose(np.array(stated["coupling"], dtype=float), expected, atol=1e-13)


@pytest.mark.parametrize("name", BENDS)
def test_rigid_motions_have_zero_strain_energy_and_rod_inertia(name):
    freedoms = generated().FAMILIES[name]["freedoms"]
    shift = np.array([1.0 if order == 0 else 0.0 for order, _ in freedoms])
    turn = np.array([at if order == 0 else float(order == 1) for order, at in freedoms])
    M, K, G = (table(name, which) for which in ("mass", "stiffness", "geometric"))
    np.testing.assert_allclose(K @ np.stack((shift, turn), axis=1), 0, atol=1e-11)
    assert shift @ M @ shift == pytest.approx(1, rel=1e-14)
    assert turn @ M @ turn == pytest.approx(1 / 3, rel=1e-14)
    np.testing.assert_allclose(G @ shift, 0, atol=1e-13)
    assert turn @ G @ turn == pytest.approx(1, rel=1e-13)


@pytest.mark.parametrize("name", BENDS)
def test_cantilever_under_end_force_is_exact(name):
    freedoms = generated().FAMILIES[name]["freedoms"]
    free = [i for i, (order, at) in enumerate(freedoms) if not (at == 0 and order < 2)]
    load = np.array([float(freedom == (0, 1)) for freedom in freedoms])
    q = np.zeros(len(freedoms))
    q[free] = np.linalg.solve(table(name, "stiffness")[np.ix_(free, free)], load[free])
    deflection = Polynomial(q @ table(name, "shapes"))
    x = np.linspace(0, 1, 7)
    np.testing.assert_allclose(deflection(x), x**2 / 2 - x**3 / 6, atol=1e-12)


def test_standard_elements_match_scikit_fem():
    skfem = pytest.importorskip("skfem")
    from skfem.helpers import d, dd

    length = 0.37
    mesh = skfem.MeshLine(np.array([0.0, length]))
    mass = skfem.BilinearForm(lambda u, v, w: u * v)
    axial = skfem.BilinearForm(lambda u, v, w: d(u)[0] * d(v)[0])
    bending = skfem.BilinearForm(lambda u, v, w: dd(u)[0][0] * dd(v)[0][0])
    cases = (
        ("linear", skfem.ElementLineP1(), axial, 1, (0, 1), (0, 0)),
        ("quadratic", skfem.ElementLineP2(), axial, 1, (0, 2, 1), (0, 0, 0)),
        ("hermite", skfem.ElementLineHermite(), bending, 3, (0, 1, 2, 3), (0, 1, 0, 1)),
    )
    for name, element, strain, power, order, powers in cases:
        basis = skfem.Basis(mesh, element, intorder=8)
        pick = np.ix_(order, order)
        scale = length ** np.add.outer(powers, powers).astype(float)
        theirs = mass.assemble(basis).toarray()[pick]
        np.testing.assert_allclose(length * scale * table(name, "mass"), theirs, rtol=1e-12, atol=1e-15)
        theirs = strain.assemble(basis).toarray()[pick]
        ours = scale / length**power * table(name, "stiffness")
        np.testing.assert_allclose(ours, theirs, rtol=1e-11, atol=1e-9 * abs(theirs).max())


def test_geometric_stiffness_of_cubic_element_matches_textbook():
    expected = np.array([[36, 3, -36, 3], [3, 4, -3, -1], [-36, -3, 36, -3], [3, -1, -3, 4]]) / 30
    np.testing.assert_allclose(table("hermite", "geometric"), expected, rtol=1e-14)


def test_internal_node_element_equals_appendix_a1():
    shapes, curvatures = published.internal_shapes()
    M, K = published.internal_matrices(1.0)
    np.testing.assert_array_equal(table("quintic_node", "shapes"), shapes)
    np.testing.assert_array_equal(table("quintic_node", "strains"), curvatures)
    np.testing.assert_allclose(table("quintic_node", "mass"), M, rtol=1e-14)
    np.testing.assert_allclose(table("quintic_node", "stiffness"), K, rtol=1e-14)


def test_printed_entry_322_violates_rigid_rotation():
    _, printed = published.internal_matrices(1.0, {Misprint.INTERNAL_STIFFNESS})
    derived = table("quintic_node", "stiffness")
    assert np.argwhere(~np.isclose(printed, derived, rtol=1e-12)).tolist() == [[1, 1]]
    assert (derived[1, 1] * 35, printed[1, 1] * 35) == (pytest.approx(332), pytest.approx(322))
    turn = np.array([0, 1, 0.5, 1, 1, 1])
    assert turn @ derived @ turn == pytest.approx(0, abs=1e-11)
    assert turn @ printed @ turn == pytest.approx(-10 / 35)


def test_appendix_a2_repeats_a1():
    M, K = published.curvature_matrices(1.0)
    np.testing.assert_allclose(table("quintic_curvature", "mass"), M, rtol=1e-14)
    np.testing.assert_allclose(table("quintic_curvature", "stiffness"), K, rtol=1e-14)
    printed, _ = published.curvature_matrices(1.0, {Misprint.CURVATURE_ELEMENT})
    shift = np.array([1, 0, 0, 1, 0, 0])
    assert shift @ M @ shift == pytest.approx(1)
    # 523/3465 + 2 (−8/693) + 32/3465: a translating element would have a seventh of its mass.
    assert shift @ printed @ shift == pytest.approx(475 / 3465)


def test_hand_coded_matrices_of_chapter_4_for_any_length():
    L = 0.41
    powers = L ** np.array([0.0, 1.0, 0.0, 1.0])
    ours = table("hermite", "stiffness") * np.outer(powers, powers) / L**3
    np.testing.assert_allclose(ours, published.cubic_stiffness(L), rtol=1e-13)
    np.testing.assert_allclose(table("linear", "stiffness") / L, published.axial_stiffness(L), rtol=1e-14)


def test_new_beam_element_is_declared_by_its_shape_functions():
    """A cubic rod element with nodes at its thirds, which the package does not contain."""
    third = sympy.Rational(1, 3)
    rod = Family("cubic_rod", AXIAL, ((0, 0), (0, third), (0, 2 * third), (0, 1)))
    assert sum(rod.shape) == 1
    assert rod.mass.is_symmetric()
    assert rod.mass[0, 0] == sympy.Rational(8, 105)
    assert rod.stiffness * sympy.ones(4, 1) == sympy.zeros(4, 1)
    assert rod.stiffness[0, 0] == sympy.Rational(37, 10)


def test_overlaps_are_exact_rationals():
    assert overlap(LINEAR.shape, HERMITE.shape)[0, 0] == sympy.Rational(7, 20)
    assert QUADRATIC.loads[0, 1] == sympy.Rational(2, 3)
