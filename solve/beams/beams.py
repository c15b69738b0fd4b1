"""A structure of beams with its elements chosen: the constant tables of its matrices."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from solve.arrays import Array
from solve.beams import dynamic_stiffness as exact
from solve.beams.assembly import Table, point_masses, spread
from solve.beams.elements import AXIAL, EXACT
from solve.beams.freedoms import Freedoms, Link


@dataclass(frozen=True)
class Properties:
    """length (m), E (Pa), EA (N), EI (N m²), mu (kg/m), height (m) of the links, mass (kg) of the joints, and
    the damping ratio of every mode."""

    length: Array
    E: Array
    EA: Array
    EI: Array
    mu: Array
    height: Array
    mass: Array
    damping_ratio: float


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


@dataclass(frozen=True)
class Beams:
    """Freedoms, properties, and angle(phase): angles (m, links) of the links at phases (m,).

    carried: whether the held joints are carried along paths that the angles of the links imply, instead of
    staying where they are.

    Every matrix is a Table whose rows belong to 1 and to c, s, c², cs of each link; what an exact link
    adds has 1, c, s, c², cs for each of its eight functions of frequency.
    """

    freedoms: Freedoms
    properties: Properties
    angle: Callable[[Array], Array]
    carried: bool = False

    @cached_property
    def members(self) -> list[Member]:
        """The links with their elements."""
        p, freedoms = self.properties, self.freedoms
        lengths = p.length / np.array(freedoms.counts)
        columns = (freedoms.links, freedoms.counts, lengths, p.EA, p.EI, p.mu)
        return [Member(*each) for each in zip(*columns, strict=True)]

    def divided(self, parts: int) -> "Beams":
        """The same beams with every exact element cut into parts, which changes no frequency."""
        counts = [
            count * (parts if kind == EXACT else 1)
            for count, kind in zip(self.freedoms.counts, self.freedoms.kinds, strict=True)
        ]
        return replace(self, freedoms=replace(self.freedoms, counts=tuple(counts)))

    @property
    def exact_links(self) -> list[int]:
        """Numbers of the links whose elements are exact."""
        return [number for number, kind in enumerate(self.freedoms.kinds) if kind == EXACT]

    @cached_property
    def mass(self) -> Table:
        """M of the finite elements and the point masses, and of exact links that do not stretch their
        axial inertia."""
        local = [self._mass(number) for number in range(len(self.members))]
        return self._whole(local, point_masses(self.freedoms, self.properties.mass))

    @cached_property
    def stiffness(self) -> Table:
        """K of the finite elements."""
        local = [self._stiffness(number) for number in range(len(self.members))]
        return self._whole(local, np.zeros((self.freedoms.n, self.freedoms.n)))

    @cached_property
    def exact(self) -> Table:
        """D of the exact links: 1, c, s, c², cs of F1 … F8 of each."""
        tables = [np.zeros((0, self.freedoms.n, self.freedoms.n))]
        for number in self.exact_links:
            tables += [spread(self.freedoms, number, local) for local in exact.patterns()]
        return Table(np.concatenate(tables))

    def _mass(self, number: int) -> Array:
        member, element = self.members[number], self.freedoms.elements[number]
        mass = element.mass(member.L, member.mu)
        if number in self.exact_links:
            axial = np.array([each.direction == AXIAL for each in element.freedoms])
            mass = mass * np.outer(axial, axial) * member.link.inextensible
        return mass

    def _stiffness(self, number: int) -> Array:
        member, element = self.members[number], self.freedoms.elements[number]
        if number in self.exact_links:
            return np.zeros((len(element.freedoms), len(element.freedoms)))
        return element.stiffness(member.L, member.EA, member.EI)

    def _whole(self, local: Sequence[Array], constant: Array) -> Table:
        tables = [spread(self.freedoms, number, each) for number, each in enumerate(local)]
        still = constant + sum(table[0] for table in tables)
        return Table(np.concatenate((still[None], *(table[1:] for table in tables))))
