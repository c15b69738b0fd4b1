"""Inertia of the rigid motion: the load under which moving links vibrate (thesis (6.15), h = −q̈_r)."""

import numpy as np

from solve.arrays import Array
from solve.beams.assembly import rotations
from solve.beams.elements import AXIAL
from solve.beams.freedoms import HELD
from solve.beams.positions import Positions


def rigid_accelerations(positions: Positions, rate: Array, second: Array) -> list[Array]:
    """q̈_r/Ω² of the elements' own freedoms in the axes of their links, (m, elements, k) for each link.

    rate, second (m, links): first and second derivative of the links' angles by the phase. Held freedoms
    accelerate too where their link does.
    """
    spans = _accelerated(positions, rate, second)
    joints = positions.placed(spans)
    return [_local(positions, number, joints, spans, second) for number in range(spans.shape[1])]


def inertia_load(positions: Positions, rate: Array, second: Array) -> Array:
    """−M q̈_r/Ω² (m, n) of the elements and of the joints' masses, at constant Ω."""
    beams, freedoms = positions.beams, positions.beams.freedoms
    load = np.zeros((len(positions.phase), freedoms.n + 1))
    for number, local in enumerate(rigid_accelerations(positions, rate, second)):
        member = beams.members[number]
        forces = local @ freedoms.elements[number].mass(member.L, member.mu).T
        ground = forces @ rotations(freedoms, number, positions.angle[:, number])
        for row, each in zip(freedoms.indices[number], np.swapaxes(ground, 0, 1), strict=True):
            load[:, row] -= each
    joints = positions.placed(_accelerated(positions, rate, second))
    masses = beams.properties.mass
    for (x, y), mass, acceleration in zip(freedoms.joint_indices, masses, joints.T, strict=True):
        load[:, x] -= mass * np.real(acceleration)
        load[:, y] -= mass * np.imag(acceleration)
    return load[:, :HELD]


def _accelerated(positions: Positions, rate: Array, second: Array) -> Array:
    """Second derivative by the phase of the vectors x + iy (m, links) along the links."""
    return positions.beams.properties.length * (1j * second - rate**2) * np.exp(1j * positions.angle)


def _local(positions: Positions, number: int, joints: Array, spans: Array, second: Array) -> Array:
    """Accelerations (m, elements, k) of a link's own freedoms, from those of the joints and spans."""
    beams, link = positions.beams, positions.beams.freedoms.links[number]
    names = [name for name, _ in beams.freedoms.joints]
    start, span = joints[:, names.index(link.start)], spans[:, number]
    count = beams.members[number].count
    backwards = np.exp(-1j * positions.angle[:, number])
    local = np.zeros((len(positions.phase), *beams.freedoms.indices[number].shape))
    for i, freedom in enumerate(beams.freedoms.elements[number].freedoms):
        if freedom.order == 0:
            place = (np.arange(count) + freedom.xi) / count
            along = (start[:, None] + place * span[:, None]) * backwards[:, None]
            local[:, :, i] = np.real(along) if freedom.direction == AXIAL else np.imag(along)
        elif freedom.order == 1:
            local[:, :, i] = second[:, None, number]
    return local
