"""Outputs of a moving beam structure: deflections and stresses at points of links, forces at joints, and
contributions of modes (thesis, Fig. 6.4)."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from solve.arrays import Array
from solve.beams.element import AXIAL, BENDING, Freedom
from solve.beams.links import Member
from solve.beams.motion import State
from solve.errors import require_name
from solve.model.modes import Modes, modes

SURFACES = {"plus": 1.0, "minus": -1.0}
"""Mapping from surfaces to signs. The surfaces are at +h/2 and −h/2 along the y axis of the link."""


@dataclass(frozen=True)
class Point:
    """Point on the axis of a link, at a fraction 0 … 1 of its length. Quantities are in the axes of the rigid
    motion of the link.

    Arguments of the methods: angles (k, links) of the links, q (n, k), and for exact elements frequencies
    omega (k,) in rad/s."""

    member: Member
    fraction: float

    def displacement(self, angle: Array, q: Array, omega: Array | None = None) -> tuple[Array, Array]:
        """Return the axial and the transverse displacement in m, (k,) each."""
        return self.displaced(self._local(angle, q), omega)

    def rotation(self, angle: Array, q: Array) -> Array:
        """Rotation v′ (k,) of the axis of the link."""
        return _sum(self.member.shapes(self._xi, 1)[1], self._local(angle, q))

    def stress(self, angle: Array, q: Array, surface: str, omega: Array | None = None) -> Array:
        """Axial stress E (u′ ∓ (h/2) v″) (k,) in Pa at the surface "plus" or "minus". Raises
        UnknownNameError."""
        return self.stressed(self._local(angle, q), surface, omega)

    def displaced(self, local: Array, omega: Array | None = None) -> tuple[Array, Array]:
        """Result of `displacement`, from the degrees of freedom (k, freedoms) of the element in link axes."""
        u, v = self.member.shapes(self._xi, 0, omega)
        return _sum(u, local), _sum(v, local)

    def stressed(self, local: Array, surface: str, omega: Array | None = None) -> Array:
        """Result of `stress`, from the degrees of freedom (k, freedoms) of the element in link axes."""
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
    """Sums (k,) of shapes (..., 1, freedoms) multiplied by the degrees of freedom (k, freedoms) of an
    element."""
    return (local * shapes[..., 0, :]).sum(axis=1)


_JOINT_FORCES = ("force_x", "force_y", "moment")


def joint_force(state: State, member: Member, place: int) -> tuple[Array, Array, Array]:
    """Return the forces along x and y (N) and the moment (N m), (k,) each, on the start (0) or end (1) of a
    link.

    The forces include the inertia forces of the rigid motion and of the deflections. Damping is not included,
    because it is defined for modes and not for a link."""
    key = member.number, place
    if key not in state.joint_forces:
        state.joint_forces[key] = _joint_force(state, member, place)
    return state.joint_forces[key]


def _joint_force(state: State, member: Member, place: int) -> tuple[Array, Array, Array]:
    forces = _element_forces(state, member, -1 if place else 0)
    axial, transverse, moment = (
        forces[:, member.element.freedoms.index(Freedom(direction, order, place))]
        for direction, order in ((AXIAL, 0), (BENDING, 0), (BENDING, 1))
    )
    force = (axial + 1j * transverse) * np.exp(1j * state.positions.angle[:, member.number])
    return np.real(force), np.imag(force), moment


def _element_forces(state: State, member: Member, index: int) -> Array:
    """Forces (k, freedoms) on an element in link axes. They are the left-hand side of the equations of motion
    of the element."""
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
    """Values (k,) of the output `kind` of a link. `place` is the fraction of the link's length or, for a
    joint force, the index of the link's end."""
    if kind == "strain_energy":
        return state.strain_energy()
    if kind in _JOINT_FORCES:
        return joint_force(state, member, int(place))[_JOINT_FORCES.index(kind)]
    point = Point(member, place)
    local = state.local(member, point.element)
    if kind == "deflection":
        return point.displaced(local)[1]
    return point.stressed(local, kind.removeprefix("stress_"))


LINEAR = ("deflection", "stress_plus", "stress_minus")
"""Kinds of outputs that are linear in the deflections, and hence sums of contributions of modes."""

_EXTRA_MODES = 4
"""Number of additional modes that are tracked, because the order of modes may change within a revolution.
Chosen by judgement."""


@dataclass(frozen=True)
class Contributions:
    """Contributions of the lowest modes to an output. The modes are tracked over the revolution.

    values (modes, k): contributions at phases (k,). frequencies (modes, k): frequencies in rad/s. total (k,):
    sum of the contributions of all modes."""

    output: str
    phase: Array
    values: Array
    frequencies: Array
    total: Array


def contributions(state: State, output: str, values: Callable[[State], Array], count: int) -> Contributions:
    """Contributions of the lowest modes to an output that is linear in q. With the modes φ_i at each
    position, the motion is q = Σ φ_i η_i with η = Φᵀ M q.

    values: function of a state that returns the output (k,). The phases must ascend in small steps."""
    M, K = state.positions.matrices()
    lowest = tracked_modes(M, K, count)
    eta = np.einsum("kni,knm,mk->ik", lowest.vectors, M, state.q, optimize=True)
    deflections = np.einsum("kni,ik->ink", lowest.vectors, eta)
    by_mode = np.array([values(replace(state, q=deflection)) for deflection in deflections])
    return Contributions(output, state.phase, by_mode, lowest.frequencies.T, values(state))


def tracked_modes(M: Array, K: Array, count: int) -> Modes:
    """Lowest `count` modes at the first of k positions, tracked over all positions. M and K are (k, n, n).

    At the next position, a mode is continued by the most similar mode (modal assurance criterion). Signs are
    chosen so that the mode is continuous."""
    from scipy.optimize import linear_sum_assignment

    pool = min(count + _EXTRA_MODES, M.shape[1])
    frequencies, vectors = (array[..., :pool].copy() for array in modes(M, K))
    for k in range(1, len(M)):
        similarity = vectors[k - 1].T @ M[k] @ vectors[k]
        _, order = linear_sum_assignment(-(similarity**2))
        sign = np.where(similarity[np.arange(pool), order] < 0, -1.0, 1.0)
        frequencies[k], vectors[k] = frequencies[k, order], vectors[k][:, order] * sign
    return Modes(frequencies[:, :count], vectors[:, :, :count])
