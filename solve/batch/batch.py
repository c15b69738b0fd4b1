"""Points of a family solved many at once: what is shared between them, and who needs more."""

from collections.abc import Iterator

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
    """How the points (P, v) of a family are solved: by which method, from which tables."""

    def __init__(
        self,
        family: Family,
        points: Array,
        method: Method,
        steps: int | None,
        rtol: float,
        orbit: bool,
        engine: Engine,
    ):
        self.family, self.points, self.method = family, points, method
        self.steps, self.rtol, self.orbit, self.engine = steps, rtol, orbit, engine
        at = family.names.index(SPEED) if SPEED in family.names else None
        self.speeds = points[:, at] if at is not None else np.full(len(points), family.system(points[0])[1])
        self._separation: Separation | None = None

    def solved(self, index: Array) -> Iterator[tuple[Array, Found | Unsound]]:
        """The points of the index (k,), in groups as they come: index of the group (g,), result."""
        if not self._ready(index):
            yield index, Unsound(np.arange(len(index)))
            return
        for chosen, chunk in self._chunks(index):
            for method, positions in self._methods(chunk):
                refinement = Refinement(self.engine, method, chunk, self.orbit, self.rtol)
                results = (
                    refinement.refined(positions)
                    if self.steps is None
                    else refinement.judged(positions, self.steps)
                )
                for result in results:
                    yield chosen[result.positions], result

    def _ready(self, index: Array) -> bool:
        """Whether the points can be solved together."""
        if not isinstance(self.method, (Auto, *BATCHED)):
            return False
        try:
            system, speed = self.family.system(self.points[index[0]])
            system.checked(speed)
            if self.steps is not None and not 1 <= self.steps <= Radau().most_steps(system.n) // 2:
                return False
            if self._separation is None and not system.breaks:
                self._separation = Separation(self.family, self.points, system.period, system.n)
        except SolveError:
            return False
        return not system.breaks

    def _chunks(self, index: Array) -> Iterator[tuple[Array, Chunk]]:
        """The points whose entries separate, and the others."""
        separation, points = self._separation, self.points[index]
        assert separation is not None
        represented = np.zeros(len(index), dtype=bool)
        if separation.separable:
            coefficients, represented = separation.coefficients(points)
            if represented.any():
                yield (
                    index[represented],
                    Separated(separation, points[represented], coefficients[represented]),
                )
        if not represented.all():
            others = points[~represented]
            yield index[~represented], Sampled(self.family, others, separation.n, separation.period)

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
