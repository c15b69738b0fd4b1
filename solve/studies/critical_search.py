"""Search for the maxima of the response and of the multipliers as functions of speed. The maxima are labelled
with the resonances that cause them."""

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from solve.arrays import Array
from solve.batch.batch import Batch
from solve.batch.gathering import gathered
from solve.period.multipliers import UNIT_CIRCLE, UNSTABLE
from solve.results.critical_speeds import Maximum
from solve.results.points import FIGURES, Kept, PointResults, selected
from solve.results.sweep import Sweep
from solve.studies.boundaries import BoundarySearch
from solve.studies.constant_coefficients import ConstantCoefficients
from solve.studies.maxima import Brackets, Trials, narrow_to_height, narrow_to_tolerance, peaks
from solve.studies.mean_frequencies import CLOSE, MeanFrequencies
from solve.studies.resonances import Label, MultiplierMatcher
from solve.studies.speed_grids import LIGHTLY_DAMPED, Rotation, by_speed, separate_crossings
from solve.studies.stability_samples import (
    StabilitySamples,
    coalescence_distance,
    crosses_plus_one,
    evaluator,
)
from solve.studies.tongues import find_narrow_tongues
from solve.system import PeriodicSystem, multiplier_count

_ASIDE = 0.25
"""Distance from a maximum to the speeds at which the response is computed for comparison, as a fraction of
the distance between neighbouring divisions. Chosen by judgement: these speeds must lie outside the peak of
this maximum, and before the next maximum."""

_BESIDE = 4.0
"""Results for comparison are computed at this distance on either side of a maximum. The unit of the distance
is the tolerance of the speed of the maximum. Chosen by judgement, larger than the error of the speed."""


_SHARE = 0.1
"""A harmonic counts as a cause of a maximum if its power rises there by at least this fraction of the largest
rise of any harmonic. Chosen by judgement."""


def radius(results: PointResults) -> Array:
    """Spectral radius (P,); NaN where the radius is below 1/2: perturbations then lose more than half of the
    amplitude in a period."""
    modulus = results.spectral_radius
    return np.where(modulus >= LIGHTLY_DAMPED, modulus, np.nan)


def real_part(results: PointResults) -> Array:
    """Largest real part (P,) among the dominant multipliers. A multiplier is dominant if, within its error,
    its modulus is the largest."""
    largest = np.where(_is_dominant(results), np.real(results.multipliers), -np.inf).max(axis=1)
    return np.where(results.failed, np.nan, largest)


def _is_dominant(results: PointResults) -> Array:
    """Mask (P, N) of the multipliers whose modulus is the largest, within its error; False at failed
    points."""
    modulus, radius = np.abs(results.multipliers), results.spectral_radius[:, None]
    with np.errstate(invalid="ignore"):
        least = radius * (1 - 2 * results.errors[:, 1:] - UNIT_CIRCLE)
    return (modulus >= np.where(np.isnan(least), radius, least)) & ~results.failed[:, None]


def _leading(results: PointResults) -> Array:
    """For each point, the index (P,) of the dominant multiplier. If several multipliers are dominant, it is
    the index of the multiplier with the largest real part."""
    return np.where(_is_dominant(results), np.real(results.multipliers), -np.inf).argmax(axis=1)


def _coalescence(results: PointResults) -> Array:
    """Distance (P,) from coalescence for the multiplier that `_leading` selects; NaN at failed points."""
    distance = coalescence_distance(results.multipliers, _leading(results))
    return np.where(results.failed, np.nan, distance)


@dataclass
class CriticalSearch:
    """Search for maxima of the response and of the multipliers as functions of speed, by solutions at the
    given speeds and between them.

    `batch` solves for orbits, and `multipliers` for multipliers only. `figure` is the statistic of the
    response. `orders` is the highest order of divisions. `rotation` returns the rotation of the multipliers
    as the speed varies. `constant` evaluates the stability of a system with constant matrices. `sweep`
    contains solutions that are already known.
    """

    batch: Batch
    multipliers: Batch
    kept: Kept
    figure: str
    orders: int
    tolerance: float
    rotation: Rotation
    constant: ConstantCoefficients | None
    sweep: Sweep | None

    @property
    def system(self) -> PeriodicSystem:
        """System whose critical speeds are sought."""
        return self.batch.family.example

    def solve(self, speeds: Array) -> PointResults:
        """Solve for the orbits at speeds (P,). Orbits of the sweep are reused."""
        if self.sweep is None:
            return gathered(self.batch, speeds[:, None], self.kept)
        _, in_sweep, known = np.intersect1d(speeds, self.sweep.speeds, return_indices=True)
        unsolved = np.setdiff1d(np.arange(len(speeds)), in_sweep)
        results = PointResults.blank(len(speeds), multiplier_count(self.system), self.kept)
        results.insert(unsolved, gathered(self.batch, speeds[unsolved, None], self.kept))
        results.insert(in_sweep, selected(self.sweep.results, known, self.kept))
        return results

    def solve_multipliers(self, speeds: Array) -> PointResults:
        """Solve for the multipliers at speeds (P,), without orbits."""
        points = speeds[:, None]
        if self.constant:
            return self.constant.results(points)
        return gathered(self.multipliers, points, Kept(warnings=False))

    def response(self, results: PointResults) -> Array:
        """Statistic (P,) of the response whose maxima are sought."""
        return results.figures[:, 0, FIGURES.index(self.figure)]

    def multiplier_maxima(
        self, speeds: Array, values: Array, results: PointResults, value: Callable[[PointResults], Array]
    ) -> list[Maximum]:
        """Locate the maxima of `value`, a function of the multipliers. `values` (P,) are the values of this
        function at the speeds (P,)."""
        maxima = peaks(values, results.errors[:, 1] * results.spectral_radius)
        trials = Trials(self.multipliers, Kept(warnings=False), results, maxima)

        def values_at(speeds: Array, numbers: Array) -> tuple[Array, Array]:
            solved = trials.solve(speeds, numbers)
            return value(solved), _coalescence(solved)

        brackets, guides = Brackets(speeds[maxima], values[maxima]), _coalescence(results)[maxima]
        return narrow_to_tolerance(brackets, guides, values_at, self.tolerance).maxima

    def response_maxima(self, speeds: Array, results: PointResults, resolved: Array) -> Brackets:
        """Return brackets of the maxima of the response. Speeds (P,) with `resolved` (P,) False are
        excluded."""
        values = np.where(resolved, self.response(results), np.nan)
        maxima = peaks(values, results.errors[:, 0] * np.abs(values))
        trials = Trials(self.batch, self.kept, results, maxima)

        def values_at(speeds: Array, numbers: Array) -> tuple[Array, Array]:
            return self.response(trials.solve(speeds, numbers)), np.full(len(speeds), np.nan)

        brackets = Brackets(speeds[maxima], values[maxima])
        return narrow_to_tolerance(brackets, np.full(maxima.shape, np.nan), values_at, self.tolerance)

    def add_crossings(
        self, speeds: Array, results: PointResults, others: Array
    ) -> tuple[Array, PointResults]:
        """Solve at further speeds, and return `speeds` and `results` with the new ones inserted. The further
        speeds are `others` (k,), and speeds on both sides of each passage of a multiplier through +1 along
        the real axis. At such a passage, the response may have an unbounded maximum of any width."""
        speeds, results = self._insert(speeds, results, others)
        evaluate_all = self.constant.evaluate if self.constant else evaluator(self.multipliers)

        def evaluate(points: Array) -> StabilitySamples:
            return evaluate_all(points).for_plus_one

        points = speeds[:, None]
        first = evaluate_all(points) if self.constant else StabilitySamples.from_results(points, results)
        samples = separate_crossings(evaluate, first.for_plus_one, self.rotation, (1,))
        samples = by_speed(samples + find_narrow_tongues(evaluate, samples, np.arange(1, len(samples) - 1)))
        side = samples.stable.astype(int) - samples.unstable
        changes = np.flatnonzero(side[:-1] * side[1:] < 0)
        search = BoundarySearch(evaluate, speeds[:1], self.tolerance)
        brackets = search.sign_changes(samples[changes], samples[changes + 1], 0)
        low, high = (end.points[:, 0] for end in (brackets.low, brackets.high))
        aside = _BESIDE * self.tolerance
        beside = np.concatenate((low * (1 - aside), low, high, high * (1 + aside)))
        return self._insert(speeds, results, beside)

    def _insert(self, speeds: Array, results: PointResults, others: Array) -> tuple[Array, PointResults]:
        """Return ascending speeds and their results, with the speeds `others` (k,) solved and inserted."""
        others = np.setdiff1d(others, speeds)
        union = np.union1d(speeds, others)
        merged = PointResults.blank(len(union), multiplier_count(self.system), self.kept)
        merged.insert(np.searchsorted(union, speeds), results)
        merged.insert(np.searchsorted(union, others), self.solve(others))
        return union, merged

    def label_response_maxima(self, brackets: Brackets) -> list[Label]:
        """Return the maxima of the response. Each is labelled with the orders whose power is higher at the
        maximum than on both sides of it.

        Maxima inside an unstable range, where no steady vibration is reached, are omitted; maxima at its
        edges are kept.
        """
        if not len(brackets):
            return []
        selection = Kept(
            self.kept.names, self.kept.names, math.ceil(self.orders * self._revolutions), warnings=False
        )
        speeds = brackets.x[:, 1]
        aside = _ASIDE / np.maximum(MeanFrequencies(self.system, speeds).lowest / speeds, _ASIDE / CLOSE)
        near = np.full(len(speeds), _BESIDE * self.tolerance)
        trials = speeds * (1 + np.stack([-aside, -near, 0 * near, near, aside]))
        results = gathered(self.batch, trials.reshape(-1, 1), selection)
        reached = (results.verdicts != UNSTABLE).reshape(trials.shape)[1:4].any(axis=0)
        heights = self.response(results).reshape(trials.shape)[2]
        maxima = self._with_heights(brackets.with_heights(heights), self._is_unbounded(trials, results))
        power = np.nan_to_num(results.amplitudes[:, 0] ** 2).reshape(*trials.shape, -1)
        rises = power[2] - (power[0] + power[4]) / 2
        return [
            Label(maximum, self._rising_orders(rise))
            for maximum, rise, is_reached in zip(maxima, rises, reached, strict=True)
            if is_reached
        ]

    def _with_heights(self, brackets: Brackets, unbounded: Array) -> list[Maximum]:
        """Return the maxima with certified heights. Maxima narrower than the tolerance of the speed are
        included. Heights are infinite where `unbounded` (k,) is True."""

        def values_at(speeds: Array, _: Array) -> tuple[Array, Array]:
            return self.response(self.solve(speeds)), np.full(len(speeds), np.nan)

        maxima = [Maximum(speed, math.inf) for speed in brackets.x[:, 1].tolist()]
        bounded = np.flatnonzero(~unbounded)
        for at, maximum in zip(
            bounded.tolist(), narrow_to_height(brackets[bounded], values_at).maxima, strict=True
        ):
            maxima[at] = maximum
        return maxima

    def _is_unbounded(self, trials: Array, results: PointResults) -> Array:
        """Return a mask (k,) of the maxima near which a multiplier passes through +1, so that the response is
        unbounded. `trials` (5, k) are the speeds of the results; the middle three are tested."""
        rho, errors = (
            values.reshape(5, trials.shape[1], -1)[1:4].copy()
            for values in (results.multipliers, results.errors)
        )
        failed = results.failed.reshape(5, -1)[1:4]
        if failed.any():
            # Multipliers exist even without an orbit.
            multipliers_only = self.solve_multipliers(trials[1:4][failed])
            rho[failed], errors[failed] = multipliers_only.multipliers, multipliers_only.errors
        return crosses_plus_one(rho, errors[..., 1] * np.abs(rho[..., 0]))

    @property
    def _revolutions(self) -> float:
        """Revolutions of the mechanism per period."""
        return self.system.period / (2 * np.pi)

    def _rising_orders(self, rise: Array) -> set[tuple[int, int]]:
        """Return the orders per revolution whose power rises by at least a tenth of the largest rise, each
        paired with every mode. `rise` (k,) contains the rise of the power of each harmonic."""
        turns = self._revolutions
        harmonics = {
            order: round(order * turns)
            for order in range(1, self.orders + 1)
            if math.isclose(order * turns, round(order * turns))
        }
        least = _SHARE * rise[1:].max()
        rising = [order for order, number in harmonics.items() if rise[number] >= least > 0]
        return set(itertools.product(range(1, self.system.n + 1), rising))

    def label_real_part_maxima(self, maxima: list[Maximum]) -> list[Label]:
        """Label maxima of the real part of the dominant multiplier. Maxima that no resonance explains are
        omitted at the edges of unstable ranges, because another multiplier becomes dominant at such edges."""
        speeds, count = np.array([maximum.speed for maximum in maxima]), len(maxima)
        near = 1 + _BESIDE * self.tolerance * np.array([0, -1, 1])
        results = self.solve_multipliers((near[:, None] * speeds).ravel())
        unstable, rho = (results.verdicts == UNSTABLE).reshape(3, count), results.multipliers[:count]
        maxima = _certified(maxima, real_part(results)[:count])
        is_edge, leading = unstable[1] != unstable[2], _leading(results)[:count].tolist()
        labels = [
            matcher.label_real_part(maximum, lead, self.orders, is_unstable)
            for matcher, maximum, lead, is_unstable in zip(
                self._matchers(maxima, rho), maxima, leading, unstable[0].tolist(), strict=True
            )
        ]
        return [label for label, edge in zip(labels, is_edge, strict=True) if label.is_explained or not edge]

    def label_radius_maxima(self, maxima: list[Maximum]) -> list[Label]:
        """Label maxima of the spectral radius. Maxima of stable motion that no resonance explains are
        omitted, because the radius also has a maximum where two multipliers of different decay meet."""
        results = self.solve_multipliers(np.array([maximum.speed for maximum in maxima]))
        maxima = _certified(maxima, results.spectral_radius)
        labels = [
            matcher.label_radius(maximum, self.orders)
            for matcher, maximum in zip(self._matchers(maxima, results.multipliers), maxima, strict=True)
        ]
        unstable = results.verdicts == UNSTABLE
        return [label for label, grows in zip(labels, unstable, strict=True) if label.is_explained or grows]

    def _matchers(self, maxima: list[Maximum], multipliers: Array) -> Iterator[MultiplierMatcher]:
        """Yield, for each of k maxima, the matching of its multipliers to modes. `multipliers` is (k, N)."""
        for maximum, rho in zip(maxima, multipliers, strict=True):
            ratios = MeanFrequencies(self.system, np.array([maximum.speed])).values[0] / maximum.speed
            yield MultiplierMatcher(self.system, maximum.speed, rho, ratios)


def _certified(maxima: list[Maximum], heights: Array) -> list[Maximum]:
    """Return maxima whose heights are replaced by the certified `heights` (k,) where these are finite."""
    return [
        replace(maximum, height=height) if math.isfinite(height) else maximum
        for maximum, height in zip(maxima, heights.tolist(), strict=True)
    ]
