"""Map of one period as a chain of affine maps, x_{k+1} = A_k x_k + b_k (chapter Eqs. (17), (38)).

Neighbouring maps are multiplied pairwise until `BLOCKS` blocks remain, with one array operation per level of
pairs. The cyclic system of the blocks is solved by structured orthogonal factorisation (S. J. Wright, SIAM J.
Sci. Stat. Comput. 13 (1992) 742-764). Single shooting, chapter Eqs. (21), (40), would lose accuracy if a
solution of the homogeneous system grows over the period."""

from dataclasses import dataclass

import numpy as np

from solve.arguments import SMALL
from solve.arrays import EPS, Array, solved
from solve.period.eigenvalues import balance_matrices, roundoff_growth

BLOCKS = 32
"""Number of blocks at which multiplication ends and orthogonal factorisation begins. Chosen by judgement."""

_LARGE, _BLOCKS_OF_LARGE = 2 * SMALL, 8
"""Number of states above which fewer blocks are used, and the number of blocks in that case. With 216 states,
an elimination takes 15 times as long as a product. If a solution grows by |ρ| over the period, 8 blocks lose
log10|ρ|/8 digits. Measured errors for 216 states and |ρ| = 1e12: 2.6e-13 with 8 blocks, 1.1e-13 with 32
blocks, 3e-4 with one block."""

SINGULAR = 1e-14
"""Reciprocal condition number below which the cyclic system counts as singular. Chosen by judgement: 45 times
the unit round-off."""

APART = 1e-3
"""Ratio between the smallest and the largest state, each measured by the sum of its terms, below which every
state has its own unit. With common units, elimination would lose digits of the small states. Chosen by
judgement."""

_ROUNDING = 8.0
"""Multiple of the relative round-off below which the ratio of a state to the sum of the moduli of its terms
counts as zero. Chosen by judgement."""

_RESTS = 512 * EPS
"""Upper limit, for any condition number, of the ratio of a state to the sum of the moduli of its terms below
which the state counts as zero. The limit is multiplied by the growth of round-off over the steps. Measured on
540 orbits with absorbers that are detuned by 2e-12 or more: with 512, no error exceeds 10 times its estimate;
with 5600, 3 errors do."""

REGULAR = 1e13
"""Upper limit of the condition number of a system that is regular in some units of the states. Chosen by
judgement."""

_LEFT = 1e-12
"""Residual of the cyclic system, relative to its terms, above which the system is solved again in other
units. Elimination first uses the same units at all nodes; a solution that varies by many powers of ten then
loses digits where it is small. Chosen by judgement."""

_AGAIN = 3
"""Largest number of repeated solutions, each in units that make the states at all nodes comparable. Chosen by
judgement."""

_SMALLEST = 2.0**-100
"""Smallest ratio between the units at two nodes that a repeated solution introduces. Chosen by judgement."""


@dataclass(frozen=True)
class Steps:
    """Affine maps of the steps of one period, A (..., m, N, N) and b (..., m, N).

    Leading axes belong to points. For `periodic_states`, b may also be (..., m, N, r), which represents r
    problems with the same A."""

    A: Array
    b: Array

    def where(self, points: Array) -> "Steps":
        """Return the maps with A and b set to zero except at the selected points. `points` is a mask (P,)."""
        if points.all():
            return self
        A, b = (np.where(points.reshape(-1, *[1] * (part.ndim - 1)), part, 0.0) for part in (self.A, self.b))
        return Steps(A, b)


def monodromy(steps: Steps) -> Array:
    """Monodromy matrix Φ(T) = A_m … A_1 (..., N, N), chapter Eq. (8)."""
    A = steps.A
    while A.shape[-3] > 1:
        A = _halved_products(A)
    return A[..., 0, :, :]


def affine_period(steps: Steps) -> Steps:
    """Combine all steps into a single step, the map of the whole period."""
    whole = _levels(Steps(steps.A, steps.b[..., None]), 1)[-1]
    return Steps(whole.A, whole.b[..., 0])


def states_from(steps: Steps, start: Array) -> Array:
    """States x (..., m+1, N) at the nodes, from the state (..., N) at the first node."""
    x = start[..., None, :, None]
    levels = _levels(Steps(steps.A, steps.b[..., None]), 1)
    for level in reversed(levels[:-1]):
        x = _refined(level, x)
    last = steps.A[..., -1:, :, :] @ x[..., -1:, :, :] + levels[0].b[..., -1:, :, :]
    return np.concatenate((x, last), axis=-3)[..., 0]


def periodic_states(steps: Steps) -> tuple[Array, Array]:
    """Return the states of the periodic solution at the nodes, (..., m+1, N) or (..., m+1, N, r), and the
    condition number (...) of the cyclic system.

    If the system is singular because a multiplier is +1, the condition number is infinite and the states are
    NaN."""
    columns = steps.b.ndim == steps.A.ndim
    with_columns = steps if columns else Steps(steps.A, steps.b[..., None])
    return _closed_levels(_levels(with_columns, _most_blocks(steps)), columns)


def period(steps: Steps) -> tuple[Array, Array, Array]:
    """Return Φ(T) and the two results of `periodic_states`, all from the same products of steps. The results
    of `periodic_states` are meaningful only for points with finite Φ."""
    levels = _levels(Steps(steps.A, steps.b[..., None]), _most_blocks(steps))
    Phi = monodromy(levels[-1])
    finite = np.asarray(np.isfinite(Phi).all(axis=(1, 2)))
    states, condition = _closed_levels([level.where(finite) for level in levels], columns=False)
    return Phi, states, condition


def _most_blocks(steps: Steps) -> int:
    """Return the largest number of blocks into which the steps are combined. It depends on the number of
    states."""
    return BLOCKS if steps.A.shape[-1] <= _LARGE else _BLOCKS_OF_LARGE


def _closed_levels(levels: list[Steps], columns: bool) -> tuple[Array, Array]:
    """Return the results of `periodic_states`, from the products of the steps in `levels`; see `_levels`."""
    steps, A, b = levels[0], levels[-1].A, levels[-1].b
    unit = _units(A)
    x, condition, left = _at_nodes(A, b, unit)
    if not columns:
        acting = _largest_term_sums(A, b, x)
        balanced_unit, ratios = unit, acting / unit
        apart = ratios.min(axis=-1) < APART * ratios.max(axis=-1)
        if apart.any():
            unit = np.where(apart[..., None], 2.0 ** np.floor(np.log2(acting)), unit)
            x, condition, left = _at_nodes(A, b, unit)
            acting = _largest_term_sums(A, b, x)
        growth = roundoff_growth(steps.A.shape[-3])
        # States that are round-off of their terms are excluded, also in the balanced units, in which the
        # round-off of all states is similar: a state may be loaded only by states at rest. The second
        # threshold does not grow with the steps, because it would exclude states with several accurate
        # digits. Of 270 orbits with undamped absorbers, 6 instead of 12 have errors above 10 times their
        # estimates.
        size = np.abs(x[..., 0]).max(axis=-2)
        rest = rest_threshold(EPS * growth * condition, growth)
        moving = _exceeds(size / unit, acting / unit, rest)
        moving &= _exceeds(size / balanced_unit, acting / balanced_unit, np.minimum(rest, _RESTS))
        cancels = np.where(moving, acting / np.where(moving, size, 1.0), 1.0).max(axis=-1)
        condition = np.minimum(condition * cancels, np.maximum(condition, REGULAR))
    condition = np.fmax(condition, np.minimum(left / (EPS * roundoff_growth(steps.A.shape[-3])), REGULAR))
    for level in reversed(levels[:-1]):
        x = _refined(level, x)
    x = np.concatenate((x, x[..., :1, :, :]), axis=-3)
    return x if columns else x[..., 0], condition


def _units(A: Array) -> Array:
    """Units (..., N) of the states, powers of 2, in which the maps are balanced.

    Orthogonal elimination weights all states equally: beside a state in metres, a state in milliradians would
    lose digits."""
    size = np.abs(A).sum(axis=-3)
    size = size / np.maximum(size.sum(axis=(-2, -1), keepdims=True), np.finfo(float).tiny)
    return balance_matrices(size)[1]


def _at_nodes(A: Array, b: Array, unit: Array) -> tuple[Array, Array, Array]:
    """Return the states at the starts of the blocks, the condition number of the cyclic system, and its
    relative residual.

    The system is solved in units (..., N) of the states. If digits are lost, it is solved again in units that
    differ between the nodes. It counts as singular only if it is singular in all these units."""
    unit = np.broadcast_to(unit[..., None, :], A.shape[:-1])
    x, condition, left = _in_units(A, b, unit, level=False)
    regular = condition < 1 / SINGULAR
    for _ in range(_AGAIN):
        open_ = (left > _LEFT) | ~(condition < 1 / SINGULAR)
        if not open_.any():
            break
        size = np.abs(x / unit[..., None]).max(axis=(-2, -1))
        largest = size.max(axis=-1, keepdims=True)
        open_ &= (largest[..., 0] > 0) & np.isfinite(largest[..., 0])
        if not open_.any():
            break
        sizes = _powers(np.maximum(size, _SMALLEST * largest)) / _powers(largest)
        unit = unit * np.where(open_[..., None], sizes, 1.0)[..., None]
        again = _in_units(A, b, unit, level=True)
        better = open_ & ((again[2] < left) | ~(condition < 1 / SINGULAR))
        x = np.where(better[..., None, None, None], again[0], x)
        condition, left = np.where(better, again[1], condition), np.where(better, again[2], left)
    condition = np.where(regular, np.minimum(condition, REGULAR), condition)
    singular = ~(condition < 1 / SINGULAR)
    return np.where(singular[..., None, None, None], np.nan, x), np.where(singular, np.inf, condition), left


def _in_units(A: Array, b: Array, unit: Array, level: bool) -> tuple[Array, Array, Array]:
    """Return the results of `_at_nodes` in units (..., B, N), without a test for singularity. level: see
    `_cyclic`."""
    ahead = np.roll(unit, -1, axis=-2)
    scaled = Steps(A * unit[..., None, :] / ahead[..., None], b / ahead[..., None])
    x, condition = _cyclic(scaled, level)
    return x * unit[..., None], condition, _largest_residual(scaled, x)


def _largest_residual(blocks: Steps, x: Array) -> Array:
    """Largest residual (...) at the ends of the blocks, divided by the largest value of `_largest_term_sums`.
    It is due to round-off and to digits lost in elimination."""
    ahead = np.roll(x, -1, axis=-3)
    left = np.abs(blocks.A @ x + blocks.b - ahead).max(axis=(-2, -1))
    acting = (np.abs(blocks.A) @ np.abs(x) + np.abs(blocks.b)).max(axis=(-2, -1))
    return np.asarray((left / np.where(acting > 0, acting, 1.0)).max(axis=-1))


def _largest_term_sums(A: Array, b: Array, x: Array) -> Array:
    """Sum (..., N) of the moduli of the terms of A x + b for each state, maximal over the blocks. The states
    x are (..., B, N, 1)."""
    acting = (np.abs(A) @ np.abs(x) + np.abs(b))[..., 0].max(axis=-2)
    least = np.where(acting > 0, acting, np.inf).min(axis=-1, keepdims=True)
    return np.where(acting > 0, acting, np.where(np.isfinite(least), least, 1.0))


def rest_threshold(rounding: Array, growth: float) -> Array:
    """Ratio (...) of a sum to its terms below which the sum counts as round-off. rounding (...): relative
    round-off of the sum. growth: factor in `rounding` that is due to the number of steps; see
    `roundoff_growth`."""
    return np.minimum(_ROUNDING * rounding, _RESTS * growth)


def _exceeds(size: Array, acting: Array, rest: Array) -> Array:
    """Return a mask (..., N) of the states whose modulus `size` (..., N) exceeds the threshold `rest` (...).
    `acting` (..., N) contains the sums of the moduli of the terms of the states; the threshold is relative to
    the largest of these sums."""
    return size > rest[..., None] * acting.max(axis=-1, keepdims=True)


def _levels(steps: Steps, most: int) -> list[Steps]:
    """Products of the steps, level by level, with b as columns. The first level contains the steps. Each
    further level contains the products of pairs of the previous level. The last level has at most `most`
    factors."""
    levels = [steps]
    while levels[-1].b.shape[-3] > most:
        levels.append(_halved(levels[-1]))
    return levels


def _halved_products(A: Array) -> Array:
    pairs = A.shape[-3] // 2 * 2
    product = A[..., 1:pairs:2, :, :] @ A[..., 0:pairs:2, :, :]
    return np.concatenate((product, A[..., pairs:, :, :]), axis=-3)


def _halved(steps: Steps) -> Steps:
    """Multiply pairs of steps. If the number of steps is odd, the last step is unchanged."""
    A, b = steps.A, steps.b
    pairs = b.shape[-3] // 2 * 2
    joined = A[..., 1:pairs:2, :, :] @ b[..., 0:pairs:2, :, :] + b[..., 1:pairs:2, :, :]
    return Steps(_halved_products(A), np.concatenate((joined, b[..., pairs:, :, :]), axis=-3))


def _refined(level: Steps, starts: Array) -> Array:
    """States at the starts of all steps of a level, from `starts`, the states at the starts of pairs of
    steps."""
    x = np.empty_like(level.b)
    x[..., 0::2, :, :] = starts
    inner = level.b.shape[-3] // 2
    first = np.s_[..., slice(0, 2 * inner, 2), :, :]
    x[..., 1::2, :, :] = level.A[first] @ starts[..., :inner, :, :] + level.b[first]
    return x


def _cyclic(blocks: Steps, level: bool) -> tuple[Array, Array]:
    """Solve a cyclic chain of blocks, x_{k+1} = A_k x_k + b_k with x_B = x_0. Return the states x (..., B, N,
    r) at the starts of the blocks and the condition number (...).

    Each row G x_k + H x_{k+1} = r is combined with the next one by orthogonal elimination of the state
    between them, until one row G x_0 + H x_B = r remains. level: whether rows are scaled to entries of at
    most about 1, which is necessary if units differ between the nodes."""
    N, r = blocks.b.shape[-2:]
    unit = np.broadcast_to(-np.eye(N), blocks.A.shape)
    rows, eliminated = np.concatenate((blocks.A, unit, -blocks.b), axis=-1), []
    if level:
        rows = rows / _powers(np.maximum(np.abs(blocks.A).max(axis=(-2, -1), keepdims=True), 1.0))
    while rows.shape[-3] > 1:
        pairs = rows.shape[-3] // 2 * 2
        even, odd = rows[..., 0:pairs:2, :, :], rows[..., 1:pairs:2, :, :]
        # Columns: the state between the two rows, the state before them, the state after them, and r.
        joined = np.zeros((*even.shape[:-2], 2 * N, 3 * N + r))
        joined[..., :N, :N], joined[..., N:, :N] = even[..., N : 2 * N], odd[..., :N]
        joined[..., :N, N : 2 * N], joined[..., N:, 2 * N :] = even[..., :N], odd[..., N:]
        joined[..., :N, 3 * N :] = even[..., 2 * N :]
        joined = np.asarray(np.linalg.qr(joined, mode="r"))
        eliminated.append((rows.shape[-3], joined[..., :N, :]))
        rows = np.concatenate((joined[..., N:, N:], rows[..., pairs:, :, :]), axis=-3)
    last = rows[..., 0, :, :]
    G, H = last[..., :N], last[..., N : 2 * N]
    x, condition = solved(G + H, last[..., 2 * N :])[..., None, :, :], closed_condition(G, H)
    for count, joined in reversed(eliminated):
        inner = count // 2
        around = np.concatenate((x, np.roll(x, -1, axis=-3)), axis=-2)[..., :inner, :, :]
        finer = np.empty((*x.shape[:-3], count, N, r))
        finer[..., 0::2, :, :] = x
        right = joined[..., 3 * N :] - joined[..., N : 3 * N] @ around
        finer[..., 1::2, :, :] = solved(joined[..., :N], right)
        x = finer
    return x, condition


def _powers(sizes: Array) -> Array:
    """Largest powers of 2 that do not exceed `sizes`. Division by powers of 2 is exact."""
    return np.ldexp(1.0, np.frexp(sizes)[1] - 1)


def closed_condition(G: Array, H: Array) -> Array:
    """Condition number (...) of G + H: the largest singular value of [G; H], divided by the smallest singular
    value of G + H."""
    least = np.linalg.svd(G + H, compute_uv=False)[..., -1]
    scale = np.linalg.svd(np.concatenate((G, H), axis=-2), compute_uv=False)[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        return scale / least
