"""Equations of motion of a structure of beams whose links move (thesis (4.32), (6.15)).

Coordinates are displacements from the rigid positions, in ground axes. With R from ground axes to a
link's, R′ = J R, and the link's ω and ω̇, an element has in its own axes (thesis (4.22), P skew)
M δ̈ + 2ωP δ̇ + (K + ω̇P − ω²M) δ; δ = R q makes of it

    C = 2ω Rᵀ(M J + P) R        K + Rᵀ[ω̇(M J + P) + ω²(M J² + 2 P J − M)] R
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from solve.arrays import Array
from solve.beams.assembly import Table, local_values, rotation, spread, spread_singly
from solve.beams.beams import Beams
from solve.beams.damping import Modal, Rayleigh
from solve.beams.positions import Positions
from solve.beams.rigid import inertia_load


@dataclass(frozen=True)
class Motion:
    """M, C, K, d of moving beams for all phases at once.

    rates(phase): first and second derivative (m, links) by the phase of the links' angles.
    """

    beams: Beams
    rates: Callable[[Array], tuple[Array, Array]]
    period: float
    terms: str
    stiffening: str
    damping: str

    def __call__(self, phase: Array, speed: float) -> tuple[Array, Array, Array, Array]:
        """M, C, K (m, n, n) and d (m, n) at phases (m,), Ω in rad/s."""
        positions = Positions(self.beams, phase)
        rate, second = self.rates(phase)
        M, K = positions.matrices()
        d = speed**2 * inertia_load(positions, rate, second)
        C = self._damping(phase)
        axial = self.axial_forces(positions, K, d) if self.stiffening == "on" else None
        if self.terms == "full":
            turning, centrifugal = self._rotary
            C = C + 2 * turning(_rows((speed * rate)[..., None] * positions.terms))
            K = K + turning(_rows((speed**2 * second)[..., None] * positions.terms))
            K = K + centrifugal(_rows((speed**2 * rate**2)[..., None] * positions.terms))
        if axial is not None:
            K = K + self._geometric(self._axial_rows(positions, axial))
        return M, C, K, d

    def axial_forces(self, positions: Positions, K: Array, d: Array) -> list[Array]:
        """Mean quasi-static axial force (m, elements) in the elements of each link, tension positive."""
        q = np.linalg.solve(K, d[..., None])[..., 0].T
        freedoms, forces = self.beams.freedoms, []
        for number, member in enumerate(self.beams.members):
            local = local_values(freedoms, number, positions.angle[:, number], q)
            ends = freedoms.elements[number].displacement(member.L, np.array([0.0, 1.0]))[0]
            forces.append(local @ (ends[1] - ends[0]) * (member.EA / member.L))
        return forces

    @cached_property
    def _damping(self) -> Callable[[Array], Array]:
        return {"modal": Modal, "rayleigh": Rayleigh}[self.damping](self.beams, self.period)

    def rotary(self, number: int) -> tuple[Array, Array]:
        """M J + P and M J² + 2 P J − M of a link's elements."""
        member, element = self.beams.members[number], self.beams.freedoms.elements[number]
        M, P = element.mass(member.L, member.mu), element.coupling(member.L, member.mu)
        J = rotation(element.freedoms)[2]
        return M @ J + P, M @ J @ J + 2 * P @ J - M

    @cached_property
    def _rotary(self) -> tuple[Table, Table]:
        """The same of the whole structure, for 1, c, s, c², cs of each link."""
        numbers = range(len(self.beams.members))
        tables = [
            [spread(self.beams.freedoms, number, each) for each in self.rotary(number)] for number in numbers
        ]
        turning, centrifugal = (Table(np.concatenate(each)) for each in zip(*tables, strict=True))
        return turning, centrifugal

    @cached_property
    def _geometric(self) -> Table:
        """Stiffness by unit axial force of every element, for 1, c, s, c², cs of its link."""
        freedoms = self.beams.freedoms
        tables = [
            np.concatenate(spread_singly(freedoms, number, element.geometric(member.L)))
            for number, (member, element) in enumerate(
                zip(self.beams.members, freedoms.elements, strict=True)
            )
        ]
        return Table(np.concatenate(tables))

    def _axial_rows(self, positions: Positions, axial: list[Array]) -> Array:
        each = [
            _rows(forces[..., None] * positions.terms[:, number, None]) for number, forces in enumerate(axial)
        ]
        return np.concatenate(each, axis=1)


def _rows(weights: Array) -> Array:
    """Weights (m, a, b) as rows (m, a b)."""
    return weights.reshape(len(weights), -1)
