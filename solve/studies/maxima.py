"""Local maxima of computed values over the speed, for all brackets at once."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from solve.arrays import Array, unique_integers
from solve.batch.batch import POINTS, Batch
from solve.batch.gathering import gathered, unjudged
from solve.period.multipliers import EPS
from solve.results.critical_rows import Maximum
from solve.results.points import Kept, PointResults
from solve.terminal import progress

_PROMINENT = 1e-2
"""Part of its own height by which a maximum must rise above the ground on either side."""

_SURE = 2.0
"""Times its error by which it must rise besides."""

_PARTS = 3
"""Initial subdivision of each side of a bracket, so that the highest of several maxima is found."""

_EVALUATIONS = 14
"""Measured number of further solutions per bracket, for the estimate of the remaining time."""

_OF_STEPS = ("radau", "gauss")
"""Methods whose better solution, with another stage, is on the same grid."""

_MOST = 100
"""Maximum number of iterations: golden sections alone reduce a bracket to 1e-16 of its width in 77."""

_SETTLED, _FLAT = 1e-5, 1e-6
"""Fraction of its height by which a maximum may exceed the ends of its bracket to count as known; fraction to
which brackets of steeper maxima are narrowed."""

Value = Callable[[Array, Array], tuple[Array, Array]]
"""Heights (m,) at speeds (m,) within brackets with the indices (m,), NaN where there is none; and guides
(m,), each of whose maxima may hide a narrow maximum of the heights, NaN without a guide."""


@dataclass(frozen=True)
class Brackets:
    """Maxima between neighbours: speeds x (k, 3), ascending, and heights y (k, 3), the highest in the
    middle."""

    x: Array
    y: Array

    def __len__(self) -> int:
        return len(self.x)

    def __getitem__(self, some: Array | slice) -> "Brackets":
        return Brackets(self.x[some], self.y[some])

    def with_heights(self, heights: Array) -> "Brackets":
        """Brackets with other heights (k,) in the middle, where these are finite."""
        y = self.y.copy()
        y[:, 1] = np.where(np.isfinite(heights), heights, y[:, 1])
        return Brackets(self.x, y)

    @property
    def maxima(self) -> list[Maximum]:
        """Highest known points."""
        return [
            Maximum(speed, height)
            for speed, height in zip(self.x[:, 1].tolist(), self.y[:, 1].tolist(), strict=True)
        ]


class Trials:
    """Solutions at speeds in brackets, on one grid whose steps suffice for the speeds of the bracket. A
    second grid, which gives errors, would only cost time."""

    def __init__(self, batch: Batch, kept: Kept, found: PointResults, places: Array):
        """found: results at speeds of which those at `places` (k, 3) are the brackets."""
        self._batch, self._kept = batch, kept
        self._steps, self._errors = found.steps[places].max(axis=1), found.errors[places].max(axis=1)
        self._on_one_grid = bool(np.isin(found.methods[places], _OF_STEPS).all())

    def solved(self, speeds: Array, numbers: Array) -> PointResults:
        """Solutions at speeds (m,) in the brackets with the indices (m,), with the errors of these."""
        if not self._on_one_grid:
            return gathered(self._batch, speeds[:, None], self._kept)
        found = PointResults.blank(len(speeds), self._batch.family.example.n, self._kept)
        steps = self._steps[numbers]
        for count in unique_integers(steps):
            at = np.flatnonzero(steps == count)
            found.insert(at, unjudged(self._batch, speeds[at, None], count, self._kept))
        found.errors[:] = self._errors[numbers]
        return found


def peaks(values: Array, errors: Array) -> Array:
    """Positions (k, 3) of prominent local maxima of values (P,), NaN where unknown, and of their known
    neighbours. Prominent means that they rise on either side by more than a hundredth of their height and
    more than twice their errors (P,)."""
    known = np.flatnonzero(np.isfinite(values))
    top, prominences = prominent(values[known])
    height, doubt = np.abs(values[known[top]]), _SURE * np.nan_to_num(errors[known[top]], nan=0.0)
    top = top[prominences > np.maximum(_PROMINENT * height, doubt)]
    return known[top[:, None] + np.array([-1, 0, 1])]


def prominent(values: Array) -> tuple[Array, Array]:
    """Positions (k,) and prominences (k,) of local maxima of finite values (P,), as in
    `scipy.signal.find_peaks`, whose import takes a second. Of equal neighbours the middle one counts."""
    starts = np.flatnonzero(np.append(True, np.diff(values) != 0)) if len(values) else np.zeros(0, dtype=int)
    levels, ends = values[starts], np.append(starts[1:], len(values)) - 1
    tops = 1 + np.flatnonzero((levels[1:-1] > levels[:-2]) & (levels[1:-1] > levels[2:]))
    rises = np.empty(len(tops))
    for number, top in enumerate(tops.tolist()):
        higher = np.flatnonzero(levels > levels[top])
        before, after = higher[higher < top].max(initial=-1), higher[higher > top].min(initial=len(levels))
        rises[number] = levels[top] - max(levels[before + 1 : top].min(), levels[top + 1 : after].min())
    return (starts[tops] + ends[tops]) // 2, rises


def sharpened(brackets: Brackets, guides: Array, value: Value, tolerance: float) -> Brackets:
    """Narrower brackets of the highest maxima, each to a tolerance relative to its speed. guides (k, 3): at
    the speeds of the brackets.

    The highest of equidistant speeds in a bracket is refined to its maximum, and the guide to its own; the
    highest of all these speeds is the result.
    """
    if len(brackets) == 0:
        return brackets
    with progress.task(POINTS, len(brackets) * (2 * (_PARTS - 1) + _EVALUATIONS)):
        solved = _Remembered(brackets, guides, value)
        x, guided = solved.divided(brackets.x)
        numbers = np.arange(len(x))
        along = np.flatnonzero(~np.isnan(guided[:, 1]))
        which = np.repeat([0, 1], [len(x), len(along)])
        lanes = np.concatenate((numbers, along)), which
        tolerances = {"xrtol": tolerance / 2, "frtol": 0.0}
        _narrowed(solved, np.concatenate((x, guided[along])), lanes, tolerances)
        return _narrowed(solved, solved.about_highest(), (numbers, np.zeros_like(numbers)), tolerances)


def settled(brackets: Brackets, value: Value) -> Brackets:
    """Brackets narrowed further if their height is not known: for a resonance that is narrower than the
    tolerance of its speed."""
    rise = brackets.y[:, 1] - brackets.y.min(axis=1)
    steep = np.flatnonzero(rise > _SETTLED * np.abs(brackets.y[:, 1]))
    if len(steep) == 0:
        return brackets
    x, y = brackets.x.copy(), brackets.y.copy()
    lanes = np.arange(len(steep)), np.zeros(len(steep), dtype=int)
    with progress.task(POINTS, len(steep) * _EVALUATIONS):
        solved = _Remembered(Brackets(x[steep], y[steep]), np.full((len(steep), 3), np.nan), value)
        found = _narrowed(solved, x[steep], lanes, {"xrtol": EPS, "frtol": _FLAT})
    x[steep], y[steep] = found.x, found.y
    return Brackets(x, y)


def _narrowed(
    solved: "_Remembered", x: Array, lanes: tuple[Array, Array], tolerances: dict[str, float]
) -> Brackets:
    """Brackets narrowed by Chandrupatla's method until one of the tolerances is met; an iteration solves one
    speed of every bracket x (k, 3) in one batch. lanes: indices (k,) of the brackets, and 0 (k,) for their
    heights, 1 for their guides."""
    from scipy.optimize.elementwise import find_minimum

    every = {"xatol": 0.0, "fatol": 0.0, **tolerances}
    # For three equal heights SciPy computes 0/0 and continues with a golden section.
    with np.errstate(invalid="ignore", divide="ignore"):
        found = find_minimum(solved, tuple(x.T), args=lanes, tolerances=every, maxiter=_MOST)
    return Brackets(np.stack(found.bracket, axis=1), -np.stack(found.f_bracket, axis=1))


class _Remembered:
    """Negated heights and guides at speeds within brackets; known ones are not solved again."""

    def __init__(self, brackets: Brackets, guides: Array, value: Value):
        self._value = value
        # A missing height is replaced by one below both ends, since SciPy abandons a bracket with NaN.
        self._floor = np.column_stack(
            (brackets.y.min(axis=1), np.where(np.isnan(guides), 0, guides).min(axis=1))
        )
        self._known: list[dict[float, Array]] = [{} for _ in brackets.x]
        numbers = np.repeat(np.arange(len(brackets)), 3)
        self._keep(numbers, brackets.x.ravel(), (brackets.y.ravel(), guides.ravel()))

    def __call__(self, speeds: Array, numbers: Array, which: Array) -> Array:
        self._solve(speeds, numbers)
        return -np.array(
            [
                self._known[number][speed][kind]
                for number, speed, kind in zip(numbers.tolist(), speeds.tolist(), which.tolist(), strict=True)
            ]
        )

    def _solve(self, speeds: Array, numbers: Array) -> None:
        pairs = zip(numbers.tolist(), speeds.tolist(), strict=True)
        new = np.array([speed not in self._known[number] for number, speed in pairs], dtype=bool)
        if new.any():
            with progress.subtask(POINTS, int(new.sum())):
                self._keep(numbers[new], speeds[new], self._value(speeds[new], numbers[new]))

    def _keep(self, numbers: Array, speeds: Array, found: tuple[Array, Array]) -> None:
        values = np.column_stack(found)
        values = np.where(np.isfinite(values), values, self._floor[numbers])
        for number, speed, each in zip(numbers.tolist(), speeds.tolist(), values, strict=True):
            self._known[number][speed] = each

    def divided(self, x: Array) -> tuple[Array, Array]:
        """Brackets (k, 3) within brackets x (k, 3), for heights and for guides: the highest of the speeds
        that divide both sides evenly, and its neighbours. NaN where a guide is highest at an end."""
        low, best, high = x.T
        sides = [np.linspace(*ends, _PARTS + 1, axis=1) for ends in ((low, best), (best, high))]
        every = np.concatenate((sides[0], sides[1][:, 1:]), axis=1)
        numbers = np.broadcast_to(np.arange(len(every))[:, None], every.shape)
        self._solve(every.ravel(), numbers.ravel())
        return self._about(every, 0), self._about(every, 1)

    def _about(self, x: Array, kind: int) -> Array:
        """Brackets (k, 3) around the highest of speeds x (k, m), ascending; NaN where it is at an end."""
        y = np.array([[self._known[n][speed][kind] for speed in row] for n, row in enumerate(x.tolist())])
        top = y[:, 1:-1].argmax(axis=1)[:, None] + 1
        three = np.take_along_axis(x, top + np.array([-1, 0, 1]), axis=1)
        inside = np.take_along_axis(y, top, axis=1)[:, 0] > y[:, [0, -1]].max(axis=1)
        return three if kind == 0 else np.where(inside[:, None], three, np.nan)

    def about_highest(self) -> Array:
        """Brackets (k, 3) around the highest of all known speeds."""
        found = []
        for known in self._known:
            speeds = sorted(known)
            top = max(range(1, len(speeds) - 1), key=lambda at: known[speeds[at]][0])
            found.append(speeds[top - 1 : top + 2])
        return np.array(found)
