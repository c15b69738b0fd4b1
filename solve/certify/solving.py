"""Solutions of points by one method on a grid, their comparison, and the results."""

import math
from collections.abc import Generator, Iterator
from functools import cached_property
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.certify.certified import Certified, Failed, Request
from solve.certify.estimates import Burdens, differences
from solve.certify.inertia import singular
from solve.errors import StepsError
from solve.methods.free import driven_freely, free, solutions_on
from solve.methods.method import Method, Solutions, no_orbit
from solve.period.frozen import Frozen, balanced, frozen
from solve.period.grid import Grid
from solve.period.points import Points
from solve.period.rigid_body import Free
from solve.terminal import progress

_MEMORY = 2**25
"""Bytes of the points that are solved at a time."""

_WORK = 1e9
"""Multiplications for the points that are solved at a time: some tenths of a second, which an interruption
waits for."""

_DRIVEN, _TIMES_ERROR = 1e-9, 10.0
"""Mean acceleration of a free machine, relative to its accelerations, that counts as zero, and the multiple
of the error of the orbit that is added to it. Measured round-off for chains whose loads have zero mean:
1e-13."""


class Solving:
    """Solver of points by one method."""

    def __init__(self, points: Points, method: Method, request: Request):
        self.points, self.method, self.request = points, method, request
        self.most = method.most_steps(points.n)
        self.orders = np.array([method.curve_order, method.order])

    @cached_property
    def modes(self) -> Frozen:
        """Frozen modes of all points."""
        return frozen(self.points, engine=self.request.engine)

    def with_method(self, method: Method) -> "Solving":
        """Solver of the same points by another method."""
        made = Solving(self.points, method, self.request)
        made.__dict__.update(modes=self.modes, free=self.free, equations=self.equations)
        return made

    def on_grid(self, method: Method, points: Points, steps: int, held: Free | None) -> Solutions:
        """Solutions of points with rigid-body modes `held` on a number of steps."""
        grid = Grid.uniform(steps, points.period, points.breaks)
        with progress.task(f"{self.method.name} on {steps} steps"):
            return solutions_on(method, points, grid, self.request.orbit, self.request.engine, held)

    @cached_property
    def free(self) -> Free | None:
        """Rigid-body modes of the points; None without, or where the method looks for those of an orbit."""
        return free(self.points, self.modes) if self.method.linear else None

    @cached_property
    def equations(self) -> Points:
        """Points with balanced equations; unbalanced for methods that do not converge, because row factors
        change modal masses and hence their result."""
        return balanced(self.points, self.modes) if self.method.converges else self.points

    def softest(self, positions: Array) -> Array:
        """Stiffness (k,) of the softest frozen mode of points at the positions (k,), relative to the
        stiffest."""
        if self.points.n == 1:
            return np.ones(len(positions))
        sizes = np.abs(self.modes[positions].few_eigenvalues)
        least, largest = sizes.min(axis=(1, 2)), sizes.max(axis=(1, 2))
        return np.where(largest > 0, least / np.where(largest > 0, largest, 1.0), 1.0) ** 2

    def burdens(self, positions: Array) -> Burdens:
        """Loads on the coordinates of points at the positions (k,)."""
        return lambda at, sizes: self.modes[positions[at]].burdens(sizes)

    def differences(self, coarse: Solutions, fine: Solutions, positions: Array) -> Array:
        """Differences (k, 2) of solutions of points at the positions (k,) from better ones."""
        return differences(coarse, fine, self.burdens(positions), self.request.engine)

    @cached_property
    def least(self) -> Array:
        """Smallest numbers of steps (P,) with which the method can be stable."""
        if type(self.method).least_steps is Method.least_steps:
            return np.ones(len(self.points), dtype=int)
        return self.method.least_steps(self.modes)

    def refused(self) -> list[Failed]:
        """Points with a singular M, and points at which the method is unstable with the given steps. Raises
        StepsError for a number of steps that the method cannot use at any point."""
        found = [Failed(*each) for each in singular(self.points, self.modes)]
        if self.request.steps is None:
            return found
        others = np.delete(np.arange(len(self.points)), [failure.position for failure in found])
        return [*found, *self.unusable(self.request.steps, others)]

    def unusable(self, steps: Any, positions: Array) -> Iterator[Failed]:
        """Points at which the method is unstable with these steps. Raises StepsError for a number that the
        method cannot use at any point."""
        self.method.require_steps(steps, self.points)
        for position in positions[steps < self.least[positions]].tolist():
            reason = StepsError(
                f"{self.method.name} with {steps} steps a period is beyond its stability limit; use at "
                f"least {self.least[position]} steps, or a method without limit (radau)"
            )
            yield Failed(position, reason)

    def solved(self, steps: int, positions: Array) -> Solutions:
        """Solutions of the points at the positions (k,) on a number of steps."""
        return self.on_grid(self.method, self.equations[positions], steps, self.held(positions))

    def held(self, positions: Array) -> Free | None:
        """Rigid-body modes of points at the positions (k,)."""
        return None if self.free is None else self.free[positions]

    def parts(self, steps: int, positions: Array) -> list[Array]:
        """The positions, split so that each part fits into memory and can be interrupted after it."""
        if len(positions) < 2:
            return [positions] if len(positions) else []
        n, stages = self.points.n, self.method.stages
        size = self.method.bytes_a_step(n, self.request.orbit, self.request.engine)
        size = (size + 8 * self.points.bytes_a_phase) * steps
        rows = n * (1 if stages is None else len(stages.c))
        work = steps * rows**2 * (rows / 3 + 2 * n + 1)
        count = math.ceil(len(positions) * max(size / _MEMORY, work / _WORK))
        return np.array_split(positions, min(len(positions), count))

    def sound(
        self, solutions: Solutions, positions: Array
    ) -> Generator[Failed, None, tuple[Solutions, Array]]:
        """Report failures; returns the other solutions and their positions."""
        if not solutions.failures:
            return solutions, positions
        for at, reason in solutions.failures.items():
            yield Failed(int(positions[at]), reason)
        return solutions[solutions.known], positions[solutions.known]

    @staticmethod
    def no_orbits(positions: Array) -> Iterator[Failed]:
        return (Failed(position, no_orbit()) for position in positions.tolist())

    def certified(
        self, positions: Array, solutions: Solutions, errors: Array, absolute: Array
    ) -> Iterator[Certified | Failed]:
        """Points with their errors; those whose load drives a rigid-body mode fail. absolute (k,): lower
        bounds of the absolute errors of the multipliers."""
        errors[:, 0] += solutions.defect
        if solutions.free is not None and solutions.driven is not None and self.request.orbit:
            driven = solutions.driven > _DRIVEN + _TIMES_ERROR * errors[:, 0]
            for at in np.flatnonzero(driven)[:, None]:
                point, modes = self.points[positions[at]], solutions.free.modes[at]
                yield Failed(int(positions[at[0]]), driven_freely(point, modes))
            if driven.all():
                return
            kept = np.flatnonzero(~driven)
            positions, solutions = positions[kept], solutions[kept]
            errors, absolute = errors[kept], absolute[kept]
        radius = solutions.multipliers.spectral_radius
        with np.errstate(over="ignore"):
            absolute = np.maximum(absolute, np.where(radius > 0, errors[:, 1], 0.0) * radius)
        modes = self.modes[positions]
        yield Certified(positions, self.method, solutions, errors, absolute, self.request, modes)
