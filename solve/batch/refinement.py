"""Step doubling for many points at once, with the rules of the single solve's certificate."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from solve.arrays import Array
from solve.batch.curves import Curves
from solve.batch.doubts import Doubts
from solve.batch.level import Engine, GridTables, Level
from solve.batch.spectra import Spectra
from solve.batch.tables import Chunk
from solve.certificate import FIRST_STEPS, WITNESS_RTOL, estimated, finished, judged
from solve.methods.gauss import Gauss
from solve.methods.grid import Grid
from solve.methods.radau import Radau

BATCHED = (Gauss, Radau)
"""Methods that go over many points at once."""

_MEMORY = 2**25
"""Bytes that the points solved at once may take."""


@dataclass(frozen=True)
class Found:
    """Points of a chunk that the same grid served: positions (k,); errors (k, 2) of orbit and
    multipliers; followed (k,): whether the steps follow the fastest modes."""

    positions: Array
    method: Gauss | Radau
    steps: int
    Phi: Array
    spectra: Spectra
    errors: Array
    followed: Array
    curves: Curves | None


@dataclass(frozen=True)
class Unsound:
    """Points that only a single solve can judge: overflow, resonance, matrices that are not finite."""

    positions: Array


@dataclass(frozen=True)
class _Trace:
    """What is known of points from the grid before: multipliers, samples of the curves, and the
    differences (k, 2) that it made."""

    positions: Array
    differences: Array
    spectra: Spectra | None = None
    samples: Array | None = None

    def __getitem__(self, some: Array) -> "_Trace":
        return _Trace(
            self.positions[some],
            self.differences[some],
            None if self.spectra is None else self.spectra[some],
            None if self.samples is None else self.samples[some],
        )


class Refinement:
    """Points of a chunk under one method."""

    def __init__(self, engine: Engine, method: Gauss | Radau, chunk: Chunk, orbit: bool, rtol: float):
        self.engine, self.method, self.chunk = engine, method, chunk
        self.orbit, self.rtol = orbit, rtol
        self.collocation = method.collocation
        self.orders = np.array([method.curve_order, method.order])
        self.most = method.most_steps(chunk.n)
        self.doubts = Doubts(method, chunk, rtol, self._witness)

    def refined(self, positions: Array) -> Iterator[Found | Unsound]:
        """The points at the positions (k,) on as many steps as each needs."""
        yield from self._on(FIRST_STEPS, _Trace(positions, np.full((len(positions), 2), np.inf)))

    def judged(self, positions: Array, steps: int) -> Iterator[Found | Unsound]:
        """The points on that many steps, judged by twice as many."""
        for part in self._parts(2 * steps, len(positions)):
            coarse, fine = (self._level(count, positions[part]) for count in (steps, 2 * steps))
            sound = coarse.sound & fine.sound
            if not sound.all():
                yield Unsound(positions[part][~sound])
            coarse, fine = coarse[sound], fine[sound]
            trace = _Trace(positions[part][sound], np.empty(0), coarse.spectra, _samples(coarse))
            errors = judged(_differences(trace, fine), self.orders)
            hidden, followed = self.doubts.hidden(steps, trace.positions, coarse.spectra)
            yield self._found(steps, trace.positions, coarse, errors, hidden, followed)

    def _on(self, steps: int, before: _Trace) -> Iterator[Found | Unsound]:
        """The points that need at least this many steps, and then those that need more."""
        for part in self._parts(steps, len(before.positions)):
            found, still_open = self._compared(steps, before[part])
            yield from found
            if len(still_open.positions):
                yield from self._on(2 * steps, still_open)

    def _compared(self, steps: int, before: _Trace) -> tuple[list[Found | Unsound], _Trace]:
        """Solve, compare with the grid before, and tell which points are still open."""
        level = self._level(steps, before.positions)
        found: list[Found | Unsound] = []
        if not level.sound.all():
            found.append(Unsound(before.positions[~level.sound]))
            before, level = before[level.sound], level[level.sound]
        trace = replace(before, spectra=level.spectra, samples=_samples(level))
        if before.spectra is None:
            return found, trace
        trace = replace(trace, differences=_differences(before, level))
        errors, last = estimated(trace.differences, before.differences, self.orders), 2 * steps > self.most
        wanted = self._wanted(level, errors)
        settled = np.flatnonzero(finished(trace.differences, before.differences, errors, wanted) | last)
        if len(settled):
            hidden, followed = self.doubts.hidden(steps, trace.positions[settled], level.spectra[settled])
            stays = (hidden <= self.rtol) | last
            settled, hidden, followed = settled[stays], hidden[stays], followed[stays]
            if len(settled):
                positions = trace.positions[settled]
                found.append(self._found(steps, positions, level[settled], errors[settled], hidden, followed))
        return found, trace[np.setdiff1d(np.arange(len(errors)), settled)]

    def _wanted(self, level: Level, errors: Array) -> Array:
        """Errors (k, 2) to reach: rtol, or what rounding leaves where that is more."""
        wanted = np.full(errors.shape, self.rtol)
        in_reach = (errors <= np.maximum(level.most_rounding, self.rtol)).all(axis=1)
        unsure = np.flatnonzero(in_reach & (errors > self.rtol).any(axis=1))
        if len(unsure):
            wanted[unsure] = np.maximum(level[unsure].rounding(errors[unsure]), self.rtol)
        return wanted

    def _found(
        self, steps: int, positions: Array, level: Level, errors: Array, hidden: Array, followed: Array
    ) -> Found:
        errors = np.maximum(errors, level.rounding(errors))
        errors[:, 1] = np.maximum(errors[:, 1], hidden)
        return Found(positions, self.method, steps, level.Phi, level.spectra, errors, followed, level.curves)

    def _witness(self, positions: Array) -> Spectra:
        """Multipliers by an L-stable method; zero where it cannot tell."""
        values = np.zeros((len(positions), 2 * self.chunk.n), dtype=complex)
        resolved = np.zeros(len(positions), dtype=int)
        order = np.argsort(positions)
        other = Refinement(self.engine, Radau(), self.chunk, False, WITNESS_RTOL)
        for found in other.refined(positions):
            if isinstance(found, Found):
                where = order[np.searchsorted(positions, found.positions, sorter=order)]
                values[where], resolved[where] = found.spectra.values, found.spectra.resolved
        return Spectra(values, resolved)

    def _level(self, steps: int, positions: Array) -> Level:
        grid = Grid.uniform(steps, self.chunk.period)
        phase = grid.stages(np.array(self.collocation.c)).ravel()
        stages, coefficients = self.chunk.tables((self.collocation, steps), phase, positions)
        nodes = None
        if self.orbit and not self.collocation.stiffly_accurate:
            nodes, _ = self.chunk.tables(("nodes", steps), grid.nodes[:-1], positions)
        tables = GridTables(self.collocation, steps, self.chunk.period, stages, nodes)
        return self.engine.level(tables, coefficients, self.orbit)

    def _parts(self, steps: int, points: int) -> list[Array]:
        """Positions of the points, split so that each part fits into memory."""
        own = (len(self.collocation.c) + 1) * self.chunk.bytes_a_phase
        size = (self.engine.bytes_a_step(self.collocation, self.chunk.n, self.orbit) + own) * steps
        parts = min(points, math.ceil(points * size / _MEMORY))
        return np.array_split(np.arange(points), parts) if points else []


def _samples(level: Level) -> Array | None:
    return None if level.curves is None else level.curves.sampled(4)


def _differences(coarse: _Trace, fine: Level) -> Array:
    """Of the orbits, per coordinate max|difference|/max|q|, and of the multipliers (k, 2)."""
    assert coarse.spectra is not None
    found = np.zeros((len(coarse.positions), 2))
    found[:, 1] = coarse.spectra.difference(fine.spectra)
    if coarse.samples is not None and fine.curves is not None:
        q = fine.curves.sampled(2)
        scale, error = np.abs(q).max(axis=2), np.abs(coarse.samples - q).max(axis=2)
        largest = scale.max(axis=1, keepdims=True)
        scale = np.where(scale > fine.closing_rounding[:, None] * largest, scale, largest)
        found[:, 0] = (error / np.where(scale > 0, scale, 1.0)).max(axis=1)
    return found
