"""Batch solution of the points of a family. Tables are shared if the entries can be separated into functions
of the phase and coefficients of the point."""

from collections.abc import Generator, Iterator
from contextlib import suppress
from dataclasses import replace

import numpy as np

from solve.arguments import SMALL
from solve.arrays import Array
from solve.batch.family import SPEED, Family
from solve.batch.tables import Sampled, Separated, Separation, training
from solve.certify.certified import Certified, Failed, SolveRequest
from solve.certify.refinement import certified, on_one_grid
from solve.errors import SolveError
from solve.methods.choice import Rule, chosen_for
from solve.methods.method import Solutions
from solve.period.points import Points, SinglePoint
from solve.system import check, multiplier_count
from solve.terminal import progress
from solve.threads import one_thread

POINTS = "points"
"""Unit of progress reports."""

_MIN_GROUP = 4
"""Minimum number of points with equal parameters for which shared terms are computed as functions of the
speed alone. Chosen by judgement."""


class Batch:
    """Solver of the points of a family by a method, with shared tables."""

    def __init__(self, family: Family, region: Array, method: Rule, request: SolveRequest):
        """Prepare the solution.

        region: points (T, v) from which shared tables are computed. Their range must contain the points to be
        solved."""
        self.family, self.method, self.request = family, method, request
        self.region = region
        self._separation: Separation | None = None
        self._is_checked = False

    def solved(self, points: Array) -> Iterator[Certified | Failed]:
        """Solve points (k, v) in groups. Yield the solutions of each group, with the indices of its
        points."""
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
        """Solve points (k, v) on grids with the given numbers of steps, without error estimates. Yield the
        number of steps, the indices of the points and their solutions. Failed points are omitted."""
        for chosen, chunk in self._chunks(points):
            if isinstance(chunk, Failed):
                continue
            for method, at in chosen_for(self.method, chunk):
                points_of_method = chunk[at]
                for steps in grids:
                    for index, solutions in on_one_grid(points_of_method, method, self.request, steps):
                        yield steps, chosen[at[index]], solutions

    def multipliers(self, points: Array, steps: int) -> Array:
        """Multipliers (k, N) of points (k, v) on one grid of `steps` steps, without error estimates; zero for
        failed points."""
        values = np.zeros((len(points), multiplier_count(self.family.example)), dtype=complex)
        with one_thread(self.family.example.n), progress.task(POINTS, len(points)) as count:
            for _, positions, solutions in self.solutions(points, steps):
                values[positions] = solutions.multipliers.values
                count.add(len(positions))
        return values

    def _reason(self, point: Array, reason: SolveError) -> SolveError:
        """Reason why a point (v,) failed: the exception raised when its system is built or, if none is
        raised, `reason`."""
        single = self._single(point[None], 0)
        return single.reason if isinstance(single, Failed) else reason

    def _chunks(self, points: Array) -> Iterator[tuple[Array, Points | Failed]]:
        """Yield groups of points for batch solution, and single points, each with their indices (k,)."""
        all_positions = np.arange(len(points))
        single = all_positions
        if self._supports_batches(points):
            single = yield from self._groups(points)
        yield from ((all_positions[at : at + 1], self._single(points, at)) for at in single.tolist())

    def _groups(self, points: Array) -> Generator[tuple[Array, Points], None, Array]:
        """Yield groups of points with the same breaks. Return the indices of points without a valid system.

        Generated code is checked at the first point only."""
        family, system, all_positions = self.family, self.family.example, np.arange(len(points))
        valid = family.exist(points)
        at_speeds = family.at_speeds(points[valid]) if valid.any() else None
        if at_speeds is not None:
            yield all_positions[valid], at_speeds
            return all_positions[~valid]
        if system.labels.model_hash is None:
            valid &= [not isinstance(self._single(points, at), Failed) for at in all_positions.tolist()]
        left = [all_positions[~valid]]
        for breaks, group in family.by_breaks(points):
            members = group[valid[group]]
            if breaks is None or not len(members):
                left.append(members)
                continue
            if family.moves_breaks and len(members) < _MIN_GROUP:
                yield members, Sampled(family, points[members], self.request.engine, breaks)
                continue
            shared = self._separation
            if shared is None or shared.breaks != breaks:
                region = training(points[members]) if family.moves_breaks else self.region
                shared = Separation(family, region, self.request.engine, breaks)
                self._separation = shared
            yield from self._with_tables(shared, points, members)
        return np.sort(np.concatenate(left))

    def _single(self, points: Array, at: int) -> Points | Failed:
        """Point with index `at`, represented by its own system; Failed if this system is invalid."""
        try:
            system, speed = self.family.system(points[at])
            check(system, speed)
        except SolveError as refusal:
            return Failed(at, refusal)
        return SinglePoint(system, speed)

    def _supports_batches(self, points: Array) -> bool:
        """Whether the points can be solved in batches."""
        system = self.family.example
        if system.n > SMALL:
            return False
        if not self._is_checked:
            with suppress(SolveError):
                check(system, float(self.family.speeds(points[:1])[0]))
                self._is_checked = True
        return self._is_checked

    def _with_tables(
        self, shared: Separation, points: Array, positions: Array
    ) -> Iterator[tuple[Array, Points]]:
        """Yield points with shared terms, which are functions of all quantities or of the speed alone; then
        yield all other points."""
        others = yield from _represented(shared, points, positions)
        for group in self._by_parameters(points, others):
            if len(group) >= _MIN_GROUP:
                region = training(points[group])
                over_speed = Separation(self.family, region, shared.engine, shared.breaks)
                left = yield from _represented(over_speed, points, group)
                others = np.setdiff1d(others, np.setdiff1d(group, left))
        if len(others):
            yield others, Sampled(self.family, points[others], shared.engine, shared.breaks)

    def _by_parameters(self, points: Array, positions: Array) -> list[Array]:
        """Groups of indices of points with equal parameters. The list is empty unless both speed and
        parameters vary."""
        free = [k for k, name in enumerate(self.family.names) if name != SPEED]
        if len(positions) == 0 or not 0 < len(free) < len(self.family.names):
            return []
        _, group = np.unique(points[positions][:, free], axis=0, return_inverse=True)
        order = np.argsort(group.ravel(), kind="stable")
        return np.split(positions[order], np.flatnonzero(np.diff(group.ravel()[order])) + 1)


def _represented(
    separation: Separation, points: Array, positions: Array
) -> Generator[tuple[Array, Points], None, Array]:
    """Find the points, among those with the indices `positions`, that the shared terms represent. Yield their
    indices and the `Points` that represent them. Return the indices of the other points."""
    if not separation.separable:
        return positions
    coefficients, fits = separation.coefficients(points[positions])
    represented = np.flatnonzero(fits)
    if len(represented):
        yield positions[represented], Separated(separation, coefficients)[represented]
    return positions[~fits]
