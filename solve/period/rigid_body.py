"""Rigid-body modes: constant vectors e with K(φ) e = 0 over the whole period.

The machine moves along e without a restoring force, for example in the rotation of a drive train without a
spring to ground."""

from dataclasses import dataclass, replace

import numpy as np

from solve.arrays import EPS, Array
from solve.period.multipliers import UNIT_CIRCLE

BOUND = 4e-12
"""Largest residual |K e|, relative to Σ|K_ij e_j| of the same equation, that counts as zero: four times the
relative error of the tables from which many points are solved (`solve.batch.tables`)."""

ROUNDING = 64 * EPS
"""Largest residual |K e| that counts as zero for entries that cancel within round-off, relative to Σ(|M_ij| +
|C_ij|)|e_j|. `solve.system` uses the same value."""

_FEW = 16
"""Minimum number of phases from which modes are computed. The modes are verified at all phases."""

_CONSTANT = 1e-9
"""Rate of change of a momentum, relative to its terms, below which the momentum counts as conserved. It is
the interpolation error for smooth matrices."""

_PASSES = 3
"""Number of scalings of the columns and rows in alternation. For typical machines, further scalings change
the factors by less than a factor of 2."""

_SMALL, _COMPARABLE = 1e-11, 0.03
"""Thresholds for the components of a unit vector. Below the first, a component may be round-off. If all
components exceed the second, all are accurate to 14 digits."""

_INTEGER = 16 * EPS
"""Relative distance from an integer within which a component is rounded to that integer."""


@dataclass(frozen=True)
class RigidBodyModes:
    """Rigid-body modes of P points, at most r per point.

    vectors (P, n, r): modes e, with component 1 at the reference coordinate; columns are zero if a point has
    fewer than r modes. references (P, r): indices of the reference coordinates. damped (P, r): whether C e ≠
    0; undamped modes come first. errors (P, r): largest |K e| over the period, relative to Σ|K_ij e_j|.
    momentum (P, 2n): row ψ for which ψ(q, q′) is a momentum at phase 0 that is conserved although C e ≠ 0,
    for example because C is the rate of a varying M; zero without such a momentum."""

    vectors: Array
    references: Array
    damped: Array
    errors: Array
    momentum: Array | None = None

    @classmethod
    def none(cls, count: int, n: int, r: int = 0) -> "RigidBodyModes":
        """Instance without modes for `count` points."""
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

    def of_one_kind(self, first_order: int) -> "RigidBodyModes":
        """Only those modes that move either first-order or second-order coordinates, not both. The
        first-order coordinates come last."""
        if not first_order:
            return self
        moves = self.vectors != 0
        mixed = moves[:, :-first_order].any(axis=1) & moves[:, -first_order:].any(axis=1)
        return replace(self, vectors=np.where(mixed[:, None], 0.0, self.vectors))

    @property
    def conserving(self) -> Array:
        """Mask (P,) of the points with a conserved momentum."""
        if self.momentum is None:
            return np.zeros(len(self), dtype=bool)
        return np.asarray(self.momentum.any(axis=1))

    @property
    def dragged(self) -> Array:
        """Mask (P, r) of the modes that are damped by drag."""
        return self.present & self.damped & ~self.conserving[:, None]

    @property
    def present(self) -> Array:
        """Mask (P, r) of the columns that contain a mode."""
        return np.asarray(self.vectors.any(axis=1))

    @property
    def measures(self) -> Array:
        """Rows l (P, r, n) with nonzero entries at the reference coordinates only and l_i e_j = δ_ij. The
        product l q is the amplitude of a mode."""
        point, mode = np.arange(len(self))[:, None, None], np.arange(self.vectors.shape[2])
        both = self.present[:, :, None] & self.present[:, None]
        at_references = self.vectors[point, self.references[..., None], mode]
        inverse = np.linalg.inv(np.where(both, at_references, np.eye(len(mode)))) * both
        rows = np.zeros((len(self), len(mode), self.vectors.shape[1]))
        np.add.at(rows, (point, mode[:, None], self.references[:, None]), inverse)
        return rows

    def weighted(self, mass: Array) -> Array:
        """Return the rows l (P, r, n) with l_i e_j = δ_ij that measure the amplitudes l q of the modes e. The
        relative motion q - Σ e_i l_i q has no momentum along the modes. `mass` (P, n, n) is the mass
        matrix."""
        rows, count = np.swapaxes(self.vectors, 1, 2) @ mass, self.vectors.shape[2]
        both = self.present[:, :, None] & self.present[:, None]
        return np.linalg.solve(np.where(both, rows @ self.vectors, np.eye(count)), rows)

    @property
    def relative(self) -> tuple[Array, Array]:
        """Return projections I - Σ e l (P, n, n) onto coordinates relative to the modes, and a mask (P, n).

        The mask is 0 for reference coordinates, which are zero relative to the modes, and 1 for the others.
        """
        mask = np.ones(self.vectors.shape[:2])
        point, mode = np.nonzero(self.present)
        mask[point, self.references[point, mode]] = 0.0
        return np.eye(self.vectors.shape[1]) - self.vectors @ self.measures, mask

    @property
    def any(self) -> Array:
        """Mask (P,) of the points with rigid-body modes."""
        return np.asarray(self.present.any(axis=1))

    @property
    def multiplicity(self) -> Array:
        """Number (P,) of Floquet multipliers +1 due to the modes: two for each mode, or one for each mode
        with drag."""
        return np.asarray((self.present * (2 - self.dragged)).sum(axis=1))


@dataclass(frozen=True)
class Free:
    """Rigid-body modes of P points, and their mean mass matrices (P, n, n) in any unit."""

    modes: RigidBodyModes
    mass: Array

    def __getitem__(self, points: Array | slice) -> "Free":
        return Free(self.modes[points], self.mass[points])


def before_rigid(multipliers: Array) -> int:
    """Number of `multipliers` (N,) outside the unit circle. They precede the multipliers +1 of rigid-body
    modes."""
    return int(np.sum(np.abs(multipliers) > 1 + UNIT_CIRCLE))


def rigid_body_modes(K: Array, C: Array, M: Array | None = None) -> RigidBodyModes:
    """Rigid-body modes from K, C and M (P, k, n, n) at k phases. Derivatives are with respect to the phase or
    to time.

    If M is given, entries of K and C that are round-off of the inertia count as zero. The result does not
    depend on the units of coordinates and equations. The vectors have no column (r = 0) if no point has a
    mode.

    >>> chain = np.array([[[[2.0, -2.0], [-2.0, 2.0]]]])
    >>> rigid_body_modes(chain, 0 * chain).vectors[0].T
    array([[1., 1.]])
    """
    count, _, n, _ = K.shape
    inertia = 0.0 if M is None else np.abs(M).max(axis=1)
    noise = ROUNDING * (inertia + np.abs(C).max(axis=1))
    damping_noise = ROUNDING * (inertia + np.abs(K).max(axis=1))
    by_point = {}
    finite = np.asarray(np.isfinite(K).all(axis=(1, 2, 3)) & np.isfinite(noise).all(axis=(1, 2)))
    for point in np.flatnonzero(finite & may_be_singular(K[:, 0], noise)).tolist():
        modes = _of_point(K[point], C[point], noise[point], damping_noise[point])
        if modes.vectors.shape[-1]:
            by_point[point] = modes
    largest = max((modes.vectors.shape[-1] for modes in by_point.values()), default=0)
    result = RigidBodyModes.none(count, n, largest)
    for point, modes in by_point.items():
        r = modes.vectors.shape[-1]
        result.vectors[point, :, :r], result.references[point, :r] = modes.vectors[0], modes.references[0]
        result.damped[point, :r], result.errors[point, :r] = modes.damped[0], modes.errors[0]
    return result


def with_unit_states(mass: Array, first_order: int) -> Array:
    """Mass matrices (P, n, n) in which the diagonal entries of first-order coordinates (the last coordinates)
    are 1.

    If the block of the other coordinates is not positive definite, for example because the equations are in
    another order, it is replaced by the identity."""
    if not first_order:
        return mass
    n, p = mass.shape[-1], mass.shape[-1] - first_order
    filled = np.broadcast_to(np.eye(n), mass.shape).copy()
    symmetric = (mass[:, :p, :p] + np.swapaxes(mass[:, :p, :p], 1, 2)) / 2
    positive = (np.linalg.eigvalsh(symmetric) > 0).all(axis=1) if p else np.ones(len(mass), dtype=bool)
    filled[positive, :p, :p] = mass[positive, :p, :p]
    return filled


def conserved_momentum(M: Array, C: Array, K: Array, modes: RigidBodyModes, period: float) -> Array:
    """Return the rows `momentum` (P, 2n) of `RigidBodyModes`. M, C, K (P, k, n, n), which must not jump, are
    the matrices at the midpoints of k equal intervals of the period. Derivatives are with respect to the
    phase.

    Let e be the rigid-body mode, g a vector with gᵀK = 0, and b = Cᵀg - (Mᵀg)′. If b is constant, the product
    of gᵀ and the equations is (gᵀM q′ + bᵀq)′ = gᵀd: the momentum gᵀM q′ + bᵀq is conserved if gᵀd = 0. If
    also bᵀe = 0, a rigid-body motion changes this momentum only through its velocity. Only points with a
    single mode are examined."""
    count, phases, n, _ = M.shape
    momentum = np.zeros((count, 2 * n))
    harmonics = np.fft.rfftfreq(phases, 1 / phases)
    to_start = np.exp(-1j * np.pi * harmonics / phases)
    single = (modes.present.sum(axis=1) == 1) & (modes.present & modes.damped).any(axis=1)
    for point in np.flatnonzero(single).tolist():
        one = slice(point, point + 1)
        left_modes = rigid_body_modes(np.swapaxes(K[one], -1, -2), 0 * C[one], M[one])
        if left_modes.present.sum() != 1:
            continue
        g, e = left_modes.vectors[0, :, 0], modes.vectors[point, :, int(modes.present[point].argmax())]
        series = np.fft.rfft(g @ M[point], axis=0)
        rate = np.fft.irfft(series * (2j * np.pi / period * harmonics)[:, None], phases, axis=0)
        damping = g @ C[point]
        b = damping - rate
        size = _CONSTANT * (np.abs(damping) + np.abs(rate)).max(axis=0)
        mean = b.mean(axis=0)
        if (np.abs(b - mean) <= size).all() and abs(mean @ e) <= size @ np.abs(e):
            start = np.fft.irfft(series * to_start[:, None], phases, axis=0)[0]
            momentum[point] = np.concatenate((mean, start))
    return momentum


def still_rigid(K: Array, C: Array, M: Array, modes: RigidBodyModes) -> Array:
    """Return a mask (P,) of the points at which K e = 0 for all modes e at k further phases. K, C and M (P,
    k, n, n) are the matrices at these phases."""
    allowed = BOUND * np.abs(K).max(axis=1) + ROUNDING * (np.abs(M) + np.abs(C)).max(axis=1)
    residual = np.abs(K @ modes.vectors[:, None]).max(axis=1)
    return np.asarray((residual <= allowed @ np.abs(modes.vectors)).all(axis=(1, 2)))


def may_be_singular(K: Array, noise: Array) -> Array:
    """Return a mask (P,) of the points at which a relative change of the entries by `BOUND` may make the
    matrix K (n, n) singular.

    Such a change alters the determinant by at most n BOUND times the product of the row sums."""
    with np.errstate(invalid="ignore", over="ignore"):
        sums, noises = np.add.reduce((np.abs(K), noise), axis=-1)
        scale = np.where(sums > 0, sums, 1.0)
        determinant = np.abs(np.linalg.det(K / scale[..., None]))
        largest = noise.max(axis=(-2, -1)) / scale.min(axis=-1)
        weak = (sums <= noises).any(axis=-1)
        return np.asarray(weak | (determinant <= 2 * K.shape[-1] * (BOUND + largest)))


def _of_point(K: Array, C: Array, noise: Array, damping_noise: Array) -> RigidBodyModes:
    """Rigid-body modes of one point, from K and C (k, n, n). `noise` and `damping_noise` (n, n) are their
    round-off errors."""
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
    undamped, rows = _reduced(_undamped(vectors, C, damping_noise))
    rest = vectors - undamped @ vectors[rows]
    damped, others = _reduced(_independent(rest, vectors.shape[1] - undamped.shape[1]))
    vectors = np.concatenate((undamped, damped), axis=1)
    residual, scale = np.abs(K @ vectors).max(axis=0), size @ np.abs(vectors)
    errors = (residual / np.where(scale > 0, scale, 1.0)).max(axis=0)
    references = np.concatenate((rows, others))
    return RigidBodyModes(
        vectors[None], references[None], (np.arange(len(references)) >= len(rows))[None], errors[None]
    )


def _null_space(K: Array, size: Array, noise: Array) -> Array:
    """Common null space (n, r) of k matrices K (k, n, n), computed independently of units. `size` (n, n):
    largest moduli of the entries. `noise` (n, n): round-off errors of the entries."""
    columns, rows = np.ones(len(size)), np.ones(len(size))
    for _ in range(_PASSES):
        columns /= _largest(size * rows[:, None] * columns, 0)
        rows /= _largest(size * rows[:, None] * columns, 1)
    K = np.where(size > noise, K, 0.0)
    null_vectors = np.empty((0, len(size)))
    for _ in range(_PASSES):
        scaled = (K * rows[:, None] * columns).reshape(-1, len(size))
        _, values, right = np.linalg.svd(scaled, full_matrices=False)
        null_vectors = right[values <= BOUND * max(float(values[0]), 1.0)]
        components = np.linalg.norm(null_vectors, axis=0)
        if not len(null_vectors) or components[components > _SMALL].min() > _COMPARABLE:
            break
        # Small components are inaccurate. They become comparable if columns are scaled by the components.
        columns = columns * np.where(components > _SMALL, components, 1.0)
        rows = rows / _largest(size * rows[:, None] * columns, 1)
    return columns[:, None] * null_vectors.T


def _largest(sizes: Array, axis: int) -> Array:
    largest = sizes.max(axis=axis)
    return np.where(largest > 0, largest, 1.0)


def _undamped(vectors: Array, C: Array, noise: Array) -> Array:
    """Linear combinations (n, u) of `vectors` (n, r) that are also in the null space of C (k, n, n)."""
    drag = C @ vectors
    allowed = (BOUND * np.abs(C).max(axis=0) + noise) @ np.abs(vectors)
    if (np.abs(drag) <= allowed).all():
        return vectors
    limit = allowed.max(axis=1, keepdims=True)
    weighted = np.where(limit > 0, drag / np.where(limit > 0, limit, 1.0), 0.0)
    _, values, right = np.linalg.svd(weighted.reshape(-1, vectors.shape[1]), full_matrices=False)
    return vectors @ right[values <= np.sqrt(len(weighted) * len(limit))].T


def _independent(vectors: Array, count: int) -> Array:
    """Linearly independent columns (n, count) with the same span as `vectors` (n, r)."""
    if count == 0:
        return vectors[:, :0]
    units = _largest(np.abs(vectors), 1)
    left, _, _ = np.linalg.svd(vectors / units[:, None], full_matrices=False)
    return units[:, None] * left[:, :count]


def _reduced(vectors: Array) -> tuple[Array, Array]:
    """Reduce `vectors` (n, r) by complete pivoting. Return a basis (n, r) of the column space, in which r
    rows are the identity, and the indices (r,) of these rows."""
    basis, rows = vectors.copy(), np.zeros(vectors.shape[1], dtype=int)
    for column in range(basis.shape[1]):
        sizes = np.abs(basis[:, column:])
        place, pivot = np.unravel_index(int(sizes.argmax()), sizes.shape)
        basis[:, [column, column + int(pivot)]] = basis[:, [column + int(pivot), column]]
        basis[:, column] /= basis[place, column]
        others = np.arange(basis.shape[1]) != column
        basis[:, others] -= basis[:, [column]] * basis[place, others]
        rows[column] = place
    rounded = np.round(basis)
    is_integer = np.abs(basis - rounded) <= _INTEGER * np.maximum(np.abs(rounded), 1.0)
    # Replaces −0.0, which output would show.
    return np.where(is_integer, rounded, basis) + 0.0, rows
