"""Entries of M, C, K and d, and checks of periodicity and inertia."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from solve.arrays import EPS, Array
from solve.contracts import Matrices
from solve.errors import MatricesError, ValueOutOfBoundsError

PERIODIC = 1e-9
"""Relative difference between the matrices at the two ends of the period, up to which the matrices count as
periodic. Chosen by judgement."""

SAME_PHASE = 1e-12
"""Distance between two phases, relative to the period, up to which the phases count as equal within
round-off. Chosen by judgement."""

_ROUNDOFF = 64 * EPS
"""Round-off of an entry, relative to the largest term of the equations. Chosen by judgement."""

_SINGULAR = 0.1 / EPS
"""Condition number of the scaled M above which M counts as singular: only one accurate digit remains."""


def real_arrays(arrays: Sequence[Array], symbols: str, kind: str) -> list[Array]:
    """Arrays of floats, one per symbol in `symbols`. Raises MatricesError for values that are not arrays of
    real numbers."""
    try:
        pairs = zip(arrays, symbols, strict=True)
        return [np.asarray(array).astype(float, casting="same_kind", copy=False) for array, _ in pairs]
    except (TypeError, ValueError) as error:
        count = {2: "two", 4: "four", 5: "five"}.get(len(symbols), str(len(symbols)))
        raise MatricesError(f"the {kind} are not {count} real arrays {', '.join(symbols)}: {error}") from None


def finite_phases(phase: Any) -> Array:
    """Return phases (k,) from a number or a sequence. Raises ValueOutOfBoundsError unless the phases are
    finite and one-dimensional."""
    phases = np.atleast_1d(np.asarray(phase, dtype=float))
    if phases.ndim > 1:
        raise ValueOutOfBoundsError(
            f"the phases have the shape {phases.shape}; allowed: (k,); flatten the array with .ravel()"
        )
    if not np.isfinite(phases).all():
        raise ValueOutOfBoundsError("a phase is NaN or infinite; give finite angles in rad")
    return phases


def require_finite_entries(arrays: Sequence[Array], symbols: str, phase: Array) -> None:
    """Raise MatricesError if arrays (m, …) at phases (m,) have NaN or infinite entries."""
    for symbol, array in zip(symbols, arrays, strict=True):
        if not np.isfinite(array).all():
            first = int(np.argmin(np.isfinite(array).reshape(len(array), -1).all(axis=1)))
            raise MatricesError(
                f"{symbol} has NaN or infinite entries at phase {phase[first % len(phase)]:.6g}; "
                "check the parameters and the function that returns the matrices"
            )


def require_shapes(arrays: Mapping[str, Array], shapes: Mapping[str, tuple[int, ...]], names: str) -> None:
    """Raise MatricesError unless each array has the shape (m, …) that `shapes` states for its symbol. names:
    names of the coordinates, for the message."""
    for symbol, array in arrays.items():
        if array.shape != shapes[symbol]:
            raise MatricesError(
                f"{symbol} at {shapes[symbol][0]} phases has shape {array.shape}; for {names} it must be "
                f"{shapes[symbol]}"
            )


def split_entries(entries: Array, n: int) -> Matrices:
    """Split entries (…, 3n² + n) into M, C, K (…, n, n) and d (…, n). The entries contain M, C and K in row
    order, and then d."""
    M, C, K = (entries[..., k * n**2 : (k + 1) * n**2].reshape(*entries.shape[:-1], n, n) for k in range(3))
    return M, C, K, entries[..., 3 * n**2 :]


def leading(M: Array, C: Array, first_order: int) -> Array:
    """Coefficient matrices (…, n, n) of the highest derivatives.

    The last `first_order` coordinates have no second derivatives. Their columns are taken from C, all other
    columns from M.

    >>> leading(np.diag([2.0, 0.0]), np.diag([5.0, 3.0]), 1).tolist()
    [[2.0, 0.0], [0.0, 3.0]]
    """
    if not first_order:
        return M
    return np.concatenate((M[..., :-first_order], C[..., -first_order:]), axis=-1)


def by_rates(M: Array, C: Array, K: Array, first_order: int) -> tuple[Array, Array, Array]:
    """Return M, C and K (…, n, n) of equations in which the last `first_order` unknowns are rates: the rates
    of the coordinates replace the coordinates.

    For these coordinates, columns of C become columns of M, and columns of K become columns of C. λ²M + λC +
    K then has the same eigenvalues as before, and an additional zero for each of these coordinates."""
    if not first_order:
        return M, C, K
    rates = np.s_[..., -first_order:]
    damping, stiffness = C.copy(), K.copy()
    damping[rates], stiffness[rates] = K[rates], 0.0
    return leading(M, C, first_order), damping, stiffness


def inertia_units(M: Array) -> Array:
    """Units (…, n) of the coordinates for which the diagonal of M (…, n, n) is ±1."""
    return 1 / np.sqrt(np.abs(np.einsum("...ii->...i", M)))


def by_the_phase(entries: Array, speeds: Array, n: int) -> Array:
    """Convert entries (P, k, 3n² + n) in place from derivatives with respect to time to derivatives with
    respect to the phase."""
    entries[:, :, : n**2] *= (speeds**2)[:, None, None]
    entries[:, :, n**2 : 2 * n**2] *= speeds[:, None, None]
    return entries


def checked_phases(period: float, breaks: Sequence[float]) -> Array:
    """Four phases of a period at which periodicity is checked. If there are breaks, the phases are inside the
    period."""
    phase, inset = np.array([0.0, 0.281, 0.618, 1.0]) * period, SAME_PHASE * period
    if breaks:
        phase[[0, -1]] += [inset, -inset]
    return phase


def jumps_at_zero(period: float, breaks: Sequence[float]) -> bool:
    """Whether one of the breaks is the end of the period."""
    return any(abs(math.remainder(b, period)) <= SAME_PHASE * period for b in breaks)


def with_neighbours(phase: Array, later: Array, period: float) -> Array:
    """Return phases (3k,) for a check of periodicity: `phase` (k,); `later` (k,), which are about one period
    later; and neighbours of `phase`, at a distance equal to the round-off of the period."""
    distance = np.maximum(np.abs(later - phase - period), 8 * EPS * period)
    return np.concatenate((phase, later, phase + distance))


def changes(matrices: Matrices, speed: float) -> list[tuple[str, float]]:
    """Find the matrices that change over one period. Return their symbols and the changes.

    matrices: Ω²M, ΩC, K and d at the phases of `with_neighbours`. A change is significant if it exceeds three
    limits: 1e-9 of the size of the matrix; the round-off of the whole equation, below which a load with
    cancelling terms counts as zero; and the effect of the round-off of the phase within a narrow pulse."""
    rates = speed**2, speed, 1.0, 1.0
    now, later, beside = zip(*(np.split(array, 3) for array in matrices), strict=True)
    differing = []
    columns = "MCKd", _negligible(now), rates, now, later, beside
    for symbol, allowed, rate, first, second, near in zip(*columns, strict=True):
        if (np.abs(second - first) > allowed + 2 * np.abs(near - first)).any():
            differing.append((symbol, float(np.abs(second - first).max()) / rate))
    return differing


def negligible_changes(matrices: Matrices, speed: float) -> Matrices:
    """Return the largest changes of the entries of M, C, K (n, n) and d (n,) that the function `changes`
    neglects. `matrices` contains samples of M, C, K (m, n, n) and d (m, n)."""
    rates = speed**2, speed, 1.0, 1.0
    allowed = _negligible([rate * array for rate, array in zip(rates, matrices, strict=True)])
    M, C, K, d = (array / rate for rate, array in zip(rates, allowed, strict=True))
    return M, C, K, d


def _negligible(matrices: Sequence[Array]) -> list[Array]:
    """Negligible changes of M, C, K and d in a common unit: the larger of 1e-9 of the size of the matrix and
    the round-off of the whole equation."""
    inertia = np.abs(np.einsum("kii->ki", matrices[0])).max(axis=0)
    unit = 1 / np.sqrt(np.where(inertia > 0, inertia, 1.0))
    scales = [unit[:, None] * unit] * 3 + [unit]
    sizes = [float(np.abs(array * scale).max()) for array, scale in zip(matrices, scales, strict=True)]
    return [
        max(PERIODIC * size, _ROUNDOFF * max(sizes)) / scale
        for size, scale in zip(sizes, scales, strict=True)
    ]


def require_inertia(M: Array, states: Sequence[str] = ()) -> None:
    """Raise MatricesError if one of the matrices M (k, n, n) is singular. states: names of first-order
    coordinates, whose columns are taken from C."""
    diagonal = np.sqrt(np.abs(np.einsum("kii->ki", M)))
    diagonal[diagonal == 0.0] = 1.0
    scaled = M / (diagonal[:, :, None] * diagonal[:, None, :])
    singular = np.linalg.cond(scaled) > _SINGULAR
    # Rows are scaled, because equations may have been multiplied by factors with units.
    for axis in (2, 1, 2, 1) if singular.any() else ():
        largest = np.abs(scaled).max(axis=axis, keepdims=True)
        scaled = scaled / np.where(largest > 0, largest, 1.0)
    if singular.any() and np.linalg.cond(scaled).max() > _SINGULAR:
        if states:
            raise MatricesError(
                f"the columns of M (coordinates) and of C (states {', '.join(states)}) are linearly "
                "dependent, so that the equations do not determine every highest derivative; give "
                "every coordinate a mass and every state an equation with its derivative"
            )
        raise MatricesError(
            "M is singular: some coordinate has no inertia; give every coordinate a mass, "
            "or omit massless coordinates"
        )
