"""Deflection and stress at a point of a moving link, from the coordinates of its structure."""

from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.structure.assembly import rotations
from solve.structure.beams import Beams

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

    def deflection(self, angle: Array, q: Array) -> Array:
        """Transverse displacement (k,) in m for angles (k, links) and coordinates (n, k)."""
        member, element = self.beams.members[self.number], self.beams.freedoms.elements[self.number]
        _, xi = self.place
        return self.local(angle, q) @ element.displacement(member.L, np.array([xi]))[1][0]

    def stress(self, angle: Array, q: Array, surface: str) -> Array:
        """E (u′ ∓ (h/2) v″) (k,) in Pa at the surface plus or minus."""
        properties, member = self.beams.properties, self.beams.members[self.number]
        _, xi = self.place
        elongation, curvature = self.beams.freedoms.elements[self.number].strains(member.L, np.array([xi]))
        half = SURFACES[surface] * properties.height[self.number] / 2
        return properties.E[self.number] * (self.local(angle, q) @ (elongation - half * curvature)[0])

    def local(self, angle: Array, q: Array) -> Array:
        """Values (k, freedoms) of the element's own freedoms."""
        freedoms, (first, _) = self.beams.freedoms, self.place
        whole = np.concatenate((q.T, np.zeros((q.shape[1], 1))), axis=1)
        ground = whole[:, freedoms.indices[self.number][first]]
        return np.einsum("kij,kj->ki", rotations(freedoms, self.number, angle[:, self.number]), ground)

    @property
    def place(self) -> tuple[int, float]:
        """The element and ξ there."""
        count = self.beams.members[self.number].count
        place = self.fraction * count
        first = min(int(place), count - 1)
        return first, place - first
