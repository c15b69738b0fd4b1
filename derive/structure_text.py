"""The text of the module that is generated from a structure: its links and joints as data, and a
function of the properties that the numerical assembly needs."""

from collections.abc import Sequence

import sympy

from derive.emit import (
    TOOLS,
    condition_functions,
    constants,
    equations_text,
    functions_text,
    literal,
    sketch_functions,
)
from derive.freshness import hashed_module
from derive.function_text import GeneratedFunction, tuple_lines
from derive.reading import links
from derive.structure import ELEMENT_NAMES, StructureStatement
from derive.structure_outputs import Observed, observed

MOST_ELEMENTS = 100

DATA = """\
# A link: name, first joint, last joint, the freedoms by which its two ends turn ("" where clamped,
# shared where welded), whether it is inextensible. A joint: name, whether its place is held. Springs and
# dashpots to the ground: the freedoms on which they act."""
MOTION = """\
# Whether Coriolis, normal and tangential accelerations of the displacements count; whether axial forces
# stiffen; whether ζ is every mode's at every position, or that of the lowest two on average."""
MOTION_OPTIONS = (
    ("terms", ("instantaneous", "full"), "instantaneous"),
    ("stiffening", ("off", "on"), "off"),
    ("damping", ("modal", "rayleigh"), "modal"),
)
OBSERVED = """\
# What each of OUTPUTS is: its kind, and the link and place on it, from 0 at its start to 1."""
DOCUMENTATION = """\
Columns of links (angle from x, length, E, EA, EI, mass mu per length, height), of joints (mass), of
springs and dashpots where there are any, and the damping ratio of every mode."""


def structure_text(structure: StructureStatement, source_sha256: str, command: str) -> str:
    """Whole text of the generated module; `command` is what renews it, after `python -m derive`."""
    texts, counts = functions_text(
        structure,
        [
            _properties(structure),
            *sketch_functions(structure),
            *condition_functions(structure.conditions),
        ],
    )
    of_interest = observed(structure)
    parts = [
        constants(
            structure,
            [each.output for each in of_interest],
            {"properties": counts["properties"]},
            structure.conditions,
        ),
        _data(structure, of_interest),
        *(tool for call, tool in TOOLS.items() if any(call in text for text in texts)),
        *texts,
        equations_text(links(structure)),
    ]
    return hashed_module(structure.title, command, source_sha256, "\n\n\n".join(parts) + "\n")


def _properties(structure: StructureStatement) -> GeneratedFunction:
    columns: dict[str, list[sympy.Expr]] = {}
    for link in structure.declared_links:
        for name, (expression, _) in link.properties.items():
            columns.setdefault(name, []).append(expression)
    columns["mass"] = [structure.mass_at(joint) for joint in structure.joints]
    columns["damping_ratio"] = [*(structure.damping_ratios or (sympy.S.Zero,))]
    for name, elastic in _elastic(structure):
        columns[name] = [*elastic.values()]
    results = {name: sympy.Matrix(column) for name, column in columns.items()}
    return GeneratedFunction("properties", DOCUMENTATION, ("phase", "p"), results)


def _elastic(structure: StructureStatement) -> list[tuple[str, dict[str, sympy.Expr]]]:
    """Springs and dashpots to the ground, if there are any."""
    declared = {"spring": structure.declared_springs, "dashpot": structure.declared_dashpots}
    found = {name: structure.to_ground(each) for name, each in declared.items()}
    return [(name, elastic) for name, elastic in found.items() if elastic]


def _data(structure: StructureStatement, of_interest: list[Observed]) -> str:
    links = [
        (
            *(link.name, link.start, link.end),
            *(structure.rotation(link, joint) for joint in (link.start, link.end)),
            link.inextensible,
        )
        for link in structure.declared_links
    ]
    joints = [(joint, joint in structure.supported) for joint in structure.joints]
    options = [
        ("elements", range(1, MOST_ELEMENTS + 1), 1),
        ("element", ELEMENT_NAMES, ELEMENT_NAMES[0]),
    ]
    return "\n".join(
        [
            DATA,
            *_rows("LINKS", links),
            *_rows("JOINTS", joints),
            *(f"{name.upper()}S = {literal(tuple(elastic))}" for name, elastic in _elastic(structure)),
            "# Options for all links or link by link.",
            *_rows("LINK_OPTIONS", options),
            MOTION,
            *_rows("MOTION_OPTIONS", MOTION_OPTIONS if structure.moves else ()),
            OBSERVED,
            *_rows("OBSERVED", [(each.kind, each.link, each.place) for each in of_interest]),
            f"MOVES = {structure.moves}",
        ]
    )


def _rows(name: str, rows: Sequence[tuple]) -> list[str]:
    return tuple_lines(name, [*map(literal, rows)])
