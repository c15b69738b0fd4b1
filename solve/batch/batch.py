"""Points of a family solved many at once: what is shared between them, and who needs more."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from solve.arrays import Array
from solve.batch.doubts import frozen
from solve.batch.family import SPEED, Family
from solve.batch.level import Engine
from solve.batch.refinement import BATCHED, Found, Refinement, Unsound
from solve.batch.tables import Chunk, Sampled, Separated, Separation
from solve.errors import SolveError
from solve.methods.auto import PHASES, RESOLVABLE, Auto
from solve.methods.gauss import Gauss
from solve.methods.method import Method
from solve.methods.radau import Radau


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
        return np.full(len(points), self.family.system(points[0])[1])

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
            system, speed = self.family.system(points[0])
            system.checked(speed)
            if self.steps is not None and not 1 <= self.steps <= Radau().most_steps(system.n) // 2:
                return False
            if self._separation is None and not system.breaks:
                self._separation = Separation(self.family, self._region, system.period, system.n)
        except SolveError:
            return False
        return not system.breaks

    def _chunks(self, points: Array) -> Iterator[tuple[Array, Chunk]]:
        """The points whose entries separate, and the others; positions (k,) of each."""
        separation, represented = self._separation, np.zeros(len(points), dtype=bool)
        assert separation is not None
        if separation.separable:
            coefficients, represented = separation.coefficients(points)
            if represented.any():
                shared = Separated(separation, points[represented], coefficients[represented])
                yield np.flatnonzero(represented), shared
        if not represented.all():
            yield (
                np.flatnonzero(~represented),
                Sampled(self.family, points[~represented], separation.n, separation.period),
            )

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
