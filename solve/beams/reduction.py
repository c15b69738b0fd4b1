"""Reduction of the links of a structure to interface coordinates and lowest modes.

The basis of a link is constant in the axes of the link. In ground axes, q = T(φ) p, where p contains the
retained coordinates of the structure, in ground axes, and the amplitudes of the modes. The matrix R, with R′
= J R, transforms from ground axes to the axes of a link, and T_l is the constant basis of the link. The rows
of the link in T and in its first and second derivatives with respect to the angle of the link are Rᵀ T_l R_r,
Rᵀ B R_r and Rᵀ B₂ R_r with

    B = Jᵀ T_l + T_l J_r        B₂ = Jᵀ B + B J_r

where R_r and J_r are R and J for the retained coordinates; for the modes, they are 1 and 0."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from solve.arrays import Array
from solve.beams.assembly import TERMS, Beams, Positions
from solve.beams.element import AXIAL
from solve.beams.links import Freedoms, Member
from solve.errors import ValueOutOfBoundsError
from solve.model.craig_bampton import craig_bampton, static_shapes


@dataclass(frozen=True)
class Body:
    """Matrices of a link in link axes, for its degrees of freedom that are not fixed.

    freedoms (k,): indices of these degrees of freedom in the structure. axes (3, k, k): coefficients of R =
    axes[0] + c axes[1] + s axes[2]. interface (b,): positions of the retained coordinates in `freedoms`."""

    member: Member
    freedoms: Array
    axes: Array
    interface: Array

    @classmethod
    def from_member(cls, member: Member, retained: Array) -> "Body":
        """Body for a link. retained (n,): mask of the interface coordinates among the degrees of freedom of
        the structure."""
        indices = np.unique(member.indices[member.indices >= 0])
        axes = np.zeros((3, len(indices), len(indices)))
        body = cls(member, indices, axes, np.flatnonzero(retained[indices]))
        for rows, fixed in body._rows():
            free = np.flatnonzero(~fixed)
            axes[:, rows[free][:, None], rows[free]] = member.element.axes[:, free[:, None], free]
        return body

    def assembled(self, local: Array) -> Array:
        """Matrix (k, k) of a link whose elements all have the matrix `local` (f, f)."""
        return self.assembled_singly(local).sum(axis=0)

    def assembled_singly(self, local: Array) -> Array:
        """Contributions (elements, k, k) of each element to the matrix (k, k) of the link."""
        matrices = np.zeros((self.member.count, len(self.freedoms) + 1, len(self.freedoms) + 1))
        for matrix, (rows, _) in zip(matrices, self._rows(), strict=True):
            matrix[rows[:, None], rows] += local
        return matrices[:, :-1, :-1]

    @property
    def loads(self) -> Array:
        """Inertia loads (k, 4) of four accelerations of the rigid link. The first two accelerations are
        directed along the axis, the last two across it. In each pair, the first is uniform, and the second
        increases linearly along the link."""
        member, loads = self.member, np.zeros((len(self.freedoms) + 1, 4))
        for number, (rows, _) in enumerate(self._rows()):
            shapes = np.zeros((len(rows), 4))
            for i, freedom in enumerate(member.element.freedoms):
                along = 0 if freedom.direction == AXIAL else 2
                if freedom.order == 0:
                    shapes[i, along] = 1.0
                    shapes[i, along + 1] = (number + freedom.xi) * member.L
                elif freedom.order == 1:
                    shapes[i, along + 1] = 1.0
            loads[rows] += member.mass @ shapes
        return loads[:-1]

    def _rows(self) -> list[tuple[Array, Array]]:
        """For each element: indices of its degrees of freedom in `freedoms`, and a mask of the fixed degrees
        of freedom, whose index is len(freedoms)."""
        indices = self.member.indices
        return [
            (np.where(row < 0, len(self.freedoms), np.searchsorted(self.freedoms, row)), row < 0)
            for row in indices
        ]


@dataclass(frozen=True)
class LinkBasis:
    """Basis of a link for its reduced coordinates: interface coordinates, followed by amplitudes of modes.

    local (k, r): T_l. at (r,): indices of the reduced coordinates of the link among those of the structure.
    frequencies (modes,): frequencies of the retained modes in rad/s. discarded: lowest frequency of the
    discarded modes; infinite if there are none."""

    body: Body
    local: Array
    at: Array
    frequencies: Array
    discarded: float

    @cached_property
    def axes(self) -> Array:
        """Coefficients (3, r, r) of 1, c and s in R_r."""
        b, r = len(self.body.interface), self.local.shape[1]
        axes = np.zeros((3, r, r))
        axes[:, :b, :b] = self.body.axes[:, self.body.interface[:, None], self.body.interface]
        axes[0, range(b, r), range(b, r)] = 1.0
        return axes

    @cached_property
    def turned(self) -> tuple[Array, Array]:
        """Matrices B and B₂ (k, r) for the first and second derivatives of the basis with respect to the
        angle of the link."""
        J, J_r = self.body.axes[2], self.axes[2]
        B = J.T @ self.local + self.local @ J_r
        return B, J.T @ B + B @ J_r

    def reduced(self, A: Array, left: Array | None = None, right: Array | None = None) -> Array:
        """Table (5, r, r) of Rᵀ leftᵀ A right R in ground axes, for a matrix A (k, k) of the link: the
        coefficients of 1, c, s, c², cs. By default, `left` and `right` are T_l."""
        local = (self.local if left is None else left).T @ A @ (self.local if right is None else right)
        return np.einsum("tij,iba,bc,jcd->tad", TERMS, self.axes, local, self.axes, optimize=True)

    def expanding(self, local: Array) -> Array:
        """Return the products Rᵀ `local` R_r for `local` (k, r) as a table (5, k, r) of the coefficients of
        1, c, s, c², cs. The rows of the interface are zero."""
        table = np.einsum("tij,iba,bc,jcd->tad", TERMS, self.body.axes, local, self.axes, optimize=True)
        table[:, self.body.interface] = 0.0
        return table


@dataclass(frozen=True)
class Basis:
    """Basis T(φ) of a structure, (n, r) at each position.

    retained (b,): indices of the retained degrees of freedom, which are the first reduced coordinates. names,
    units, meanings (r,): names, units and meanings of the reduced coordinates."""

    beams: Beams
    retained: Array
    links: Sequence[LinkBasis]

    @property
    def r(self) -> int:
        """Number of reduced coordinates."""
        return len(self.retained) + sum(len(link.at) - len(link.body.interface) for link in self.links)

    @property
    def declared(self) -> list[tuple[str, str, str]]:
        """Name, unit and meaning of each reduced coordinate."""
        freedoms = self.beams.freedoms
        declared = [
            (freedoms.names[at], freedoms.units[at], "displacement from the rigid motion")
            for at in self.retained
        ]
        for basis in self.links:
            link = basis.body.member.link.name
            for number in range(len(basis.at) - len(basis.body.interface)):
                meaning = f"largest deflection of {link} in its mode {number + 1}, ends fixed"
                declared.append((f"{link}_mode_{number + 1}", "m", meaning))
        return declared

    def spread(self, tables: Sequence[Array]) -> Array:
        """Table (links, 5, …, …) of a structure, from one table (5, …, …) per link."""
        spread = np.zeros((len(self.links), 5, self.r, self.r))
        for target, link, table in zip(spread, self.links, tables, strict=True):
            target[:, link.at[:, None], link.at] += table
        return spread

    @cached_property
    def tables(self) -> tuple[Array, Array, Array]:
        """Tables (links, 5, n, r) of T, B and B₂."""
        tables = np.zeros((3, len(self.links), 5, self.beams.freedoms.n, self.r))
        for number, link in enumerate(self.links):
            rows, columns = link.body.freedoms[:, None], link.at
            for table, local in zip(tables, (link.local, *link.turned), strict=True):
                table[number][:, rows, columns] += link.expanding(local)
        # Retained coordinates are the same in q and p.
        tables[0, 0, 0, self.retained, np.arange(len(self.retained))] = 1.0
        T, B, B2 = tables
        return T, B, B2

    def at(self, positions: Positions) -> Array:
        """Basis T (m, n, r) at m positions."""
        return np.tensordot(positions.terms, self.tables[0], 2)

    def rates(self, positions: Positions, rate: Array, second: Array) -> tuple[Array, Array]:
        """Derivatives Ṫ and T̈, (m, n, r) each. `rate` and `second` (m, links) are the first and second
        derivatives of the angles of the links."""
        _, B, B2 = self.tables
        first, turned, squared = (factor[..., None] * positions.terms for factor in (rate, second, rate**2))
        return np.tensordot(first, B, 2), np.tensordot(turned, B, 2) + np.tensordot(squared, B2, 2)


def retained_freedoms(freedoms: Freedoms) -> Array:
    """Mask (n,) of the interface coordinates: displacements of the joints, and rotations that several links
    share or on which springs or dashpots act. If these coordinates are fixed, no link can move rigidly."""
    ends = [set(rows[rows >= 0].tolist()) for rows in freedoms.indices]
    mask = np.array([sum(index in link for link in ends) > 1 for index in range(freedoms.n)])
    mask[freedoms.joint_indices[freedoms.joint_indices >= 0]] = True
    mask[[freedoms.names.index(name) for name in (*freedoms.springs, *freedoms.dashpots)]] = True
    return mask


def basis(beams: Beams, modes: int, static: bool = False) -> Basis:
    """Basis with `modes` modes per link; links with fewer modes have all of them.

    static: whether the static shapes of the discarded modes are added. Raises ValueOutOfBoundsError if no
    link has that many modes."""
    retained = retained_freedoms(beams.freedoms)
    bodies = [Body.from_member(member, retained) for member in beams.members]
    most = max(len(body.freedoms) - len(body.interface) for body in bodies)
    if not 1 <= modes <= most:
        raise ValueOutOfBoundsError(
            f"reduce is {modes}; allowed: 1 to {most} modes per link for these elements; {most} retains all "
            "modes"
        )
    interface = np.flatnonzero(retained)
    links, end = [], len(interface)
    for body in bodies:
        link = _link_basis(
            body, modes, static, np.searchsorted(interface, body.freedoms[body.interface]), end
        )
        links.append(link)
        end += len(link.at) - len(body.interface)
    return Basis(beams, interface, links)


def _link_basis(body: Body, modes: int, static: bool, at: Array, end: int) -> LinkBasis:
    """Basis of a link. at (b,): indices of the interface coordinates among the reduced coordinates. end:
    index of the first mode."""
    M, K = body.assembled(body.member.mass), body.assembled(body.member.stiffness)
    reduced = craig_bampton(M, K, body.interface, min(modes, len(body.freedoms) - len(body.interface)))
    local, b = reduced.basis, len(body.interface)
    if static:
        loads = np.concatenate((M @ local[:, :b], body.loads), axis=1)
        local = np.concatenate((local, static_shapes(K, local, body.interface, loads)), axis=1)
    scales = np.array([_largest(body, shape) for shape in local[:, b:].T])
    local = np.concatenate((local[:, :b], local[:, b:] / scales), axis=1)
    at = np.concatenate((at, end + np.arange(local.shape[1] - b)))
    return LinkBasis(body, local, at, reduced.frequencies, reduced.discarded)


_POINTS = 33
"""Number of points per element at which the largest deflection is sought."""


def _largest(body: Body, shape: Array) -> float:
    """Displacement with the largest modulus in a shape (k,) of a link."""
    member, xi = body.member, np.linspace(0.0, 1.0, _POINTS)
    values = np.append(shape, 0.0)
    pieces = [shapes @ values[rows] for rows, _ in body._rows() for shapes in member.shapes(xi)]
    curve = np.concatenate(pieces)
    # Of several equal extrema, the first is selected, so that the result does not depend on round-off.
    return float(curve[np.flatnonzero(np.abs(curve) > (1 - 1e-6) * np.abs(curve).max())[0]])
