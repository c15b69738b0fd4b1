"""A structure of beams frozen at several positions: its matrices there, all at once."""

from functools import cached_property
from itertools import pairwise

import numpy as np

from solve.arrays import Array
from solve.beams.assembly import angle_terms
from solve.beams.beams import Beams
from solve.beams.freedoms import HELD, Node
from solve.errors import StructureError

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
