"""Beam elements: their local matrices from the generated tables, the links that they make up, and the
freedoms that they share."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial import polynomial

from solve.arrays import Array
from solve.beams import dynamic_stiffness as exact
from solve.model.generated import beam_elements

AXIAL, BENDING = 1, 2
"""Order of the derivative that the strain energy holds; it names the direction of a freedom."""

EXACT = "dynamic"
"""The element whose shape functions solve the equation of vibration; its freedoms are the cubic one's."""


class Freedom(NamedTuple):
    """The derivative of order `order` of the axial or transverse displacement at ξ = x/L."""

    direction: int
    order: int
    xi: float


@dataclass(frozen=True)
class Element:
    """A plane beam element: axial freedoms first, then those of bending, k together.

    mass, elongation, bending, geometric and coupling are (k, k) for unit length; coefficients (k, p) of
    the shape functions are those of 1, ξ, ξ², ….
    """

    name: str
    freedoms: tuple[Freedom, ...]
    unit_mass: Array
    unit_elongation: Array
    unit_bending: Array
    unit_geometric: Array
    unit_coupling: Array
    coefficients: Array

    def mass(self, L: float, mu: float) -> Array:
        """Mass matrix for derivatives by x (kg, kg m, …): thesis (4.22)."""
        return mu * L * self._scaled(self.unit_mass, L)

    def stiffness(self, L: float, EA: float, EI: float) -> Array:
        """Stiffness matrix for derivatives by x (N/m, N, …): thesis (4.11)."""
        return EA / L * self.unit_elongation + EI / L**3 * self._scaled(self.unit_bending, L)

    def geometric(self, L: float) -> Array:
        """Stiffness by a unit axial force, tension positive (1/m, 1, …): thesis (4.38)."""
        return self._scaled(self.unit_geometric, L) / L

    def coupling(self, L: float, mu: float) -> Array:
        """Skew P = ∫ ρA Nᵀ S N dx, S = [[0, −1], [1, 0]]: how rotation couples both displacements."""
        return mu * L * self._scaled(self.unit_coupling, L)

    def strains(self, L: float, xi: Array) -> tuple[Array, Array]:
        """Elongation u′ and curvature v″ (points, k) at ξ for each unit freedom."""
        axial = np.array([each.direction == AXIAL for each in self.freedoms])
        return self._derivative(L, xi, AXIAL) * axial, self._derivative(L, xi, BENDING) * ~axial

    def displacement(self, L: float, xi: Array) -> tuple[Array, Array]:
        """Axial and transverse displacement (points, k) at ξ for each unit freedom."""
        shapes = self._derivative(L, xi, 0)
        axial = np.array([each.direction == AXIAL for each in self.freedoms])
        return shapes * axial, shapes * ~axial

    def rotation(self, L: float, xi: Array) -> Array:
        """Rotation v′ (points, k) of the axis at ξ for each unit freedom."""
        bending = np.array([each.direction == BENDING for each in self.freedoms])
        return self._derivative(L, xi, 1) * bending

    def _derivative(self, L: float, xi: Array, order: int) -> Array:
        """Derivative by x of the shape functions (points, k) at ξ."""
        coefficients = polynomial.polyder(self.coefficients, order, axis=1)
        powers = xi[:, None] ** np.arange(coefficients.shape[1])
        return powers @ coefficients.T * self._powers(L) / L**order

    def _scaled(self, table: Array, L: float) -> Array:
        return table * np.multiply.outer(self._powers(L), self._powers(L))

    def _powers(self, L: float) -> Array:
        return L ** np.array([each.order for each in self.freedoms], dtype=float)


@lru_cache
def element(name: str) -> Element:
    """The element of a name that the generated tables know; the exact one has the cubic's freedoms."""
    tables = beam_elements()
    stated = tables.ELEMENTS["cubic" if name == EXACT else name]
    families = [tables.FAMILIES[stated[direction]] for direction in ("axial", "bending")]
    freedoms = tuple(
        Freedom(family["strain"], order, xi) for family in families for order, xi in family["freedoms"]
    )
    axial, bending = (
        {name: np.array(family[name], dtype=float) for name in ("mass", "stiffness", "shapes")}
        for family in families
    )
    none_axial, none_bending = (np.zeros_like(each["mass"]) for each in (axial, bending))
    return Element(
        name,
        freedoms,
        _diagonal(axial["mass"], bending["mass"]),
        _diagonal(axial["stiffness"], none_bending),
        _diagonal(none_axial, bending["stiffness"]),
        _diagonal(none_axial, np.array(families[1]["geometric"], dtype=float)),
        _skew(np.array(stated["coupling"], dtype=float)),
        _stacked(axial["shapes"], bending["shapes"]),
    )


def _diagonal(first: Array, second: Array) -> Array:
    """Two square blocks on the diagonal."""
    k = len(first)
    whole = np.zeros((k + len(second),) * 2)
    whole[:k, :k], whole[k:, k:] = first, second
    return whole


def _skew(X: Array) -> Array:
    """[[0, −X], [Xᵀ, 0]] for X (axial, bending)."""
    a, b = X.shape
    return np.block([[np.zeros((a, a)), -X], [X.T, np.zeros((b, b))]])


def _stacked(first: Array, second: Array) -> Array:
    """Rows of both, filled up with zeros to the same length."""
    width = max(first.shape[1], second.shape[1])
    return np.vstack([np.pad(rows, ((0, 0), (0, width - rows.shape[1]))) for rows in (first, second)])


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


@dataclass(frozen=True)
class Member:
    """A link with its elements: how many, how long each (m), EA (N), EI (N m²), mu (kg/m)."""

    link: Link
    count: int
    L: float
    EA: float
    EI: float
    mu: float

    def bending_number(self, omega: Array) -> Array:
        """λL of an element at ω (rad/s): thesis (5.4)."""
        return self.L * (self.mu / self.EI) ** 0.25 * np.sqrt(omega)

    def axial_number(self, omega: Array) -> Array:
        """βL of an element at ω (rad/s): thesis (5.9)."""
        return self.L * np.sqrt(self.mu / self.EA) * omega

    def exact_weights(self, omega: Array) -> Array:
        """EI F1 … EI F6, EA F7, EA F8 at ω (b,): (b, 8)."""
        bending = exact.bending(self.bending_number(omega)) * self.EI / self.L**exact.BENDING_POWERS
        axial = np.zeros((len(omega), 2))
        if not self.link.inextensible:
            axial = exact.axial(self.axial_number(omega)) * self.EA / self.L
        return np.concatenate((bending, axial), axis=1)

    def exact_mass_weights(self, omega: Array) -> Array:
        """ρA G1 … ρA G6, and EA G7, EA G8 of thesis (5.19), at ω (b,): (b, 8)."""
        bending = (
            exact.bending_mass(self.bending_number(omega)) * self.mu * self.L ** (4.0 - exact.BENDING_POWERS)
        )
        axial = np.zeros((len(omega), 2))
        if not self.link.inextensible:
            axial = exact.axial_mass(self.axial_number(omega)) * self.mu * self.L
        return np.concatenate((bending, axial), axis=1)

    def exact_shapes(self, omega: Array | float, xi: Array, order: int = 0) -> tuple[Array, Array]:
        """Axial and transverse displacement (..., points, 6) at ξ of an element that vibrates at ω (...), for
        its unit freedoms, or their derivatives of an order by x."""
        at = np.asarray(omega, dtype=float)
        scale = np.array([1.0, self.L, 1.0, self.L])
        axial, transverse = np.zeros((2, *at.shape, len(xi), 6))
        b = np.zeros_like(at) if self.link.inextensible else self.axial_number(at)
        axial[..., :2] = exact.axial_shapes(b, xi, order)
        transverse[..., 2:] = exact.bending_shapes(self.bending_number(at), xi, order) * scale
        return axial / self.L**order, transverse / self.L**order

    def interior_count(self, omega: Array) -> Array:
        """Frequencies below ω (b,) of the elements with their ends clamped: J0 of thesis (5.21)."""
        axial = None if self.link.inextensible else self.axial_number(omega)
        return self.count * exact.interior_count(self.bending_number(omega), axial)
