"""Links of beam elements, and their degrees of freedom."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.beams import dynamic_stiffness as exact
from solve.beams.element import AXIAL, BENDING, EXACT, Element, Function, element
from solve.contracts import DrawnLink

HELD = -1
"""Index that represents a degree of freedom fixed at zero."""

_UNITS = {"x": "m", "y": "m", "turn": "rad", "curvature": "1/m"}


class Link(NamedTuple):
    """Straight beam: names of its joints, names of the rotations of its ends ("" if clamped), and whether it
    is inextensible."""

    name: str
    start: str
    end: str
    start_rotation: str
    end_rotation: str
    inextensible: bool


class Node(NamedTuple):
    """Node at a fraction `place` of the length of a link, with the indices of its displacements x and y."""

    place: float
    x: int
    y: int


@dataclass(frozen=True)
class Freedoms:
    """Numbering of the degrees of freedom for the selected elements. Displacements are in ground axes.

    joints: name of each joint, and whether it is fixed. kinds, counts: kind and number of the elements of
    each link. springs, dashpots: degrees of freedom with a spring or dashpot to the ground. A rotation
    belongs to the end of a link, or to several welded ends. A curvature belongs to the end of a link, and is
    zero at a free pin."""

    links: tuple[Link, ...]
    joints: tuple[tuple[str, bool], ...]
    kinds: tuple[str, ...]
    counts: tuple[int, ...]
    springs: tuple[str, ...] = ()
    dashpots: tuple[str, ...] = ()

    @property
    def anchored(self) -> set[str]:
        """Names of the joints with a rigid or elastic support."""
        elastic = {*self.springs, *self.dashpots}
        return {name for name, is_held in self.joints if is_held or {f"{name}_x", f"{name}_y"} & elastic}

    @property
    def elements(self) -> list[Element]:
        """Element of each link."""
        return [element(kind) for kind in self.kinds]

    @property
    def names(self) -> list[str]:
        """Names of the degrees of freedom, for example A_x, crank_A_turn, or coupler_1_y (y of interior node
        1)."""
        return list(self._numbers)

    @property
    def units(self) -> list[str]:
        """Units of the degrees of freedom."""
        return [_UNITS[name.rpartition("_")[2]] for name in self.names]

    @property
    def n(self) -> int:
        """Number of degrees of freedom."""
        return len(self._numbers)

    @cached_property
    def indices(self) -> list[Array]:
        """For each link, the indices (elements, k) of the degrees of freedom of its elements; HELD if
        fixed."""
        return [
            np.array([[self._numbers.get(name, HELD) for name in row] for row in rows])
            for rows in self._labels
        ]

    @cached_property
    def nodes(self) -> list[list[Node]]:
        """Nodes of each link, from its start to its end."""
        nodes: list[dict[float, list[int]]] = [{} for _ in self.links]
        columns = nodes, self.elements, self.counts, self.indices
        for of_link, kind, count, rows in zip(*columns, strict=True):
            for (first, row), (i, freedom) in product(enumerate(rows), enumerate(kind.freedoms)):
                if freedom.order == 0:
                    node = of_link.setdefault((first + freedom.xi) / count, [HELD, HELD])
                    node[freedom.direction == BENDING] = row[i]
        return [[Node(place, *of_link[place]) for place in sorted(of_link)] for of_link in nodes]

    @property
    def joint_indices(self) -> Array:
        """Indices (joints, 2) of the displacements x and y of the joints."""
        return np.array(
            [[self._numbers.get(f"{joint}_{axis}", HELD) for axis in "xy"] for joint, _ in self.joints]
        )

    @cached_property
    def _numbers(self) -> dict[str, int]:
        free = dict.fromkeys(name for rows in self._labels for row in rows for name in row if name)
        return {name: number for number, name in enumerate(free)}

    @cached_property
    def _labels(self) -> list[list[list[str]]]:
        """Names of the degrees of freedom of each link and element; "" if fixed."""
        return [
            [[self._label(number, first, freedom) for freedom in kind.freedoms] for first in range(count)]
            for number, (kind, count) in enumerate(zip(self.elements, self.counts, strict=True))
        ]

    def _label(self, number: int, first: int, freedom: tuple[int, int, float]) -> str:
        link, count = self.links[number], self.counts[number]
        direction, order, xi = freedom
        place = first + xi
        suffix = ("x" if direction == AXIAL else "y") if order == 0 else ("turn", "curvature")[order - 1]
        if 0 < place < count:
            intervals = len({freedom.xi for freedom in self.elements[number].freedoms}) - 1
            return f"{link.name}_{round(place * intervals)}_{suffix}"
        joint, rotation = (link.start, link.start_rotation) if place == 0 else (link.end, link.end_rotation)
        if order == 0:
            return "" if dict(self.joints)[joint] else f"{joint}_{suffix}"
        if order == 1:
            return f"{rotation}_{suffix}" if rotation else ""
        carries_moment = f"{rotation}_turn" in (*self.springs, *self.dashpots)
        free_pin = self.is_unshared(rotation) and not carries_moment
        return "" if free_pin else f"{link.name}_{joint}_{suffix}"

    def is_unshared(self, rotation: str) -> bool:
        """Whether the rotation belongs to a single end of a link. The moment at this end is then zero, unless
        a spring or dashpot acts on the rotation."""
        ends = [name for link in self.links for name in (link.start_rotation, link.end_rotation)]
        return bool(rotation) and ends.count(rotation) == 1


@dataclass(frozen=True)
class MemberMatrices:
    """Link with the matrices of its elements.

    number: index of the link. start, end: indices of its joints. indices (elements, k): indices of the
    degrees of freedom in the structure. count: number of elements. L (m), EA (N), EI (N m²), mu (kg/m):
    properties of each element. E (Pa), height (m): properties of the link."""

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
        """Whether the elements are exact."""
        return self.element.name == EXACT

    @cached_property
    def mass(self) -> Array:
        """Mass matrix (kg, kg m, …) for degrees of freedom that include derivatives of the deflection with
        respect to x; thesis, Eq. (4.22)."""
        return self.mu * self.L * self.element.scaled(self.element.mass, self.L)

    @cached_property
    def stiffness(self) -> Array:
        """Stiffness matrix (N/m, N, …) for degrees of freedom that include derivatives of the deflection with
        respect to x; thesis, Eq. (4.11)."""
        bending = self.element.scaled(self.element.bending, self.L)
        return self.EA / self.L * self.element.elongation + self.EI / self.L**3 * bending

    @cached_property
    def geometric(self) -> Array:
        """Geometric stiffness matrix for a unit axial force, tension positive (1/m, 1, …); thesis, Eq.
        (4.38)."""
        return self.element.scaled(self.element.geometric, self.L) / self.L

    @cached_property
    def rotary(self) -> tuple[Array, Array]:
        """Matrices T and Z of the terms 2ω T q̇ + (ω̇ T + ω² Z) q, which the rotation of the link adds to its
        equations of motion.

        T = M J + P and Z = M J² + 2 P J − M, where R′ = J R. With the shape functions N and S = [[0, −1], [1,
        0]], the matrix P = ∫ ρA Nᵀ S N dx is skew-symmetric."""
        M, J = self.mass, self.element.axes[2]
        P = self.mu * self.L * self.element.scaled(self.element.coupling, self.L)
        return M @ J + P, M @ J @ J + 2 * P @ J - M


class Member(MemberMatrices):
    """Link with methods for the rotations, shapes and stresses of its elements, and for the frequency
    functions of exact elements."""

    def rotations(self, angle: Array) -> Array:
        """Rotation matrices R (m, k, k) from ground axes to link axes. `angle` (m, links) contains the angles
        of all links."""
        theta = angle[:, self.number]
        terms = np.stack((np.ones_like(theta), np.cos(theta), np.sin(theta)), -1)
        return np.tensordot(terms, self.element.axes, 1)

    def local(self, angle: Array, q: Array, elements: slice = slice(None)) -> Array:
        """Degrees of freedom (m, elements, k) in link axes. `q` (n, m) contains the degrees of freedom of the
        structure, `angle` (m, links) the angles of all links."""
        extended = np.concatenate((q.T, np.zeros((q.shape[1], 1))), axis=1)
        ground, theta = extended[:, self.indices[elements]], angle[:, self.number, None, None]
        # One product for all phases takes a third of the time of one product per phase.
        k = ground.shape[-1]
        constant, c, s = (
            (ground.reshape(-1, k) @ axes.T).reshape(ground.shape) for axes in self.element.axes
        )
        return constant + np.cos(theta) * c + np.sin(theta) * s

    def place(self, fraction: float) -> tuple[int, float]:
        """Return the index of the element at a fraction of the length of the link, and ξ within this element.
        At a node, the second of the two elements is returned."""
        first = min(int(fraction * self.count), self.count - 1)
        return first, fraction * self.count - first

    def shapes(self, xi: Array, order: int = 0, omega: Array | float | None = None) -> tuple[Array, Array]:
        """Return axial and transverse displacements at ξ for unit degrees of freedom of an element, (...,
        points, k) each, or their derivatives of order `order` with respect to x.

        omega (...): frequency of exact elements in rad/s."""
        if not self.exact:
            return self.element.shapes(self.L, xi, order)
        frequency = np.asarray(omega, dtype=float)
        axial, transverse = np.zeros((2, *frequency.shape, len(xi), 6))
        b = np.zeros_like(frequency) if self.link.inextensible else self._axial_number(frequency)
        axial[..., :2] = exact.axial_shapes(b, xi, order)
        scale = np.array([1.0, self.L, 1.0, self.L])
        transverse[..., 2:] = exact.bending_shapes(self._bending_number(frequency), xi, order) * scale
        return axial / self.L**order, transverse / self.L**order

    def stresses(self, xi: Array, omega: Array | None = None) -> tuple[Array, Array]:
        """Return the axial stress E u′ and the bending stress −E (h/2) v″ at the + surface for unit degrees
        of freedom, (..., points, k) each, in Pa."""
        elongation, curvature = self.shapes(xi, 1, omega)[0], self.shapes(xi, 2, omega)[1]
        return self.E * elongation, -self.E * self.height / 2 * curvature

    def exact_stiffness(self, omega: Array) -> Array:
        """Functions EI F1 … EI F6, EA F7, EA F8 (b, 8) at ω (b,)."""
        return self._functions(omega, exact.bending, exact.axial, self.EI, self.EA / self.L)

    def exact_mass(self, omega: Array) -> Array:
        """Functions ρA G1 … ρA G6, EA G7, EA G8 (b, 8) at ω (b,); thesis, Eq. (5.19)."""
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
        """Number J0 (b,) of natural frequencies below ω (b,) of the elements with clamped ends; thesis, Eq.
        (5.21)."""
        axial = None if self.link.inextensible else self._axial_number(omega)
        return self.count * exact.interior_count(self._bending_number(omega), axial)

    def _bending_number(self, omega: Array) -> Array:
        """Frequency parameter λL of an element at ω (rad/s); thesis, Eq. (5.4)."""
        return self.L * (self.mu / self.EI) ** 0.25 * np.sqrt(omega)

    def _axial_number(self, omega: Array) -> Array:
        """Frequency parameter βL of an element at ω (rad/s); thesis, Eq. (5.9)."""
        return self.L * np.sqrt(self.mu / self.EA) * omega


def freedoms(
    links: Sequence[Sequence],
    joints: Sequence[tuple[str, bool]],
    kinds: Sequence[str],
    counts: Sequence[int],
    springs: Sequence[str] = (),
    dashpots: Sequence[str] = (),
) -> Freedoms:
    """Degrees of freedom of the links and joints of a generated module."""
    rows = (tuple(Link(*link) for link in links), tuple(joints), tuple(kinds), tuple(counts))
    return Freedoms(*rows, tuple(springs), tuple(dashpots))


def drawn_links(freedoms: Freedoms) -> tuple[DrawnLink, ...]:
    """Links as drawn in figures of mode shapes, with the supports of their ends."""
    is_held, ends = dict(freedoms.joints), [joint for link in freedoms.links for joint in link[1:3]]

    def support(joint: str, rotation: str) -> str:
        if is_held[joint]:
            return "pinned" if rotation else "clamped"
        return "joined" if ends.count(joint) > 1 and freedoms.is_unshared(rotation) else ""

    return tuple(
        DrawnLink(link.name, (support(link.start, link.start_rotation), support(link.end, link.end_rotation)))
        for link in freedoms.links
    )
