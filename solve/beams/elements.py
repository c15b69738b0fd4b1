"""Beam elements: their local matrices from the generated tables, the links that they make up, and the
freedoms that they share."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.polynomial import polynomial

from solve.arrays import Array
from solve.beams import dynamic_stiffness as exact
from solve.model.generated import beam_elements

AXIAL, BENDING = 1, 2
"""Order of the derivative that the strain energy holds; it names the direction of a freedom."""

Function = Callable[[Array], Array]

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
    mass: Array
    elongation: Array
    bending: Array
    geometric: Array
    coupling: Array
    coefficients: Array

    @cached_property
    def axial(self) -> Array:
        """Which of the freedoms are axial (k,)."""
        return np.array([each.direction == AXIAL for each in self.freedoms])

    @cached_property
    def axes(self) -> Array:
        """Parts (3, k, k) with 1, c and s of the rotation R from ground axes to the link's (thesis (4.26)).

        Translations in ground axes stand in the places of the link's: x for u, y for v.
        """
        parts = np.zeros((3, len(self.freedoms), len(self.freedoms)))
        for (i, one), (j, other) in product(enumerate(self.freedoms), repeat=2):
            if one.order > 0:
                parts[0, i, i] = 1.0
            elif i == j:
                parts[1, i, i] = 1.0
            elif (one.xi, 0) == (other.xi, other.order):
                parts[2, i, j] = 1.0 if one.direction == AXIAL else -1.0
        return parts

    def scaled(self, table: Array, L: float) -> Array:
        """A table (k, k) for freedoms that are derivatives by ξ as one for derivatives by x."""
        return table * np.multiply.outer(self._powers(L), self._powers(L))

    def shapes(self, L: float, xi: Array, order: int = 0) -> tuple[Array, Array]:
        """Axial and transverse displacement (points, k) at ξ for each unit freedom, or their derivatives of
        an order by x."""
        coefficients = polynomial.polyder(self.coefficients, order, axis=1)
        powers = xi[:, None] ** np.arange(coefficients.shape[1])
        shapes = powers @ coefficients.T * self._powers(L) / L**order
        return shapes * self.axial, shapes * ~self.axial

    def _powers(self, L: float) -> Array:
        return L ** np.array([each.order for each in self.freedoms], dtype=float)


@lru_cache
def element(name: str) -> Element:
    """The element of a name that the generated tables know; the exact one has the cubic's freedoms."""
    tables = beam_elements()
    stated = tables.ELEMENTS["cubic" if name == EXACT else name]
    axial, bending = families = [tables.FAMILIES[stated[direction]] for direction in ("axial", "bending")]
    freedoms = tuple(
        Freedom(family["strain"], order, xi) for family in families for order, xi in family["freedoms"]
    )
    k, split = len(freedoms), len(axial["freedoms"])
    a, b = slice(0, split), slice(split, k)
    coupling = _filled((k, k), (a, b, stated["coupling"]))
    terms = [len(family["shapes"][0]) for family in families]
    return Element(
        name,
        freedoms,
        mass=_filled((k, k), (a, a, axial["mass"]), (b, b, bending["mass"])),
        elongation=_filled((k, k), (a, a, axial["stiffness"])),
        bending=_filled((k, k), (b, b, bending["stiffness"])),
        geometric=_filled((k, k), (b, b, bending["geometric"])),
        coupling=coupling.T - coupling,
        coefficients=_filled(
            (k, max(terms)), (a, slice(terms[0]), axial["shapes"]), (b, slice(terms[1]), bending["shapes"])
        ),
    )


def _filled(shape: tuple[int, int], *blocks: tuple[slice, slice, Sequence]) -> Array:
    """Zeros with blocks of rows, columns and values."""
    whole = np.zeros(shape)
    for rows, columns, values in blocks:
        whole[rows, columns] = values
    return whole


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
    and vanish where the end is alone on its pin. springs, dashpots: freedoms between which and the ground
    there are some.
    """

    links: tuple[Link, ...]
    joints: tuple[tuple[str, bool], ...]
    kinds: tuple[str, ...]
    counts: tuple[int, ...]
    springs: tuple[str, ...] = ()
    dashpots: tuple[str, ...] = ()

    @property
    def anchored(self) -> set[str]:
        """Joints whose place is held, rigidly or elastically."""
        elastic = {*self.springs, *self.dashpots}
        return {name for name, held in self.joints if held or {f"{name}_x", f"{name}_y"} & elastic}

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
        nodes: list[dict[float, list[int]]] = [{} for _ in self.links]
        for own, each, count, rows in zip(nodes, self.elements, self.counts, self.indices, strict=True):
            for (first, row), (i, freedom) in product(enumerate(rows), enumerate(each.freedoms)):
                if freedom.order == 0:
                    node = own.setdefault((first + freedom.xi) / count, [HELD, HELD])
                    node[freedom.direction == BENDING] = row[i]
        return [[Node(place, *own[place]) for place in sorted(own)] for own in nodes]

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
            return "" if dict(self.joints)[joint] else f"{joint}_{what}"
        if order == 1:
            return f"{rotation}_{what}" if rotation else ""
        bears = f"{rotation}_turn" in (*self.springs, *self.dashpots)
        return "" if self.alone(rotation) and not bears else f"{link.name}_{joint}_{what}"

    def alone(self, rotation: str) -> bool:
        """Whether a link's end turns freely by itself, so that it bears no moment."""
        ends = [name for link in self.links for name in (link.start_rotation, link.end_rotation)]
        return bool(rotation) and ends.count(rotation) == 1


@dataclass(frozen=True)
class Member:
    """The link of a number with its elements: how many, their freedoms (elements, k) in the structure, the
    numbers of its joints, and of each element L (m), EA (N), EI (N m²), mu (kg/m); E (Pa), height (m)."""

    number: int
    link: Link
    start: int
    end: int
    element: Element
    indices: Array
    count: int
    L: float
    E: float
    EA: float
    EI: float
    mu: float
    height: float

    @property
    def exact(self) -> bool:
        """Whether its elements are exact."""
        return self.element.name == EXACT

    @cached_property
    def mass(self) -> Array:
        """Mass matrix for derivatives by x (kg, kg m, …): thesis (4.22)."""
        return self.mu * self.L * self.element.scaled(self.element.mass, self.L)

    @cached_property
    def stiffness(self) -> Array:
        """Stiffness matrix for derivatives by x (N/m, N, …): thesis (4.11)."""
        bending = self.element.scaled(self.element.bending, self.L)
        return self.EA / self.L * self.element.elongation + self.EI / self.L**3 * bending

    @cached_property
    def geometric(self) -> Array:
        """Stiffness by a unit axial force, tension positive (1/m, 1, …): thesis (4.38)."""
        return self.element.scaled(self.element.geometric, self.L) / self.L

    @cached_property
    def rotary(self) -> tuple[Array, Array]:
        """M J + P and M J² + 2 P J − M, with R′ = J R and the skew P = ∫ ρA Nᵀ S N dx, S = [[0, −1], [1, 0]]:
        how rotation couples both displacements."""
        M, J = self.mass, self.element.axes[2]
        P = self.mu * self.L * self.element.scaled(self.element.coupling, self.L)
        return M @ J + P, M @ J @ J + 2 * P @ J - M

    def rotations(self, angle: Array) -> Array:
        """R (m, k, k) from ground axes to the link's, for the angles (m, links) of all links."""
        own = angle[:, self.number]
        return np.tensordot(np.stack((np.ones_like(own), np.cos(own), np.sin(own)), -1), self.element.axes, 1)

    def local(self, angle: Array, q: Array, elements: slice = slice(None)) -> Array:
        """Values (m, elements, k) of the elements' freedoms in the axes of the link, for a structure's
        q (n, m) and the angles (m, links) of all links."""
        whole = np.concatenate((q.T, np.zeros((q.shape[1], 1))), axis=1)
        ground, own = whole[:, self.indices[elements]], angle[:, self.number, None, None]
        # One product for all phases; products with the rotations of each phase take three times as long.
        k = ground.shape[-1]
        still, c, s = (ground.reshape(-1, k) @ each.T for each in self.element.axes)
        still, c, s = (each.reshape(ground.shape) for each in (still, c, s))
        return still + np.cos(own) * c + np.sin(own) * s

    def place(self, fraction: float) -> tuple[int, float]:
        """The element at a fraction of the link's length, and ξ there. Between two elements it belongs to
        the one that begins there."""
        first = min(int(fraction * self.count), self.count - 1)
        return first, fraction * self.count - first

    def shapes(self, xi: Array, order: int = 0, omega: Array | float | None = None) -> tuple[Array, Array]:
        """Axial and transverse displacement (..., points, k) at ξ for the unit freedoms of an element, or
        their derivatives of an order by x. Exact elements vibrate at ω (...) in rad/s."""
        if not self.exact:
            return self.element.shapes(self.L, xi, order)
        at = np.asarray(omega, dtype=float)
        axial, transverse = np.zeros((2, *at.shape, len(xi), 6))
        b = np.zeros_like(at) if self.link.inextensible else self._axial_number(at)
        axial[..., :2] = exact.axial_shapes(b, xi, order)
        scale = np.array([1.0, self.L, 1.0, self.L])
        transverse[..., 2:] = exact.bending_shapes(self._bending_number(at), xi, order) * scale
        return axial / self.L**order, transverse / self.L**order

    def stresses(self, xi: Array, omega: Array | None = None) -> tuple[Array, Array]:
        """E u′ and −E (h/2) v″ (..., points, k) in Pa for the same unit freedoms: the axial stress, and that
        of bending at the + surface."""
        elongation, curvature = self.shapes(xi, 1, omega)[0], self.shapes(xi, 2, omega)[1]
        return self.E * elongation, -self.E * self.height / 2 * curvature

    def exact_stiffness(self, omega: Array) -> Array:
        """EI F1 … EI F6, EA F7, EA F8 at ω (b,): (b, 8)."""
        return self._functions(omega, exact.bending, exact.axial, self.EI, self.EA / self.L)

    def exact_mass(self, omega: Array) -> Array:
        """ρA G1 … ρA G6, and EA G7, EA G8 of thesis (5.19), at ω (b,): (b, 8)."""
        mass = self.mu * self.L
        return self._functions(omega, exact.bending_mass, exact.axial_mass, mass * self.L**3, mass)

    def _functions(
        self, omega: Array, bending: Function, axial: Function, bending_unit: float, axial_unit: float
    ) -> Array:
        weights = np.zeros((len(omega), 8))
        weights[:, :6] = bending(self._bending_number(omega)) * bending_unit / self.L**exact.BENDING_POWERS
        if not self.link.inextensible:
            weights[:, 6:] = axial(self._axial_number(omega)) * axial_unit
        return weights

    def interior_count(self, omega: Array) -> Array:
        """Frequencies below ω (b,) of the elements with their ends clamped: J0 of thesis (5.21)."""
        axial = None if self.link.inextensible else self._axial_number(omega)
        return self.count * exact.interior_count(self._bending_number(omega), axial)

    def _bending_number(self, omega: Array) -> Array:
        """λL of an element at ω (rad/s): thesis (5.4)."""
        return self.L * (self.mu / self.EI) ** 0.25 * np.sqrt(omega)

    def _axial_number(self, omega: Array) -> Array:
        """βL of an element at ω (rad/s): thesis (5.9)."""
        return self.L * np.sqrt(self.mu / self.EA) * omega


def freedoms(
    links: Sequence[Sequence],
    joints: Sequence[tuple[str, bool]],
    kinds: Sequence[str],
    counts: Sequence[int],
    springs: Sequence[str] = (),
    dashpots: Sequence[str] = (),
) -> Freedoms:
    """Freedoms of the links and joints of a generated module."""
    rows = (tuple(Link(*each) for each in links), tuple(joints), tuple(kinds), tuple(counts))
    return Freedoms(*rows, tuple(springs), tuple(dashpots))
