"""Points of a family solved many at once: from shared tables where their entries separate, else sampled."""

from collections.abc import Generator, Iterator
from contextlib import suppress
from dataclasses import replace

import numpy as np

from solve.arrays import Array
from solve.batch.family import SPEED, Family
from solve.batch.tables import Sampled, Separated, Separation, training
from solve.certify.certified import Certified, Failed, SolveRequest
from solve.certify.refinement import certified, on_one_grid
from solve.errors import SolveError
from solve.methods.choice import Rule, chosen_for
from solve.methods.method import Solutions
from solve.period.points import OnePoint, Points
from solve.sizes import SMALL
from solve.terminal import progress
from solve.threads import one_thread

POINTS = "points"
"""How stages name them."""

_LEAST_GROUP = 4
"""Least number of points with equal parameters for which terms over the speed alone are made."""


class Batch:
    """How points of a family are solved: by which method, from which tables."""

    def __init__(self, family: Family, region: Array, method: Rule, request: SolveRequest):
        """`region`: points (T, v) that span those to be solved; the shared tables are learnt from them."""
        self.family, self.method, self.request = family, method, request
        self.region = region
        self._separation: Separation | None = None
        self._sound = False

    def solved(self, points: Array) -> Iterator[Certified | Failed]:
        """Points (k, v), in groups as they come; positions are those among the points."""
        for chosen, chunk in self._chunks(points):
            if isinstance(chunk, Failed):
                yield chunk
                continue
            for method, at in chosen_for(self.method, chunk):
                positions = chosen[at]
                try:
                    for result in certified(chunk[at], method, self.request):
                        if isinstance(result, Failed):
                            position = int(positions[result.position])
                            yield Failed(position, self._reason(points[position], result.reason))
                        else:
                            yield replace(result, positions=positions[result.positions])
                except SolveError as error:
                    yield from (Failed(position, error) for position in positions.tolist())

    def solutions(self, points: Array, *grids: int) -> Iterator[tuple[int, Array, Solutions]]:
        """Points (k, v) on each of grids of so many steps, not judged: the steps, the positions of the points
        and their solutions; failures left out."""
        for chosen, chunk in self._chunks(points):
            if isinstance(chunk, Failed):
                continue
            for method, at in chosen_for(self.method, chunk):
                some = chunk[at]
                for steps in grids:
                    for part, solutions in on_one_grid(some, method, self.request, steps):
                        yield steps, chosen[at[part]], solutions

    def multipliers(self, points: Array, steps: int) -> Array:
        """Multipliers (k, N) of points (k, v) on one grid, not judged; zero where there are none."""
        values = np.zeros((len(points), 2 * self.family.example.n), dtype=complex)
        with one_thread(self.family.example.n), progress.task(POINTS, len(points)) as count:
            for _, positions, solutions in self.solutions(points, steps):
                values[positions] = solutions.multipliers.values
                count.add(len(positions))
        return values

    def _reason(self, point: Array, reason: SolveError) -> SolveError:
        """Why a point (v,) fails: what its own system refuses, else the reason met."""
        alone = self._alone(point[None], 0)
        return alone.reason if isinstance(alone, Failed) else reason

    def _chunks(self, points: Array) -> Iterator[tuple[Array, Points | Failed]]:
        """Groups of points that can be solved side by side, or single ones; positions (k,) of each."""
        every = np.arange(len(points))
        alone = every
        if self._together(points):
            alone = yield from self._side_by_side(points)
        yield from ((every[at : at + 1], self._alone(points, at)) for at in alone.tolist())

    def _side_by_side(self, points: Array) -> Generator[tuple[Array, Points], None, Array]:
        """The points in groups whose matrices jump at the same phases; returns the positions of those without
        a system, or with matrices that cannot be. Of generated code the first point alone was asked."""
        family, system, every = self.family, self.family.example, np.arange(len(points))
        sound = family.exist(points)
        known = family.at_speeds(points[sound]) if sound.any() else None
        if known is not None:
            yield every[sound], known
            return every[~sound]
        if system.model_hash is None:
            sound &= [not isinstance(self._alone(points, at), Failed) for at in every.tolist()]
        left = [every[~sound]]
        for breaks, group in family.by_breaks(points):
            alike = group[sound[group]]
            if breaks is None or not len(alike):
                left.append(alike)
                continue
            if family.moves_breaks and len(alike) < _LEAST_GROUP:
                yield alike, Sampled(family, points[alike], self.request.engine, breaks)
                continue
            shared = self._separation
            if shared is None or shared.breaks != breaks:
                region = training(points[alike]) if family.moves_breaks else self.region
                shared = Separation(family, region, system.period, system.n, self.request.engine, breaks)
                self._separation = shared
            yield from self._shared(shared, points, alike)
        return np.sort(np.concatenate(left))

    def _alone(self, points: Array, at: int) -> Points | Failed:
        try:
            system, speed = self.family.system(points[at])
            system.checked(speed)
        except SolveError as refusal:
            return Failed(at, refusal)
        return OnePoint(system, speed)

    def _together(self, points: Array) -> bool:
        """Whether the points can be solved side by side."""
        system = self.family.example
        if system.n > SMALL:
            return False
        if not self._sound:
            with suppress(SolveError):
                system.checked(float(self.family.speeds(points[:1])[0]))
                self._sound = True
        return self._sound

    def _shared(self, shared: Separation, points: Array, positions: Array) -> Iterator[tuple[Array, Points]]:
        """The points whose entries separate, over all quantities or over the speed alone; then the rest."""
        others = yield from _represented(shared, points, positions)
        for alike in self._by_parameters(points, others):
            if len(alike) >= _LEAST_GROUP:
                region = training(points[alike])
                own = Separation(self.family, region, shared.period, shared.n, shared.engine, shared.breaks)
                left = yield from _represented(own, points, alike)
                others = np.setdiff1d(others, np.setdiff1d(alike, left))
        if len(others):
            yield others, Sampled(self.family, points[others], shared.engine, shared.breaks)

    def _by_parameters(self, points: Array, positions: Array) -> list[Array]:
        """The positions in groups of equal parameters, where the speed varies too."""
        free = [k for k, name in enumerate(self.family.names) if name != SPEED]
        if len(positions) == 0 or not 0 < len(free) < len(self.family.names):
            return []
        _, group = np.unique(points[positions][:, free], axis=0, return_inverse=True)
        order = np.argsort(group.ravel(), kind="stable")
        return np.split(positions[order], np.flatnonzero(np.diff(group.ravel()[order])) + 1)


def _represented(
    separation: Separation, points: Array, positions: Array
) -> Generator[tuple[Array, Points], None, Array]:
    """The positions whose entries the terms represent, with their points; returns the positions left."""
    if not separation.separable:
        return positions
    coefficients, fits = separation.coefficients(points[positions])
    fitting = np.flatnonzero(fits)
    if len(fitting):
        yield positions[fitting], Separated(separation, coefficients)[fitting]
    return positions[~fits]
