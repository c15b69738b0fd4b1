"""Matrices of beam elements from their shape functions; a family of elements is a declaration.

A family is a polynomial in ξ = x/L with as many coefficients as it has freedoms; a freedom is the
polynomial's derivative of some order at some ξ. All else follows by exact integration: mass,
stiffness, geometric stiffness, load, strain, and the coupling of axial with transverse displacement
that rotation brings in (thesis 4.2, Appendix A).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import sympy

XI = sympy.Symbol("xi", real=True)

HALF = sympy.Rational(1, 2)

AXIAL, BENDING = 1, 2
"""Order of the derivative that the strain energy holds: elongation u′, curvature v″."""

LOADS = (0, 1)
"""Powers of ξ by which a distributed load may vary along the element."""


@dataclass(frozen=True)
class Family:
    """Shape functions that interpolate `freedoms`: pairs (order of the derivative, ξ).

    `strain` is AXIAL or BENDING. Derivatives by x = Lξ make row i of every table carry L to the power of
    its freedom's order.
    """

    name: str
    strain: int
    freedoms: tuple[tuple[int, sympy.Expr | int], ...]

    @cached_property
    def shape(self) -> Any:
        """Column N̂(ξ) of the shape functions, each 1 at its own freedom and 0 at the others."""
        monomials: Any = sympy.Matrix([XI**power for power in range(len(self.freedoms))])
        values = [monomials.diff(XI, order).subs(XI, at).T for order, at in self.freedoms]
        return (sympy.Matrix.vstack(*values).T.inv() * monomials).applyfunc(sympy.expand)

    @property
    def mass(self) -> sympy.Matrix:
        """∫ N̂ N̂ᵀ dξ, times ρA L: thesis (4.22)."""
        return overlap(self.shape, self.shape)

    @property
    def stiffness(self) -> sympy.Matrix:
        """∫ B̂ B̂ᵀ dξ, times EA/L or EI/L³: thesis (4.11)."""
        return overlap(self.strains, self.strains)

    @property
    def geometric(self) -> sympy.Matrix:
        """∫ N̂′ N̂′ᵀ dξ, times the axial force (tension positive) over L: thesis (4.38)."""
        slope = self.shape.diff(XI)
        return overlap(slope, slope)

    @property
    def strains(self) -> Any:
        """Column B̂(ξ): elongation times L, or curvature times L², for each unit freedom."""
        return self.shape.diff(XI, self.strain)

    @property
    def loads(self) -> sympy.Matrix:
        """Row k is ∫ N̂ᵀ ξᵏ dξ, times L and a load per length that varies as ξᵏ."""
        return overlap(sympy.Matrix([XI**power for power in LOADS]), self.shape)


@dataclass(frozen=True)
class Element:
    """A plane beam element: a family along the axis and one across it, with common nodes."""

    name: str
    axial: Family
    bending: Family

    @property
    def coupling(self) -> sympy.Matrix:
        """∫ N̂u N̂vᵀ dξ, times ρA L: the blocks −X and Xᵀ of P = ∫ ρA Nᵀ S N dx, S = [[0, −1], [1, 0]].

        In axes that turn at ω the Coriolis matrix is ωP, the rest of the frame's acceleration
        ω̇P − ω²M: thesis (4.22).
        """
        return overlap(self.axial.shape, self.bending.shape)


def overlap(left: sympy.Matrix, right: sympy.Matrix) -> sympy.Matrix:
    """∫₀¹ left rightᵀ dξ of two columns of polynomials in ξ, exact."""
    return (left * right.T).applyfunc(lambda entry: sympy.Poly(entry, XI).integrate().eval(1))


LINEAR = Family("linear", AXIAL, ((0, 0), (0, 1)))
QUADRATIC = Family("quadratic", AXIAL, ((0, 0), (0, HALF), (0, 1)))
HERMITE = Family("hermite", BENDING, ((0, 0), (1, 0), (0, 1), (1, 1)))
QUINTIC_NODE = Family("quintic_node", BENDING, ((0, 0), (1, 0), (0, HALF), (1, HALF), (0, 1), (1, 1)))
QUINTIC_CURVATURE = Family("quintic_curvature", BENDING, ((0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1)))

FAMILIES = (LINEAR, QUADRATIC, HERMITE, QUINTIC_NODE, QUINTIC_CURVATURE)

ELEMENTS = (
    Element("cubic", LINEAR, HERMITE),
    Element("internal", QUADRATIC, QUINTIC_NODE),
    Element("curvature", LINEAR, QUINTIC_CURVATURE),
)
