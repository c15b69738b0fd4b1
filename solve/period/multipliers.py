"""Floquet multipliers from monodromy matrices (…, N, N), their rounding, and the verdict of stability.

Every array may have a leading axis of points, here `…`.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from solve.arrays import Array, across, solved
from solve.kernel import multipliers as kernel
from solve.kernel.engines import COMPILED, NUMPY
from solve.period import pairs

NEGLIGIBLE = 1e-100
"""Modulus below which multipliers count as unresolved: products of so different factors keep no digit."""

UNIT_CIRCLE = 1e-9
"""Distance from 1 within which a modulus counts as 1, beside its own error."""

KNOWN_ON_CIRCLE = 1e-6
"""Distance of a modulus from 1, its error added, up to which a multiplier counts as being on the circle."""

SURE = 2.0
"""Times its estimate that an error is taken for before a modulus counts as larger than 1."""

_TIMES_ESTIMATE = 10.0
"""Times its estimate that an error may be: what tears a double multiplier apart takes it off the circle."""

_ILL = 0.1
"""Part of the error of a defective pair from which on an eigenvalue counts as ill-conditioned."""

_NEAR_ONE = 1e-3
"""Distance from +1 of two multipliers within which a drift is looked for."""

_APART = 1e3
"""Errors by which multipliers are known to be distinct."""

_SWEEPS, _ALIKE = 50, 2.0
"""Of balancing: at most so often, and only where the squares of the norms of a row and its column are farther
apart than this power of 2."""


class Inertia(Protocol):
    """What verdicts need of points at positions (k,), see `Frozen`."""

    def drifts(self, points: Array, Phi: Array, errors: Array) -> Array: ...

    def units(self, points: Array) -> Array: ...


VERDICTS: tuple[str, ...] = ("asymptotically stable", "stable", "unstable", "undetermined")
ASYMPTOTICALLY_STABLE, STABLE, UNSTABLE, UNDETERMINED = range(4)

EPS = float(np.finfo(float).eps)

_LOST = 8 * EPS
"""Part of the norm below which rounding leaves no digit of a multiplier."""


@dataclass(frozen=True)
class Multipliers:
    """values (…, N): complex, falling in modulus, + imaginary part first, zero where unresolved: below
    `bound` (…) and so lost in rounding. resolved (…): how many of them are not."""

    values: Array
    resolved: Array
    bound: Array

    @classmethod
    def of(cls, Phi: Array, units: Array | None = None, engine: str = NUMPY) -> "Multipliers":
        """Eigenvalues of finite monodromy matrices (…, N, N); rounding is 8 eps‖Φ‖ of the balanced
        matrix, in whatever units Φ is given, or 1e-100. units: as in `scaled_alike`, where known."""
        values, norm = _in_order(Phi, units, engine)
        bound = np.maximum(_LOST * norm, NEGLIGIBLE)
        kept = np.abs(values) > bound[..., None]
        if kept.all():
            return cls(values, np.full(bound.shape, values.shape[-1]), bound)
        return cls(np.where(kept, values, 0.0), across(np.add, kept.astype(int)), bound)

    def __getitem__(self, points: Any) -> "Multipliers":
        return Multipliers(self.values[points], self.resolved[points], self.bound[points])

    @cached_property
    def moduli(self) -> Array:
        """(…, N)."""
        return np.abs(self.values)

    @property
    def spectral_radius(self) -> Array:
        """Largest modulus (…)."""
        return self.moduli[..., 0]

    @property
    def nearest_one(self) -> Array:
        """The multiplier nearest to +1 (…), with its imaginary part's modulus; 0 where none is resolved."""
        values = self.values.reshape(-1, self.values.shape[-1])
        value = values[np.arange(len(values)), np.abs(values - 1.0).argmin(axis=1)]
        return (np.real(value) + 1j * np.abs(np.imag(value))).reshape(self.values.shape[:-1])

    @property
    def distance_from_one(self) -> Array:
        """Smallest |ρ - 1| of a resolved multiplier (…): 0 at resonance and on a stability boundary of
        kind +1."""
        known = np.arange(self.values.shape[-1]) < self.resolved[..., None]
        return np.where(known, np.abs(self.values - 1.0), np.inf).min(axis=-1)

    def distance(self, other: "Multipliers") -> Array:
        """Largest distance (…) to the multipliers of `other`, each matched with one of them."""
        if self.values.shape[-1] == 2:
            return pairs.apart(self.values, other.values)
        distance = np.abs(self.values[..., :, None] - other.values[..., None, :])
        nearest, least = distance.argmin(axis=-1), distance.min(axis=-1)
        largest, places = np.asarray(least.max(axis=-1)), np.arange(nearest.shape[-1])
        if (nearest == places).all():
            return largest
        # No matching has a smaller largest distance; where two have the same nearest neighbour, that by
        # places may have the same.
        shared = (np.sort(nearest, axis=-1) != places).any(axis=-1)
        shared &= np.abs(self.values - other.values).max(axis=-1) > largest
        for point in zip(*np.nonzero(np.atleast_1d(shared)), strict=True) if shared.any() else ():
            at = point if largest.ndim else ()
            largest[at] = distance[at][matched(distance[at])].max()
        return largest

    def difference(self, other: "Multipliers") -> Array:
        """The same relative to the spectral radius of the others, the better ones; infinite where that is 0
        and ours is not."""
        distance, scale = self.distance(other), other.spectral_radius
        nothing = np.where(distance == 0, 0.0, np.inf)
        return np.where(scale > 0, distance / np.where(scale > 0, scale, 1.0), nothing)

    def with_digits(self, error: Array, most: float) -> "Multipliers":
        """Those alone of which the error (…), relative to the spectral radius, leaves a digit; all are below
        `most`, which is known of them where it leaves none."""
        unknown = np.isinf(error)
        bound = np.where(unknown, most, np.where(unknown, 0.0, error) * self.spectral_radius)
        bound = np.maximum(bound, self.bound)
        kept = np.abs(self.values) > bound[..., None]
        return Multipliers(np.where(kept, self.values, 0.0), kept.sum(axis=-1), bound)


def matched(distance: Array) -> tuple[Array, Array]:
    """Rows and columns of a matrix of distances (k, N), k ≤ N, that are paired so that their sum is least."""
    nearest, places = distance.argmin(axis=1), np.arange(len(distance))
    if len(set(nearest.tolist())) == len(nearest):
        return places, nearest
    if len(distance) == distance.shape[1] and _least_by_places(distance):
        return places, places
    # The package alone takes longer to be read than many a command.
    from scipy.optimize import linear_sum_assignment

    return linear_sum_assignment(distance)


def _least_by_places(distance: Array) -> bool:
    """Whether each row with the column of its own place has the least sum (N, N), but for rounding: no cycle
    of exchanges makes it less (R. W. Floyd's shortest paths, Commun. ACM 5 (1962) 345)."""
    ways = distance - np.diagonal(distance)[:, None]
    for k in range(len(ways)):
        ways = np.minimum(ways, ways[:, k, None] + ways[k])
    return bool((np.diagonal(ways) >= -_LOST * distance.max()).all())


def frobenius(Phi: Array) -> Array:
    """Frobenius' norm (…) of matrices (…, N, N), without overflow."""
    scaled, unit = _scaled(Phi)
    return unit * _frobenius(scaled)


def _frobenius(entries: Array) -> Array:
    return np.sqrt(np.square(entries).sum(axis=0))


def _spectral(matrices: Array) -> Array:
    """Spectral norm (…) of matrices (…, N, N)."""
    return np.linalg.svd(matrices, compute_uv=False)[..., 0]


def accumulated(steps: int) -> float:
    """Units of rounding that so many steps leave in what they make together, as measured."""
    return max(8.0, steps / 16)


def most_rounding(Phi: Array, radius: Array, steps: int) -> Array:
    """What `rounding_errors` cannot exceed (…) but for blocks of more than two, from the spectral radius
    (…)."""
    known = radius > NEGLIGIBLE
    perturbation = EPS * accumulated(steps) * frobenius(Phi) / np.where(known, radius, 1.0)
    perturbation = np.minimum(perturbation, 1.0)
    return np.where(known, np.sqrt(perturbation), 0.0)


def rounding_errors(Phi: Array, units: Array | None = None, engine: str = NUMPY, steps: int = 1) -> Array:
    """Errors of the multipliers (…), relative to the spectral radius, that rounding in so many steps makes by
    its error in Φ: as many times larger as the eigenvalue is ill-conditioned, and its k-th root in a
    defective block of k. units: as in `scaled_alike`, where known."""
    values, unit, norm, conditions = _conditioned(Phi, units, engine)
    radius = across(np.maximum, np.abs(values))
    known = unit * radius > NEGLIGIBLE
    scale = np.where(known, radius, 1.0)
    perturbation = EPS * accumulated(steps) * norm / scale
    most = perturbation ** (1 / _block(values / scale[..., None], conditions, perturbation))
    return np.where(known, np.minimum(perturbation * across(np.maximum, conditions), most), 0.0)


def _in_order(Phi: Array, units: Array | None, engine: str) -> tuple[Array, Array]:
    """Eigenvalues (…, N) in the order of `Multipliers`, and Frobenius' norms (…) of the balanced matrices, of
    two rows the least in any units; larger ones where these tell as much."""
    if engine == COMPILED and Phi.ndim == 3:
        found = kernel.eigenvalues(Phi, units)
        if found is not None:
            at, matrices, known = _missed(found.values, Phi, units)
            if len(at):
                found.values[at], found.sizes[at] = _in_order(matrices, known, NUMPY)
            return found.values, found.sizes
    scaled, unit = _scaled(Phi)
    if len(scaled) == 4:
        norm = np.asarray(unit * pairs.least_norm(*scaled))
        return _by_modulus(pairs.eigenvalues(*scaled) * unit[..., None]), norm
    values = _by_modulus(np.linalg.eigvals(Phi).astype(complex))
    _put_positive_first(values)
    norm = np.asarray(unit * _frobenius(scaled))
    unsure = np.asarray(np.abs(values[..., -1]) <= _LOST * norm)
    if unsure.any():
        scaled, unit = _scaled(Phi[unsure])
        known = None if units is None else units[unsure]
        norm[unsure] = unit * _frobenius(_by_entry(_balanced(_matrices(scaled), known)))
    return values, norm


def _missed(values: Array, Phi: Array, units: Array | None) -> tuple[Array, Array, Array | None]:
    """Positions (k,) of matrices whose eigenvalues (P, N) are not found, these matrices and their units."""
    at = np.flatnonzero(np.isnan(values).any(axis=1))
    return at, Phi[at], None if units is None else units[at]


def _by_modulus(values: Array) -> Array:
    """Eigenvalues (…, N), falling in modulus."""
    modulus = np.abs(values)
    if (modulus[..., 1:] > modulus[..., :-1]).any():
        return np.take_along_axis(values, np.argsort(-modulus, axis=-1, kind="stable"), axis=-1)
    return values


def _conditioned(Phi: Array, units: Array | None, engine: str) -> tuple[Array, Array, Array, Array]:
    """Eigenvalues (…, N) of balanced matrices divided by powers of two (…), these, spectral norms (…) and
    condition numbers (…, N)."""
    if engine == COMPILED and Phi.ndim == 3:
        found, unit = kernel.conditioned(Phi, units), np.ones(len(Phi))
        if found is not None:
            at, matrices, known = _missed(found.values, Phi, units)
            if len(at):
                made = _conditioned(matrices, known, NUMPY)
                found.values[at], unit[at], found.norms[at], found.conditions[at] = made
            return found.values, unit, found.norms, found.conditions
    scaled, unit = _scaled(Phi)
    if len(scaled) == 4:
        entries = pairs.balanced(*scaled)
        values = pairs.eigenvalues(*entries)
        norm, condition = pairs.conditions(entries, values, 8 * EPS)
        return values, unit, norm, np.stack((condition, condition), axis=-1)
    balanced = _balanced(_matrices(scaled), units)
    values, right = np.linalg.eig(balanced)
    # Complex for every point alike, whatever its neighbours are.
    right = right.astype(complex)
    with np.errstate(over="ignore"):
        left = np.linalg.norm(solved(right, np.eye(Phi.shape[-1])), axis=-1)
    # No left eigenvectors stand beside defective ones.
    return values, unit, _spectral(balanced), np.where(np.isnan(left), np.inf, left)


def _block(values: Array, conditions: Array, perturbation: Array) -> Array:
    """The largest number (…), at least 2, of ill-conditioned eigenvalues (…, N) that a perturbation may have
    torn out of one."""
    size = np.full(perturbation.shape, 2)
    ill = conditions * np.sqrt(perturbation)[..., None] > _ILL
    if values.shape[-1] == 2 or not (ill.sum(axis=-1) > 2).any():
        return size
    distance = np.where(ill[..., None, :], np.abs(values[..., :, None] - values[..., None, :]), np.inf)
    for k in range(3, values.shape[-1] + 1):
        near = distance <= 4 * perturbation[..., None, None] ** (1 / k)
        size = np.where((near.sum(axis=-1) >= k).any(axis=-1), k, size)
    return size


def _balanced(Phi: Array, units: Array | None = None) -> Array:
    """Matrices (…, N, N) in units of the state in which rows and columns are alike: in these, where known."""
    if Phi.shape[-1] == 2:
        return _matrices(pairs.balanced(*_by_entry(Phi)))
    return scaled_alike(Phi)[0] if units is None else _in_units(Phi, units)


def _by_entry(matrices: Array) -> Array:
    """Matrices (…, N, N) as fields (N², …): long rows to go along instead of many short ones."""
    *points, rows, columns = matrices.shape
    fields = matrices.reshape(-1, rows * columns).T
    return np.ascontiguousarray(fields).reshape(-1, *points)


def _matrices(entries: Array) -> Array:
    """Fields (N², …) as matrices (…, N, N)."""
    size = math.isqrt(len(entries))
    return np.moveaxis(entries, 0, -1).reshape(*entries.shape[1:], size, size)


def scaled_alike(matrices: Array) -> tuple[Array, Array]:
    """Matrices (…, N, N) with rows and columns scaled by powers of two so that their norms are alike, and
    the units (…, N) in which they then are: A_ij unit_j / unit_i (E. E. Osborne, J. ACM 7 (1960) 338-345,
    all rows at once). Rows and columns of zeros stay as they are."""
    scaled, powers = matrices, np.zeros(matrices.shape[:-1])
    with np.errstate(all="ignore"):
        for _ in range(_SWEEPS):
            squares = np.square(scaled / np.abs(scaled).max(axis=(-2, -1), keepdims=True))
            ratio = np.log2(squares.sum(axis=-1)) - np.log2(squares.sum(axis=-2))
            ratio = np.where(np.isfinite(ratio), ratio, 0.0)
            unlike = np.abs(ratio).max(axis=-1, keepdims=True) > _ALIKE
            if not unlike.any():
                break
            powers += np.where(unlike, ratio / 8, 0.0)
            scaled = _in_units(matrices, np.exp2(powers))
    units = np.exp2(np.round(powers))
    return _in_units(matrices, units), units


def _in_units(matrices: Array, units: Array) -> Array:
    return matrices * units[..., None, :] / units[..., :, None]


def verdicts(Phi: Array, multipliers: Multipliers, errors: Array, modes: Inertia) -> Array:
    """Positions (P,) in VERDICTS, of monodromy matrices (P, N, N).

    errors (P,): of the multipliers, absolute; e is that, or the bound of unresolved ones where it is larger.
    Asymptotically stable: all |ρ| + e < 1 - 1e-9. Unstable: some |ρ| - 2 e > 1 + 1e-9, since an estimate is
    no bound, or a coordinate that drifts freely. Stable: those that are not inside have |ρ| - e ≤ 1 + 1e-9
    and ||ρ| - 1| + e ≤ 1e-6, and none may be defective (chapter Section 2). Else undetermined. Where two are
    so near that they may be one, 10 e takes the place of e in the first, of 2 e in the second.
    """
    values, moduli, e = multipliers.values, multipliers.moduli, _absolute(multipliers, errors)
    judged = _by_moduli(moduli, e, e, SURE * e)
    some, meet = _meetings(multipliers, errors, e)
    if len(some):
        alone, own = ~meet.any(axis=-1), e[some]
        inner, outer = (np.where(alone, times, _TIMES_ESTIMATE) * own for times in (1.0, SURE))
        judged[some] = _by_moduli(moduli[some], own, inner, outer)
    open_ = np.flatnonzero((judged == STABLE) | (judged == UNDETERMINED))
    near_one = (np.abs(values[open_] - 1) <= _NEAR_ONE).astype(int)
    open_ = open_[across(np.add, near_one) > 1]
    if len(open_):
        judged[open_] = np.where(modes.drifts(open_, Phi[open_], errors[open_]), UNSTABLE, judged[open_])
    stable = np.flatnonzero(judged[some] == STABLE)
    units = modes.units(some[stable]) if len(stable) else ()
    for at, meets, unit in zip(some[stable].tolist(), meet[stable], units, strict=True):
        alike = _balanced(Phi[at] * unit[:, None] / unit)
        if _may_be_defective(alike, values[at], meets, float(errors[at])):
            judged[at] = UNDETERMINED
    return judged


def roughly(multipliers: Multipliers, errors: Array) -> Array:
    """The same by the moduli alone, whichever may be one."""
    e = _absolute(multipliers, errors)
    return _by_moduli(multipliers.moduli, e, e, e)


def _absolute(multipliers: Multipliers, errors: Array) -> Array:
    """e (P, N) of `verdicts`."""
    values, resolved = multipliers.values, multipliers.resolved
    if (resolved == values.shape[-1]).all():
        return np.broadcast_to(errors[:, None], values.shape)
    unresolved = np.arange(values.shape[-1]) >= resolved[:, None]
    return np.where(unresolved, np.maximum(multipliers.bound[:, None], errors[:, None]), errors[:, None])


def _by_moduli(moduli: Array, e: Array, inner: Array, outer: Array) -> Array:
    """Positions (P,) in VERDICTS, with margins (P, N) for moduli (P, N) in- and outside the unit circle."""
    inside, outside = moduli + inner < 1 - UNIT_CIRCLE, moduli - outer > 1 + UNIT_CIRCLE
    on_circle = ~inside & ~outside
    judged = np.where(across(np.logical_or, on_circle), STABLE, ASYMPTOTICALLY_STABLE)
    known = (np.abs(moduli - 1) + e <= KNOWN_ON_CIRCLE) & (moduli - e <= 1 + UNIT_CIRCLE)
    judged = np.where(across(np.logical_or, on_circle & ~known), UNDETERMINED, judged)
    return np.where(across(np.logical_or, outside), UNSTABLE, judged)


def _meetings(multipliers: Multipliers, errors: Array, e: Array) -> tuple[Array, Array]:
    """Points (k,) with multipliers near the unit circle that may be one, and which of these with which other
    (k, N, N): a double one of a defective block splits by the square root of a perturbation, of which the
    errors (P,) may show little. e (P, N): those of each."""
    near = np.abs(multipliers.moduli - 1) <= _TIMES_ESTIMATE * e + UNIT_CIRCLE
    some, N = np.flatnonzero(across(np.add, near.astype(int)) > 1), near.shape[1]
    if not len(some):
        return some, np.zeros((0, N, N), dtype=bool)
    values, near, error = multipliers.values[some], near[some], np.maximum(errors[some], UNIT_CIRCLE)
    reach = np.minimum(np.sqrt(error), _APART * error)
    i, j = np.triu_indices(N, 1)
    close = (np.abs(values[:, i] - values[:, j]) <= reach[:, None]) & near[:, i] & near[:, j]
    met = across(np.logical_or, close)
    some, close = some[met], close[met]
    meet = np.zeros((len(some), N, N), dtype=bool)
    meet[:, i, j] = meet[:, j, i] = close
    return some, meet


def _may_be_defective(Phi: Array, values: Array, meet: Array, error: float) -> bool:
    """Whether there may be fewer eigenvectors than multipliers (N,) that `meet` (N, N): those that are apart
    by no more than their errors leave as much of Φ - ρ."""
    for at in np.flatnonzero(meet.any(axis=-1)):
        singular = np.linalg.svd(Phi - values[at] * np.eye(len(Phi)), compute_uv=False)
        apart = float(np.abs(values[meet[at]] - values[at]).max())
        small = _TIMES_ESTIMATE * max(error, UNIT_CIRCLE, apart) * max(float(singular[0]), 1.0)
        if np.sum(singular <= small) < 1 + np.sum(meet[at]):
            return True
    return False


def _scaled(Phi: Array) -> tuple[Array, Array]:
    """Entries (N², …) of matrices, whose squares neither over- nor underflow, and the powers of two (…) that
    they were divided by, which costs no digit."""
    entries = _by_entry(Phi)
    unit = np.exp2(np.frexp(np.abs(entries).max(axis=0))[1] - 1)
    return entries / unit, unit


def _put_positive_first(values: Array) -> None:
    """Swap neighbours that are a conjugate pair with the - imaginary part first, in place."""
    wrong = (values[..., 1:] == values[..., :-1].conj()) & (np.imag(values[..., :-1]) < 0)
    for k in range(values.shape[-1] - 1) if wrong.any() else ():
        swap = (values[..., k + 1] == values[..., k].conj()) & (np.imag(values[..., k]) < 0)
        values[swap, k : k + 2] = values[swap, k : k + 2][..., ::-1]
