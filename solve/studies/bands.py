"""Bands of speed in which the motion is unstable, with edges refined by bisection."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from solve.arrays import Array
from solve.errors import ValueOutOfBoundsError
from solve.floquet import Stability, floquet
from solve.methods.method import Method
from solve.system import PeriodicSystem
from solve.units import speed_in_si

GROWTH = 1e-6
"""Growth a turn that makes a band: less is within what two multipliers that meet lose to rounding."""

_GOLDEN = (3 - 5**0.5) / 2


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
) -> list[Band]:
    """Unstable bands between the lowest and the highest of the speeds (rad/s, or texts with unit).

    Bands narrower than the distance of two speeds are looked for where multipliers come closest to
    each other, to +1 and to -1 between them; a growth below 1e-6 a turn makes no band. Edges are bisected to `tolerance`, relative.
    """
    omegas = sorted({speed_in_si(speed) for speed in speeds})
    if len(omegas) < 2:
        raise ValueOutOfBoundsError("bands need at least two speeds; give a range such as '100:900:81 rpm'")
    search = _Search(system, method, rtol, progress)
    for omega in omegas:
        search.at(omega)
    for middle in range(1, len(omegas) - 1):
        search.between(*omegas[middle - 1 : middle + 2])
    return search.found(tolerance)


@dataclass
class _Search:
    system: PeriodicSystem
    method: str | Method
    rtol: float
    progress: Callable[[int], None] | None
    known: dict[float, Stability] = field(default_factory=dict)

    def at(self, omega: float) -> Stability:
        if omega not in self.known:
            self.known[omega] = floquet(self.system, omega, self.method, rtol=self.rtol)
            if self.progress:
                self.progress(len(self.known))
        return self.known[omega]

    def stable(self, omega: float) -> bool:
        return self.at(omega).stable

    def between(self, low: float, middle: float, high: float) -> None:
        """Follow a pair of multipliers that is closest at the middle speed to where it meets."""
        if not all(map(self.stable, (low, middle, high))):
            return
        for gap in (_gap_to_one, _gap_to_minus_one, _gap_between_pairs):
            gaps = [gap(self.at(omega).multipliers) for omega in (low, middle, high)]
            if gaps[1] < min(gaps[0], gaps[2]):
                self._descend(gap, low, middle, high)

    def _descend(self, gap: Callable[[Array], float], low: float, middle: float, high: float) -> None:
        """Golden section on the gap, until an unstable speed is met or the bracket is small."""
        for _ in range(40):
            into_high = high - middle > middle - low
            trial = middle + _GOLDEN * ((high if into_high else low) - middle)
            if not self.stable(trial) or abs(high - low) < 1e-9 * high:
                return
            if gap(self.at(trial).multipliers) < gap(self.at(middle).multipliers):
                low, middle, high = (middle, trial, high) if into_high else (low, trial, middle)
            elif into_high:
                high = trial
            else:
                low = trial

    def found(self, tolerance: float) -> list[Band]:
        omegas = sorted(self.known)
        found = []
        start: int | None = None
        for i, omega in enumerate(omegas):
            if not self.stable(omega) and start is None:
                start = i
            if start is not None and (self.stable(omega) or i == len(omegas) - 1):
                found += self._split(omegas, start, i if self.stable(omega) else i + 1, tolerance)
                start = None
        return [band for band in found if band.spectral_radius > 1 + GROWTH]

    def _split(self, omegas: list[float], first: int, last: int, tolerance: float) -> list[Band]:
        """The bands among the unstable speeds first … last-1, edges refined; one a kind."""
        low = self._edge(omegas[first - 1], omegas[first], tolerance) if first else omegas[0]
        high = self._edge(omegas[last], omegas[last - 1], tolerance) if last < len(omegas) else omegas[-1]
        inside = [omegas[i] for i in range(first, last)]
        made = []
        begin, kind = low, self._kind(inside[0])
        group = [inside[0]]
        for omega in inside[1:]:
            if self._kind(omega) == kind:
                group.append(omega)
                continue
            border = self._border(group[-1], omega, tolerance)
            made.append((begin, border, kind, group))
            begin, kind, group = border, self._kind(omega), [omega]
        made.append((begin, high, kind, group))
        return [
            Band(
                start,
                end,
                kind,
                max(self.at(omega).spectral_radius for omega in group),
                open_low=first == 0 and start == low,
                open_high=last == len(omegas) and end == high,
            )
            for start, end, kind, group in made
        ]

    def _kind(self, omega: float) -> str:
        leader = self.at(omega).multipliers[0]
        if abs(leader.imag) > 1e-6 * abs(leader):
            return "complex"
        return "+1" if leader.real > 0 else "-1"

    def _edge(self, stable: float, unstable: float, tolerance: float) -> float:
        while abs(unstable - stable) > tolerance * unstable:
            middle = (stable + unstable) / 2
            stable, unstable = (middle, unstable) if self.stable(middle) else (stable, middle)
        return (stable + unstable) / 2

    def _border(self, one: float, other: float, tolerance: float) -> float:
        """Where the kind changes within an unstable range."""
        kind = self._kind(one)
        while abs(other - one) > tolerance * other:
            middle = (one + other) / 2
            one, other = (middle, other) if self._kind(middle) == kind else (one, middle)
        return (one + other) / 2


def _gap_to_one(multipliers: Array) -> float:
    return float(np.abs(multipliers - 1).min(initial=np.inf))


def _gap_to_minus_one(multipliers: Array) -> float:
    return float(np.abs(multipliers + 1).min(initial=np.inf))


def _gap_between_pairs(multipliers: Array) -> float:
    """Smallest distance between two multipliers of the upper half plane."""
    upper = multipliers[np.imag(multipliers) > 0]
    distance = np.abs(upper[:, None] - upper)
    return float(distance[np.triu_indices(len(upper), 1)].min(initial=np.inf))
