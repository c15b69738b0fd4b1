"""What is seen of a moving structure of beams: deflections and stresses at points of its links, forces at its
joints, and what each mode gives to them (thesis Fig. 6.4)."""

from dataclasses import dataclass, replace

import numpy as np

from solve.arrays import Array
from solve.beams.assembly import Beams, local_values
from solve.beams.elements import AXIAL, Element
from solve.beams.frozen import Modes, modes
from solve.beams.motion import State

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


_OF_JOINTS = ("force_x", "force_y", "moment")


def joint_force(state: State, number: int, place: int) -> tuple[Array, Array, Array]:
    """Force along x and y (N) and moment (N m), (k,) each, on the start (0) or end (1) of a link.

    Inertia of the rigid motion and of the deflections counts; damping does not: it belongs to the modes,
    to no link.
    """
    forces = _element_forces(state, number, -1 if place else 0)
    element = state.motion.beams.freedoms.elements[number]
    along, across = (forces[:, _row(element, place, order=0, axial=axial)] for axial in (True, False))
    force = (along + 1j * across) * np.exp(1j * state.positions.angle[:, number])
    return np.real(force), np.imag(force), forces[:, _row(element, place, order=1, axial=False)]


def _row(element: Element, place: int, order: int, axial: bool) -> int:
    """The freedom of that order at an element's start or end."""
    return next(
        row
        for row, each in enumerate(element.freedoms)
        if (each.xi, each.order, each.direction == AXIAL) == (place, order, axial)
    )


def _element_forces(state: State, number: int, index: int) -> Array:
    """Forces (k, freedoms) on an element of a link in its axes: the left side of its equation of motion."""
    beams = state.motion.beams
    member, element = beams.members[number], beams.freedoms.elements[number]
    here = slice(index, None) if index < 0 else slice(index, index + 1)
    q, qd, qdd = (
        local_values(beams.freedoms, number, state.positions.angle[:, number], part, here)[:, 0]
        for part in (state.q, state.qd, state.qdd)
    )
    accelerations = qdd + state.rigid_accelerations[number][:, index]
    forces = accelerations @ element.mass(member.L, member.mu)
    forces += q @ element.stiffness(member.L, member.EA, member.EI)
    if state.motion.stiffening == "on":
        forces += state.axial_forces[number][:, index, None] * (q @ element.geometric(member.L))
    if state.motion.terms == "full":
        turning, centrifugal = state.motion.rotary(number)
        rate, second = (part[:, number, None] for part in state.rates)
        forces += 2 * state.speed * rate * (qd @ turning.T)
        forces += state.speed**2 * (second * (q @ turning.T) + rate**2 * (q @ centrifugal.T))
    return forces


def quantity(state: State, kind: str, number: int, place: float) -> Array:
    """Values (k,) of a kind of output at a place of a link, from 0 at its start to 1."""
    if kind == "strain_energy":
        return state.strain_energy()
    if kind in _OF_JOINTS:
        return joint_force(state, number, int(place))[_OF_JOINTS.index(kind)]
    point, angle = Point(state.motion.beams, number, place), state.positions.angle
    if kind == "deflection":
        return point.displacement(angle, state.q)[1]
    return point.stress(angle, state.q, kind.removeprefix("stress_"))


LINEAR = ("deflection", "stress_plus", "stress_minus")
"""Kinds of outputs that are sums of what the modes give."""

_NEIGHBOURS = 4
"""Modes above those wanted that may take their place along the turn."""


@dataclass(frozen=True)
class Contributions:
    """Of the lowest modes, each followed along the turn, to an output: values (modes, k) and frequencies
    (modes, k) in rad/s at phases (k,); total (k,): of all modes together."""

    output: str
    phase: Array
    values: Array
    frequencies: Array
    total: Array


def contributions(
    state: State, output: str, kind: str, number: int, place: float, count: int
) -> Contributions:
    """q = Σ φ_i η_i with the modes φ_i of each position, η = Φᵀ M q; phases rise in small steps."""
    M, K = state.positions.matrices()
    found = followed(M, K, count)
    eta = np.einsum("kni,knm,mk->ik", found.vectors, M, state.q, optimize=True)
    parts = np.einsum("kni,ik->ink", found.vectors, eta)
    values = [quantity(replace(state, q=part), kind, number, place) for part in parts]
    total = quantity(state, kind, number, place)
    return Contributions(output, state.phase, np.array(values), found.frequencies.T, total)


def followed(M: Array, K: Array, count: int) -> Modes:
    """The lowest modes at the first of the positions (k, n, n), each followed to the others: the mode of the
    next position that is most like it (modal assurance criterion) continues it, with its sign."""
    from scipy.optimize import linear_sum_assignment

    pool = min(count + _NEIGHBOURS, M.shape[1])
    frequencies, vectors = (part[..., :pool].copy() for part in modes(M, K))
    for k in range(1, len(M)):
        likeness = vectors[k - 1].T @ M[k] @ vectors[k]
        _, order = linear_sum_assignment(-(likeness**2))
        sign = np.where(likeness[np.arange(pool), order] < 0, -1.0, 1.0)
        frequencies[k], vectors[k] = frequencies[k, order], vectors[k][:, order] * sign
    return Modes(frequencies[:, :count], vectors[:, :, :count])
