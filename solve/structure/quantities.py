"""What is of interest in a structure of beams whose links move: deflections, stresses, energy."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.structure.beams import Beams
from solve.structure.points import SURFACES, Point
from solve.structure.positions import Positions


class Quantity(NamedTuple):
    """A quantity with its unit and meaning; values (k,) follow from positions at k phases and q (n, k)."""

    name: str
    unit: str
    meaning: str
    values: Callable[[Positions, Array], Array]


def quantities(beams: Beams) -> Iterator[Quantity]:
    """Of a link that is clamped at one end the tip's deflection and the root's stresses, of another those
    of its middle; and the strain energy of all links."""
    for number, link in enumerate(beams.freedoms.links):
        clamped = link.start_rotation == "", link.end_rotation == ""
        if clamped[0] == clamped[1]:
            yield _deflection(beams, number, "midpoint", 0.5)
            yield from _stresses(beams, number, "midpoint", 0.5)
        else:
            yield _deflection(beams, number, "tip", float(clamped[0]))
            yield from _stresses(beams, number, "root", float(clamped[1]))
    yield Quantity("strain_energy", "J", "strain energy of all links", strain_energy)


def strain_energy(positions: Positions, q: Array) -> Array:
    """½ qᵀ K q (k,) of the links' elastic stiffness, in J."""
    _, K = positions.matrices()
    return np.einsum("ik,kij,jk->k", q, K, q, optimize=True) / 2


def _deflection(beams: Beams, number: int, place: str, fraction: float) -> Quantity:
    link = beams.freedoms.links[number].name
    point = Point(beams, number, fraction)
    return Quantity(
        f"{link}_{place}_deflection",
        "m",
        f"transverse deflection of the {link}'s {place} from its rigid motion",
        lambda positions, q: point.deflection(positions.angle, q),
    )


def _stresses(beams: Beams, number: int, place: str, fraction: float) -> Iterator[Quantity]:
    link = beams.freedoms.links[number].name
    point = Point(beams, number, fraction)
    for surface in SURFACES:
        yield Quantity(
            f"{link}_{place}_stress_{surface}",
            "Pa",
            f"axial stress at the {link}'s {place}, {surface} surface",
            partial(_stress, point, surface),
        )


def _stress(point: Point, surface: str, positions: Positions, q: Array) -> Array:
    return point.stress(positions.angle, q, surface)
