"""Points under one method: solved on one grid after another, compared, and their results put together."""

import math
from collections.abc import Generator, Iterator
from functools import cached_property
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.certify.certified import Certified, Failed, Request
from solve.certify.estimates import Burdens, at_one, differences
from solve.certify.inertia import singular
from solve.errors import StepsError
from solve.methods.free import driven_freely, free, solutions_on
from solve.methods.method import Method, Solutions, no_orbit
from solve.period.frozen import Frozen, balanced, frozen
from solve.period.grid import Grid
from solve.period.multipliers import Multipliers
from solve.period.points import Points
from solve.period.rigid_body import Free
from solve.progress import stage

_MEMORY = 2**25
"""Bytes that the points solved at once may take."""

_DRIVEN, _TIMES_ERROR = 1e-9, 10.0
"""Mean acceleration of a free machine, relative to its accelerations, that counts as none, and the times the
error of the orbit that is added to it: round-off leaves 1e-13 of chains whose loads have no mean."""


class Solving:
    """Points under one method."""

    def __init__(self, points: Points, method: Method, request: Request):
        self.points, self.method, self.request = points, method, request
        self.most = method.most_steps(points.n)
        self.orders = np.array([method.curve_order, method.order])

    @cached_property
    def modes(self) -> Frozen:
        """Frozen ones of all points."""
        return frozen(self.points, engine=self.request.engine)

    def with_method(self, method: Method) -> "Solving":
        """The same points under another method."""
        made = Solving(self.points, method, self.request)
        made.__dict__["modes"] = self.modes
        return made

    def on_grid(self, points: Points, steps: int) -> Solutions:
        """Solutions of linear equations on that many steps."""
        grid, method = Grid.uniform(steps, points.period, points.breaks), self.method.corrector
        with stage(f"{self.method.name} on {steps} steps"):
            return method.solutions(points, grid, self.request.orbit, self.request.engine)

    @cached_property
    def free(self) -> Free | None:
        """Rigid-body modes of the points; None without, or where the method looks for those of an orbit."""
        return free(self.points, self.modes) if self.method.linear else None

    @cached_property
    def equations(self) -> Points:
        """The points as the method solves them: factors would change modal masses, and what an approximation
        makes of these."""
        return balanced(self.points, self.modes) if self.method.converges else self.points

    def burdens(self, positions: Array) -> Burdens:
        """What acts on the coordinates of points at the positions (k,)."""
        return lambda at, sizes: self.modes[positions[at]].burdens(sizes)

    def differences(self, coarse: Solutions, fine: Solutions, positions: Array) -> Array:
        """Of solutions of points at the positions (k,) to better ones, (k, 2)."""
        return differences(coarse, fine, self.burdens(positions), self.request.engine)

    @cached_property
    def least(self) -> Array:
        """Steps (P,) below which the method cannot be stable."""
        if type(self.method).least_steps is Method.least_steps:
            return np.ones(len(self.points), dtype=int)
        return self.method.least_steps(self.modes)

    def refused(self) -> list[Failed]:
        """Points whose M is singular somewhere, and those at which the method is unstable with the steps that
        are given. Raises StepsError for a number of steps that it can use nowhere."""
        found = [Failed(*each) for each in singular(self.points, self.modes)]
        if self.request.steps is None:
            return found
        others = np.delete(np.arange(len(self.points)), [failure.position for failure in found])
        return [*found, *self.unusable(self.request.steps, others)]

    def unusable(self, steps: Any, positions: Array) -> Iterator[Failed]:
        """The points at which the method is unstable with these steps. Raises StepsError for a number that
        it can use nowhere."""
        self.method.require_steps(steps, self.points)
        for position in positions[steps < self.least[positions]].tolist():
            reason = StepsError(
                f"{self.method.name} with {steps} steps a period is beyond its stability limit; use at "
                f"least {self.least[position]} steps, or a method without limit (radau)"
            )
            yield Failed(position, reason)

    def solved(self, steps: int, positions: Array) -> Solutions:
        """Those of the points at the positions (k,) on that many steps."""
        points = self.equations[positions]
        grid = Grid.uniform(steps, points.period, points.breaks)
        with stage(f"{self.method.name} on {steps} steps"):
            held = None if self.free is None else self.free[positions]
            return solutions_on(self.method, points, grid, self.request.orbit, self.request.engine, held)

    def parts(self, steps: int, positions: Array) -> list[Array]:
        """The positions, split so that each part fits into memory."""
        if len(positions) < 2:
            return [positions] if len(positions) else []
        size = self.method.bytes_a_step(self.points.n, self.request.orbit, self.request.engine)
        size = (size + 8 * self.points.bytes_a_phase) * steps
        return np.array_split(positions, min(len(positions), math.ceil(len(positions) * size / _MEMORY)))

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

    def resonant(self, coarse: Multipliers, fine: Solutions, ratio: Array | float) -> Array:
        """Points (k,) with a multiplier that goes to +1, where an orbit is asked for."""
        if not self.request.orbit:
            return np.zeros(len(fine), dtype=bool)
        return at_one(coarse, fine.multipliers, ratio, self.method.order, fine.grid.steps)

    def certified(
        self, positions: Array, solutions: Solutions, errors: Array, absolute: Array
    ) -> Iterator[Certified | Failed]:
        """Points with their errors; those whose load drives a rigid-body mode fail. absolute (k,): errors
        of the multipliers, beside what the relative ones leave of these."""
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
