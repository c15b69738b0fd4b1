"""Matrices of a whole structure for all positions at once.

In ground axes a local matrix A of a link at angle θ becomes RᵀAR, which is affine in 1, c, s, c², cs with
c = cos θ, s = sin θ (thesis (4.28)). So a structure's matrix is a constant table for each of these and
each link, and all positions together are one matrix product.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.beams.elements import AXIAL, Freedom
from solve.beams.freedoms import HELD, Freedoms

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
