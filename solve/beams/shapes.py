"""Mode shapes of a structure of beams at one position: how every link bends."""

from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.beams.assembly import local_values
from solve.beams.beams import Beams
from solve.beams.eigen import modes
from solve.beams.elements import EXACT
from solve.beams.positions import Positions
from solve.beams.wittrick_williams import PARTS, near_clamped

_POINTS = 48
"""Points along a link, at least."""

_SAME = 1e-9
"""Relative difference of frequencies that count as one that occurs several times."""


@dataclass(frozen=True)
class Shape:
    """A mode with its frequency (rad/s), scaled so that its largest displacement is 1.

    places and displacements: for each link x, y along it, (points, 2), in m and in units of the largest.
    transverse: the displacements across each link, (points,). modal_mass: kg.
    """

    frequency: float
    modal_mass: float
    places: tuple[Array, ...]
    displacements: tuple[Array, ...]
    transverse: tuple[Array, ...]


def shapes(beams: Beams, phase: float, frequencies: Array) -> list[Shape]:
    """The modes of the lowest frequencies (count,) of the beams at a phase."""
    if not beams.exact_links:
        positions = Positions(beams, np.array([phase]))
        vectors = positions.expanded(modes(*positions.matrices()).vectors)[0, :, : len(frequencies)]
        each = [(positions, vector, 1.0) for vector in vectors.T]
    else:
        each = [_exact_mode(beams, phase, frequencies, number) for number in range(len(frequencies))]
    return [_shape(*mode, float(omega)) for mode, omega in zip(each, frequencies, strict=True)]


def _exact_mode(
    beams: Beams, phase: float, frequencies: Array, number: int
) -> tuple[Positions, Array, float]:
    """Positions, vector (N,) and modal mass of one of the modes.

    The links are divided so that none of the elements vibrates with clamped ends at this frequency:
    then every mode moves a node (thesis 5.4.1), and D has no pole.
    """
    # All of a repeated frequency are taken at its first copy: another rounding reorders the modes.
    own = max(float(frequencies[number]), np.finfo(float).tiny)
    before = np.count_nonzero(np.abs(frequencies[:number] / own - 1) < _SAME)
    omega = frequencies[number - before : number - before + 1]
    positions = Positions(beams, np.array([phase]))
    for parts in PARTS:
        if not near_clamped(positions, omega)[0]:
            break
        positions = Positions(beams.divided(parts), np.array([phase]))
    index = np.zeros(1, dtype=int)
    D, M = positions.dynamic_stiffness(index, omega)[0], positions.dynamic_mass(index, omega)[0]
    scale = 1 / np.sqrt(np.diag(M))
    values, vectors = np.linalg.eigh(D * np.outer(scale, scale))
    chosen = np.argsort(np.abs(values), kind="stable")[before]
    vector = scale * vectors[:, chosen]
    return positions, positions.expanded(vector[None, :, None])[0, :, 0], float(vector @ M @ vector)


def _shape(positions: Positions, vector: Array, mass: float, omega: float) -> Shape:
    curves = [_curve(positions, number, vector, omega) for number in range(len(positions.beams.members))]
    largest = max(np.linalg.norm(displacement, axis=1).max() for _, displacement, _ in curves)
    places, displacements, transverse = zip(*curves, strict=True)
    return Shape(
        omega,
        mass / largest**2,
        places,
        tuple(each / largest for each in displacements),
        tuple(each / largest for each in transverse),
    )


def _curve(positions: Positions, number: int, vector: Array, omega: float) -> tuple[Array, Array, Array]:
    """Places, displacements and their transverse part along a link."""
    beams = positions.beams
    member, kind = beams.members[number], beams.freedoms.kinds[number]
    angle = positions.angle[:, number]
    xi = np.linspace(0.0, 1.0, 1 + -(-_POINTS // member.count))
    if kind == EXACT:
        axial, transverse = member.exact_shapes(omega, xi)
    else:
        axial, transverse = beams.freedoms.elements[number].displacement(member.L, xi)
    values = local_values(beams.freedoms, number, angle, vector[:, None])[0]
    u, v = (np.concatenate([shapes @ each for each in values]) for shapes in (axial, transverse))
    along = np.concatenate([member.L * (first + xi) for first in range(member.count)])
    joints = [name for name, _ in beams.freedoms.joints]
    start = positions.joints[0, joints.index(member.link.start)]
    c, s = np.cos(angle[0]), np.sin(angle[0])
    places = np.column_stack((np.real(start) + along * c, np.imag(start) + along * s))
    return places, np.column_stack((u * c - v * s, u * s + v * c)), v
