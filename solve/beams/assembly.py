"""Matrices of a whole structure for all positions at once.

In ground axes a local matrix A of a link at angle θ becomes RᵀAR, which is affine in 1, c, s, c², cs with
c = cos θ, s = sin θ (thesis (4.28)). So a structure's matrix is a constant table for each of these and
each link, and all positions together are one matrix product.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from solve.arrays import Array
from solve.beams import dynamic_stiffness as exact
from solve.beams.elements import AXIAL, EXACT, HELD, Freedom, Freedoms, Member, Node
from solve.errors import StructureError

TERMS = 5
"""1, c, s, c², cs."""


def angle_terms(angle: Array) -> Array:
    """1, c, s, c², cs of angles of any shape, along a new last axis."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack((np.ones_like(c), c, s, c * c, c * s), axis=-1)


@dataclass(frozen=True)
class Table:
    """Constants (r, n, n) such that a matrix is Σ w_r constants_r, for rows of weights w."""

    constants: Array

    def __call__(self, weights: Array) -> Array:
        """Matrices (..., n, n) for weights (..., r)."""
        rows, n, _ = self.constants.shape
        flat = weights.reshape(-1, rows) @ self.constants.reshape(rows, n * n)
        return flat.reshape(*weights.shape[:-1], n, n)


def spread(freedoms: Freedoms, link: int, local: Array) -> Array:
    """Tables (5, n, n) of 1, c, s, c², cs for a link whose elements all have the local matrix (k, k)."""
    return spread_singly(freedoms, link, local).sum(axis=0)


def spread_singly(freedoms: Freedoms, link: int, local: Array) -> Array:
    """The same for each element of the link by itself: (elements, 5, n, n)."""
    still, cosine, sine = rotation(freedoms.elements[link].freedoms)
    turned = np.stack(
        (
            still @ local @ still + sine.T @ local @ sine,
            still @ local @ cosine + cosine @ local @ still,
            still @ local @ sine + sine.T @ local @ still,
            cosine @ local @ cosine - sine.T @ local @ sine,
            cosine @ local @ sine + sine.T @ local @ cosine,
        )
    )
    rows = freedoms.indices[link]
    whole = np.zeros((len(rows), TERMS, freedoms.n + 1, freedoms.n + 1))
    for each, row in zip(whole, rows, strict=True):
        each[:, row[:, None], row[None, :]] += turned
    return whole[..., :HELD, :HELD]


def point_masses(freedoms: Freedoms, masses: Array) -> Array:
    """Mass matrix (n, n) of point masses at the joints."""
    whole = np.zeros((freedoms.n + 1, freedoms.n + 1))
    for (x, y), mass in zip(freedoms.joint_indices, masses, strict=True):
        whole[x, x] += mass
        whole[y, y] += mass
    return whole[:HELD, :HELD]


def local_values(
    freedoms: Freedoms, link: int, angle: Array, q: Array, elements: slice = slice(None)
) -> Array:
    """Values (m, elements, k) of the own freedoms of a link's elements, in its axes, for a structure's
    q (N, m) and the link's angles (m,)."""
    whole = np.concatenate((q.T, np.zeros((q.shape[1], 1))), axis=1)
    ground = whole[:, freedoms.indices[link][elements]]
    return ground @ np.swapaxes(rotations(freedoms, link, angle), 1, 2)


def rotations(freedoms: Freedoms, link: int, angle: Array) -> Array:
    """R (m, k, k) from ground axes to the link's at its angles (m,)."""
    still, cosine, sine = rotation(freedoms.elements[link].freedoms)
    c, s = np.cos(angle)[:, None, None], np.sin(angle)[:, None, None]
    return still + c * cosine + s * sine


def rotation(local: Sequence[Freedom]) -> tuple[Array, Array, Array]:
    """R = still + c cosine + s sine, from ground axes to the link's (thesis (4.26)).

    Translations in ground axes stand in the places of the link's: x for u, y for v.
    """
    k = len(local)
    still, cosine, sine = np.zeros((k, k)), np.zeros((k, k)), np.zeros((k, k))
    for i, freedom in enumerate(local):
        if freedom.order > 0:
            still[i, i] = 1.0
            continue
        cosine[i, i] = 1.0
        other = next(
            j
            for j, each in enumerate(local)
            if (each.order, each.xi) == (0, freedom.xi) and each.direction != freedom.direction
        )
        sine[i, other] = 1.0 if freedom.direction == AXIAL else -1.0
    return still, cosine, sine


@dataclass(frozen=True)
class Properties:
    """length (m), E (Pa), EA (N), EI (N m²), mu (kg/m), height (m) of the links, mass (kg) of the joints, and
    the damping ratio of every mode."""

    length: Array
    E: Array
    EA: Array
    EI: Array
    mu: Array
    height: Array
    mass: Array
    damping_ratio: float


@dataclass(frozen=True)
class Beams:
    """Freedoms, properties, and angle(phase): angles (m, links) of the links at phases (m,).

    carried: whether the held joints are carried along paths that the angles of the links imply, instead of
    staying where they are.

    Every matrix is a Table whose rows belong to 1 and to c, s, c², cs of each link; what an exact link
    adds has 1, c, s, c², cs for each of its eight functions of frequency.
    """

    freedoms: Freedoms
    properties: Properties
    angle: Callable[[Array], Array]
    carried: bool = False

    @cached_property
    def members(self) -> list[Member]:
        """The links with their elements."""
        p, freedoms = self.properties, self.freedoms
        lengths = p.length / np.array(freedoms.counts)
        columns = (freedoms.links, freedoms.counts, lengths, p.EA, p.EI, p.mu)
        return [Member(*each) for each in zip(*columns, strict=True)]

    def divided(self, parts: int) -> "Beams":
        """The same beams with every exact element cut into parts, which changes no frequency."""
        counts = [
            count * (parts if kind == EXACT else 1)
            for count, kind in zip(self.freedoms.counts, self.freedoms.kinds, strict=True)
        ]
        return replace(self, freedoms=replace(self.freedoms, counts=tuple(counts)))

    @property
    def exact_links(self) -> list[int]:
        """Numbers of the links whose elements are exact."""
        return [number for number, kind in enumerate(self.freedoms.kinds) if kind == EXACT]

    @cached_property
    def mass(self) -> Table:
        """M of the finite elements and the point masses, and of exact links that do not stretch their
        axial inertia."""
        local = [self._mass(number) for number in range(len(self.members))]
        return self._whole(local, point_masses(self.freedoms, self.properties.mass))

    @cached_property
    def stiffness(self) -> Table:
        """K of the finite elements."""
        local = [self._stiffness(number) for number in range(len(self.members))]
        return self._whole(local, np.zeros((self.freedoms.n, self.freedoms.n)))

    @cached_property
    def exact(self) -> Table:
        """D of the exact links: 1, c, s, c², cs of F1 … F8 of each."""
        tables = [np.zeros((0, self.freedoms.n, self.freedoms.n))]
        for number in self.exact_links:
            tables += [spread(self.freedoms, number, local) for local in exact.patterns()]
        return Table(np.concatenate(tables))

    def _mass(self, number: int) -> Array:
        member, element = self.members[number], self.freedoms.elements[number]
        mass = element.mass(member.L, member.mu)
        if number in self.exact_links:
            axial = np.array([each.direction == AXIAL for each in element.freedoms])
            mass = mass * np.outer(axial, axial) * member.link.inextensible
        return mass

    def _stiffness(self, number: int) -> Array:
        member, element = self.members[number], self.freedoms.elements[number]
        if number in self.exact_links:
            return np.zeros((len(element.freedoms), len(element.freedoms)))
        return element.stiffness(member.L, member.EA, member.EI)

    def _whole(self, local: Sequence[Array], constant: Array) -> Table:
        tables = [spread(self.freedoms, number, each) for number, each in enumerate(local)]
        still = constant + sum(table[0] for table in tables)
        return Table(np.concatenate((still[None], *(table[1:] for table in tables))))


_ROUNDING = 1e-9
"""Part of the largest length or singular value that counts as none."""


class Positions:
    """Beams at phases (m,). Raises StructureError where links do not meet at their joints."""

    def __init__(self, beams: Beams, phase: Array):
        self.beams = beams
        self.phase = np.atleast_1d(np.asarray(phase, dtype=float))
        self.angle = beams.angle(self.phase)
        self.terms = angle_terms(self.angle)
        shared = self.terms[:, :, 1:].reshape(len(self.phase), -1)
        self.weights = np.concatenate((np.ones((len(self.phase), 1)), shared), axis=1)
        self._require_closed()

    @property
    def n(self) -> int:
        """Number of freedoms that no tie takes away."""
        return self.beams.freedoms.n if self._free is None else self._free.shape[2]

    def matrices(self) -> tuple[Array, Array]:
        """M and K of the finite elements, (m, n, n)."""
        everywhere = np.arange(len(self.phase))
        M, K = self.beams.mass(self.weights), self.beams.stiffness(self.weights)
        return self._reduced(M, everywhere), self._reduced(K, everywhere)

    def dynamic_stiffness(self, index: Array, omega: Array) -> Array:
        """D(ω) = K − ω²M, (b, n, n), at the positions of number `index` (b,) and ω (b,) rad/s."""
        weights = self.weights[index]
        D = self.beams.stiffness(weights) - (omega**2)[:, None, None] * self.beams.mass(weights)
        functions = [self.beams.members[number].exact_weights(omega) for number in self.beams.exact_links]
        return self._reduced(D + self._exact(index, functions), index)

    def dynamic_mass(self, index: Array, omega: Array) -> Array:
        """M(ω) = −∂D/∂(ω²), (b, n, n), as `dynamic_stiffness`: thesis (5.16)."""
        M = self.beams.mass(self.weights[index])
        functions = [
            self.beams.members[number].exact_mass_weights(omega) for number in self.beams.exact_links
        ]
        return self._reduced(M + self._exact(index, functions), index)

    def interior_count(self, omega: Array) -> Array:
        """J0 (b,): frequencies below ω (b,) at which no freedom moves; thesis (5.21)."""
        counts = np.zeros(len(omega), dtype=int)
        for number in self.beams.exact_links:
            counts += self.beams.members[number].interior_count(omega)
        return counts

    def expanded(self, vectors: Array) -> Array:
        """Vectors (m, n, k) of the freedoms that ties leave as vectors (m, N, k) of all of them."""
        return vectors if self._free is None else self._free @ vectors

    @cached_property
    def joints(self) -> Array:
        """Places x + iy (m) of the joints, (m, joints), the first held one at 0."""
        return self.placed(self._spans)

    def placed(self, spans: Array) -> Array:
        """Vectors x + iy (m, joints) of the joints from those along the links (m, links); the first held
        joint's is 0."""
        freedoms = self.beams.freedoms
        names = [name for name, _ in freedoms.joints]
        first = next((name for name, held in freedoms.joints if held), names[0])
        places = {first: np.zeros(len(self.phase), dtype=complex)}
        while len(places) < len(names):
            before = len(places)
            for link, span in zip(freedoms.links, spans.T, strict=True):
                if link.start in places and link.end not in places:
                    places[link.end] = places[link.start] + span
                elif link.end in places and link.start not in places:
                    places[link.start] = places[link.end] - span
            if len(places) == before:
                apart = next(name for name in names if name not in places)
                places[apart] = np.zeros(len(self.phase), dtype=complex)
        return np.stack([places[name] for name in names], axis=1)

    @property
    def _spans(self) -> Array:
        """From start to end of the links as complex numbers, (m, links)."""
        return self.beams.properties.length * np.exp(1j * self.angle)

    def _exact(self, index: Array, functions: list[Array]) -> Array:
        """Of exact links, (b, N, N), from their eight functions (b, 8) each."""
        parts = [np.zeros((len(index), 0))]
        for number, values in zip(self.beams.exact_links, functions, strict=True):
            parts.append((values[:, :, None] * self.terms[index, number, None, :]).reshape(len(index), -1))
        return self.beams.exact(np.concatenate(parts, axis=1))

    def _require_closed(self) -> None:
        """Links must meet at their joints, and held joints stay where they are."""
        freedoms = self.beams.freedoms
        if not np.isfinite(self.angle).all():
            worst = self.phase[~np.isfinite(self.angle).all(axis=1)][0]
            raise StructureError(
                f"the links cannot be assembled at {np.degrees(worst):.6g} deg; change their lengths so that "
                "they close at every position"
            )
        allowed = _ROUNDING * self.beams.properties.length.max()
        names = [name for name, _ in freedoms.joints]
        for link, span in zip(freedoms.links, self._spans.T, strict=True):
            start, end = (self.joints[:, names.index(joint)] for joint in (link.start, link.end))
            missed = np.abs(start + span - end).max()
            if missed > allowed:
                raise StructureError(
                    f"link {link.name} misses joint {link.end} by {missed:.3g} m; "
                    "lengths and angles of the links must close every loop"
                )
        for (name, held), places in zip(freedoms.joints, self.joints.T, strict=True):
            moved = np.abs(places - places[0]).max()
            if held and moved > allowed and not self.beams.carried:
                raise StructureError(
                    f"joint {name} is held, but the angles of the links move it by {moved:.3g} m"
                )

    def _reduced(self, matrices: Array, index: Array) -> Array:
        if self._free is None:
            return matrices
        free = self._free[index]
        return np.swapaxes(free, 1, 2) @ matrices @ free

    @cached_property
    def _free(self) -> Array | None:
        """Orthonormal basis (m, N, n) of the motions that stretch no inextensible link; None where all
        links stretch."""
        rows = [
            row
            for number, link in enumerate(self.beams.freedoms.links)
            if link.inextensible
            for row in self._ties(number)
        ]
        if not rows:
            return None
        _, values, vectors = np.linalg.svd(np.stack(rows, axis=1), full_matrices=True)
        ranks = (values > _ROUNDING * values[:, :1]).sum(axis=1)
        if np.ptp(ranks) > 0:
            worst = self.phase[ranks != ranks[0]][0]
            raise StructureError(
                f"at {np.degrees(worst):.6g} deg the inextensible links leave another number of freedoms "
                "than elsewhere; let one of them stretch"
            )
        return np.swapaxes(vectors[:, ranks[0] :], 1, 2)

    def _ties(self, number: int) -> list[Array]:
        """For each pair of neighbouring nodes of a link a row (m, N): by how much it stretches."""
        nodes = self.beams.freedoms.nodes[number]
        direction = np.stack((np.cos(self.angle[:, number]), np.sin(self.angle[:, number])), axis=1)
        return [self._stretch(one, other, direction) for one, other in pairwise(nodes)]

    def _stretch(self, one: Node, other: Node, direction: Array) -> Array:
        row = np.zeros((len(self.phase), self.beams.freedoms.n))
        for node, sign in ((one, -1.0), (other, 1.0)):
            for freedom, component in zip((node.x, node.y), direction.T, strict=True):
                if freedom != HELD:
                    row[:, freedom] += sign * component
        return row
