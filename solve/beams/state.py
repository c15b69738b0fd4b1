"""A structure of beams in motion: what its displacements mean link by link."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from solve.arrays import Array
from solve.beams.assembly import local_values
from solve.beams.motion import Motion
from solve.beams.positions import Positions
from solve.beams.rigid import inertia_load, rigid_accelerations


@dataclass(frozen=True)
class State:
    """Beams at phases (k,) and a speed (rad/s), with q, q̇, q̈ (n, k), derivatives by time."""

    motion: Motion
    phase: Array
    speed: float
    q: Array
    qd: Array
    qdd: Array

    @cached_property
    def positions(self) -> Positions:
        """The rigid positions."""
        return Positions(self.motion.beams, self.phase)

    @cached_property
    def rates(self) -> tuple[Array, Array]:
        """First and second derivative (k, links) of the links' angles by the phase."""
        return self.motion.rates(self.phase)

    @cached_property
    def axial_forces(self) -> list[Array]:
        """Quasi-static axial force (k, elements) in the elements of each link, tension positive."""
        load = self.speed**2 * inertia_load(self.positions, *self.rates)
        return self.motion.axial_forces(self.positions, self.positions.matrices()[1], load)

    @cached_property
    def rigid_accelerations(self) -> list[Array]:
        """q̈_r of the elements' own freedoms in the axes of their links, (k, elements, freedoms) a link."""
        found = rigid_accelerations(self.positions, *self.rates)
        return [self.speed**2 * each for each in found]

    def strain_energy(self) -> Array:
        """½ qᵀ K q (k,) of the links' elastic stiffness, in J."""
        beams = self.motion.beams
        energy = np.zeros(len(self.phase))
        for number, member in enumerate(beams.members):
            local = local_values(beams.freedoms, number, self.positions.angle[:, number], self.q)
            K = beams.freedoms.elements[number].stiffness(member.L, member.EA, member.EI)
            energy += ((local @ K) * local).sum(axis=(1, 2)) / 2
        return energy
