"""What a joint exerts on a link's end: the forces that its element there takes beside its own inertia."""

import numpy as np

from solve.arrays import Array
from solve.beams.assembly import local_values
from solve.beams.elements import AXIAL, Element
from solve.beams.state import State


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
