"""The text of the generated module of beam elements: tables of rationals, no code."""

import json

import sympy

from derive.beam import BENDING, ELEMENTS, FAMILIES, XI, Element, Family
from derive.freshness import hashed_module

TITLE = "Beam elements of unit length"
FACTORS = """\
# ξ = x/L runs from 0 to 1. A freedom is (order, ξ): the derivative of that order by x at that place.
# Row i and column i of every table carry L to the power of freedom i's order, and tables these factors:
# mass ρA L; stiffness EA/L (strain 1) or EI/L³ (strain 2); geometric axial force/L, tension positive;
# loads[k] L, for a load per length that varies as ξᵏ; coupling[i][j] ρA L, axial freedom i by bending
# freedom j; strains 1/L (elongation u′) or 1/L² (curvature v″), where row i of shapes and strains holds
# the coefficients of 1, ξ, ξ², …."""


def beam_elements_text(source_sha256: str, command: str) -> str:
    """Whole text of the generated module; `command` is what renews it, after `python -m derive`."""
    families = "".join(f'    "{family.name}": {_dict(_family(family), 4)},\n' for family in FAMILIES)
    elements = "".join(f'    "{element.name}": {_dict(_element(element), 4)},\n' for element in ELEMENTS)
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
    """A row for each polynomial in ξ: its coefficients, lowest power first."""
    rows = [sympy.Poly(each, XI).all_coeffs()[::-1] for each in functions]
    width = max(map(len, rows))
    return sympy.Matrix([row + [sympy.S.Zero] * (width - len(row)) for row in rows])


def _rows(table: sympy.Matrix) -> str:
    rows = "".join(f"    {_tuple(table.row(i))},\n" for i in range(table.rows))
    return f"(\n{rows})"


def _tuple(entries) -> str:
    texts = [str(entry) for entry in entries]
    return f"({', '.join(texts)}{',' if len(texts) == 1 else ''})"


def _dict(entries: dict[str, str], indent: int) -> str:
    margin = " " * indent
    lines = [f'{margin}    "{name}": {text},' for name, text in entries.items()]
    text = "\n".join(line.replace("\n", f"\n{margin}    ") for line in lines)
    return f"{{\n{text}\n{margin}}}"
