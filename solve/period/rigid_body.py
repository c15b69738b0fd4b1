"""Rigid-body modes: constant directions e in which a machine moves without any restoring force, K(φ)e = 0
over the whole period, such as the rotation of a drive train that nothing holds."""

from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.period.multipliers import EPS

BOUND = 4e-12
"""Largest residual |K e| that counts as none, relative to Σ|K_ij e_j| of the same equation: four times the
relative error of the tables from which many points are solved (`solve.batch.tables`)."""

ROUNDING = 64 * EPS
"""The same relative to Σ(|M_ij| + |C_ij|)|e_j|, for entries that cancel to zero within round-off; as in
`solve.system`."""

_FEW = 16
"""Phases, at least, from which directions are computed; all phases verify them."""

_CONSTANT = 1e-9
"""Part of its terms by which a momentum's rate may differ from zero: what interpolation of smooth matrices
leaves."""

_PASSES = 3
"""Alternate scalings of columns and rows; more change the factors of usual machines by less than 2."""

_SMALL, _COMPARABLE = 1e-11, 0.03
"""Components of a unit vector: below the first they may be round-off; above the second all have 14 digits."""

_INTEGER = 16 * EPS
"""Distance from a whole number within which a component is that number."""


@dataclass(frozen=True)
class RigidBodyModes:
    """Rigid-body modes of P points, at most r each.

    vectors (P, n, r): e, with component 1 at its own coordinate of reference; columns of zeros where a point
    has fewer than r. references (P, r): these coordinates. damped (P, r): whether C e ≠ 0. errors (P, r):
    largest |K e| over the period, relative to Σ|K_ij e_j|. Modes without damping come first. momentum (P,
    2n): row ψ of a momentum ψ(q, q′) at phase 0 that is conserved though C e ≠ 0, as where C is the rate of a
    varying M; zero where there is none.
    """

    vectors: Array
    references: Array
    damped: Array
    errors: Array
    momentum: Array | None = None

    @classmethod
    def none(cls, count: int, n: int, r: int = 0) -> "RigidBodyModes":
        """Of points that have none."""
        return cls(
            np.zeros((count, n, r)),
            np.zeros((count, r), dtype=int),
            np.zeros((count, r), dtype=bool),
            np.zeros((count, r)),
        )

    def __len__(self) -> int:
        return len(self.vectors)

    def __getitem__(self, points: Array | slice) -> "RigidBodyModes":
        return RigidBodyModes(
            self.vectors[points],
            self.references[points],
            self.damped[points],
            self.errors[points],
            None if self.momentum is None else self.momentum[points],
        )

    @property
    def conserving(self) -> Array:
        """Which points have such a momentum (P,)."""
        if self.momentum is None:
            return np.zeros(len(self), dtype=bool)
        return np.asarray(self.momentum.any(axis=1))

    @property
    def dragged(self) -> Array:
        """Which modes (P, r) lose their momentum by drag."""
        return self.present & self.damped & ~self.conserving[:, None]

    @property
    def present(self) -> Array:
        """Which of the columns are modes (P, r)."""
        return np.asarray(self.vectors.any(axis=1))

    @property
    def measures(self) -> Array:
        """Rows l (P, r, n) that give a motion's share of each mode from the coordinates of reference alone:
        l_i e_j = 1 where i = j, else 0."""
        point, mode = np.arange(len(self))[:, None, None], np.arange(self.vectors.shape[2])
        both = self.present[:, :, None] & self.present[:, None]
        at_references = self.vectors[point, self.references[..., None], mode]
        inverse = np.linalg.inv(np.where(both, at_references, np.eye(len(mode)))) * both
        made = np.zeros((len(self), len(mode), self.vectors.shape[1]))
        np.add.at(made, (point, mode[:, None], self.references[:, None]), inverse)
        return made

    def weighted(self, mass: Array) -> Array:
        """Rows l (P, r, n) as `measures`, by which motions relative to the modes have no momentum with a mass
        matrix (P, n, n)."""
        rows, count = np.swapaxes(self.vectors, 1, 2) @ mass, self.vectors.shape[2]
        both = self.present[:, :, None] & self.present[:, None]
        return np.linalg.solve(np.where(both, rows @ self.vectors, np.eye(count)), rows)

    @property
    def relative(self) -> tuple[Array, Array]:
        """Projections I - Σ e l (P, n, n) onto coordinates relative to the modes, and 1 for coordinates (P,
        n) but those of reference, which are 0 relative to the modes."""
        kept = np.ones(self.vectors.shape[:2])
        at, mode = np.nonzero(self.present)
        kept[at, self.references[at, mode]] = 0.0
        return np.eye(self.vectors.shape[1]) - self.vectors @ self.measures, kept

    @property
    def any(self) -> Array:
        """Which points have one or more (P,)."""
        return np.asarray(self.present.any(axis=1))

    @property
    def multiplicity(self) -> Array:
        """How many Floquet multipliers +1 belong to the modes (P,): two each, one with drag."""
        return np.asarray((self.present * (2 - self.dragged)).sum(axis=1))


@dataclass(frozen=True)
class Free:
    """Rigid-body modes of points, and their mean mass matrices (P, n, n) in any unit."""

    modes: RigidBodyModes
    mass: Array

    def __getitem__(self, points: Array | slice) -> "Free":
        return Free(self.modes[points], self.mass[points])


def rigid_body_modes(K: Array, C: Array, M: Array | None = None) -> RigidBodyModes:
    """Of K, C and M (P, k, n, n) at k phases, all for derivatives by one variable, the phase or the time.

    M: where given, entries of K and C that are round-off of the inertia count as zero. The result does not
    depend on units of coordinates and equations, and has r = 0 columns where no point has such a mode.

    >>> chain = np.array([[[[2.0, -2.0], [-2.0, 2.0]]]])
    >>> rigid_body_modes(chain, 0 * chain).vectors[0].T
    array([[1., 1.]])
    """
    count, _, n, _ = K.shape
    inertia = 0.0 if M is None else np.abs(M).max(axis=1)
    noise = ROUNDING * (inertia + np.abs(C).max(axis=1))
    of_damping = ROUNDING * (inertia + np.abs(K).max(axis=1))
    found = {}
    finite = np.asarray(np.isfinite(K).all(axis=(1, 2, 3)) & np.isfinite(noise).all(axis=(1, 2)))
    for at in np.flatnonzero(finite & may_be_singular(K[:, 0], noise)).tolist():
        modes = _of_point(K[at], C[at], noise[at], of_damping[at])
        if modes.vectors.shape[-1]:
            found[at] = modes
    made = RigidBodyModes.none(count, n, max((one.vectors.shape[-1] for one in found.values()), default=0))
    for at, one in found.items():
        r = one.vectors.shape[-1]
        made.vectors[at, :, :r], made.references[at, :r] = one.vectors[0], one.references[0]
        made.damped[at, :r], made.errors[at, :r] = one.damped[0], one.errors[0]
    return made


def conserved_momentum(M: Array, C: Array, K: Array, modes: RigidBodyModes, period: float) -> Array:
    """`RigidBodyModes.momentum` (P, 2n) of points with M, C, K (P, k, n, n) at the middles of k equal parts
    of the period, without jumps, all for derivatives by the phase.

    Of g with gᵀK = 0 the product with the equations is a total derivative, (gᵀM q′ + bᵀq)′ = gᵀd, where
    b = Cᵀg - (Mg)′ is constant; where bᵀe = 0 besides, a rigid-body motion changes it by its velocity alone.
    Looked for where a point has a single mode.
    """
    count, phases, n, _ = M.shape
    found = np.zeros((count, 2 * n))
    orders = np.fft.rfftfreq(phases, 1 / phases)
    first = np.exp(-1j * np.pi * orders / phases)
    single = (modes.present.sum(axis=1) == 1) & (modes.present & modes.damped).any(axis=1)
    for at in np.flatnonzero(single).tolist():
        left = rigid_body_modes(np.swapaxes(K[at : at + 1], -1, -2), 0 * C[at : at + 1], M[at : at + 1])
        if left.present.sum() != 1:
            continue
        g, e = left.vectors[0, :, 0], modes.vectors[at, :, int(modes.present[at].argmax())]
        series = np.fft.rfft(g @ M[at], axis=0)
        rate = np.fft.irfft(series * (2j * np.pi / period * orders)[:, None], phases, axis=0)
        damping = g @ C[at]
        b = damping - rate
        size = _CONSTANT * (np.abs(damping) + np.abs(rate)).max(axis=0)
        mean = b.mean(axis=0)
        if (np.abs(b - mean) <= size).all() and abs(mean @ e) <= size @ np.abs(e):
            start = np.fft.irfft(series * first[:, None], phases, axis=0)[0]
            found[at] = np.concatenate((mean, start))
    return found


def still_rigid(K: Array, C: Array, M: Array, modes: RigidBodyModes) -> Array:
    """Whether K e = 0 holds for all modes of points at further phases too (P,); K, C, M (P, k, n, n)."""
    allowed = BOUND * np.abs(K).max(axis=1) + ROUNDING * (np.abs(M) + np.abs(C)).max(axis=1)
    residual = np.abs(K @ modes.vectors[:, None]).max(axis=1)
    return np.asarray((residual <= allowed @ np.abs(modes.vectors)).all(axis=(1, 2)))


def may_be_singular(K: Array, noise: Array) -> Array:
    """Whether matrices (P, n, n) may be singular within a change of their entries by `BOUND` of themselves
    (P,), which changes the determinant by no more than n BOUND times the product of sums of rows."""
    with np.errstate(invalid="ignore", over="ignore"):
        sums = np.abs(K).sum(axis=-1)
        weak = (sums <= noise.sum(axis=-1)).any(axis=-1)
        scale = np.where(sums > 0, sums, 1.0)
        determinant = np.abs(np.linalg.det(K / scale[..., None]))
        largest = noise.max(axis=(-2, -1)) / scale.min(axis=-1)
        return np.asarray(weak | (determinant <= 2 * K.shape[-1] * (BOUND + largest)))


def _of_point(K: Array, C: Array, noise: Array, noise_of_damping: Array) -> RigidBodyModes:
    """Of one point with K and C (k, n, n), and the round-off (n, n) of either."""
    n, few = K.shape[-1], max(1, len(K) // _FEW)
    size = np.abs(K).max(axis=0)

    def verified(vectors: Array) -> Array:
        return (np.abs(K @ vectors).max(axis=0) <= (BOUND * size + noise) @ np.abs(vectors)).all(axis=0)

    vectors = _null_space(K[::few], size, noise)
    if vectors.shape[1] > 1 and not verified(vectors).all():
        vectors = _null_space(K, size, noise)
    vectors = vectors[:, verified(vectors)]
    if not vectors.shape[1]:
        return RigidBodyModes.none(1, n)
    free = _undamped(vectors, C, noise_of_damping)
    held, places = _reduced(free)
    rest = vectors - held @ vectors[places]
    damped, others = _reduced(_independent(rest, vectors.shape[1] - held.shape[1]))
    vectors = np.concatenate((held, damped), axis=1)
    residual, scale = np.abs(K @ vectors).max(axis=0), size @ np.abs(vectors)
    errors = (residual / np.where(scale > 0, scale, 1.0)).max(axis=0)
    references = np.concatenate((places, others))
    return RigidBodyModes(
        vectors[None], references[None], (np.arange(len(references)) >= len(places))[None], errors[None]
    )


def _null_space(K: Array, size: Array, noise: Array) -> Array:
    """Directions (n, r) in which matrices (k, n, n) of sizes (n, n) vanish, in whatever units."""
    columns, rows = np.ones(len(size)), np.ones(len(size))
    for _ in range(_PASSES):
        columns /= _largest(size * rows[:, None] * columns, 0)
        rows /= _largest(size * rows[:, None] * columns, 1)
    K = np.where(size > noise, K, 0.0)
    found = np.empty((0, len(size)))
    for _ in range(_PASSES):
        scaled = (K * rows[:, None] * columns).reshape(-1, len(size))
        _, values, right = np.linalg.svd(scaled, full_matrices=False)
        found = right[values <= BOUND * max(float(values[0]), 1.0)]
        moved = np.linalg.norm(found, axis=0)
        if not len(found) or moved[moved > _SMALL].min() > _COMPARABLE:
            break
        # Small components have few digits: with columns as large as these, none is small.
        columns = columns * np.where(moved > _SMALL, moved, 1.0)
        rows = rows / _largest(size * rows[:, None] * columns, 1)
    return columns[:, None] * found.T


def _largest(sizes: Array, axis: int) -> Array:
    found = sizes.max(axis=axis)
    return np.where(found > 0, found, 1.0)


def _undamped(vectors: Array, C: Array, noise: Array) -> Array:
    """Combinations (n, u) of directions (n, r) on which C (k, n, n) does not act either."""
    acting = C @ vectors
    allowed = (BOUND * np.abs(C).max(axis=0) + noise) @ np.abs(vectors)
    if (np.abs(acting) <= allowed).all():
        return vectors
    limit = allowed.max(axis=1, keepdims=True)
    weighted = np.where(limit > 0, acting / np.where(limit > 0, limit, 1.0), 0.0)
    _, values, right = np.linalg.svd(weighted.reshape(-1, vectors.shape[1]), full_matrices=False)
    return vectors @ right[values <= np.sqrt(len(weighted) * len(limit))].T


def _independent(vectors: Array, count: int) -> Array:
    """As given by the count, independent columns (n, count) that span the same as columns (n, r)."""
    if count == 0:
        return vectors[:, :0]
    units = _largest(np.abs(vectors), 1)
    left, _, _ = np.linalg.svd(vectors / units[:, None], full_matrices=False)
    return units[:, None] * left[:, :count]


def _reduced(vectors: Array) -> tuple[Array, Array]:
    """A basis (n, r) of the space of columns with the identity at r places (r,), by complete pivoting."""
    made, places = vectors.copy(), np.zeros(vectors.shape[1], dtype=int)
    for column in range(made.shape[1]):
        sizes = np.abs(made[:, column:])
        place, other = np.unravel_index(int(sizes.argmax()), sizes.shape)
        made[:, [column, column + int(other)]] = made[:, [column + int(other), column]]
        made[:, column] /= made[place, column]
        others = np.arange(made.shape[1]) != column
        made[:, others] -= made[:, [column]] * made[place, others]
        places[column] = place
    whole = np.round(made)
    return np.where(np.abs(made - whole) <= _INTEGER * np.maximum(np.abs(whole), 1.0), whole, made), places
