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
from solve.structure.assembly import Table, rotation, rotations, spread, spread_singly
from solve.structure.beams import Beams
from solve.structure.damping import Modal, Rayleigh
from solve.structure.positions import Positions
from solve.structure.rigid import inertia_load

OPTIONS = (
    ("terms", ("instantaneous", "full"), "instantaneous"),
    ("stiffening", ("off", "on"), "off"),
    ("damping", ("modal", "rayleigh"), "modal"),
)
"""Whether Coriolis, normal and tangential accelerations of the displacements count; whether axial forces
stiffen; whether ζ is every mode's at every position, or that of the lowest two on average."""


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
            C = C + 2 * self._turning(_rows((speed * rate)[..., None] * positions.terms))
            K = K + self._turning(_rows((speed**2 * second)[..., None] * positions.terms))
            K = K + self._centrifugal(_rows((speed**2 * rate**2)[..., None] * positions.terms))
        if axial is not None:
            K = K + self._geometric(self._axial_rows(positions, axial))
        return M, C, K, d

    def axial_forces(self, positions: Positions, K: Array, d: Array) -> list[Array]:
        """Mean quasi-static axial force (m, elements) in the elements of each link, tension positive."""
        q = np.linalg.solve(K, d[..., None])[..., 0]
        whole = np.concatenate((q, np.zeros((len(q), 1))), axis=1)
        freedoms, forces = self.beams.freedoms, []
        for number, member in enumerate(self.beams.members):
            element = freedoms.elements[number]
            local = whole[:, freedoms.indices[number]] @ np.swapaxes(
                rotations(freedoms, number, positions.angle[:, number]), 1, 2
            )
            ends = element.displacement(member.L, np.array([0.0, 1.0]))[0]
            forces.append(local @ (ends[1] - ends[0]) * (member.EA / member.L))
        return forces

    @cached_property
    def _damping(self) -> Callable[[Array], Array]:
        return {"modal": Modal, "rayleigh": Rayleigh}[self.damping](self.beams, self.period)

    @cached_property
    def _turning(self) -> Table:
        """M J + P of the links, for 1, c, s, c², cs of each."""
        return self._table(lambda M, P, J: M @ J + P)

    @cached_property
    def _centrifugal(self) -> Table:
        """M J² + 2 P J − M of the links, for 1, c, s, c², cs of each."""
        return self._table(lambda M, P, J: M @ J @ J + 2 * P @ J - M)

    def _table(self, local: Callable[[Array, Array, Array], Array]) -> Table:
        freedoms, tables = self.beams.freedoms, []
        for number, (member, element) in enumerate(zip(self.beams.members, freedoms.elements, strict=True)):
            M, P = element.mass(member.L, member.mu), element.coupling(member.L, member.mu)
            tables.append(spread(freedoms, number, local(M, P, rotation(element.freedoms)[2])))
        return Table(np.concatenate(tables))

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
