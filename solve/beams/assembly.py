"""Assembly of the matrices of a structure at all positions in one call.

In ground axes, a local matrix A of a link at angle θ becomes RᵀAR. This is linear in 1, c, s, c², cs with c =
cos θ, s = sin θ (thesis, Eq. (4.28)). A matrix of the structure is therefore stored as a constant table for
each link and each of these terms. One matrix product yields its values at all positions."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from solve.arrays import Array, Latest
from solve.beams import dynamic_stiffness as exact
from solve.beams.links import HELD, Freedoms, Member
from solve.errors import StructureError
from solve.model.sampling import Sampler, symbol
from solve.model.setup import Setup
from solve.threads import symbolic

if TYPE_CHECKING:
    import casadi

TERMS = np.zeros((5, 3, 3))
"""Products of two of the functions 1, c, s. `TERMS[:, i, j]` contains the coefficients of 1, c, s, c², cs in
the product of functions i and j, with s² = 1 − c²."""
for _row, _i, _j, _sign in (
    *((0, 0, 0, 1), (0, 2, 2, 1), (1, 0, 1, 1), (1, 1, 0, 1), (2, 0, 2, 1), (2, 2, 0, 1)),
    *((3, 1, 1, 1), (3, 2, 2, -1), (4, 1, 2, 1), (4, 2, 1, 1)),
):
    TERMS[_row, _i, _j] = _sign


@dataclass(frozen=True)
class Properties:
    """Properties of links and joints.

    length (m), E (Pa), EA (N), EI (N m²), mu (kg/m), height (m): one value per link. mass (kg): point masses
    at the joints. damping_ratio: damping ratio of all modes. spring, dashpot: constants of the springs and
    dashpots to the ground (N/m or N m, N s/m or N m s), one value per degree of freedom with a spring or
    dashpot."""

    length: Array
    E: Array
    EA: Array
    EI: Array
    mu: Array
    height: Array
    mass: Array
    damping_ratio: float
    spring: Array = field(default_factory=lambda: np.zeros(0))
    dashpot: Array = field(default_factory=lambda: np.zeros(0))


class Kinematics:
    """Link angles and constants, from the generated function `properties` of a structure."""

    def __init__(self, setup: Setup):
        self._p = setup.p
        self._properties: casadi.Function = setup.function("properties")

    @property
    def properties(self) -> Properties:
        """Values of the properties of links and joints."""
        values = self._properties.call({"phase": 0.0, "p": self._p})
        columns = {name: value.full().ravel() for name, value in values.items() if name != "angle"}
        return Properties(**{**columns, "damping_ratio": float(columns["damping_ratio"][0])})

    def angle(self, phase: Array) -> Array:
        """Angles (m, links) of the links at phases (m,)."""
        return np.split(self._angles(phase), 3, axis=1)[0]

    def rates(self, phase: Array) -> tuple[Array, Array]:
        """First and second derivatives (m, links) of the angles with respect to the phase."""
        _, rate, second = np.split(self._angles(phase), 3, axis=1)
        return rate, second

    @cached_property
    @symbolic
    def _angles(self) -> Latest[Array]:
        import casadi

        phase = symbol("phase")
        angle = self._properties(phase=phase, p=self._p)["angle"]
        rate = casadi.jacobian(angle, phase)
        rows = map(casadi.densify, (angle, rate, casadi.jacobian(rate, phase)))
        return Latest(Sampler(casadi.Function("angles", [phase], [casadi.vertcat(*rows)])))


@dataclass(frozen=True)
class Beams:
    """Beams of a structure: degrees of freedom, properties, and the angles of the links.

    angle: function that returns the angles (m, links) at phases (m,). carried: whether supported joints move
    along the paths that result from the angles of the links; otherwise, they are at rest. Matrices are stored
    as tables (links, 5, n, n): for each link, the coefficients of 1, c, s, c², cs. Exact links have such a
    table for each of the eight functions of frequency."""

    freedoms: Freedoms
    properties: Properties
    angle: Callable[[Array], Array]
    carried: bool = False

    @cached_property
    def members(self) -> list[Member]:
        """Links with their elements."""
        p, freedoms = self.properties, self.freedoms
        joints = [name for name, _ in freedoms.joints]
        return [
            Member(
                number,
                link,
                joints.index(link.start),
                joints.index(link.end),
                freedoms.elements[number],
                freedoms.indices[number],
                count,
                p.length[number] / count,
                *(column[number] for column in (p.E, p.EA, p.EI, p.mu, p.height)),
            )
            for number, (link, count) in enumerate(zip(freedoms.links, freedoms.counts, strict=True))
        ]

    def divided(self, parts: int) -> "Beams":
        """Beams with every exact element divided into `parts` elements. The frequencies of the structure do
        not change."""
        counts = tuple(member.count * (parts if member.exact else 1) for member in self.members)
        return replace(self, freedoms=replace(self.freedoms, counts=counts))

    @cached_property
    def exact_links(self) -> list[Member]:
        """Links with exact elements."""
        return [member for member in self.members if member.exact]

    @cached_property
    def mass(self) -> Array:
        """Table of the mass matrix M of the finite elements and point masses. It includes the axial inertia
        of inextensible exact links."""
        tables = []
        for member in self.members:
            axial = member.element.axial * member.link.inextensible
            tables.append(self.spread(member, member.mass * (np.outer(axial, axial) if member.exact else 1)))
        tables[0][0] += self.point_masses
        return np.stack(tables)

    @cached_property
    def point_masses(self) -> Array:
        """Mass matrix M (n, n) of the point masses at the joints."""
        M = np.zeros((self.freedoms.n + 1, self.freedoms.n + 1))
        for xy, mass in zip(self.freedoms.joint_indices, self.properties.mass, strict=True):
            M[xy, xy] += mass
        return M[:HELD, :HELD]

    @cached_property
    def stiffness(self) -> Array:
        """Table of the stiffness matrix K of the finite elements and of the springs to the ground."""
        tables = [self.spread(member, member.stiffness * (not member.exact)) for member in self.members]
        tables[0][0] += self.springs
        return np.stack(tables)

    @cached_property
    def springs(self) -> Array:
        """Stiffness matrix K (n, n) of the springs to the ground."""
        return self._to_ground(self.freedoms.springs, self.properties.spring)

    @cached_property
    def dashpots(self) -> Array:
        """Damping matrix C (n, n) of the dashpots to the ground."""
        return self._to_ground(self.freedoms.dashpots, self.properties.dashpot)

    def _to_ground(self, names: Sequence[str], values: Array) -> Array:
        index = [self.freedoms.names.index(name) for name in names]
        matrix = np.zeros((self.freedoms.n, self.freedoms.n))
        matrix[index, index] = values
        return matrix

    @cached_property
    def exact(self) -> Array:
        """Coefficients (exact links, 8, 5, n, n) of the functions F1 … F8 in the dynamic stiffness D: for
        each exact link, eight tables."""
        patterns = exact.patterns()
        tables = [[self.spread(member, pattern) for pattern in patterns] for member in self.exact_links]
        return np.array(tables)

    def spread(self, member: Member, local: Array) -> Array:
        """Table (5, n, n) of a link whose elements all have the local matrix `local` (k, k)."""
        return self.spread_singly(member, local).sum(axis=0)

    def spread_singly(self, member: Member, local: Array) -> Array:
        """One table (5, n, n) for each element of a link, in an array (elements, 5, n, n). All elements have
        the local matrix `local` (k, k)."""
        R = member.element.axes
        rotated = np.einsum("tij,iba,bc,jcd->tad", TERMS, R, local, R, optimize=True)
        tables = np.zeros((member.count, 5, self.freedoms.n + 1, self.freedoms.n + 1))
        for table, row in zip(tables, member.indices, strict=True):
            table[:, row[:, None], row[None, :]] += rotated
        return tables[..., :HELD, :HELD]


POSITIONS = 36
"""Number of positions per revolution at which assembly and frequencies are sampled, one every 10 degrees.
Chosen by judgement."""

ROUNDING = 1e-9
"""Relative size below which distances, differences between frequencies, and singular values count as
round-off. Chosen by judgement."""


class Positions:
    """Beams at phases (m,). Raises StructureError if the links do not meet at their joints."""

    def __init__(self, beams: Beams, phase: Array):
        self.beams = beams
        self.phase = np.atleast_1d(np.asarray(phase, dtype=float))
        self.angle = beams.angle(self.phase)
        c, s = np.cos(self.angle), np.sin(self.angle)
        self.terms = np.stack((np.ones_like(c), c, s, c * c, c * s), axis=-1)
        self._require_closed()

    @property
    def n(self) -> int:
        """Number of degrees of freedom that remain after inextensible links have removed some."""
        return self.beams.freedoms.n if self._free is None else self._free.shape[2]

    def matrices(self) -> tuple[Array, Array]:
        """M and K (m, n, n) of the finite elements."""
        tables = self.beams.mass, self.beams.stiffness
        M, K = (self._reduced(np.tensordot(self.terms, table, 2)) for table in tables)
        return M, K

    def dynamic_stiffness(self, index: Array, omega: Array) -> Array:
        """D(ω) = K − ω²M (b, n, n) at the positions with indices `index` (b,) and at ω (b,) in rad/s."""
        tables = self.beams.mass, self.beams.stiffness
        M, K = (np.tensordot(self.terms[index], table, 2) for table in tables)
        functions = [member.exact_stiffness(omega) for member in self.beams.exact_links]
        return self._with_exact(K - (omega**2)[:, None, None] * M, index, functions)

    def dynamic_mass(self, index: Array, omega: Array) -> Array:
        """M(ω) = −∂D/∂(ω²) (b, n, n), with the arguments of `dynamic_stiffness`: thesis, Eq. (5.16)."""
        functions = [member.exact_mass(omega) for member in self.beams.exact_links]
        return self._with_exact(np.tensordot(self.terms[index], self.beams.mass, 2), index, functions)

    def interior_count(self, omega: Array) -> Array:
        """Number J0 (b,) of natural frequencies below ω (b,) of the elements with clamped ends (thesis, Eq.
        (5.21))."""
        counts = np.zeros(len(omega), dtype=int)
        for member in self.beams.exact_links:
            counts += member.interior_count(omega)
        return counts

    def expanded(self, vectors: Array) -> Array:
        """Vectors (m, N, k) in all degrees of freedom, from vectors (m, n, k) in the degrees of freedom that
        remain with inextensible links."""
        return vectors if self._free is None else self._free @ vectors

    @cached_property
    def joints(self) -> Array:
        """Positions x + iy of the joints in metres, as an array (m, joints). The first supported joint is at
        0; see `placed`."""
        return self.placed(self._spans)

    def placed(self, spans: Array) -> Array:
        """Return vectors x + iy (m, joints) of the joints, as sums of the vectors `spans` (m, links) along
        the links. The vector of the first joint with a rigid or elastic support is 0."""
        joints, anchored = self.beams.freedoms.joints, self.beams.freedoms.anchored
        still = np.zeros(len(self.phase), dtype=complex)
        located = {next((number for number, (name, _) in enumerate(joints) if name in anchored), 0): still}
        while len(located) < len(joints):
            before = len(located)
            for member, span in zip(self.beams.members, spans.T, strict=True):
                if member.start in located and member.end not in located:
                    located[member.end] = located[member.start] + span
                elif member.end in located and member.start not in located:
                    located[member.start] = located[member.end] - span
            if len(located) == before:
                located[next(number for number in range(len(joints)) if number not in located)] = still
        return np.stack([located[number] for number in range(len(joints))], axis=1)

    @property
    def _spans(self) -> Array:
        """Vectors x + iy from the start to the end of each link, as an array (m, links)."""
        return self.beams.properties.length * np.exp(1j * self.angle)

    def _with_exact(self, finite: Array, index: Array, functions: list[Array]) -> Array:
        """Matrices (b, n, n) of the structure, reduced for inextensible links. The contribution of the exact
        links is added to `finite` (b, N, N), the contribution of the finite elements. functions: for each
        exact link, the eight functions (b, 8)."""
        if functions:
            terms = self.terms[index][:, [member.number for member in self.beams.exact_links], None, :]
            weights = np.stack(functions, axis=1)[..., None] * terms
            finite = finite + np.tensordot(weights, self.beams.exact, 3)
        return self._reduced(finite, index)

    def _require_closed(self) -> None:
        """Raise StructureError unless the links meet at their joints, and supported joints do not move."""
        freedoms = self.beams.freedoms
        if not np.isfinite(self.angle).all():
            worst = self.phase[~np.isfinite(self.angle).all(axis=1)][0]
            raise StructureError(
                f"the links cannot be assembled at {np.degrees(worst):.6g} deg; choose lengths for "
                "which every loop closes at all positions"
            )
        allowed = ROUNDING * self.beams.properties.length.max()
        for member, span in zip(self.beams.members, self._spans.T, strict=True):
            missed = np.abs(self.joints[:, member.start] + span - self.joints[:, member.end]).max()
            if missed > allowed:
                raise StructureError(
                    f"link {member.link.name} misses joint {member.link.end} by {missed:.3g} m; "
                    "lengths and angles of the links must close every loop"
                )
        for (name, _), positions in zip(freedoms.joints, self.joints.T, strict=True):
            moved = np.abs(positions - positions[0]).max()
            if name in freedoms.anchored and moved > allowed and not self.beams.carried:
                raise StructureError(
                    f"joint {name} is supported, but the angles of the links move it by {moved:.3g} m; "
                    "correct the angles, or remove the support"
                )

    def _reduced(self, matrices: Array, index: Array | slice = slice(None)) -> Array:
        if self._free is None:
            return matrices
        free = self._free[index]
        return np.swapaxes(free, 1, 2) @ matrices @ free

    @cached_property
    def _free(self) -> Array | None:
        """Orthonormal basis (m, N, n) of the motions that do not stretch inextensible links; None if all
        links are extensible."""
        members = [member for member in self.beams.members if member.link.inextensible]
        rows = [row for member in members for row in self._ties(member.number)]
        if not rows:
            return None
        _, values, vectors = np.linalg.svd(np.stack(rows, axis=1), full_matrices=True)
        ranks = (values > ROUNDING * values[:, :1]).sum(axis=1)
        if np.ptp(ranks) > 0:
            worst = self.phase[ranks != ranks[0]][0]
            raise StructureError(
                f"at {np.degrees(worst):.6g} deg the inextensible links leave a different number of "
                "degrees of freedom than at other positions; make one of these links extensible"
            )
        return np.swapaxes(vectors[:, ranks[0] :], 1, 2)

    def _ties(self, number: int) -> list[Array]:
        """For each element of a link, rows (m, N) that measure the stretch between the two nodes of the
        element."""
        rows, angle = [], self.angle[:, number]
        for start, end in pairwise(self.beams.freedoms.nodes[number]):
            row = np.zeros((len(self.phase), self.beams.freedoms.n + 1))
            for node, sign in ((start, -1.0), (end, 1.0)):
                row[:, node.x] += sign * np.cos(angle)
                row[:, node.y] += sign * np.sin(angle)
            rows.append(row[:, :HELD])
        return rows
