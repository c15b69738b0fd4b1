"""Deflection and stress at a point of a moving link, from the coordinates of its structure."""

from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.beams.assembly import local_values
from solve.beams.beams import Beams

SURFACES = {"plus": 1.0, "minus": -1.0}
"""Surface at +h/2 or −h/2 across the link, along its y axis."""


@dataclass(frozen=True)
class Point:
    """The place of a link's axis at a fraction of its length, 0 … 1, in the axes of its rigid motion.

    Between two elements it belongs to the one that begins there.
    """

    beams: Beams
    number: int
    fraction: float

    def displacement(self, angle: Array, q: Array) -> tuple[Array, Array]:
        """Axial and transverse displacement (k,) in m for angles (k, links) and coordinates (n, k)."""
        member, element = self.beams.members[self.number], self.beams.freedoms.elements[self.number]
        _, xi = self.place
        local = self.local(angle, q)
        u, v = element.displacement(member.L, np.array([xi]))
        return local @ u[0], local @ v[0]

    def rotation(self, angle: Array, q: Array) -> Array:
        """Rotation v′ (k,) of the link's axis."""
        member, element = self.beams.members[self.number], self.beams.freedoms.elements[self.number]
        _, xi = self.place
        return self.local(angle, q) @ element.rotation(member.L, np.array([xi]))[0]

    def stress(self, angle: Array, q: Array, surface: str) -> Array:
        """E (u′ ∓ (h/2) v″) (k,) in Pa at the surface plus or minus."""
        properties, member = self.beams.properties, self.beams.members[self.number]
        _, xi = self.place
        elongation, curvature = self.beams.freedoms.elements[self.number].strains(member.L, np.array([xi]))
        half = SURFACES[surface] * properties.height[self.number] / 2
        local = self.local(angle, q)
        return properties.E[self.number] * (local @ (elongation - half * curvature)[0])

    def local(self, angle: Array, q: Array) -> Array:
        """Values (k, freedoms) of the element's own freedoms."""
        first, _ = self.place
        here = slice(first, first + 1)
        return local_values(self.beams.freedoms, self.number, angle[:, self.number], q, here)[:, 0]

    @property
    def place(self) -> tuple[int, float]:
        """The element and ξ there."""
        count = self.beams.members[self.number].count
        place = self.fraction * count
        first = min(int(place), count - 1)
        return first, place - first
