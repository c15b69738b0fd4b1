"""What explains a maximum over speed: a division of a natural frequency, a combination of two, or nothing."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.period.multipliers import matched
from solve.results.critical_speeds import Combination, Critical, Maximum
from solve.studies.mean_frequencies import MeanFrequencies, excited
from solve.studies.mean_modes import mean_modes
from solve.system import PeriodicSystem

_NEAR, CLOSE = 0.2, 0.05
"""Difference of frequency over speed from an integer, and its part of this, up to which a maximum may belong
to that division."""

_TURNED = 0.02
"""Part of a full turn that a multiplier's angle may differ from what a division or a combination asks for."""

_DECAYS = 0.25
"""Part by which a mode's decay in a turn may differ from the mean of the frozen rates."""

_MOST = 9.0
"""Most that the square of a single difference counts, so that none alone decides which multipliers are
whose."""

_ALLOWED, _SURELY, _AS_GOOD = 3.0, 0.25, 0.3
"""Sum of squared differences, each over what is allowed, up to which something explains a maximum of a real
part, and one of the spectral radius, which is narrower; what has a sum larger than the least by more than the
last of these is ruled out."""

_WEAKER = 0.1
"""Added to the sum for each order above the first: higher orders are weaker."""

_ALIKE = 1e-3
"""Relative difference of speeds up to which maxima of the real part and of the modulus of a multiplier
coincide."""


class Explained(NamedTuple):
    """A maximum with the divisions that may explain it, modes from 1 on and their orders of rotation, or the
    combinations that do, equally well where they are several."""

    maximum: Maximum
    divisions: set[tuple[int, int]]
    combinations: Sequence[Combination] = ()


def allowed_distance(orders: Array | float) -> Array:
    """Differences of frequencies over the speed from orders, up to which these may explain a maximum."""
    return np.minimum(_NEAR, CLOSE * orders)


@dataclass(frozen=True)
class Turn:
    """What a period does to the modes at a speed (rad/s). rho (2n,): the multipliers; ratios (n,): the means
    of the natural frequencies over the speed, rising.

    Multipliers are matched to modes in pairs: conjugate ones, and real ones of one sign, of which the product
    alone tells the mode. A mode's pair has the angle ω̄T, up to whole turns and its sign, and decays by δT.
    All pairs are matched at once so that squares of the differences, each over what is allowed, have the
    least sum. Where pairs have one angle they may feed each other, and a decay may differ from its mode's as
    much as from the mean of theirs.
    """

    system: PeriodicSystem
    speed: float
    rho: Array
    ratios: Array

    @property
    def turns(self) -> float:
        """Turns of the mechanism in a period."""
        return self.system.period / (2 * math.pi)

    @cached_property
    def pairs(self) -> list[tuple[int, int]]:
        """Positions of the multipliers that belong together, n times."""
        upper = np.flatnonzero(np.imag(self.rho) > 0).tolist()
        lower = np.flatnonzero(np.imag(self.rho) < 0)
        found = [(one, int(lower[np.abs(self.rho[lower] - self.rho[one].conj()).argmin()])) for one in upper]
        real = [at for at in np.argsort(-np.real(self.rho)).tolist() if np.imag(self.rho[at]) == 0]
        left = [at for at in real if self.rho[at] == 0]
        for sign in (1, -1):
            alike = [at for at in real if sign * np.real(self.rho[at]) > 0]
            half = len(alike) // 2
            found += zip(alike[:half], alike[: len(alike) - half - 1 : -1], strict=True)
            left += alike[half : len(alike) - half]
        return found + list(zip(left[::2], left[1::2], strict=True))

    def pair_of(self, multiplier: int) -> int:
        """The pair (a position) with the multiplier at that position."""
        return next(at for at, pair in enumerate(self.pairs) if multiplier in pair)

    @cached_property
    def angles(self) -> Array:
        """Of the pairs (n,), parts of a full turn, 0 to 1/2."""
        return np.abs(np.angle(self.rho[[one for one, _ in self.pairs]])) / (2 * math.pi)

    def meeting(self, pair: int) -> list[int]:
        """The other pairs with the same angle."""
        near = np.flatnonzero(np.abs(self.angles - self.angles[pair]) <= _TURNED)
        return [int(other) for other in near if other != pair and self._known[other]]

    @cached_property
    def _known(self) -> Array:
        """Pairs (n,) of which both multipliers are resolved."""
        return np.array([abs(self.rho[one]) > 0 and abs(self.rho[other]) > 0 for one, other in self.pairs])

    @cached_property
    def _costs(self) -> Array:
        """(n, n) of pairs by modes; 0 for pairs of which nothing is known."""
        modulus = np.abs(self.rho[np.array(self.pairs)])
        logs = -np.log(np.where(modulus > 0, modulus, 1.0))
        decays, unsure = logs.mean(axis=1), np.abs(np.diff(logs, axis=1))[:, 0] / 2
        for pair in range(len(decays)):
            fed = [pair, *self.meeting(pair)]
            unsure[pair] += abs(decays[pair] - decays[fed].mean())
        rates = mean_modes(self.system, self.speed).rates / self.speed
        turned = np.sqrt(np.maximum(self.ratios**2 - rates**2, 0.0))
        allowed = self.turns * allowed_distance(self.ratios) + _TURNED
        off = (self.angles[:, None] - _folded(turned * self.turns)) / allowed
        decay = rates * self.turns * 2 * math.pi
        slower = (decays[:, None] - decay) / (_DECAYS * np.abs(decay) + unsure[:, None] + _TURNED)
        found = np.minimum(off**2, _MOST) + np.minimum(slower**2, _MOST)
        return np.where(self._known[:, None], np.nan_to_num(found, nan=_MOST), 0.0)

    @cached_property
    def _best(self) -> float:
        return float(self._costs[matched(self._costs)].sum())

    def misfit(self, modes: dict[int, int]) -> float:
        """Of the best match in which some pairs have these modes, by the pair, beyond the best of all."""
        pairs, others = (
            [at for at in range(len(self.pairs)) if at not in some] for some in (modes, modes.values())
        )
        left = self._costs[np.ix_(pairs, others)]
        least = left[matched(left)].sum() if left.size else 0.0
        return float(least + sum(self._costs[pair, mode] for pair, mode in modes.items())) - self._best

    def divided(self, lead: int, orders: int) -> list[tuple[float, Combination]]:
        """Divisions, as combinations of a mode with itself, that explain that the pair `lead` turns whole
        turns: misfit and division, the best first."""
        found = [
            (self._off(k, self.ratios[mode]) + self.misfit({lead: mode}), self._of(mode, mode, 1, 2 * k))
            for mode in range(len(self.ratios))
            if 1 <= (k := _nearest(self.ratios[mode])) <= orders
        ]
        return _allowed(found)

    def combined(self, lead: int, orders: int) -> list[tuple[float, Combination]]:
        """Combinations of two modes, or of one with itself, that feed the pair `lead` at its angle: misfit
        and combination, the best first."""
        found, modes, met = [], np.flatnonzero(self.ratios).tolist(), self.meeting(lead)
        for (low, high), sign in itertools.product(
            itertools.combinations_with_replacement(modes, 2), (1, -1)
        ):
            total = self.ratios[high] + sign * self.ratios[low]
            k = _nearest(total)
            if (
                not 1 <= k <= orders * (1 + (low == high))
                or abs(total - k) > allowed_distance(k)
                or not excited(self.system, k)
            ):
                continue
            if low != high:
                ways = [{lead: one, other: two} for other in met for one, two in ((low, high), (high, low))]
            else:
                turned = abs(self.angles[lead] - _folded(k * self.turns / 2)) <= _TURNED
                ways = [{lead: low}] if sign > 0 and turned else []
            found += [(self._off(k, total) + self.misfit(way), self._of(low, high, sign, k)) for way in ways]
        best: dict[Combination, float] = {}
        for misfit, one in found:
            best[one] = min(misfit, best.get(one, math.inf))
        return _allowed([(misfit, one) for one, misfit in best.items()], _WEAKER)

    def _off(self, order: int, total: float) -> float:
        """Square of a sum of frequencies over the speed off an order, over what is allowed."""
        return float((total - order) / allowed_distance(order)) ** 2

    def _of(self, low: int, high: int, sign: int, order: int) -> Combination:
        speed = self.speed * float(self.ratios[high] + sign * self.ratios[low]) / order
        return Combination(speed, (high + 1, low + 1), sign, order)


def of_real_part(turn: Turn, maximum: Maximum, lead: int, orders: int, *, unstable: bool) -> Explained:
    """What explains a maximum of the real part of a multiplier, at the position `lead`.

    An order of its mode does where the multiplier has turned to +1 but for the angle arctan(δ/ω): there
    exp(-δT) cos ωT is largest. Elsewhere, and where the motion is unstable, a combination does where a
    multiplier of another mode has turned as far, so that both meet, and the sum or difference of the frozen
    frequencies is near an order.
    """
    rho = turn.rho[lead]
    if rho == 0:
        return Explained(maximum, set())
    pair = turn.pair_of(lead)
    damped = math.atan(max(0.0, -math.log(abs(rho))) / (2 * math.pi * turn.turns)) / (2 * math.pi)
    whole = not unstable and turn.angles[pair] <= _TURNED + damped
    found = turn.divided(pair, orders) if whole else []
    return _explained(maximum, found or turn.combined(pair, orders))


def of_modulus(turn: Turn, maximum: Maximum, orders: int) -> Explained:
    """What explains a maximum of the spectral radius: modes whose multipliers meet, or one that has turned to
    +1 or -1."""
    return _explained(maximum, [one for one in turn.combined(turn.pair_of(0), orders) if one[0] <= _SURELY])


def assigned(
    rows: list[Critical], explained: list[Explained], frequencies: MeanFrequencies, way: str
) -> list[Critical]:
    """The rows with each maximum at the nearest division that explains it, higher maxima first. If no
    division explains a maximum, or if the frozen frequencies are meaningless there, it gets its own row or
    that of the same combination."""
    rows = list(rows)
    for one in sorted(explained, key=lambda one: -one.maximum.height):
        here = replace(frequencies, speeds=np.array([one.maximum.speed]))
        ratios = here.values[0] / one.maximum.speed
        several = () if here.imaginary[0] else one.combinations
        combination = several[0] if len(several) == 1 else None
        places = [
            (abs(ratios[(row.mode or 0) - 1] - (row.order or 0)), place)
            for place, row in enumerate(rows)
            if (row.mode, row.order) in one.divisions and getattr(row, way) is None and not here.imaginary[0]
        ]
        distance, place = min(places, default=(np.inf, 0))
        if not places or distance >= allowed_distance(rows[place].order or 0):
            place = next((at for at, row in enumerate(rows) if _tells(row, one, combination, way)), len(rows))
            candidates = several if len(several) > 1 else ()
            rows += [Critical(combination=combination, candidates=candidates)] * (place == len(rows))
        rows[place] = replace(rows[place], **{way: one.maximum})
    return rows


def _tells(row: Critical, one: Explained, combination: Combination | None, way: str) -> bool:
    """Whether a row already contains this maximum of that kind."""
    if getattr(row, way) is not None:
        return False
    apart = abs(row.speed - one.maximum.speed) / one.maximum.speed
    if combination is not None and row.combination is not None:
        return combination.same(row.combination) and apart < CLOSE
    return way == "radius" and row.multiplier is not None and apart < _ALIKE


def _explained(maximum: Maximum, found: list[tuple[float, Combination]]) -> Explained:
    every = [one for _, one in found]
    if every and all(one.is_division and one.order == every[0].order for one in every):
        return Explained(maximum, {(one.modes[0], one.order // 2) for one in every})
    return Explained(maximum, set(), every)


def _allowed(found: list[tuple[float, Combination]], weaker: float = 0.0) -> list[tuple[float, Combination]]:
    """Those that explain, the best first, without those that another is clearly better than; weaker: what is
    added for each order above the first."""

    def rank(one: tuple[float, Combination]) -> float:
        return one[0] + weaker * (one[1].order - 1)

    found = sorted((one for one in found if one[0] <= _ALLOWED), key=rank)
    return [one for one in found if rank(one) <= rank(found[0]) + _AS_GOOD]


def _nearest(total: float) -> int:
    return round(float(np.nan_to_num(total)))


def _folded(turns: Array | float) -> Array:
    """Angles in full turns, 0 to 1/2, up to whole turns and their sign."""
    return np.abs(turns - np.round(turns))
