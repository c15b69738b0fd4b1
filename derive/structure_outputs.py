"""What is of interest in a structure whose links move: deflections, stresses, joint forces, energy."""

from collections.abc import Iterator
from itertools import product
from typing import NamedTuple

from derive.declarations import Output
from derive.structure import Link, StructureStatement


class Observed(NamedTuple):
    """An output, its kind, and the place of a link to which it belongs, from 0 at its start to 1."""

    output: Output
    kind: str
    link: str
    place: float


def observed(structure: StructureStatement) -> list[Observed]:
    """Of each link the stresses at its middle, and its deflection there; of one that is clamped at one end
    the tip's deflection instead, and the root's stresses too; what the joints bear; the strain energy of all
    links. Nothing of a structure at rest."""
    if not structure.moves:
        return []
    energy = Output("strain_energy", None, "J", "strain energy of all links")
    return [
        *(each for link in structure.declared_links for each in _of_link(structure, link)),
        *(each for joint in structure.joints for each in _of_joint(structure, joint)),
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
    """The force on the last of the links that meet there, and the moment of a clamp."""
    links = [each for each in structure.declared_links if joint in (each.start, each.end)]
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
