"""Orders of M, C, K and d, their variations over the period, that the samples of a method do not tell.

A smooth system has orders over its period; one with jumps has orders over each piece between two of them,
those of Chebyshev's polynomials: either way even samples on a circle give them.
"""

import weakref
from collections.abc import Callable

import numpy as np

from solve.arrays import Array
from solve.certify.pace import Pace, estimated
from solve.methods.method import Method
from solve.period.grid import pieces, steps_of
from solve.period.multipliers import EPS
from solve.period.points import Points, parted

_PHASES = 1001
"""At which orders of a period are looked for, no multiple of any grid's; of pieces, twice as many in all."""

_FEWEST = 8
"""Orders that are looked for in a piece at least."""

_MEMORY = 2**25
"""Bytes of matrices at these phases that are looked at at once."""

ALIAS = 0.01
"""Part of the tolerance that orders may have that samples do not tell: a resonance may enlarge them."""

_TAIL = 0.75
"""Part of the orders that these phases show, from which on parts are taken for the beginning of more."""

_BLIND = 0.1
"""Part that orders may have which steps do not follow, if the differences of their solutions are to tell
anything: what stands at one phase, as a pulse does, may lie between the samples of every grid."""

_UNRESOLVED_ORDER = 2.0
"""With which errors fall at most as long as orders are not resolved: as with a kink."""


def aliasing(points: Points, method: Method, finest: int, given: bool = False) -> Array:
    """Errors (P, 2) of orbit and multipliers that samples cannot tell: orders of M, C, K and, for the orbit
    alone, of d that look like lower ones on every grid, such as 48 teeth.

    On evenly spaced samples these are orders above half the finest grid's steps; a series needs the orders
    about them too. Uneven samples tell them by and by, see `unresolved`, but not where the steps are `given`:
    those follow orders as they do modes.
    """
    if not (method.samples_evenly or given):
        return np.zeros((len(points), 2))
    if not method.samples_evenly:
        return _beyond(points, finest, method.follows)
    return _beyond(points, finest, np.pi / 2 if method.spectral else np.pi)


def unresolved(
    points: Points, method: Method, pace: Pace, found: Array, before: Array, wanted: Array
) -> Array:
    """Errors (P, 2) of orbit and multipliers on the finer of two grids, as `estimated` has them, that orders
    of the matrices may leave which the uneven samples of a step do not follow: errors that fall with no
    more than the second power of the steps, whatever the differences show. Orders that are large enough for
    the `wanted` errors (P, 2) to be missed are believed to matter no more than that only if three grids tell,
    and not where they are most of what varies."""
    if method.samples_evenly:
        return np.zeros((len(points), 2))
    loaded = method.loaded(points)
    steps = round(pace.steps * loaded.period / points.period)
    angle = 2 * method.follows
    parts = _beyond(loaded, steps, angle, _TAIL)
    if not parts.any():
        return parts
    orders = np.minimum((method.curve_order, method.order), _UNRESOLVED_ORDER)
    tells = parts <= ALIAS * wanted
    if pace.tells.any() and not tells.all():
        tells |= pace.tells[:, None] & (_beyond(loaded, steps, angle) <= _BLIND)
    return np.fmin(parts / ALIAS, np.where(tells, estimated(found, before, pace, orders), np.inf))


def _beyond(points: Points, steps: int, angle: float, most: float = 1.0) -> Array:
    """Parts (P, 2) of M, C, K or d, whichever is larger, and of M, C or K alone, in orders that turn by more
    than an angle a step, or that are beyond a part, `most`, of those looked for; the largest order is 1."""
    circles = _circles(points, steps, angle)
    seen = [min(last, int(most * (len(phases) // 2))) for phases, last in circles]
    if all(2 * last + 1 >= len(phases) for last, (phases, _) in zip(seen, circles, strict=True)):
        return np.zeros((len(points), 2))
    phases = np.concatenate([phases for phases, _ in circles])
    ends = np.cumsum([len(each) for each, _ in circles[:-1]])

    def sizes(samples: Array) -> tuple[Array, Array]:
        """Largest order, and the sum of those not seen, of samples (…, k, m): (…, m) each."""
        return _largest_and_sums(_orders(samples, ends), seen)

    own = points.bytes_a_phase
    fit = max(1, _MEMORY // (len(phases) * max(own, 8 * (3 * points.n**2 + points.n))))
    if len(points) <= fit or not own:
        tables = points.tables(phases)
        # Tables that points have of their own do not come again.
        if tables.own:
            largest, rest = _by_columns(tables.table, sizes)
        else:
            largest, rest = _largest_and_sums(_latest(tables.table, ends), seen)
        if (rest <= 64 * EPS * largest).all():
            return np.zeros((len(points), 2))
        if len(points) <= fit:
            entries = tables.entries()
            if entries is not tables.table:
                largest, rest = _by_columns(entries, sizes)
            return _parts(parted(entries, points.n)[0], parted(largest, points.n), parted(rest, points.n))
    split = np.array_split(np.arange(len(points)), -(-len(points) // fit))
    return np.concatenate([_beyond(points[some], steps, angle, most) for some in split])


def _orders(samples: Array, ends: Array) -> list[Array]:
    """Moduli of the orders (…, k', m) of each part of samples (…, k, m), parted at `ends`."""
    with np.errstate(over="ignore", invalid="ignore"):
        return [np.abs(np.fft.rfft(part, axis=-2, norm="forward")) for part in np.split(samples, ends, -2)]


def _by_columns(samples: Array, sizes: Callable[[Array], tuple[Array, Array]]) -> tuple[Array, Array]:
    """Both sizes (P, m) of samples (P, k, m), with as many columns at a time as fit into memory."""
    parts = np.array_split(samples, max(1, samples.nbytes // _MEMORY), axis=-1)
    largest, rest = zip(*map(sizes, parts), strict=True)
    return np.concatenate(largest, axis=-1), np.concatenate(rest, axis=-1)


class _Latest:
    """`_orders` of the last table, which a model keeps for its next solutions."""

    def __init__(self) -> None:
        self._kept: tuple[weakref.ref[Array], list[Array]] | None = None

    def __call__(self, table: Array, ends: Array) -> list[Array]:
        kept = self._kept
        if kept is None or kept[0]() is not table:
            kept = self._kept = weakref.ref(table), _orders(table, ends)
        return kept[1]


_latest = _Latest()


def _largest_and_sums(orders: list[Array], seen: list[int]) -> tuple[Array, Array]:
    """Of each part the largest order, and the sum of those beyond the last that is seen, (…, m); the larger
    of the parts."""
    largest = np.max([each.max(axis=-2) for each in orders], axis=0)
    sums = [each[..., last + 1 :, :].sum(axis=-2) for each, last in zip(orders, seen, strict=True)]
    return largest, np.max(sums, axis=0)


def _circles(points: Points, steps: int, angle: float) -> list[tuple[Array, int]]:
    """Phases (k,) of each piece between jumps, even on a circle, and the last order there that turns by no
    more than an angle in any of so many steps."""
    period = points.period
    if not points.breaks:
        return [(np.arange(_PHASES) * (period / _PHASES), int(steps * (angle / (2 * np.pi))))]
    ends, _ = pieces(period, points.breaks)
    lengths = np.diff(ends)
    found = []
    for first, length, own in zip(ends[:-1], lengths, steps_of(steps, lengths / period), strict=True):
        # An even number, so that no phase is an end, where the matrices jump.
        count = 2 * max(_FEWEST, round(_PHASES * length / period))
        phases = first + length / 2 * (1 + np.cos(np.pi * (2 * np.arange(count) + 1) / count))
        found.append((phases, int(own * angle / 2)))
    return found


def _parts(M: Array, largest: tuple[Array, ...], rest: tuple[Array, ...]) -> Array:
    """What `_beyond` gives of M (P, k, n, n) at the phases and of both sizes of M, C, K (P, n, n) and d
    (P, n), in units in which the inertias are about 1."""
    tiny = np.finfo(float).tiny
    unit = 1.0 / np.sqrt(np.maximum(np.abs(np.einsum("pkii->pki", M)).mean(axis=1), tiny))
    of_matrices = unit[:, :, None] * unit[:, None, :]
    found = []
    for scale, size, left in zip([of_matrices] * 3 + [unit], largest, rest, strict=True):
        most, remaining = ((scale * each).reshape(len(M), -1).max(axis=1) for each in (size, left))
        found.append(remaining / np.maximum(most, tiny))
    return np.column_stack([np.max(found, axis=0), np.max(found[:-1], axis=0)])
