"""Step doubling for many points at once, with the rules of the single solve's certificate."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.batch.curves import Curves
from solve.batch.level import Engine, GridTables, Level
from solve.batch.spectra import Spectra
from solve.batch.tables import Separation, Tables, sampled
from solve.methods.gauss import Gauss
from solve.methods.grid import Grid
from solve.methods.radau import Radau

FIRST_STEPS = 32
_ROUNDING = 64 * float(np.finfo(float).eps)
_MEMORY = 2**25
"""Bytes that the points solved at once may take."""

_MOST_CACHED = 2**22
"""Bytes of tables up to which they are kept for the next points."""

BATCHED = (Gauss, Radau)
"""Methods that go over many points at once."""


@dataclass(frozen=True)
class Found:
    """Points that the same grid served: index (k,) into the points given; errors (k, 2) of orbit and
    multipliers. steps is 0 for points that only a single solve can judge; nothing else is then set."""

    index: Array
    steps: int = 0
    Phi: Array | None = None
    spectra: Spectra | None = None
    errors: Array | None = None
    curves: Curves | None = None


@dataclass(frozen=True)
class _Trace:
    """What is known of points from the grid before."""

    index: Array
    spectra: Spectra
    samples: Array | None
    differences: Array

    def __getitem__(self, points: Array) -> "_Trace":
        samples = None if self.samples is None else self.samples[points]
        return _Trace(self.index[points], self.spectra[points], samples, self.differences[points])


class Refinement:
    """Points of a family under one method."""

    def __init__(
        self,
        engine: Engine,
        method: Gauss | Radau,
        separation: Separation,
        points: Array,
        orbit: bool,
        rtol: float,
    ):
        self.engine, self.method, self.separation = engine, method, separation
        self.points, self.orbit, self.rtol = points, orbit, rtol
        self.collocation = method.collocation
        self.orders = np.array([method.curve_order, method.order])
        self.most = method.most_steps(separation.n)
        self._cached: dict[int, GridTables] = {}

    def refined(self, index: Array, coefficients: Array | None) -> Iterator[Found]:
        """The points of the index (k,) on as many steps as each needs, from coefficients (k, R) or,
        without, from samples of their own."""
        blank = Spectra(np.zeros((len(index), 1)), np.zeros(len(index), dtype=int))
        start = _Trace(index, blank, None, np.full((len(index), 2), np.inf))
        return self._on(FIRST_STEPS, start, coefficients, first=True)

    def judged(self, index: Array, coefficients: Array | None, steps: int) -> Iterator[Found]:
        """The points on that many steps, judged by twice as many."""
        for part in np.array_split(np.arange(len(index)), self._parts(2 * steps, len(index))):
            own = None if coefficients is None else coefficients[part]
            coarse, spectra, ok = self._level(steps, index[part], own)
            fine, finer, fine_ok = self._level(2 * steps, index[part], own)
            ok &= fine_ok
            yield Found(index[part][~ok])
            spectra, finer = spectra[ok], finer[ok]
            found = np.zeros((int(ok.sum()), 2))
            found[:, 1] = spectra.difference(finer)
            curves = None
            if coarse.curves is not None and fine.curves is not None:
                curves = coarse.curves[ok]
                found[:, 0] = _orbit_difference(curves.sampled(4), fine.curves[ok].sampled(2))
            factor = 2.0**self.orders
            errors = np.maximum(found * factor / (factor - 1), _ROUNDING)
            yield Found(index[part][ok], steps, coarse.Phi[ok], spectra, errors, curves)

    def _on(
        self, steps: int, before: _Trace, coefficients: Array | None, first: bool = False
    ) -> Iterator[Found]:
        """The points that need at least this many steps, and then those that need more."""
        for part in np.array_split(np.arange(len(before.index)), self._parts(steps, len(before.index))):
            if len(part) == 0:
                continue
            own = None if coefficients is None else coefficients[part]
            trace, found, open_ = self._compared(steps, before[part], own, first)
            yield from found
            if len(open_):
                yield from self._on(2 * steps, trace, None if own is None else own[open_])

    def _compared(
        self, steps: int, before: _Trace, coefficients: Array | None, first: bool
    ) -> tuple[_Trace, list[Found], Array]:
        """Solve, compare with the grid before, and tell which points are still open."""
        level, spectra, ok = self._level(steps, before.index, coefficients)
        differences = np.full((len(ok), 2), np.inf)
        samples = None if level.curves is None else level.curves.sampled(4)
        if not first:
            old = before[ok]
            differences[ok, 1] = old.spectra.difference(spectra[ok])
            differences[ok, 0] = 0.0
            if samples is not None and old.samples is not None:
                differences[ok, 0] = _orbit_difference(old.samples, samples[ok][..., ::2])
        errors = estimated(differences, before.differences, self.orders)
        done = ok & (finished(differences, before.differences, errors, self.rtol) | (2 * steps > self.most))
        if first:
            done[:] = False
        found = [Found(before.index[~ok])] if not ok.all() else []
        if done.any():
            curves = None if level.curves is None else level.curves[done]
            found.append(
                Found(before.index[done], steps, level.Phi[done], spectra[done], errors[done], curves)
            )
        open_ = np.flatnonzero(ok & ~done)
        trace = _Trace(before.index, spectra, samples, differences)
        return trace[open_], found, open_

    def _level(self, steps: int, index: Array, coefficients: Array | None) -> tuple[Level, Spectra, Array]:
        if coefficients is None:
            tables = self._tables(steps, lambda phase: self._sampled(phase, index))
            coefficients = np.ones((len(index), len(tables.stages.entry)))
        elif steps in self._cached:
            tables = self._cached[steps]
        else:
            tables = self._tables(steps, self.separation.tables)
            if tables.stages.table.nbytes <= _MOST_CACHED:
                self._cached[steps] = tables
        level = self.engine.level(tables, coefficients, self.orbit)
        finite = np.where(level.sound[:, None, None], level.Phi, 0.0)
        return level, Spectra.of(finite), level.sound.copy()

    def _tables(self, steps: int, tabulate: Callable[[Array], Tables]) -> GridTables:
        grid = Grid.uniform(steps, self.separation.period)
        stages = tabulate(grid.stages(np.array(self.collocation.c)).ravel())
        nodes = None
        if self.orbit and not self.collocation.stiffly_accurate:
            nodes = tabulate(grid.nodes[:-1])
        return GridTables(self.collocation, steps, self.separation.period, stages, nodes)

    def _sampled(self, phase: Array, index: Array) -> Tables:
        return sampled(self.separation.family, phase, self.points[index], self.separation.n)

    def _parts(self, steps: int, points: int) -> int:
        """Into how many parts points are split so that each fits."""
        size = self.engine.bytes_a_step(self.collocation, self.separation.n) * steps
        return max(1, math.ceil(points * size / _MEMORY)) if points else 1


def estimated(found: Array, before: Array, orders: Array) -> Array:
    """Errors (…, 2) of the finer of two grids from their differences and those of the grids before:
    doubling reduces them as seen, by a factor between 2 and 2^order."""
    known = (found > 0) & np.isfinite(before)
    seen = np.where(known, before, 0.0) / np.where(known, found, 1.0)
    factor = np.minimum(np.maximum(seen, 2.0), 2.0**orders)
    return np.maximum(found / (factor - 1), _ROUNDING)


def finished(found: Array, before: Array, errors: Array, rtol: float) -> Array:
    """Whether both errors (…, 2) are in reach of `rtol`, or finer grids gain no more."""
    stalled = ((found <= rtol) | ((found >= before) & (before < 1e-6))).all(axis=-1)
    return (errors <= rtol).all(axis=-1) | stalled


def _orbit_difference(coarse: Array, fine: Array) -> Array:
    """Per point the largest max|difference|/max|q| of its coordinates, from samples (P, n, k)."""
    scale = np.abs(fine).max(axis=2)
    error = np.abs(coarse - fine).max(axis=2)
    return (error / np.where(scale > 0, scale, 1.0)).max(axis=1)
