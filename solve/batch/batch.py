"""Points of a family solved many at once: what is shared between them, and who needs more."""

import contextlib
from collections.abc import Generator, Iterator
from dataclasses import replace

import numpy as np

from solve.arrays import Array
from solve.batch.doubts import frozen
from solve.batch.family import SPEED, Family
from solve.batch.level import Engine
from solve.batch.refinement import BATCHED, Found, Refinement, Unsound
from solve.batch.spectra import Spectra
from solve.batch.tables import Chunk, Sampled, Separated, Separation
from solve.errors import SolveError
from solve.methods.auto import PHASES, RESOLVABLE, Auto
from solve.methods.gauss import Gauss
from solve.methods.method import Method
from solve.methods.radau import Radau

_LARGEST = 40
"""Coordinates up to which points gain from each other; tables of larger ones only fill the memory."""

_WORTH = 4
"""Points that differ in speed alone from which terms of their own are worth learning."""


class Batch:
    """How points of a family are solved: by which method and engine, from which tables."""

    def __init__(
        self,
        family: Family,
        region: Array,
        method: Method,
        engine: Engine,
        steps: int | None = None,
        rtol: float = 1e-8,
        orbit: bool = False,
    ):
        """`region`: points (P, v) like those to come, from which the tables are learnt."""
        self.family, self.method, self.engine = family, method, engine
        self.steps, self.rtol, self.orbit = steps, rtol, orbit
        self._region = region
        self._separation: Separation | None = None

    def speeds(self, points: Array) -> Array:
        """Speeds (k,) of points (k, v)."""
        if SPEED in self.family.names:
            return points[:, self.family.names.index(SPEED)]
        return np.full(len(points), self.family.speed)

    def solved(self, points: Array) -> Iterator[Found | Unsound]:
        """Points (k, v), in groups as they come; positions are those among the points."""
        if not self._ready(points):
            yield Unsound(np.arange(len(points)))
            return
        for chosen, chunk in self._chunks(points):
            left = np.ones(len(chosen), dtype=bool)
            try:
                for result in self._of_chunk(chunk):
                    left[result.positions] = False
                    yield replace(result, positions=chosen[result.positions])
            except np.linalg.LinAlgError:
                # A singular M somewhere: each of the points that are left shall speak for itself.
                yield Unsound(chosen[left])

    def spectra(self, points: Array, steps: int) -> Spectra:
        """Multipliers of points (k, v) on one grid of a collocation method, not judged; zero where there
        are none."""
        values = np.zeros((len(points), 2 * self.family.example.n), dtype=complex)
        resolved = np.zeros(len(points), dtype=int)
        if self._ready(points) and isinstance(self.method, BATCHED):
            for chosen, chunk in self._chunks(points):
                refinement = Refinement(self.engine, self.method, chunk, False, self.rtol)
                with contextlib.suppress(np.linalg.LinAlgError):
                    for part, found in refinement.spectra(steps):
                        values[chosen[part]], resolved[chosen[part]] = found.values, found.resolved
        return Spectra(values, resolved)

    def _of_chunk(self, chunk: Chunk) -> Iterator[Found | Unsound]:
        for method, positions in self._methods(chunk):
            refinement = Refinement(self.engine, method, chunk, self.orbit, self.rtol)
            if self.steps is None:
                yield from refinement.refined(positions)
            else:
                yield from refinement.judged(positions, self.steps)

    def _ready(self, points: Array) -> bool:
        """Whether the points can be solved together."""
        if not isinstance(self.method, (Auto, *BATCHED)):
            return False
        try:
            system = self.family.example
            if system.n > _LARGEST:
                return False
            system.checked(float(self.speeds(points[:1])[0]))
            if self.steps is not None and not 1 <= self.steps <= Radau().most_steps(system.n) // 2:
                return False
            if self._separation is None and not system.breaks:
                self._separation = Separation(self.family, self._region, system.period, system.n)
        except SolveError:
            return False
        return not system.breaks

    def _chunks(self, points: Array) -> Iterator[tuple[Array, Chunk]]:
        """The points whose entries separate, all of them or over speed alone, and the others; positions
        (k,) of each."""
        shared, every = self._separation, np.arange(len(points))
        assert shared is not None
        others = yield from _represented(shared, points, every)
        for alike in self._alike(points, others):
            if len(alike) >= _WORTH:
                own = Separation(self.family, points[alike], shared.period, shared.n)
                left = yield from _represented(own, points, alike)
                others = np.setdiff1d(others, np.setdiff1d(alike, left))
        if len(others):
            yield others, Sampled(self.family, points[others], shared.n, shared.period)

    def _alike(self, points: Array, positions: Array) -> list[Array]:
        """The positions, apart by the values of the parameters, where the speed varies beside these."""
        free = [k for k, name in enumerate(self.family.names) if name != SPEED]
        if len(positions) == 0 or not 0 < len(free) < len(self.family.names):
            return []
        _, group = np.unique(points[positions][:, free], axis=0, return_inverse=True)
        order = np.argsort(group.ravel(), kind="stable")
        return np.split(positions[order], np.flatnonzero(np.diff(group.ravel()[order])) + 1)

    def _methods(self, chunk: Chunk) -> Iterator[tuple[Gauss | Radau, Array]]:
        """The method of each point, as `Auto.settled` chooses it."""
        every = np.arange(len(chunk.points))
        if isinstance(self.method, BATCHED):
            yield self.method, every
            return
        stiff = frozen(chunk, every, PHASES).faster(RESOLVABLE / chunk.period)
        for method, positions in ((Radau(), every[stiff]), (Gauss(), every[~stiff])):
            if len(positions):
                yield method, positions


def _represented(
    separation: Separation, points: Array, positions: Array
) -> Generator[tuple[Array, Chunk], None, Array]:
    """Those of the positions that the terms represent, and their chunk; returns the others."""
    if not separation.separable:
        return positions
    coefficients, fits = separation.coefficients(points[positions])
    if fits.any():
        yield positions[fits], Separated(separation, points[positions[fits]], coefficients[fits])
    return positions[~fits]
