"""Search for local maxima of computed values versus speed, in all brackets simultaneously."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from solve.arrays import EPS, Array, unique_integers
from solve.batch.batch import POINTS, Batch
from solve.batch.gathering import gathered, on_one_grid
from solve.results.critical_speeds import Maximum
from solve.results.points import Kept, PointResults
from solve.system import multiplier_count
from solve.terminal import progress

_PROMINENCE = 1e-2
"""Smallest prominence of a maximum, relative to its height. Chosen by judgement."""

_ERROR_FACTOR = 2.0
"""Smallest prominence of a maximum, relative to the estimated error of its height. Chosen by judgement."""

_SUBDIVISION = 3
"""Number of parts into which each side of a bracket is divided first, so that the highest of several maxima
is found. Chosen by judgement."""

_EVALUATIONS = 14
"""Typical number of further solutions per bracket, as measured. It is used to estimate the remaining time."""

_SAME_GRID = ("radau", "gauss")
"""Methods whose error estimate is a solution on the same grid with one more stage."""

_FLAT_TOP, _HEIGHT_TOLERANCE = 1e-5, 1e-6
"""The height of a maximum is refined if it exceeds the heights at both ends of the bracket by more than the
first number, relative to the height. The second number is the relative tolerance of the refined height.
Chosen by judgement."""

Value = Callable[[Array, Array], tuple[Array, Array]]
"""Type of functions of speeds (m,) and the indices (m,) of their brackets. Such a function returns heights
(m,), which are NaN without a result, and guides (m,), which are NaN if there are no guides. Guides are values
of a smooth function whose maxima may coincide with narrow maxima of the heights."""


@dataclass(frozen=True)
class Brackets:
    """Brackets of maxima: ascending speeds `x` (k, 3) and heights `y` (k, 3). In each bracket, the middle
    height is the largest."""

    x: Array
    y: Array

    def __len__(self) -> int:
        return len(self.x)

    def __getitem__(self, some: Array | slice) -> "Brackets":
        return Brackets(self.x[some], self.y[some])

    def with_heights(self, heights: Array) -> "Brackets":
        """Brackets in which the middle heights are replaced by `heights` (k,) where these are finite."""
        y = self.y.copy()
        y[:, 1] = np.where(np.isfinite(heights), heights, y[:, 1])
        return Brackets(self.x, y)

    @property
    def maxima(self) -> list[Maximum]:
        """Speed and height of the highest known point of each bracket."""
        return [
            Maximum(speed, height)
            for speed, height in zip(self.x[:, 1].tolist(), self.y[:, 1].tolist(), strict=True)
        ]


class Trials:
    """Solver at speeds within brackets. All solutions in a bracket use one grid: the finest grid among the
    solutions at its three original speeds.

    Errors are not estimated again by a second grid: they are set to the largest errors at the ends and the
    middle. `results` are the solutions at the original speeds; `brackets` (k, 3) are the indices of the
    brackets' speeds among these.
    """

    def __init__(self, batch: Batch, kept: Kept, results: PointResults, brackets: Array):
        self._batch, self._kept = batch, kept
        self._steps, self._errors = results.steps[brackets].max(axis=1), results.errors[brackets].max(axis=1)
        self._on_one_grid = bool(np.isin(results.methods[brackets], _SAME_GRID).all())

    def solve(self, speeds: Array, numbers: Array) -> PointResults:
        """Solve at speeds (m,) in the brackets with the indices `numbers` (m,)."""
        if not self._on_one_grid:
            return gathered(self._batch, speeds[:, None], self._kept)
        results = PointResults.blank(len(speeds), multiplier_count(self._batch.family.example), self._kept)
        steps = self._steps[numbers]
        for count in unique_integers(steps):
            at = np.flatnonzero(steps == count)
            results.insert(at, on_one_grid(self._batch, speeds[at, None], count, self._kept))
        results.errors[:] = self._errors[numbers]
        return results


def peaks(values: Array, errors: Array) -> Array:
    """For each prominent local maximum, return the indices (k, 3) of the nearest finite value to the left, of
    the maximum, and of the nearest finite value to the right.

    `values` (P,) are NaN where unknown; `errors` (P,) are the errors of these values. A maximum counts as
    prominent if its prominence exceeds both a hundredth of its height and twice its error."""
    finite = np.flatnonzero(np.isfinite(values))
    top, prominences = find_peaks(values[finite])
    height, error = np.abs(values[finite[top]]), np.nan_to_num(errors[finite[top]], nan=0.0)
    top = top[prominences > np.maximum(_PROMINENCE * height, _ERROR_FACTOR * error)]
    return finite[top[:, None] + np.array([-1, 0, 1])]


def find_peaks(values: Array) -> tuple[Array, Array]:
    """Return the indices (k,) and prominences (k,) of the local maxima of finite values (P,). The result
    equals that of `scipy.signal.find_peaks`, whose import takes a second. Of several equal neighbours, the
    middle one is returned."""
    starts = np.flatnonzero(np.append(True, np.diff(values) != 0)) if len(values) else np.zeros(0, dtype=int)
    levels, ends = values[starts], np.append(starts[1:], len(values)) - 1
    tops = 1 + np.flatnonzero((levels[1:-1] > levels[:-2]) & (levels[1:-1] > levels[2:]))
    prominences = np.empty(len(tops))
    for number, top in enumerate(tops.tolist()):
        higher = np.flatnonzero(levels > levels[top])
        before, after = higher[higher < top].max(initial=-1), higher[higher > top].min(initial=len(levels))
        base = max(levels[before + 1 : top].min(), levels[top + 1 : after].min())
        prominences[number] = levels[top] - base
    return (starts[tops] + ends[tops]) // 2, prominences


def narrow_to_tolerance(brackets: Brackets, guides: Array, value: Value, tolerance: float) -> Brackets:
    """For each bracket, return a narrower bracket around the highest maximum in it. The widths of the new
    brackets meet a tolerance relative to the speed. `guides` (k, 3) are the guides at the speeds of the
    brackets; see `Value`.

    The maximum of the heights and the maximum of the guides are refined separately. Each search starts from
    the highest value at evenly spaced speeds in the bracket. The returned bracket surrounds the speed with
    the greatest height among all solved speeds.
    """
    if len(brackets) == 0:
        return brackets
    with progress.task(POINTS, len(brackets) * (2 * (_SUBDIVISION - 1) + _EVALUATIONS)):
        values = _CachedValues(brackets, guides, value)
        x, guided = values.subdivide(brackets.x)
        numbers = np.arange(len(x))
        with_guide = np.flatnonzero(~np.isnan(guided[:, 1]))
        column = np.repeat([0, 1], [len(x), len(with_guide)])
        lanes = np.concatenate((numbers, with_guide)), column
        tolerances = {"xrtol": tolerance / 2, "frtol": 0.0}
        _find_minimum(values, np.concatenate((x, guided[with_guide])), lanes, tolerances)
        return _find_minimum(values, values.around_highest(), (numbers, np.zeros_like(numbers)), tolerances)


def narrow_to_height(brackets: Brackets, value: Value) -> Brackets:
    """Return brackets that are narrowed until the heights meet their tolerance. This serves resonances that
    are narrower than the tolerance of the speed."""
    rise = brackets.y[:, 1] - brackets.y.min(axis=1)
    narrow = np.flatnonzero(rise > _FLAT_TOP * np.abs(brackets.y[:, 1]))
    if len(narrow) == 0:
        return brackets
    x, y = brackets.x.copy(), brackets.y.copy()
    lanes = np.arange(len(narrow)), np.zeros(len(narrow), dtype=int)
    with progress.task(POINTS, len(narrow) * _EVALUATIONS):
        values = _CachedValues(brackets[narrow], np.full((len(narrow), 3), np.nan), value)
        narrowed = _find_minimum(values, x[narrow], lanes, {"xrtol": EPS, "frtol": _HEIGHT_TOLERANCE})
    x[narrow], y[narrow] = narrowed.x, narrowed.y
    return Brackets(x, y)


def _find_minimum(
    values: "_CachedValues", x: Array, lanes: tuple[Array, Array], tolerances: dict[str, float]
) -> Brackets:
    """Narrow brackets by Chandrupatla's method until one of the tolerances is met. Each iteration solves one
    speed in every bracket `x` (k, 3), in one batch. `lanes` contains two arrays: the indices (k,) of the
    brackets for `values`, and the numbers (k,), which are 0 for heights and 1 for guides."""
    from scipy.optimize.elementwise import find_minimum

    all_tolerances = {"xatol": 0.0, "fatol": 0.0, **tolerances}
    # For three equal heights SciPy computes 0/0 and continues with a golden section.
    with np.errstate(invalid="ignore", divide="ignore"):
        result = find_minimum(values, tuple(x.T), args=lanes, tolerances=all_tolerances)
    return Brackets(np.stack(result.bracket, axis=1), -np.stack(result.f_bracket, axis=1))


class _CachedValues:
    """Function that returns negated heights and guides at speeds within brackets, and solves each speed only
    once."""

    def __init__(self, brackets: Brackets, guides: Array, value: Value):
        self._value = value
        # A missing value is replaced by the lowest of its bracket, because SciPy abandons a bracket with NaN.
        self._floor = np.column_stack(
            (brackets.y.min(axis=1), np.where(np.isnan(guides), 0, guides).min(axis=1))
        )
        self._cache: list[dict[float, Array]] = [{} for _ in brackets.x]
        numbers = np.repeat(np.arange(len(brackets)), 3)
        self._store(numbers, brackets.x.ravel(), (brackets.y.ravel(), guides.ravel()))

    def __call__(self, speeds: Array, numbers: Array, column: Array) -> Array:
        self._solve(speeds, numbers)
        keys = zip(numbers.tolist(), speeds.tolist(), column.tolist(), strict=True)
        return -np.array([self._cache[number][speed][at] for number, speed, at in keys])

    def _solve(self, speeds: Array, numbers: Array) -> None:
        keys = zip(numbers.tolist(), speeds.tolist(), strict=True)
        new = np.array([speed not in self._cache[number] for number, speed in keys], dtype=bool)
        if new.any():
            with progress.subtask(POINTS, int(new.sum())):
                self._store(numbers[new], speeds[new], self._value(speeds[new], numbers[new]))

    def _store(self, numbers: Array, speeds: Array, values: tuple[Array, Array]) -> None:
        rows = np.column_stack(values)
        rows = np.where(np.isfinite(rows), rows, self._floor[numbers])
        for number, speed, row in zip(numbers.tolist(), speeds.tolist(), rows, strict=True):
            self._cache[number][speed] = row

    def subdivide(self, x: Array) -> tuple[Array, Array]:
        """Return narrower brackets (k, 3) within the brackets `x` (k, 3), first for heights and then for
        guides. Both sides of each bracket are divided evenly by additional speeds. A narrower bracket
        consists of the speed with the highest value and the two neighbouring speeds. A bracket for guides is
        NaN if the guide is largest at an end."""
        low, best, high = x.T
        sides = [np.linspace(*ends, _SUBDIVISION + 1, axis=1) for ends in ((low, best), (best, high))]
        speeds = np.concatenate((sides[0], sides[1][:, 1:]), axis=1)
        numbers = np.broadcast_to(np.arange(len(speeds))[:, None], speeds.shape)
        self._solve(speeds.ravel(), numbers.ravel())
        return self._around_highest_of(speeds, 0), self._around_highest_of(speeds, 1)

    def _around_highest_of(self, x: Array, column: int) -> Array:
        """Brackets (k, 3) around the speed with the highest value among ascending speeds `x` (k, m). `column`
        is 0 for heights and 1 for guides. A bracket for guides is NaN if the guide is largest at an end."""
        y = np.array([[self._cache[n][speed][column] for speed in row] for n, row in enumerate(x.tolist())])
        top = y[:, 1:-1].argmax(axis=1)[:, None] + 1
        three = np.take_along_axis(x, top + np.array([-1, 0, 1]), axis=1)
        inside = np.take_along_axis(y, top, axis=1)[:, 0] > y[:, [0, -1]].max(axis=1)
        return three if column == 0 else np.where(inside[:, None], three, np.nan)

    def around_highest(self) -> Array:
        """Brackets (k, 3) around the speed with the greatest height among all speeds solved so far."""
        brackets = []
        for values in self._cache:
            speeds = sorted(values)
            top = max(range(1, len(speeds) - 1), key=lambda at: values[speeds[at]][0])
            brackets.append(speeds[top - 1 : top + 2])
        return np.array(brackets)
