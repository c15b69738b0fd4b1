"""What is kept of every point, in arrays: a point costs some hundred bytes."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from solve.arrays import Array
from solve.batch.batch import Batch
from solve.batch.figures import FIGURES, Signals
from solve.batch.refinement import Found
from solve.batch.spectra import VERDICTS, verdicts
from solve.certificate import Refinement
from solve.errors import SolveError
from solve.floquet import NEAR_ONE, Stability, floquet
from solve.load import Model
from solve.methods.grid import Grid
from solve.methods.method import Solution
from solve.orbit import Orbit, Turn
from solve.periodic import periodic
from solve.signal import Statistics
from solve.system import PeriodicSystem

FAILED = -1
"""Instead of the position of a verdict, where there is none."""

CHUNK = 512
"""Points that are prepared together."""

_ANYWHERE = Statistics(*(float(value) for value in ("-inf", "inf", "-inf", "nan", "nan", "nan", "nan")))
"""Of a quantity that nobody asked for: it keeps within all bounds."""


@dataclass(frozen=True)
class Wish:
    """What to keep of a point beside its stability: figures of the quantities `names`, and amplitudes of
    so many harmonics of some of them."""

    names: tuple[str, ...] = ()
    spectra: tuple[str, ...] = ()
    harmonics: int = 0


@dataclass(frozen=True)
class Results:
    """Arrays over P points.

    figures (P, q, 7): the fields of `Statistics`; amplitudes (P, spectra, harmonics + 1); multipliers
    (P, N), zero where unresolved; errors (P, 2) of orbit and multipliers; verdicts (P,), positions in
    VERDICTS or FAILED; steps (P,); methods (P,), names. warnings and failures: texts by point.
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
            np.full(count, "", dtype="U16"),
        )

    def __len__(self) -> int:
        return len(self.steps)

    @property
    def spectral_radius(self) -> Array:
        """Largest |ρ| (P,); NaN where the point failed."""
        return np.abs(self.multipliers[:, 0])

    def insert(self, index: Array, part: "Results") -> None:
        """Take over the results of some of the points."""
        for name in ("figures", "amplitudes", "multipliers", "errors", "verdicts", "steps", "methods"):
            getattr(self, name)[index] = getattr(part, name)
        self.warnings.update({int(index[at]): texts for at, texts in part.warnings.items()})
        self.failures.update({int(index[at]): text for at, text in part.failures.items()})


def gathered(batch: Batch, wish: Wish, progress: Callable[[int], None] | None = None) -> Results:
    """All points of the batch; progress is told the number of points done."""
    system, _ = batch.family.system(batch.points[0])
    results, done = Results.blank(len(batch.points), system.n, wish), 0
    for start in range(0, len(batch.points), CHUNK):
        for index, found in batch.solved(np.arange(start, min(start + CHUNK, len(batch.points)))):
            if isinstance(found, Found):
                _keep(results, batch, index, found)
            else:
                _keep_singles(results, batch, index)
            done += len(index)
            if progress:
                progress(done)
    return results


def _keep(results: Results, batch: Batch, index: Array, found: Found) -> None:
    results.multipliers[index], results.errors[index] = found.spectra.values, found.errors
    results.verdicts[index] = verdicts(found.Phi, found.spectra, found.errors[:, 1])
    results.steps[index], results.methods[index] = found.steps, found.method.name
    if found.curves is not None:
        _keep_figures(results, batch, index, found)
    else:
        results.errors[index, 0] = np.nan
    doubtful = (found.errors > batch.rtol).any(axis=1) | (found.spectra.distance_from_one < NEAR_ONE)
    if not found.method.l_stable:
        doubtful |= ~found.followed
    for position in np.flatnonzero(doubtful):
        results.warnings[int(index[position])] = _doubts(batch, int(index[position]), found, int(position))
    if found.curves is not None:
        _keep_concerns(results, batch, index)


def _keep_figures(results: Results, batch: Batch, index: Array, found: Found) -> None:
    assert found.curves is not None
    system, _ = batch.family.system(batch.points[index[0]])
    order = [*system.coordinates, *system.outputs]
    outputs = any(name in system.outputs for name in (*results.wish.names, *results.wish.spectra))
    signals = Signals(batch.family, batch.points[index], batch.speeds[index], found.curves, outputs)
    chosen = [order.index(name) for name in results.wish.names]
    results.figures[index] = signals.figures()[:, chosen]
    if results.wish.spectra:
        chosen = [order.index(name) for name in results.wish.spectra]
        results.amplitudes[index] = signals.amplitudes(chosen, results.wish.harmonics)


def _doubts(batch: Batch, point: int, found: Found, position: int) -> list[str]:
    """The warnings of a single solve with this result."""
    system, speed = batch.family.system(batch.points[point])
    solution = Solution(Grid.uniform(found.steps, system.period), found.Phi[position])
    where = "at the precision in reach" if batch.steps is None else f"with {batch.steps} steps"
    refinement = Refinement(system, speed, found.method, batch.orbit)
    certified = refinement.result(solution, found.errors[position], batch.rtol, where)
    return Stability(system, speed, certified).warnings


class _Kept(Turn):
    """The figures of a point, for a system to judge."""

    def __init__(self, system: PeriodicSystem, speed: float, figures: dict[str, Array]):
        self.system, self.speed, self._figures = system, speed, figures

    def statistics(self, name: str) -> Statistics:
        return Statistics(*self._figures[name]) if name in self._figures else _ANYWHERE


def _keep_concerns(results: Results, batch: Batch, index: Array) -> None:
    system, _ = batch.family.system(batch.points[index[0]])
    if isinstance(system, Model):
        for point in index:
            figures = dict(zip(results.wish.names, results.figures[point], strict=True))
            texts = system.concerns(_Kept(system, float(batch.speeds[point]), figures))
            if texts:
                results.warnings.setdefault(int(point), []).extend(texts)


def _keep_singles(results: Results, batch: Batch, index: Array) -> None:
    """Points that are solved one by one."""
    for point in map(int, index):
        try:
            system, speed = batch.family.system(batch.points[point])
            solve_one = periodic if batch.orbit else floquet
            _keep_one(results, point, solve_one(system, speed, batch.method, batch.steps, batch.rtol))
        except SolveError as failure:
            results.failures[point] = str(failure)


def _keep_one(results: Results, point: int, one: Stability) -> None:
    if isinstance(one, Orbit):
        figures = [one.statistics(name) for name in results.wish.names]
        results.figures[point] = [[getattr(each, name) for name in FIGURES] for each in figures]
        for place, name in enumerate(results.wish.spectra):
            results.amplitudes[point, place] = one.harmonics(name, results.wish.harmonics)[0]
    results.multipliers[point] = 0.0
    results.multipliers[point, : len(one.multipliers)] = one.multipliers
    results.errors[point] = one.error_estimate
    results.verdicts[point] = VERDICTS.index(one.verdict)
    results.steps[point], results.methods[point] = one.steps, one.method
    if one.warnings:
        results.warnings[point] = one.warnings
