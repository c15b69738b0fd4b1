"""Which freedoms a structure of beams has, and how its elements share them."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.beams.elements import AXIAL, Element, element

HELD = -1
"""Index of a freedom that is held at zero."""

_UNITS = {"x": "m", "y": "m", "turn": "rad", "curvature": "1/m"}


class Link(NamedTuple):
    """A straight beam: its joints, the freedoms by which its ends turn ("" where clamped), and whether
    it only bends."""

    name: str
    start: str
    end: str
    start_rotation: str
    end_rotation: str
    inextensible: bool


class Node(NamedTuple):
    """A place on a link, from 0 to 1, and the freedoms (x, y) by which it moves."""

    place: float
    x: int
    y: int


@dataclass(frozen=True)
class Freedoms:
    """Numbering of the freedoms for chosen elements; displacements are in ground axes.

    joints: name, and whether its place is held. kinds, counts: the element of each link and how many
    of them. Rotations belong to a link's end, or to several that are welded; curvatures to a link's end,
    and vanish where the end is alone on its pin.
    """

    links: tuple[Link, ...]
    joints: tuple[tuple[str, bool], ...]
    kinds: tuple[str, ...]
    counts: tuple[int, ...]

    @property
    def elements(self) -> list[Element]:
        """The element of each link."""
        return [element(kind) for kind in self.kinds]

    @property
    def names(self) -> list[str]:
        """Names of the freedoms, such as A_x, crank_A_turn, coupler_1_y (interior node 1)."""
        return list(self._numbers)

    @property
    def units(self) -> list[str]:
        """Units of the freedoms."""
        return [_UNITS[name.rpartition("_")[2]] for name in self.names]

    @property
    def n(self) -> int:
        """Number of freedoms."""
        return len(self._numbers)

    @cached_property
    def indices(self) -> list[Array]:
        """For each link the freedoms of its elements, (elements, k); HELD where there is none."""
        return [
            np.array([[self._numbers.get(name, HELD) for name in row] for row in rows])
            for rows in self._labels
        ]

    @cached_property
    def nodes(self) -> list[list[Node]]:
        """For each link its nodes from start to end."""
        return [self._nodes_of(number) for number in range(len(self.links))]

    @property
    def joint_indices(self) -> Array:
        """The freedoms x and y of the joints, (joints, 2)."""
        return np.array(
            [[self._numbers.get(f"{joint}_{axis}", HELD) for axis in "xy"] for joint, _ in self.joints]
        )

    @cached_property
    def _numbers(self) -> dict[str, int]:
        free = dict.fromkeys(name for rows in self._labels for row in rows for name in row if name)
        return {name: number for number, name in enumerate(free)}

    @cached_property
    def _labels(self) -> list[list[list[str]]]:
        """For each link and element the names of its freedoms, "" where held."""
        return [
            [[self._label(number, first, freedom) for freedom in each.freedoms] for first in range(count)]
            for number, (each, count) in enumerate(zip(self.elements, self.counts, strict=True))
        ]

    def _label(self, number: int, first: int, freedom: tuple[int, int, float]) -> str:
        link, count = self.links[number], self.counts[number]
        direction, order, xi = freedom
        place = first + xi
        what = ("x" if direction == AXIAL else "y") if order == 0 else ("turn", "curvature")[order - 1]
        if 0 < place < count:
            nodes_an_element = len({each.xi for each in self.elements[number].freedoms}) - 1
            return f"{link.name}_{round(place * nodes_an_element)}_{what}"
        joint, rotation = (link.start, link.start_rotation) if place == 0 else (link.end, link.end_rotation)
        if order == 0:
            return "" if joint in self._held else f"{joint}_{what}"
        if order == 1:
            return f"{rotation}_{what}" if rotation else ""
        return "" if self._alone(rotation) else f"{link.name}_{joint}_{what}"

    def _alone(self, rotation: str) -> bool:
        """Whether a link's end turns freely by itself, so that it bears no moment."""
        ends = [name for link in self.links for name in (link.start_rotation, link.end_rotation)]
        return bool(rotation) and ends.count(rotation) == 1

    @cached_property
    def _held(self) -> set[str]:
        return {joint for joint, held in self.joints if held}

    def _nodes_of(self, number: int) -> list[Node]:
        each, count = self.elements[number], self.counts[number]
        nodes = {}
        for first, row in enumerate(self.indices[number]):
            for xi in sorted({freedom.xi for freedom in each.freedoms}):
                x, y = (
                    next(
                        index
                        for index, freedom in zip(row, each.freedoms, strict=True)
                        if freedom.xi == xi and freedom.order == 0 and (freedom.direction == AXIAL) == axial
                    )
                    for axial in (True, False)
                )
                nodes[first + xi] = Node((first + xi) / count, x, y)
        return [nodes[place] for place in sorted(nodes)]


def freedoms(
    links: Sequence[Sequence], joints: Sequence[tuple[str, bool]], kinds: Sequence[str], counts: Sequence[int]
) -> Freedoms:
    """Freedoms of the links and joints of a generated module."""
    return Freedoms(tuple(Link(*each) for each in links), tuple(joints), tuple(kinds), tuple(counts))
