"""Labels of maxima versus speed: integer divisions of a natural frequency, and combinations of two natural
frequencies."""

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
from solve.studies.mean_frequencies import CLOSE, MeanFrequencies, is_excited
from solve.studies.mean_modes import mean_modes
from solve.system import PeriodicSystem

_NEAR = 0.2
"""A maximum may belong to an integer division if the ratio of frequency to speed is close to the integer. The
difference may be at most this number, and at most the fraction `CLOSE` of the integer. Chosen by
judgement."""

_ANGLE_TOLERANCE = 0.02
"""Allowed difference between the angle of a multiplier and the angle implied by a division or combination, as
a fraction of 2π. Chosen by judgement."""

_DECAY_TOLERANCE = 0.25
"""Allowed relative difference between the decay of a mode per period and the mean of the frozen decay rates.
Chosen by judgement."""

_MAX_COST = 9.0
"""Upper limit of each squared difference, reached at three times the allowed difference, so that no single
difference decides the matching. Chosen by judgement."""

_MAX_MISFIT, _MAX_RADIUS_MISFIT, _EQUIVALENT = 3.0, 0.25, 0.3
"""Limits of a sum of squared differences, each relative to its allowed value. The first limit is for maxima
of a real part. The second is for maxima of the spectral radius, which are narrower. The third number is the
excess over the smallest sum up to which a label counts as equally good. Chosen by judgement."""

_ORDER_PENALTY = 0.1
"""Penalty added to the sum of squared differences for each order above the first, because resonances of
higher order are weaker. Chosen by judgement."""

_SAME_SPEED = 1e-3
"""A maximum of the real part and a maximum of the modulus of a multiplier count as the same resonance if the
relative difference of their speeds is at most this number. Chosen by judgement."""

Fit = tuple[float, Combination]
"""Misfit of a combination, followed by the combination."""


class Label(NamedTuple):
    """Maximum with the resonances that may explain it. These are combinations, or resonances of one mode,
    given by the number of the mode (from 1) and the integer ratio of its frequency to the speed. If several
    resonances explain the maximum equally well, all are listed."""

    maximum: Maximum
    divisions: set[tuple[int, int]]
    combinations: Sequence[Combination] = ()

    @property
    def is_explained(self) -> bool:
        """Whether a division or a combination explains the maximum."""
        return bool(self.divisions or self.combinations)


def allowed_distance(orders: Array | float) -> Array:
    """For each order, return the largest difference allowed between the order and the ratio of a frequency to
    the speed. With a larger difference, the order cannot explain a maximum."""
    return np.minimum(_NEAR, CLOSE * orders)


@dataclass(frozen=True)
class MultiplierMatcher:
    """Matching of multipliers `rho` (2n,) to modes at a speed (rad/s). `ratios` (n,) are the ascending ratios
    of the mean natural frequencies to the speed.

    Multipliers are matched to modes in pairs: conjugate multipliers, and real multipliers of equal sign, of
    which only the product identifies the mode. The pair of a mode has the angle ω̄T, up to sign and multiples
    of 2π, and the logarithmic decrement δT. All pairs are matched simultaneously so that the sum of the
    squared differences of angles and decrements, each relative to its allowed value, is smallest. Pairs with
    the same angle may exchange energy. For such a pair, the allowed difference of decrements is therefore
    increased by the distance of the pair's decrement from the mean decrement of all pairs with this angle.
    """

    system: PeriodicSystem
    speed: float
    rho: Array
    ratios: Array

    @property
    def revolutions(self) -> float:
        """Revolutions of the mechanism per period."""
        return self.system.period / (2 * math.pi)

    @cached_property
    def pairs(self) -> list[tuple[int, int]]:
        """Indices of the multipliers in each of the n pairs."""
        upper = np.flatnonzero(np.imag(self.rho) > 0).tolist()
        lower = np.flatnonzero(np.imag(self.rho) < 0)
        pairs = [(one, int(lower[np.abs(self.rho[lower] - self.rho[one].conj()).argmin()])) for one in upper]
        real = [at for at in np.argsort(-np.real(self.rho)).tolist() if np.imag(self.rho[at]) == 0]
        remaining = [at for at in real if self.rho[at] == 0]
        for sign in (1, -1):
            same_sign = [at for at in real if sign * np.real(self.rho[at]) > 0]
            half = len(same_sign) // 2
            pairs += zip(same_sign[:half], same_sign[: len(same_sign) - half - 1 : -1], strict=True)
            remaining += same_sign[half : len(same_sign) - half]
        return pairs + list(zip(remaining[::2], remaining[1::2], strict=True))

    def pair_of(self, multiplier: int) -> int:
        """Index of the pair that contains the multiplier with index `multiplier`."""
        return next(at for at, pair in enumerate(self.pairs) if multiplier in pair)

    @cached_property
    def angles(self) -> Array:
        """Angles (n,) of the pairs as fractions of 2π, from 0 to 1/2."""
        return np.abs(np.angle(self.rho[[first for first, _ in self.pairs]])) / (2 * math.pi)

    def pairs_at_angle_of(self, pair: int) -> list[int]:
        """Indices of the other pairs that are resolved and have the same angle as this pair."""
        near = np.flatnonzero(np.abs(self.angles - self.angles[pair]) <= _ANGLE_TOLERANCE)
        return [int(other) for other in near if other != pair and self._resolved[other]]

    @cached_property
    def _resolved(self) -> Array:
        """Mask (n,) of the pairs whose multipliers are both resolved."""
        return np.all(np.abs(self.rho[np.array(self.pairs)]) > 0, axis=1)

    @cached_property
    def _costs(self) -> Array:
        """Costs (n, n) of matching pairs to modes: sums of the squared differences of angles and of
        decrements, relative to the allowed values. They are 0 for pairs that are not resolved."""
        modulus = np.abs(self.rho[np.array(self.pairs)])
        logs = -np.log(np.where(modulus > 0, modulus, 1.0))
        decays, tolerance = logs.mean(axis=1), np.abs(np.diff(logs, axis=1))[:, 0] / 2
        for pair in range(len(decays)):
            coupled = [pair, *self.pairs_at_angle_of(pair)]
            tolerance[pair] += abs(decays[pair] - decays[coupled].mean())
        rates = mean_modes(self.system, self.speed).rates / self.speed
        damped = np.sqrt(np.maximum(self.ratios**2 - rates**2, 0.0))
        allowed = self.revolutions * allowed_distance(self.ratios) + _ANGLE_TOLERANCE
        angle = (self.angles[:, None] - _folded(damped * self.revolutions)) / allowed
        decay = rates * self.revolutions * 2 * math.pi
        allowed = _DECAY_TOLERANCE * np.abs(decay) + tolerance[:, None] + _ANGLE_TOLERANCE
        slower = (decays[:, None] - decay) / allowed
        costs = np.minimum(angle**2, _MAX_COST) + np.minimum(slower**2, _MAX_COST)
        return np.where(self._resolved[:, None], np.nan_to_num(costs, nan=_MAX_COST), 0.0)

    @cached_property
    def _least_cost(self) -> float:
        return float(self._costs[matched(self._costs)].sum())

    def misfit(self, modes: dict[int, int]) -> float:
        """Return the cost of the best matching in which each pair that is a key of `modes` has the mode
        `modes[pair]`, minus the cost of the best matching without this condition."""
        pairs, others = (
            [at for at in range(len(self.pairs)) if at not in fixed] for fixed in (modes, modes.values())
        )
        free = self._costs[np.ix_(pairs, others)]
        least = free[matched(free)].sum() if free.size else 0.0
        fixed = sum(self._costs[pair, mode] for pair, mode in modes.items())
        return float(least + fixed) - self._least_cost

    def divisions(self, pair: int, orders: int) -> list[Fit]:
        """Divisions, as combinations of a mode with itself, that explain why a pair passes through +1. The
        best comes first."""
        return _plausible(
            [
                (
                    self._deviation(k, self.ratios[mode]) + self.misfit({pair: mode}),
                    self._combination(mode, mode, 1, 2 * k),
                )
                for mode in range(len(self.ratios))
                if 1 <= (k := _nearest(self.ratios[mode])) <= orders
            ]
        )

    def combinations(self, pair: int, orders: int) -> list[Fit]:
        """Combinations of two modes, or of one mode with itself, that excite a pair at its angle. The best
        comes first."""
        elastic, others = np.flatnonzero(self.ratios).tolist(), self.pairs_at_angle_of(pair)
        best: dict[Combination, float] = {}
        for (low, high), sign in itertools.product(
            itertools.combinations_with_replacement(elastic, 2), (1, -1)
        ):
            total = self.ratios[high] + sign * self.ratios[low]
            k, most = _nearest(total), orders * (1 + (low == high))
            if not (1 <= k <= most and abs(total - k) <= allowed_distance(k) and is_excited(self.system, k)):
                continue
            combination = self._combination(low, high, sign, k)
            for modes in self._assignments(pair, others, low, high, sign * k):
                misfit = self._deviation(k, total) + self.misfit(modes)
                best[combination] = min(misfit, best.get(combination, math.inf))
        return _plausible([(misfit, one) for one, misfit in best.items()], _ORDER_PENALTY)

    def _assignments(
        self, pair: int, others: list[int], low: int, high: int, signed_order: int
    ) -> list[dict[int, int]]:
        """Return the assignments of modes to pairs of multipliers with which the combination of the modes
        `low` and `high` can excite `pair`. Two different modes require a second pair at the same angle, one
        of `others`."""
        if low != high:
            return [{pair: one, other: two} for other in others for one, two in ((low, high), (high, low))]
        angle = _folded(signed_order * self.revolutions / 2)
        at_angle = abs(self.angles[pair] - angle) <= _ANGLE_TOLERANCE
        return [{pair: low}] if signed_order > 0 and at_angle else []

    def _deviation(self, order: int, total: float) -> float:
        """Squared difference between an order and `total`, the ratio of a sum of frequencies to the speed,
        relative to the allowed difference."""
        return float((total - order) / allowed_distance(order)) ** 2

    def _combination(self, low: int, high: int, sign: int, order: int) -> Combination:
        speed = self.speed * float(self.ratios[high] + sign * self.ratios[low]) / order
        return Combination(speed, (high + 1, low + 1), sign, order)

    def label_real_part(self, maximum: Maximum, multiplier: int, orders: int, unstable: bool) -> Label:
        """Label of a maximum of the real part of the multiplier with index `multiplier`.

        Suppose that the motion is stable and that the angle of the multiplier is near 0 or at most
        arctan(δ/ω). At the angle arctan(δ/ω), exp(-δT) cos ωT is largest. The maximum is then attributed to
        an integer division of the frequency of the multiplier's mode. Otherwise it is attributed to a
        combination if two conditions hold: the multiplier of another mode has the same angle, and the sum or
        difference of the frozen frequencies is near an integer multiple of the speed.
        """
        rho = self.rho[multiplier]
        if rho == 0:
            return Label(maximum, set())
        pair = self.pair_of(multiplier)
        decrement = max(0.0, -math.log(abs(rho)))
        shift = math.atan(decrement / (2 * math.pi * self.revolutions)) / (2 * math.pi)
        at_plus_one = not unstable and self.angles[pair] <= _ANGLE_TOLERANCE + shift
        divisions = self.divisions(pair, orders) if at_plus_one else []
        return _label(maximum, divisions or self.combinations(pair, orders))

    def label_radius(self, maximum: Maximum, orders: int) -> Label:
        """Label of a maximum of the spectral radius, at which the multipliers of two modes meet, or one
        multiplier passes through +1 or -1."""
        fits = self.combinations(self.pair_of(0), orders)
        return _label(maximum, [fit for fit in fits if fit[0] <= _MAX_RADIUS_MISFIT])


def assign(
    rows: list[Critical], labels: list[Label], frequencies: MeanFrequencies, column: str
) -> list[Critical]:
    """Return rows in which the maxima of `labels` are inserted in a column, the highest first. A maximum is
    inserted in the row of the nearest division that explains it. If there is no such division, or if frozen
    frequencies are imaginary at the maximum, the row is that of the same combination or a new row.
    """
    rows = list(rows)
    for label in sorted(labels, key=lambda label: -label.maximum.height):
        speed = label.maximum.speed
        here = replace(frequencies, speeds=np.array([speed]))
        meaningful = not here.imaginary[0]
        at = _row_of_division(rows, label, here.values[0] / speed, column) if meaningful else None
        if at is None:
            several = label.combinations if meaningful else ()
            combination = several[0] if len(several) == 1 else None
            same = (k for k, row in enumerate(rows) if _belongs(row, label, combination, column))
            at = next(same, len(rows))
            if at == len(rows):
                candidates = several if len(several) > 1 else ()
                rows.append(Critical(combination=combination, candidates=candidates))
        rows[at] = replace(rows[at], **{column: label.maximum})
    return rows


def _row_of_division(rows: list[Critical], label: Label, ratios: Array, column: str) -> int | None:
    """Return the index of the row whose division is nearest, among the rows that belong to a division of the
    label and have no entry in `column`. Return None if no such division is near enough."""
    distances = [
        (abs(ratios[(row.mode or 0) - 1] - (row.order or 0)), at)
        for at, row in enumerate(rows)
        if (row.mode, row.order) in label.divisions and getattr(row, column) is None
    ]
    distance, at = min(distances, default=(np.inf, -1))
    return at if distances and distance < allowed_distance(rows[at].order or 0) else None


def _belongs(row: Critical, label: Label, combination: Combination | None, column: str) -> bool:
    """Return whether a row, with an empty column, shows the resonance of a label that no division
    explains."""
    if getattr(row, column) is not None:
        return False
    distance = abs(row.speed - label.maximum.speed) / label.maximum.speed
    if combination is not None and row.combination is not None:
        return combination.same(row.combination) and distance < CLOSE
    return column == "radius" and row.multiplier is not None and distance < _SAME_SPEED


def _label(maximum: Maximum, fits: list[Fit]) -> Label:
    """Return a label that contains divisions if all fits are divisions of the same order, and otherwise
    combinations."""
    explaining = [one for _, one in fits]
    if explaining and all(one.is_division and one.order == explaining[0].order for one in explaining):
        return Label(maximum, {(one.modes[0], one.order // 2) for one in explaining})
    return Label(maximum, set(), explaining)


def _plausible(fits: list[Fit], penalty: float = 0.0) -> list[Fit]:
    """Return the combinations with a small misfit, the best first, without those that are clearly worse than
    the best. `penalty` is added to the misfit for each order above the first."""

    def rank(fit: Fit) -> float:
        return fit[0] + penalty * (fit[1].order - 1)

    fits = sorted((fit for fit in fits if fit[0] <= _MAX_MISFIT), key=rank)
    return [fit for fit in fits if rank(fit) <= rank(fits[0]) + _EQUIVALENT]


def _nearest(total: float) -> int:
    return round(float(np.nan_to_num(total)))


def _folded(turns: Array | float) -> Array:
    """Return the distances, 0 … 1/2, of `turns` from the nearest integers. `turns` are angles as fractions of
    2π."""
    return np.abs(turns - np.round(turns))
