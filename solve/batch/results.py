"""What is kept of every point, in arrays: a point costs some hundred bytes."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from solve.arrays import Array
from solve.batch.batch import Batch
from solve.batch.curves import Curves
from solve.batch.doubts import FROZEN_PHASES
from solve.batch.figures import FIGURES, Signals
from solve.batch.refinement import Found
from solve.batch.spectra import VERDICTS, verdicts
from solve.certify.certificate import Refinement
from solve.errors import SolveError
from solve.loading import Model
from solve.methods import choice
from solve.methods.method import Solution
from solve.period.grid import Grid
from solve.period.signal import Statistics
from solve.results.orbit import Orbit, Turn
from solve.results.stability import NEAR_ONE, Stability
from solve.single import floquet, periodic
from solve.system import PeriodicSystem

FAILED = -1
"""Instead of the position of a verdict, where there is none."""

METHODS = tuple(choice.METHODS)
"""Names of methods, by position."""

_FEWEST = 8
"""Points prepared together, however large."""

_MEMORY = 2**23
"""Bytes that the frozen coefficients of points prepared together may take."""

_ANYWHERE = Statistics(*(float(value) for value in ("-inf", "inf", "-inf", "nan", "nan", "nan", "nan")))
"""Of a quantity that nobody asked for: it keeps within all bounds."""


_ARRAYS = ("figures", "amplitudes", "multipliers", "errors", "verdicts", "steps", "methods")


@dataclass(frozen=True)
class Wish:
    """What to keep of a point beside its stability: figures of the quantities `names`, amplitudes of so
    many harmonics of some of them, the texts of warnings; meetings: whether multipliers that meet on the
    unit circle are looked at, of which the verdict may be "unstable" though none is outside."""

    names: tuple[str, ...] = ()
    spectra: tuple[str, ...] = ()
    harmonics: int = 0
    warnings: bool = True
    meetings: bool = True


@dataclass(frozen=True)
class Results:
    """Arrays over P points.

    figures (P, q, 7): the fields of `Statistics`; amplitudes (P, spectra, harmonics + 1); multipliers
    (P, N), zero where unresolved; errors (P, 2) of orbit and multipliers; verdicts (P,), positions in
    VERDICTS or FAILED; steps (P,); methods (P,), positions in METHODS. warnings and failures: texts by
    point.
    """

    wish: Wish
    figures: Array
    amplitudes: Array
    multipliers: Array
    errors: Array
    verdicts: Array
    steps: Array
    methods: Array
    warnings: dict[int, list[str]] = field(default_factory=dict)
    failures: dict[int, str] = field(default_factory=dict)

    @classmethod
    def blank(cls, count: int, n: int, wish: Wish) -> "Results":
        """Of points that are still to be solved."""
        return cls(
            wish,
            np.full((count, len(wish.names), len(FIGURES)), np.nan),
            np.full((count, len(wish.spectra), wish.harmonics + 1), np.nan),
            np.full((count, 2 * n), np.nan, dtype=complex),
            np.full((count, 2), np.nan),
            np.full(count, FAILED, dtype=np.int8),
            np.zeros(count, dtype=np.int32),
            np.zeros(count, dtype=np.int8),
        )

    def __len__(self) -> int:
        return len(self.steps)

    def __getitem__(self, index: Array) -> "Results":
        """Some of the points."""
        part = Results(self.wish, *(getattr(self, name)[index] for name in _ARRAYS))
        for position, point in enumerate(index.tolist()):
            if point in self.warnings:
                part.warnings[position] = self.warnings[point]
            if point in self.failures:
                part.failures[position] = self.failures[point]
        return part

    @property
    def spectral_radius(self) -> Array:
        """Largest |ρ| (P,); NaN where the point failed."""
        return np.abs(self.multipliers[:, 0])

    def insert(self, index: Array, part: "Results") -> None:
        """Take over the results of some of the points."""
        for name in _ARRAYS:
            getattr(self, name)[index] = getattr(part, name)
        self.warnings.update({int(index[at]): texts for at, texts in part.warnings.items()})
        self.failures.update({int(index[at]): text for at, text in part.failures.items()})


def gathered(
    batch: Batch, points: Array, wish: Wish | None = None, progress: Callable[[int], None] | None = None
) -> Results:
    """All the points (P, v); progress is told the number of points done."""
    n = batch.family.example.n
    results, done = Results.blank(len(points), n, wish or Wish()), 0
    size = chunk_size(n)
    for start in range(0, len(points), size):
        keeper = _Keeper(batch, points[start : start + size], results, start)
        for found in batch.solved(keeper.points):
            if len(found.positions) == 0:
                continue
            if isinstance(found, Found):
                keeper.keep(found)
            else:
                keeper.keep_singles(found.positions)
            done += len(found.positions)
            if progress:
                progress(done)
    return results


def chunk_size(n: int) -> int:
    """Points with n coordinates that are prepared together."""
    return max(_FEWEST, _MEMORY // (8 * FROZEN_PHASES * (3 * n**2 + n)))


@dataclass(frozen=True)
class _Keeper:
    """Puts what is found of some points in its place among the results, from `start` on."""

    batch: Batch
    points: Array
    results: Results
    start: int

    def keep(self, found: Found) -> None:
        """Points that were solved together."""
        at, results = self.start + found.positions, self.results
        results.multipliers[at], results.errors[at] = found.spectra.values, found.errors
        results.verdicts[at] = verdicts(found.Phi, found.spectra, found.errors[:, 1], results.wish.meetings)
        results.steps[at], results.methods[at] = found.steps, METHODS.index(found.method.name)
        if self.results.wish.warnings:
            self._keep_doubts(found)
        if found.curves is None:
            results.errors[at, 0] = np.nan
        else:
            self._keep_figures(found, found.curves)
            self._keep_concerns(found.positions)

    def _keep_doubts(self, found: Found) -> None:
        doubtful = (found.errors > self.batch.rtol).any(axis=1) | (found.spectra.distance_from_one < NEAR_ONE)
        if self.batch.steps is not None and not found.method.l_stable:
            doubtful |= ~found.followed
        of_model = type(self.batch.family.example).doubts is not PeriodicSystem.doubts
        for position in np.arange(len(doubtful)) if of_model else np.flatnonzero(doubtful):
            point = int(found.positions[position])
            if doubtful[position]:
                texts = self._doubts(point, found, int(position))
            else:
                system, speed = self.batch.family.system(self.points[point])
                texts = system.doubts(speed)
            if texts:
                self.results.warnings[self.start + point] = texts

    def keep_singles(self, positions: Array) -> None:
        """Points that are solved one by one."""
        batch = self.batch
        for position in map(int, positions):
            try:
                system, speed = batch.family.system(self.points[position])
                solve_one = periodic if batch.orbit else floquet
                one = solve_one(system, speed, batch.method, batch.steps, batch.rtol)
                self._keep_one(self.start + position, one)
            except SolveError as failure:
                self.results.failures[self.start + position] = str(failure)

    def _keep_figures(self, found: Found, curves: Curves) -> None:
        wish, points = self.results.wish, self.points[found.positions]
        if not (wish.names or wish.spectra):
            return
        system = self.batch.family.example
        order = [*system.coordinates, *system.outputs]
        outputs = any(name in system.outputs for name in (*wish.names, *wish.spectra))
        signals = Signals(self.batch.family, points, self.batch.speeds(points), curves, outputs)
        at = self.start + found.positions
        self.results.figures[at] = signals.figures()[:, [order.index(name) for name in wish.names]]
        if wish.spectra:
            chosen = [order.index(name) for name in wish.spectra]
            self.results.amplitudes[at] = signals.amplitudes(chosen, wish.harmonics)

    def _doubts(self, point: int, found: Found, position: int) -> list[str]:
        """The warnings of a single solve with this result."""
        system, speed = self.batch.family.system(self.points[point])
        solution = Solution(Grid.uniform(found.steps, system.period), found.Phi[position])
        refinement = Refinement(system, speed, found.method, self.batch.orbit)
        certified = refinement.result(solution, found.errors[position], self.batch.rtol, self.batch.steps)
        return Stability(system, speed, certified).warnings

    def _keep_concerns(self, positions: Array) -> None:
        """Bounds of the model that the solutions leave."""
        names = self.results.wish.names
        for position in map(int, positions):
            system, speed = self.batch.family.system(self.points[position])
            if not isinstance(system, Model):
                return
            at = self.start + position
            figures = dict(zip(names, self.results.figures[at], strict=True))
            texts = system.concerns(_Kept(system, speed, figures))
            if texts:
                self.results.warnings.setdefault(at, []).extend(texts)

    def _keep_one(self, at: int, one: Stability) -> None:
        results, wish = self.results, self.results.wish
        if isinstance(one, Orbit):
            found = [one.statistics(name) for name in wish.names]
            results.figures[at] = np.reshape(
                [[getattr(each, name) for name in FIGURES] for each in found], (len(found), len(FIGURES))
            )
            for place, name in enumerate(wish.spectra):
                results.amplitudes[at, place] = one.harmonics(name, wish.harmonics)[0]
        results.multipliers[at] = 0.0
        results.multipliers[at, : len(one.multipliers)] = one.multipliers
        results.errors[at] = one.error_estimate
        results.verdicts[at] = VERDICTS.index(one.verdict)
        results.steps[at], results.methods[at] = one.steps, METHODS.index(one.method)
        if wish.warnings and one.warnings:
            results.warnings[at] = one.warnings


class _Kept(Turn):
    """The figures of a point, for a system to judge."""

    def __init__(self, system: PeriodicSystem, speed: float, figures: dict[str, Array]):
        self.system, self.speed, self._figures = system, speed, figures

    def statistics(self, name: str) -> Statistics:
        return Statistics(*self._figures[name]) if name in self._figures else _ANYWHERE
