"""The text of the module that is generated from a structure: its links and joints as data, and a
function of the properties that the numerical assembly needs."""

import sympy

from derive.emit import TOOLS, condition_functions, constants, functions_text, literal
from derive.freshness import banner, seal
from derive.function_text import Generated
from derive.structure import ELEMENT_NAMES, Structure

MOST_ELEMENTS = 100

DATA = """\
# A link: name, first joint, last joint, the freedoms by which its two ends turn ("" where clamped,
# shared where welded), whether it is inextensible. A joint: name, whether its place is held."""
DOCUMENTATION = """\
Columns of links (angle from x, length, E, EA, EI, mass mu per length, height), of joints (mass),
and the damping ratio of every mode."""


def structure_text(structure: Structure, source_sha256: str, derive_sha256: str, command: str) -> str:
    """Whole text of the generated module; `command` is what renews it, after `python -m derive`."""
    texts, counts = functions_text(structure, [_properties(structure), *condition_functions(structure)])
    parts = [
        constants(structure, [], {"properties": counts["properties"]}),
        _data(structure),
        *(tool for call, tool in TOOLS.items() if any(call in text for text in texts)),
        *texts,
    ]
    head = banner(structure.title, command)
    body = "\n\n\n".join(parts) + "\n"
    return seal(head, source_sha256, derive_sha256, sympy.__version__, body)


def _properties(structure: Structure) -> Generated:
    columns: dict[str, list[sympy.Expr]] = {}
    for link in structure.declared_links:
        for name, (expression, _) in link.properties.items():
            columns.setdefault(name, []).append(expression)
    columns["mass"] = [structure.mass_at(joint) for joint in structure.joints]
    columns["damping_ratio"] = [sympy.sympify(structure.damping_ratio)]
    results = {name: sympy.Matrix(column) for name, column in columns.items()}
    return Generated("properties", DOCUMENTATION, ("phase", "p"), results)


def _data(structure: Structure) -> str:
    links = [
        (
            *(link.name, link.start, link.end),
            *(structure.rotation(link, joint) for joint in (link.start, link.end)),
            link.inextensible,
        )
        for link in structure.declared_links
    ]
    joints = [(joint, joint in structure.held) for joint in structure.joints]
    options = [
        ("elements", range(1, MOST_ELEMENTS + 1), 1),
        ("element", ELEMENT_NAMES, ELEMENT_NAMES[0]),
    ]
    return "\n".join(
        [
            DATA,
            "LINKS = (",
            *(f"    {literal(link)}," for link in links),
            ")",
            "JOINTS = (",
            *(f"    {literal(joint)}," for joint in joints),
            ")",
            "# Options for all links or link by link.",
            "LINK_OPTIONS = (",
            *(f"    {literal(option)}," for option in options),
            ")",
            f"MOVES = {structure.moves}",
        ]
    )
