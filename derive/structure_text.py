"""Source code of the module that is generated from a structure: links, joints and outputs as data."""

from collections.abc import Callable, Iterator, Sequence
from itertools import product
from typing import NamedTuple

import sympy

from derive.constants import constants, literal
from derive.declarations import Output
from derive.emit import (
    TOOLS,
    condition_functions,
    equations_text,
    functions_text,
    module_text,
    sketch_functions,
)
from derive.freshness import hashed_module
from derive.function_text import GeneratedFunction, tuple_lines
from derive.mechanism import MechanismStatement
from derive.reading import links
from derive.structure import ELEMENT_NAMES, Link, StructureStatement


class Observed(NamedTuple):
    """Output with its kind, its link, and the position on the link, from 0 at the start to 1 at the end."""

    output: Output
    kind: str
    link: str
    place: float


def observed(structure: StructureStatement) -> list[Observed]:
    """Outputs of a moving structure; empty for a structure at rest.

    The outputs are stresses and the deflection at the midpoint of each link, the joint forces, and the strain
    energy of all links. For a link with one clamped end, the deflection is that of the other end, and
    stresses at the clamped end are added.
    """
    if not structure.moves:
        return []
    energy = Output("strain_energy", None, "J", "strain energy of all links")
    return [
        *(output for link in structure.declared_links for output in _of_link(structure, link)),
        *(output for joint in structure.joints for output in _of_joint(structure, joint)),
        Observed(energy, "strain_energy", "", 0.0),
    ]


def _of_link(structure: StructureStatement, link: Link) -> Iterator[Observed]:
    clamped = [structure.rotation(link, joint) == "" for joint in (link.start, link.end)]
    ends = clamped[0] != clamped[1]
    place, deflected = ("tip", float(clamped[0])) if ends else ("midpoint", 0.5)
    meaning = f"transverse deflection of the {link.name}'s {place} from its rigid motion"
    deflection = Output(f"{link.name}_{place}_deflection", None, "m", meaning)
    yield Observed(deflection, "deflection", link.name, deflected)
    strained = {"root": float(clamped[1])} if ends else {}
    for place, surface in product((*strained, "midpoint"), ("plus", "minus")):
        meaning = f"axial stress at the {link.name}'s {place}, {surface} surface"
        stress = Output(f"{link.name}_{place}_stress_{surface}", None, "Pa", meaning)
        yield Observed(stress, f"stress_{surface}", link.name, strained.get(place, 0.5))


def _of_joint(structure: StructureStatement, joint: str) -> Iterator[Observed]:
    """Outputs of a joint: the force on its last link, and the moment of a clamp."""
    links = [link for link in structure.declared_links if joint in (link.start, link.end)]
    link = links[-1]
    place = float(joint == link.end)
    springs = structure.to_ground(structure.declared_springs)
    if joint in structure.supported or len(links) > 1 or {f"{joint}_x", f"{joint}_y"} & {*springs}:
        for axis in "xy":
            meaning = f"force of joint {joint} on the {link.name}, along {axis}"
            force = Output(f"{joint}_force_{axis}", None, "N", meaning)
            yield Observed(force, f"force_{axis}", link.name, place)
    turn = structure.rotation(link, joint)
    if turn == "" or f"{turn}_turn" in springs:
        meaning = f"moment of joint {joint} on the {link.name}"
        moment = Output(f"{joint}_moment", None, "N m", meaning)
        yield Observed(moment, "moment", link.name, place)


MOST_ELEMENTS = 100

DATA = """\
# A link: name, first joint, last joint, names of the rotations of its two ends ("" if clamped, the same name
# if welded), whether it is inextensible. A joint: name, whether its position is fixed. SPRINGS and DASHPOTS,
# if there are any: degrees of freedom on which springs and dashpots to the ground act."""
MOTION = """\
# terms: whether Coriolis, centripetal and tangential accelerations of the displacements are included.
# stiffening: whether axial forces change the stiffness. damping: whether ζ applies to every mode at every
# position, or on average to the two lowest modes."""
MOTION_OPTIONS = (
    ("terms", ("instantaneous", "full"), "instantaneous"),
    ("stiffening", ("off", "on"), "off"),
    ("damping", ("modal", "rayleigh"), "modal"),
)
OBSERVED = """\
# Kind of each entry of OUTPUTS, its link, and its position on the link, from 0 at the start to 1 at the
# end."""
DOCUMENTATION = """\
Columns with one row per link (angle from x, length, E, EA, EI, mass mu per unit length, height), per joint
(mass), and per spring and dashpot if there are any; and the damping ratio of all modes."""


def generated_text(
    mechanism: MechanismStatement,
    source_sha256: str,
    command: str,
    report: Callable[[str], object] = lambda _: None,
) -> str:
    """Source code of the generated module of a mechanism or a structure; see `module_text`."""
    if isinstance(mechanism, StructureStatement):
        return structure_text(mechanism, source_sha256, command)
    return module_text(mechanism, source_sha256, command, report)


def structure_text(structure: StructureStatement, source_sha256: str, command: str) -> str:
    """Source code of the generated module of a structure.

    command: arguments of `python -m derive` that regenerate the module.
    """
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
            [entry.output for entry in of_interest],
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
    """Pairs of "spring" or "dashpot" and the mapping from degrees of freedom to coefficients."""
    declared = {"spring": structure.declared_springs, "dashpot": structure.declared_dashpots}
    by_kind = {name: structure.to_ground(declared_for) for name, declared_for in declared.items()}
    return [(name, elastic) for name, elastic in by_kind.items() if elastic]


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
            "# Options that may be given for all links together or for each link.",
            *_rows("LINK_OPTIONS", options),
            MOTION,
            *_rows("MOTION_OPTIONS", MOTION_OPTIONS if structure.moves else ()),
            OBSERVED,
            *_rows("OBSERVED", [(entry.kind, entry.link, entry.place) for entry in of_interest]),
            f"MOVES = {structure.moves}",
        ]
    )


def _rows(name: str, rows: Sequence[tuple]) -> list[str]:
    return tuple_lines(name, [*map(literal, rows)])
