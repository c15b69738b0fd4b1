"""Bands of speed in which the motion is unstable, with refined edges."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.batch.batch import Batch
from solve.batch.engines import chosen_engine
from solve.batch.family import over_speed
from solve.errors import ValueOutOfBoundsError
from solve.methods.choice import chosen
from solve.methods.method import Method
from solve.studies.boundaries import KINDS, Judge, Judged, edges, hidden, judge, sectioned
from solve.system import PeriodicSystem
from solve.units import checked_rtol, speed_in_si

GROWTH = 1e-6
"""Growth a turn that makes a band: less is within what two multipliers that meet lose to rounding."""

_INSIDE = 15
"""Further points of every band, to find its largest multiplier."""


@dataclass(frozen=True)
class Band:
    """low, high: edges in rad/s, those of the range where the band goes on beyond it (open).

    kind: the multiplier that leaves the unit circle: "+1" (period T), "-1" (period 2T) or "complex".
    spectral_radius: the largest that was met inside.
    """

    low: float
    high: float
    kind: str
    spectral_radius: float
    open_low: bool = False
    open_high: bool = False


def bands(
    system: PeriodicSystem,
    speeds: Sequence[float | str] | Array,
    method: str | Method = "auto",
    rtol: float = 1e-8,
    tolerance: float = 1e-7,
    progress: Callable[[int], None] | None = None,
    engine: str = "auto",
) -> list[Band]:
    """Unstable bands between the lowest and the highest of the speeds (rad/s, or texts with unit).

    Bands narrower than the distance of two speeds are looked for where multipliers come closest to
    each other, to +1 and to -1 between them; a growth below 1e-6 a turn makes no band. Edges are found to
    `tolerance`, relative. progress is told the number of points solved so far. engine: as in `sweep`.
    """
    omegas = np.unique([speed_in_si(speed) for speed in speeds])
    if len(omegas) < 2:
        raise ValueOutOfBoundsError("bands need at least two speeds; give a range such as '100:900:81 rpm'")
    points, solved = omegas[:, None], [0]

    def count(more: int) -> None:
        solved[0] += more
        if progress:
            progress(solved[0])

    batch = Batch(
        over_speed(system), points, chosen(method), chosen_engine(engine)[0], rtol=checked_rtol(rtol)
    )
    asked = judge(batch, count)
    known = asked(points)
    middle = np.arange(1, len(omegas) - 1)
    known += hidden(asked, known[middle - 1], known[middle], known[middle + 1])
    return _Runs(asked, known[np.argsort(known.points[:, 0])], tolerance).bands()


@dataclass(frozen=True)
class _Runs:
    """Runs of unstable speeds of one kind among known ones, rising."""

    judge: Judge
    known: Judged
    tolerance: float

    def bands(self) -> list[Band]:
        state = np.where(self.known.stable, -1, self.known.kinds)
        changes = np.flatnonzero(np.diff(state))
        borders = dict(zip(changes.tolist(), self._borders(changes, state), strict=True))
        starts = [0, *(changes + 1).tolist()]
        ends = [*changes.tolist(), len(state) - 1]
        speeds = self.known.points[:, 0]
        found = []
        for first, last in zip(starts, ends, strict=True):
            if state[first] < 0:
                continue
            low, high = borders.get(first - 1, speeds[0]), borders.get(last, speeds[-1])
            radius = max(self._largest(low, high), np.abs(self.known.multipliers[first : last + 1, 0]).max())
            open_ends = first == 0, last == len(state) - 1
            found.append(Band(float(low), float(high), KINDS[state[first]], float(radius), *open_ends))
        return [band for band in found if band.spectral_radius > 1 + GROWTH]

    def _borders(self, changes: Array, state: Array) -> Array:
        """Speeds between known ones at which the state changes."""
        low, high = self.known.points[changes], self.known.points[changes + 1]
        borders, scale = np.empty(len(changes)), np.abs(high).max(axis=0, initial=0.0)
        loses, wins = state[changes] < 0, state[changes + 1] < 0
        kind_only = ~(loses | wins)
        stable, unstable = np.where(loses[:, None], low, high), np.where(loses[:, None], high, low)
        places, _ = edges(self.judge, stable[~kind_only], unstable[~kind_only], scale, self.tolerance)
        borders[~kind_only] = places[:, 0]
        if kind_only.any():
            kinds = state[changes][kind_only]

            def differs(points: Array, lines: Array) -> Array:
                found = self.judge(points)
                return found.stable | (found.kinds != kinds[lines])

            ends = sectioned(differs, low[kind_only], high[kind_only], scale, self.tolerance)
            borders[kind_only] = (ends[0] + ends[1])[:, 0] / 2
        return borders

    def _largest(self, low: float, high: float) -> float:
        inside = low + (np.arange(_INSIDE) + 1) * (high - low) / (_INSIDE + 1)
        return float(np.abs(self.judge(inside[:, None]).multipliers[:, 0]).max())
