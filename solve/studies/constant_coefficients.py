"""Stability of systems with constant M, C and K, for any load, from the eigenvalues µ of µ²M + µC + K.

These systems have no parametric resonance and therefore no narrow tongues between speeds. Their eigenvalues
vary slowly with the speed or a parameter.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from solve.arrays import Array, solved
from solve.batch.batch import Batch
from solve.batch.family import Family, representative
from solve.batch.gathering import gathered
from solve.matrices import inertia_units, split_entries
from solve.methods.method import Method
from solve.period.multipliers import (
    ASYMPTOTICALLY_STABLE,
    EPS,
    KNOWN_ON_CIRCLE,
    STABLE,
    UNIT_CIRCLE,
    UNSTABLE,
)
from solve.period.natural import PERTURBATION
from solve.period.rigid_body import BOUND, RigidBodyModes, rigid_body_modes
from solve.results.points import Kept, PointResults
from solve.studies.stability_samples import StabilitySamples, evaluator

_TEST_FRACTIONS = np.array([0.0137, 0.2719, 0.5443, 0.8311])
"""Fractions of the period at which matrices are sampled to test whether they are constant."""

_CONSTANT = 1e-13
"""Variation of an entry over the period, relative to its magnitude, that counts as round-off. Parametric
excitation of this relative amplitude changes a mode by less than 1e-13 ω T / 2 per period, far below the
growth that counts as an unstable band."""

_ROUNDING = 64 * EPS
"""Asymmetry, or modulus of a negative eigenvalue, that counts as round-off, relative to the largest entry of
the matrix."""

_LARGEST = 300.0
"""Upper limit of growth exponents per period. It prevents overflow of the moduli of multipliers."""


class Exponents(NamedTuple):
    """Characteristic exponents µ (P, N), per radian of the phase: real parts `growth` in descending order,
    imaginary parts `angular_rates`, and `errors` of the real parts. All are NaN at points whose matrices are
    not constant."""

    growth: Array
    angular_rates: Array
    errors: Array


@dataclass(frozen=True)
class ConstantCoefficients:
    """Stability of points with constant matrices. Points whose matrices vary, or whose eigenvalues are too
    uncertain, are solved by `batch`. `multiplicity` is the number of multipliers +1 of rigid-body modes;
    `unit` is a time in seconds; the product of any frequency in rad/s and this time is an angle below π."""

    batch: Batch
    multiplicity: int
    unit: float

    @property
    def family(self) -> Family:
        """Parameter family to which the points belong."""
        return self.batch.family

    def evaluate(self, points: Array) -> StabilitySamples:
        """Return the stability at points (k, v).

        The moduli of the multipliers are exact. The angles are not exact: the frequency (rad/s) of each
        exponent is multiplied by the fixed time `unit`, and not by the period. Two multipliers therefore
        coincide only if their exponents coincide.
        """
        exponents, period = self.exponents(points), self.family.example.period
        growth, errors = exponents.growth * period, exponents.errors * period
        with np.errstate(invalid="ignore"):
            unstable = np.asarray((growth - errors > UNIT_CIRCLE).any(axis=1))
            stable = np.asarray(~unstable & (growth + errors <= KNOWN_ON_CIRCLE).all(axis=1))
        angles = exponents.angular_rates * (self.family.speeds(points) * self.unit)[:, None]
        multipliers = np.exp(np.minimum(growth, _LARGEST) + 1j * angles)
        samples = StabilitySamples.from_multipliers(points, stable, unstable, np.nan_to_num(multipliers))
        undecided = np.flatnonzero(samples.failed)
        if len(undecided):
            solved = evaluator(self.batch)(points[undecided])
            rho = solved.multipliers[:, : multipliers.shape[1]]
            solved = StabilitySamples.from_multipliers(solved.points, solved.stable, solved.unstable, rho)
            samples = samples.replaced(undecided, solved)
        return samples

    def results(self, points: Array) -> PointResults:
        """Multipliers and verdicts of points (k, v), without rigid-body modes."""
        rates, n, period = self.exponents(points), self.family.example.n, self.family.example.period
        growth, errors = rates.growth * period, rates.errors.max(axis=1) * period
        results = PointResults.blank(len(points), 2 * n, Kept(warnings=False))
        is_certain = np.flatnonzero(errors <= KNOWN_ON_CIRCLE)
        exponents = np.minimum(growth, _LARGEST) + 1j * rates.angular_rates * period
        results.multipliers[is_certain] = 0.0
        results.multipliers[is_certain, : growth.shape[1]] = np.exp(exponents[is_certain])
        results.errors[is_certain, 1] = errors[is_certain]
        results.verdicts[is_certain] = np.select(
            [
                growth[is_certain, 0] - errors[is_certain] > UNIT_CIRCLE,
                growth[is_certain, 0] + errors[is_certain] < -UNIT_CIRCLE,
            ],
            [UNSTABLE, ASYMPTOTICALLY_STABLE],
            STABLE,
        )
        results.methods[is_certain] = "eigenvalues"
        failed = np.flatnonzero(results.failed)
        if len(failed):
            results.insert(failed, gathered(self.batch, points[failed], results.kept))
        return results

    def exponents(self, points: Array) -> Exponents:
        """Exponents of points (P, v), without rigid-body modes."""
        n = self.family.example.n
        entries = self.family.entries(_TEST_FRACTIONS * self.family.example.period, points)
        is_constant = _are_constant(entries, n)
        exponents = np.full((3, len(points), 2 * n - self.multiplicity), np.nan)
        M, C, K = split_entries(entries[is_constant, 0], n)[:3]
        modes = _rigid_body_modes(M, C, K)
        same_references: dict[tuple[int, ...], list[int]] = {}
        for at in np.flatnonzero(modes.multiplicity == self.multiplicity).tolist():
            same_references.setdefault(tuple(modes.references[at][modes.present[at]].tolist()), []).append(at)
        where = np.flatnonzero(is_constant)
        for references, at in same_references.items():
            exponents[:, where[at]] = _exponents(
                M[at], C[at], K[at], modes[np.array(at)], list(references), self.multiplicity
            )
        return Exponents(*exponents)


def constant_coefficients(batch: Batch) -> ConstantCoefficients | None:
    """Return an evaluator of stability for the points of a batch if M, C and K are constant at all points.
    Return None if the matrices vary, if some coordinates are of first order, or if the method is an
    approximation whose stability differs from that of the equations."""
    family = batch.family
    if len(family.example.states):
        return None
    n, period = family.example.n, family.example.period
    if isinstance(batch.method, Method) and not batch.method.converges:
        return None
    entries = family.entries(_TEST_FRACTIONS * period, batch.region)
    is_finite = np.isfinite(entries).all(axis=(1, 2))
    entries = entries[is_finite]
    if not len(entries) or not _are_constant(entries, n).all():
        return None
    some = representative(entries)
    for _, further in family.compared_entries(representative(batch.region[is_finite])):
        if not _are_constant(np.concatenate((some, further), axis=1), n).all():
            return None
    modes = _rigid_body_modes(*split_entries(entries[:, 0], n)[:3])
    multiplicity = int(np.bincount(modes.multiplicity).argmax())
    if multiplicity == 2 * n:
        return None
    evaluation = ConstantCoefficients(batch, multiplicity, 0.0)
    exponents = evaluation.exponents(batch.region)
    frequencies = np.abs(exponents.angular_rates * family.speeds(batch.region)[:, None])
    return replace(evaluation, unit=1 / max(float(np.nanmax(frequencies, initial=0.0)), np.finfo(float).tiny))


def _are_constant(entries: Array, n: int) -> Array:
    """Mask (P,) of the points with constant M, C and K, from entries (P, k, 3n² + n)."""
    some = entries[..., : 3 * n**2]
    largest, change = np.abs(some).max(axis=1), np.ptp(some, axis=1)
    unit = np.sqrt(np.abs(largest[:, : n**2 : n + 1]))
    both = np.tile((unit[:, :, None] * unit[:, None]).reshape(-1, n**2), (1, 3))
    with np.errstate(invalid="ignore", divide="ignore"):
        sizes = np.where(both > 0, largest / both, 0.0).reshape(-1, 3, n**2).max(axis=2)
        allowed = _CONSTANT * largest + EPS * np.repeat(sizes, n**2, axis=1) * both
        return np.asarray((change <= allowed).all(axis=1))


def _rigid_body_modes(M: Array, C: Array, K: Array) -> RigidBodyModes:
    """Return the rigid-body modes of points with M, C, K (P, n, n). The modes are computed at the first
    point, and reused at all points that have the same modes. Usually these are all points, because speeds and
    stiffnesses do not change the modes."""
    first = rigid_body_modes(K[:1, None], C[:1, None], M[:1, None])
    vectors = first.vectors[:1].sum(axis=0)
    if not vectors.any():
        return rigid_body_modes(K[:, None], C[:, None], M[:, None])

    def acts(part: Array) -> Array:
        return np.asarray((np.abs(part @ vectors) > BOUND * (np.abs(part) @ np.abs(vectors))).any(axis=1))

    shares_modes = ~acts(K).any(axis=1) & (acts(C) == first.damped[0]).all(axis=1)
    modes = first[np.zeros(len(K), dtype=int)]
    others = np.flatnonzero(~shares_modes)
    if not len(others):
        return modes
    some = rigid_body_modes(K[others, None], C[others, None], M[others, None])
    count = max(vectors.shape[1], some.vectors.shape[2])
    combined = RigidBodyModes.none(len(K), K.shape[1], count)
    for at, part in ((np.flatnonzero(shares_modes), modes[shares_modes]), (others, some)):
        r = part.vectors.shape[2]
        combined.vectors[at, :, :r], combined.references[at, :r] = part.vectors, part.references
        combined.damped[at, :r], combined.errors[at, :r] = part.damped, part.errors
    return combined


def _exponents(
    M: Array, C: Array, K: Array, modes: RigidBodyModes, references: list[int], multiplicity: int
) -> Array:
    """Return the growth rates, angular rates and errors (3, P, N) of points with M, C, K (P, n, n).

    `references` are the reference coordinates of the rigid-body modes. The states are the coordinates that
    are not in `references`, relative to the rigid-body motion, and all velocities."""
    n, remaining = K.shape[1], [k for k in range(K.shape[1]) if k not in references]
    unit = inertia_units(M)
    unit[~np.isfinite(unit)] = 1.0
    M, C, K = (matrix * unit[:, :, None] * unit[:, None] for matrix in (M, C, K))
    vectors = modes.vectors[:, :, : len(references)]
    vectors = vectors / unit[:, :, None] * unit[:, references][:, None]
    rate_scale = np.sqrt(np.abs(K).max(axis=(1, 2))) + np.abs(C).max(axis=(1, 2))
    rate_scale = np.where(rate_scale > 0, rate_scale, 1.0)[:, None, None]
    size = len(remaining)
    A = np.zeros((len(M), size + n, size + n))
    A[:, :size, size:] = rate_scale * np.eye(n)[remaining]
    if references:
        A[:, :size, [size + at for at in references]] -= rate_scale * vectors[:, remaining]
    A[:, size:, :size] = -solved(M, K)[:, :, remaining] / rate_scale
    A[:, size:, size:] = -solved(M, C)
    values, errors = _eigenvalues(A)
    # The smallest eigenvalues belong to rigid-body modes without drag.
    elastic = np.argsort(np.abs(values), axis=1, kind="stable")[:, multiplicity - len(references) :]
    values, errors = (np.take_along_axis(matrix, elastic, axis=1) for matrix in (values, errors))
    bound = _energy_bound(M, C, K, remaining)[:, None]
    growth = np.minimum(np.real(values), bound)
    errors = np.minimum(errors, bound - growth)
    order = np.argsort(-growth, axis=1, kind="stable")
    columns = growth, np.imag(values), errors
    return np.array([np.take_along_axis(column, order, axis=1) for column in columns])


def _eigenvalues(A: Array) -> tuple[Array, Array]:
    """Return the eigenvalues (P, N) of matrices (P, N, N), and their errors (P, N). In conjugate pairs, the
    eigenvalue with positive imaginary part comes first."""
    finite = np.asarray(np.isfinite(A).all(axis=(1, 2)))
    values, right = np.linalg.eig(np.where(finite[:, None, None], A, 0.0))
    left = solved(right, np.broadcast_to(np.eye(A.shape[1]), A.shape))
    condition = np.linalg.norm(left, axis=2)
    norms = np.linalg.norm(A, axis=(1, 2))[:, None]
    errors = PERTURBATION * A.shape[1] * EPS * norms * np.nan_to_num(condition, nan=np.inf)
    return np.where(finite[:, None], values, np.nan), errors


def _energy_bound(M: Array, C: Array, K: Array, rest: list[int]) -> Array:
    """Return an upper bound (P,) on the growth rate, from the energy q̇ᵀMq̇/2 + xᵀKx/2, where x are the
    coordinates with the indices `rest`. If M and the block of K that belongs to x are symmetric and positive
    definite, the rate of change of the energy is -q̇ᵀCq̇. Gyroscopic forces do not contribute to it (W.
    Thomson, P. G. Tait, Treatise on Natural Philosophy, 345). Otherwise the bound is infinite."""
    scale = [np.abs(matrix).max(axis=(1, 2)) for matrix in (M, C, K)]
    symmetric = [
        np.abs(matrix - np.swapaxes(matrix, 1, 2)).max(axis=(1, 2)) <= _ROUNDING * size
        for matrix, size in ((M, scale[0]), (K, scale[2]))
    ]
    of_mass = np.linalg.eigvalsh((M + np.swapaxes(M, 1, 2)) / 2)[:, 0]
    stiffness = K[:, rest][:, :, rest]
    of_stiffness = np.linalg.eigvalsh((stiffness + np.swapaxes(stiffness, 1, 2)) / 2)[:, :1].min(
        axis=1, initial=np.inf
    )
    positive = (of_mass > _ROUNDING * scale[0]) & (of_stiffness > _ROUNDING * scale[2])
    least = np.linalg.eigvalsh((C + np.swapaxes(C, 1, 2)) / 2)[:, 0]
    fed = np.where(least < -_ROUNDING * scale[1], -least / np.where(positive, of_mass, 1.0), 0.0)
    return np.where(symmetric[0] & symmetric[1] & positive, fed, np.inf)
