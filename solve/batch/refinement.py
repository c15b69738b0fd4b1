"""Finer and finer grids for many points at once, with the rules of the single solve's certificate."""

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
from solve.certify.certificate import FADED, WITNESS_RTOL, at_one
from solve.certify.pace import Pace, estimated, far, finished, first_steps, judged, telling_steps
from solve.methods.gauss import Gauss
from solve.methods.radau import Radau
from solve.period.grid import Grid

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
    """Points that only a single solve can judge: overflow, resonance, matrices that are not finite,
    multipliers that have faded."""

    positions: Array


@dataclass(frozen=True)
class _Trace:
    """What is known of points from the grid before: its phases to compare at (p,), samples of the curves
    there, multipliers, and the differences (k, 2) that it made."""

    positions: Array
    differences: Array
    spectra: Spectra | None = None
    phase: Array | None = None
    samples: Array | None = None

    def __getitem__(self, some: Array) -> "_Trace":
        return replace(
            self,
            positions=self.positions[some],
            differences=self.differences[some],
            spectra=None if self.spectra is None else self.spectra[some],
            samples=None if self.samples is None else self.samples[some],
        )

    def beside(self, level: Level) -> "_Trace":
        """The same points, known from this grid."""
        if level.curves is None:
            return replace(self, spectra=level.spectra)
        m = level.steps
        phase = (np.arange(4 * m) / (4 * m)) * level.curves.period
        return replace(self, spectra=level.spectra, phase=phase, samples=level.curves.sampled(4))


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
        unknown = _Trace(positions, np.full((len(positions), 2), np.inf))
        yield from self._on(Pace(first_steps(self.method)), unknown)

    def judged(self, positions: Array, steps: int) -> Iterator[Found | Unsound]:
        """The points on that many steps, judged by twice as many."""
        for part in self._parts(2 * steps, len(positions)):
            coarse, fine = (self._level(count, positions[part]) for count in (steps, 2 * steps))
            sound = coarse.sound & fine.sound
            if not sound.all():
                yield Unsound(positions[part][~sound])
            coarse, fine = coarse[sound], fine[sound]
            trace = _Trace(positions[part][sound], np.zeros((int(sound.sum()), 2))).beside(coarse)
            resonant = self._resonant(trace, fine, 2.0)
            if resonant.any():
                yield Unsound(trace.positions[resonant])
                trace, coarse, fine = trace[~resonant], coarse[~resonant], fine[~resonant]
            errors = judged(_differences(trace, fine), self.orders)
            hidden, followed = self.doubts.hidden(steps, trace.positions, coarse.spectra)
            yield self._found(steps, trace.positions, coarse, errors, hidden, followed)

    def spectra(self, steps: int) -> Iterator[tuple[Array, Spectra]]:
        """Multipliers of all points on that many steps, not judged, and the positions (p,) of each part."""
        for part in self._parts(steps, len(self.chunk.points)):
            yield part, self._level(steps, part).spectra

    def _on(self, pace: Pace, before: _Trace) -> Iterator[Found | Unsound]:
        """The points that need at least this many steps, and then those that need more."""
        for part in self._parts(pace.steps, len(before.positions)):
            found, still_open, further = self._compared(pace, before[part])
            yield from found
            for leap in (False, True):
                points = further == leap
                if points.any():
                    yield from self._on(pace.onward(leap, self.most), still_open[points])

    def _compared(self, pace: Pace, before: _Trace) -> tuple[list[Found | Unsound], _Trace, Array]:
        """Solve, compare with the grid before, and tell which points are still open, and which of these
        (k,) need more than the next number of steps."""
        level = self._level(pace.steps, before.positions)
        found: list[Found | Unsound] = []
        if not level.sound.all():
            found.append(Unsound(before.positions[~level.sound]))
            before, level = before[level.sound], level[level.sound]
        trace = before.beside(level)
        if before.spectra is None:
            return found, trace, np.zeros(len(trace.positions), dtype=bool)
        trace = replace(trace, differences=_differences(before, level))
        errors = estimated(trace.differences, before.differences, pace, self.orders)
        wanted = self._wanted(level, errors)
        done = finished(trace.differences, before.differences, errors, wanted, pace)
        faded = np.maximum(before.spectra.radius, level.spectra.radius) < FADED
        further = done | far(pace, errors, wanted, self.orders)
        last = np.array([pace.onward(bool(leap), self.most).steps > self.most for leap in (False, True)])
        last = last[further.astype(int)]
        closed = faded.copy()
        if faded.any():
            found.append(Unsound(trace.positions[faded]))
        ended = np.flatnonzero((done | last) & ~faded)
        if len(ended):
            stays = self._ended(
                pace, before[ended], trace[ended], level[ended], errors[ended], last[ended], found
            )
            closed[ended] = stays
        return found, trace[~closed], further[~closed]

    def _ended(
        self,
        pace: Pace,
        before: _Trace,
        trace: _Trace,
        level: Level,
        errors: Array,
        last: Array,
        found: list[Found | Unsound],
    ) -> Array:
        """Put points whose grids agree among what is found, unless modes that these do not follow matter
        and grids are not at their `last` (k,); which points that are (k,)."""
        hidden, followed = self.doubts.hidden(
            telling_steps(pace, self.method), trace.positions, level.spectra
        )
        stays = (hidden <= self.rtol) | last
        resonant = stays & self._resonant(before, level, pace.ratio)
        if resonant.any():
            found.append(Unsound(trace.positions[resonant]))
        good = stays & ~resonant
        if good.any():
            positions, part = trace.positions[good], level[good]
            found.append(self._found(pace.steps, positions, part, errors[good], hidden[good], followed[good]))
        return stays

    def _resonant(self, coarse: _Trace, fine: Level, ratio: float) -> Array:
        """Points (k,) with a multiplier that goes to +1, where an orbit is asked for."""
        assert coarse.spectra is not None
        if not self.orbit:
            return np.zeros(len(coarse.positions), dtype=bool)
        ours, theirs = coarse.spectra.nearest_one, fine.spectra.nearest_one
        return at_one(ours, theirs, ratio, self.method.order, fine.steps)

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


def _differences(coarse: _Trace, fine: Level) -> Array:
    """Of the orbits, per coordinate max|difference|/max|q|, and of the multipliers (k, 2)."""
    assert coarse.spectra is not None
    found = np.zeros((len(coarse.positions), 2))
    found[:, 1] = coarse.spectra.difference(fine.spectra)
    if coarse.samples is not None and fine.curves is not None:
        assert coarse.phase is not None
        q = fine.curves.through(coarse.phase)
        scale, error = np.abs(q).max(axis=2), np.abs(coarse.samples - q).max(axis=2)
        largest = scale.max(axis=1, keepdims=True)
        scale = np.where(scale > fine.closing_rounding[:, None] * largest, scale, largest)
        found[:, 0] = (error / np.where(scale > 0, scale, 1.0)).max(axis=1)
    return found
