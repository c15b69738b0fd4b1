"""Beam elements: matrices from shape functions, and the text of their generated module.

The displacement is a polynomial in ξ = x/L with one coefficient per degree of freedom. A degree of freedom is
the value of a derivative of this polynomial at a node. The tables are computed exactly: mass, stiffness,
geometric stiffness, loads, strains, and the coupling of axial and transverse displacements in a rotating
element (section 4.2 and Appendix A of the thesis).
"""

import json
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import sympy

from derive.freshness import hashed_module

XI = sympy.Symbol("xi", real=True)

HALF = sympy.Rational(1, 2)

AXIAL, BENDING = 1, 2
"""Order of the derivative in the strain energy: 1 for the elongation u′, 2 for the curvature v″."""

LOADS = (0, 1)
"""Powers of ξ in a distributed load along the element."""


@dataclass(frozen=True)
class Family:
    """Shape functions with one degree of freedom per pair (order of the derivative, ξ) in `freedoms`.

    `strain` is AXIAL or BENDING. Because x = Lξ, row i of every table must be multiplied by L^k if degree of
    freedom i is a derivative of order k.
    """

    name: str
    strain: int
    freedoms: tuple[tuple[int, sympy.Expr | int], ...]

    @cached_property
    def shape(self) -> Any:
        """Column N̂(ξ) of the shape functions, each 1 at its own degree of freedom and 0 at the others."""
        monomials: Any = sympy.Matrix([XI**power for power in range(len(self.freedoms))])
        values = [monomials.diff(XI, order).subs(XI, position).T for order, position in self.freedoms]
        return (sympy.Matrix.vstack(*values).T.inv() * monomials).applyfunc(sympy.expand)

    @property
    def mass(self) -> sympy.Matrix:
        """Integral ∫ N̂ N̂ᵀ dξ, to be multiplied by ρA L: Eq. (4.22) of the thesis."""
        return overlap(self.shape, self.shape)

    @property
    def stiffness(self) -> sympy.Matrix:
        """Integral ∫ B̂ B̂ᵀ dξ, to be multiplied by EA/L or EI/L³: Eq. (4.11) of the thesis."""
        return overlap(self.strains, self.strains)

    @property
    def geometric(self) -> sympy.Matrix:
        """Integral ∫ N̂′ N̂′ᵀ dξ, to be multiplied by the axial force (tension positive) and divided by L: Eq.
        (4.38) of the thesis."""
        slope = self.shape.diff(XI)
        return overlap(slope, slope)

    @property
    def strains(self) -> Any:
        """Column B̂(ξ) of the strains, one row per unit degree of freedom: u′ times L, or v″ times L²."""
        return self.shape.diff(XI, self.strain)

    @property
    def loads(self) -> sympy.Matrix:
        """Load vectors of distributed loads that vary as ξᵏ. Row k is ∫ N̂ᵀ ξᵏ dξ, to be multiplied by L and
        by the load per unit length."""
        return overlap(sympy.Matrix([XI**power for power in LOADS]), self.shape)


@dataclass(frozen=True)
class Element:
    """Plane beam element with one family of shape functions for the axial displacement and one for the
    transverse displacement."""

    name: str
    axial: Family
    bending: Family

    @property
    def coupling(self) -> sympy.Matrix:
        """Integral ∫ N̂u N̂vᵀ dξ of the axial and the transverse shape functions.

        Let X be this integral times ρA L. The matrix P = ∫ ρA Nᵀ S N dx, with S = [[0, −1], [1, 0]], has the
        off-diagonal blocks −X (upper right) and Xᵀ (lower left). Its products with functions of the angular
        velocity are the terms due to rotation: Eq. (4.22) of the thesis.
        """
        return overlap(self.axial.shape, self.bending.shape)


def overlap(left: sympy.Matrix, right: sympy.Matrix) -> sympy.Matrix:
    """Exact integral ∫₀¹ left rightᵀ dξ of two columns of polynomials in ξ."""
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


TITLE = "Beam elements of unit length"
FACTORS = """\
# ξ = x/L runs from 0 to 1. A freedom is (order, ξ): the derivative of this order with respect to x, at ξ.
# Row i and column i of every table have the factor L to the power of the order of freedom i. The tables have
# the further factors ρA L (mass); EA/L for strain 1 or EI/L³ for strain 2 (stiffness); axial force/L, tension
# positive (geometric); L (loads[k], for a load per unit length that varies as ξᵏ); ρA L (coupling[i][j],
# axial freedom i and bending freedom j); 1/L for elongation u′ or 1/L² for curvature v″ (strains). Row i of
# shapes and strains contains the coefficients of 1, ξ, ξ², …."""


def beam_elements_text(source_sha256: str, command: str) -> str:
    """Source code of the generated module of element matrices.

    command: arguments of `python -m derive` that regenerate the module.
    """
    families = "".join(f'    "{family.name}": {_dict(_family(family))},\n' for family in FAMILIES)
    elements = "".join(f'    "{element.name}": {_dict(_element(element))},\n' for element in ELEMENTS)
    body = f"{FACTORS}\n\nFAMILIES = {{\n{families}}}\n\nELEMENTS = {{\n{elements}}}\n"
    return hashed_module(TITLE, command, source_sha256, body, imports="")


def _family(family: Family) -> dict[str, str]:
    tables = {
        "shapes": _coefficients(family.shape),
        "strains": _coefficients(family.strains),
        "mass": family.mass,
        "stiffness": family.stiffness,
        "loads": family.loads,
    }
    if family.strain == BENDING:
        tables["geometric"] = family.geometric
    texts = {name: _rows(table) for name, table in tables.items()}
    return {"strain": str(family.strain), "freedoms": _tuple(map(_tuple, family.freedoms)), **texts}


def _element(element: Element) -> dict[str, str]:
    names = {"axial": json.dumps(element.axial.name), "bending": json.dumps(element.bending.name)}
    return {**names, "coupling": _rows(element.coupling)}


def _coefficients(functions: sympy.Matrix) -> sympy.Matrix:
    """Matrix of the coefficients of polynomials in ξ: one row per polynomial, lowest power first."""
    rows = [sympy.Poly(function, XI).all_coeffs()[::-1] for function in functions]
    width = max(map(len, rows))
    return sympy.Matrix([row + [sympy.S.Zero] * (width - len(row)) for row in rows])


def _rows(table: sympy.Matrix) -> str:
    rows = "".join(f"    {_tuple(table.row(i))},\n" for i in range(table.rows))
    return f"(\n{rows})"


def _tuple(entries) -> str:
    texts = [str(entry) for entry in entries]
    return f"({', '.join(texts)}{',' if len(texts) == 1 else ''})"


def _dict(entries: dict[str, str]) -> str:
    margin = "    "
    lines = [f'{margin}    "{name}": {text},' for name, text in entries.items()]
    text = "\n".join(line.replace("\n", f"\n{margin}    ") for line in lines)
    return f"{{\n{text}\n{margin}}}"
