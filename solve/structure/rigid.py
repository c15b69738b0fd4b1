"""Inertia of the rigid motion: the load under which moving links vibrate (thesis (6.15), h = −q̈_r)."""

import numpy as np

from solve.arrays import Array
from solve.structure.assembly import rotations
from solve.structure.elements import AXIAL
from solve.structure.freedoms import HELD
from solve.structure.positions import Positions


def inertia_load(positions: Positions, rate: Array, second: Array) -> Array:
    """−M q̈_r/Ω² (m, n) of the elements and of the joints' masses, at constant Ω.

    rate, second (m, links): first and second derivative of the links' angles by the phase. Held freedoms
    accelerate too where their link does.
    """
    beams, freedoms = positions.beams, positions.beams.freedoms
    direction = np.exp(1j * positions.angle)
    spans = beams.properties.length * (1j * second - rate**2) * direction
    joints = positions.placed(spans)
    names = [name for name, _ in freedoms.joints]
    load = np.zeros((len(positions.phase), freedoms.n + 1))
    for number, link in enumerate(freedoms.links):
        start = joints[:, names.index(link.start)]
        local = _local(positions, number, start, spans[:, number], second[:, number])
        member = beams.members[number]
        forces = local @ freedoms.elements[number].mass(member.L, member.mu).T
        ground = forces @ rotations(freedoms, number, positions.angle[:, number])
        for row, each in zip(freedoms.indices[number], np.swapaxes(ground, 0, 1), strict=True):
            load[:, row] -= each
    masses = beams.properties.mass
    for (x, y), mass, acceleration in zip(freedoms.joint_indices, masses, joints.T, strict=True):
        load[:, x] -= mass * np.real(acceleration)
        load[:, y] -= mass * np.imag(acceleration)
    return load[:, :HELD]


def _local(positions: Positions, number: int, start: Array, span: Array, second: Array) -> Array:
    """Accelerations (m, elements, k) of the elements' own freedoms in the axes of their link."""
    beams = positions.beams
    count = beams.members[number].count
    backwards = np.exp(-1j * positions.angle[:, number])
    local = np.zeros((len(positions.phase), *beams.freedoms.indices[number].shape))
    for i, freedom in enumerate(beams.freedoms.elements[number].freedoms):
        if freedom.order == 0:
            place = (np.arange(count) + freedom.xi) / count
            along = (start[:, None] + place * span[:, None]) * backwards[:, None]
            local[:, :, i] = np.real(along) if freedom.direction == AXIAL else np.imag(along)
        elif freedom.order == 1:
            local[:, :, i] = second[:, None]
    return local
