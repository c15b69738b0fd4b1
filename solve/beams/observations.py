"""What is seen of a moving structure of beams: deflections and stresses at points of its links, forces at its
joints, and what each mode gives to them (thesis Fig. 6.4)."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from solve.arrays import Array
from solve.beams.elements import AXIAL, BENDING, Freedom, Member
from solve.beams.motion import State
from solve.errors import require_name
from solve.model.modes import Modes, modes

SURFACES = {"plus": 1.0, "minus": -1.0}
"""Surface at +h/2 or −h/2 across the link, along its y axis."""


@dataclass(frozen=True)
class Point:
    """The place of a link's axis at a fraction of its length, 0 … 1, in the axes of its rigid motion.

    angle: angles (k, links) of the links; q: coordinates (n, k); omega: frequencies (k,) in rad/s at which
    exact elements vibrate.
    """

    member: Member
    fraction: float

    def displacement(self, angle: Array, q: Array, omega: Array | None = None) -> tuple[Array, Array]:
        """Axial and transverse displacement (k,) in m."""
        return self.displaced(self._local(angle, q), omega)

    def rotation(self, angle: Array, q: Array) -> Array:
        """Rotation v′ (k,) of the link's axis."""
        return _sum(self.member.shapes(self._xi, 1)[1], self._local(angle, q))

    def stress(self, angle: Array, q: Array, surface: str, omega: Array | None = None) -> Array:
        """E (u′ ∓ (h/2) v″) (k,) in Pa at the surface plus or minus. Raises UnknownNameError."""
        return self.stressed(self._local(angle, q), surface, omega)

    def displaced(self, local: Array, omega: Array | None = None) -> tuple[Array, Array]:
        """`displacement` from the values (k, freedoms) of the element in the axes of the link."""
        u, v = self.member.shapes(self._xi, 0, omega)
        return _sum(u, local), _sum(v, local)

    def stressed(self, local: Array, surface: str, omega: Array | None = None) -> Array:
        """`stress` from the values (k, freedoms) of the element in the axes of the link."""
        require_name("surface", surface, SURFACES)
        axial, bending = self.member.stresses(self._xi, omega)
        return _sum(axial + SURFACES[surface] * bending, local)

    @property
    def element(self) -> int:
        """Index of the element of the link that contains the point."""
        return self.member.place(self.fraction)[0]

    def _local(self, angle: Array, q: Array) -> Array:
        return self.member.local(angle, q, slice(self.element, self.element + 1))[:, 0]

    @property
    def _xi(self) -> Array:
        return np.array([self.member.place(self.fraction)[1]])


def _sum(shapes: Array, local: Array) -> Array:
    """Sums (k,) of shapes (..., 1, freedoms) times the values (k, freedoms) of the degrees of freedom of an
    element."""
    return (local * shapes[..., 0, :]).sum(axis=1)


_OF_JOINTS = ("force_x", "force_y", "moment")


def joint_force(state: State, member: Member, place: int) -> tuple[Array, Array, Array]:
    """Force along x and y (N) and moment (N m), (k,) each, on the start (0) or end (1) of a link.

    Inertia of the rigid motion and of the deflections counts; damping does not: it belongs to the modes,
    to no link.
    """
    key = member.number, place
    if key not in state.joint_forces:
        state.joint_forces[key] = _joint_force(state, member, place)
    return state.joint_forces[key]


def _joint_force(state: State, member: Member, place: int) -> tuple[Array, Array, Array]:
    forces = _element_forces(state, member, -1 if place else 0)
    along, across, moment = (
        forces[:, member.element.freedoms.index(Freedom(direction, order, place))]
        for direction, order in ((AXIAL, 0), (BENDING, 0), (BENDING, 1))
    )
    force = (along + 1j * across) * np.exp(1j * state.positions.angle[:, member.number])
    return np.real(force), np.imag(force), moment


def _element_forces(state: State, member: Member, index: int) -> Array:
    """Forces (k, freedoms) on an element of a link in its axes: the left side of its equation of motion."""
    number = member.number
    q, qd, qdd = (state.local(member, index, order) for order in range(3))
    accelerations = qdd + state.rigid_accelerations[number][:, index]
    forces = accelerations @ member.mass + q @ member.stiffness
    if state.motion.stiffening == "on":
        forces += state.axial_forces[number][:, index, None] * (q @ member.geometric)
    if state.motion.terms == "full":
        turning, centrifugal = member.rotary
        rate, second = (part[:, number, None] for part in state.rates)
        forces += 2 * rate * (qd @ turning.T)
        forces += second * (q @ turning.T) + rate**2 * (q @ centrifugal.T)
    return forces


def quantity(state: State, kind: str, member: Member, place: float) -> Array:
    """Values (k,) of a kind of output at a place of a link, from 0 at its start to 1."""
    if kind == "strain_energy":
        return state.strain_energy()
    if kind in _OF_JOINTS:
        return joint_force(state, member, int(place))[_OF_JOINTS.index(kind)]
    point = Point(member, place)
    local = state.local(member, point.element)
    if kind == "deflection":
        return point.displaced(local)[1]
    return point.stressed(local, kind.removeprefix("stress_"))


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


def contributions(state: State, output: str, values: Callable[[State], Array], count: int) -> Contributions:
    """What the lowest modes give to an output with the values (k,) at states, linear in q:
    q = Σ φ_i η_i with the modes φ_i of each position, η = Φᵀ M q; phases rise in small steps."""
    M, K = state.positions.matrices()
    lowest = followed(M, K, count)
    eta = np.einsum("kni,knm,mk->ik", lowest.vectors, M, state.q, optimize=True)
    parts = np.einsum("kni,ik->ink", lowest.vectors, eta)
    by_mode = np.array([values(replace(state, q=part)) for part in parts])
    return Contributions(output, state.phase, by_mode, lowest.frequencies.T, values(state))


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
