"""Refinement of grids until the errors estimated from two solutions meet the tolerance."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from solve.arrays import Array, across, unique_integers
from solve.certify.certified import Certified, Failed, SolveRequest, verdicts_of
from solve.certify.comparison import Comparison, comparison_of
from solve.certify.estimates import (
    NO_DIGIT,
    attainable_tolerances,
    relative_to_smallest_scale,
    roundoff_errors,
)
from solve.certify.point_solver import PointSolver
from solve.certify.resolution import (
    AIM,
    MIN_STEPS,
    UNDERFLOW,
    first_steps,
    grid_sizes,
    unresolved_remainder,
)
from solve.errors import SolveError, StepsError
from solve.methods.method import Method, Solutions, no_orbit
from solve.period.multipliers import EPS, KNOWN_ON_CIRCLE, NEGLIGIBLE, UNDETERMINED
from solve.period.points import Points
from solve.terminal import progress

STEPS = "steps"
"""Name of the progress counter for the steps of a single solution."""

SAFETY = 2.0
"""Ratio of the error estimate to the difference from a better solution. The difference equals the error to
first order, and is at least half of it in 99.8 % of the stored population."""

_MAX_GROWTH = 6.0
"""Largest ratio of the steps of successive grids: a choice."""

_STALLED = 0.5
"""Fraction of the previous error above which an error does not decrease: a choice."""


def certified(points: Points, method: Method, request: SolveRequest) -> Iterator[Certified | Failed]:
    """Solutions with error estimates, each point once, in groups as they are completed.

    The grid has the given number of `steps`, or is the first one with errors of at most `rtol` or of
    round-off. Errors are differences from a better solution, see `Comparison`. A point fails with
    ResonanceError if an orbit is requested and a multiplier equals +1 within the difference of both
    solutions. Raises StepsError for `steps` that the method cannot use at any point."""
    comparison = comparison_of(points, method, request)
    solver = comparison.solver
    groups = _rigid_body_groups(solver)
    if len(groups) > 1:
        for group in groups:
            for result in certified(points[group], method, request):
                yield _at_positions(result, group)
        return
    failures = solver.invalid_points()
    yield from failures
    positions = np.delete(np.arange(len(points)), [failure.position for failure in failures])
    if not method.converges:
        yield from _certify_approximation(solver, positions)
    elif request.steps is None:
        yield from _Refinement(comparison).refine(positions)
    else:
        yield from _Refinement(comparison).solve_on_given_steps(request.steps, positions)


def on_one_grid(
    points: Points, method: Method, request: SolveRequest, steps: int
) -> Iterator[tuple[Array, Solutions]]:
    """Better solutions of the points on one grid, without error estimates, in chunks with their positions
    (k,); failed points are omitted."""
    solver = PointSolver(points, method.with_another_stage or method, request)
    for chunk in solver.chunks(steps, np.arange(len(points))):
        solutions = solver.solve(steps, chunk)
        yield chunk[solutions.known], solutions[solutions.known]


def _rigid_body_groups(solver: PointSolver) -> list[Array]:
    """Positions of points with rigid-body modes that conserve no momentum, with ones that do, and without
    any; nonempty groups only."""
    if solver.free is None:
        return []
    has_modes, conserves = solver.free.modes.any, solver.free.modes.conserving
    groups = (np.flatnonzero(kind) for kind in (has_modes & ~conserves, conserves, ~has_modes))
    return [group for group in groups if len(group)]


def _at_positions(result: Certified | Failed, positions: Array) -> Certified | Failed:
    """A result for a group of points at these positions."""
    if isinstance(result, Failed):
        return Failed(int(positions[result.position]), result.reason)
    return replace(result, positions=positions[result.positions])


@dataclass(frozen=True)
class _GridComparison:
    """Two solutions of points on related grids.

    positions (k,) of the points; errors (k, 2) of the first solution; roundoff (k,): relative errors of the
    multipliers from the coefficients of the stiffest mode; remainder (k,): what is left of a disturbance
    after a period in modes that the steps do not resolve."""

    positions: Array
    solutions: Solutions
    better: Solutions
    errors: Array
    stiff_roundoff: Array
    remainder: Array

    def __len__(self) -> int:
        return len(self.positions)

    def __getitem__(self, rows: Array) -> "_GridComparison":
        return _GridComparison(
            self.positions[rows],
            self.solutions[rows],
            self.better[rows],
            self.errors[rows],
            self.stiff_roundoff[rows],
            self.remainder[rows],
        )

    @property
    def underflows(self) -> Array:
        """Points (k,) whose multipliers are round-off of the entries of Φ."""
        return self.solutions.multipliers.spectral_radius < UNDERFLOW


class _Refinement:
    """Solution of the points of a comparison on given steps, or on as many as each point requires.

    previous_errors (P, 2), smallest_radii (P,), stalled_grids (P, 2) and grids (P,): errors of the last grid
    of each point, smallest sum of the spectral radii of both solutions, number of successive grids on which
    errors did not decrease, and number of grids."""

    def __init__(self, comparison: Comparison):
        self.comparison, self.solver = comparison, comparison.solver
        self.request, self.method = self.solver.request, self.solver.method
        self.max_steps, count = comparison.max_steps, len(self.solver.points)
        self.previous_errors = np.full((count, 2), np.inf)
        self.smallest_radii = np.full(count, np.inf)
        self.stalled_grids = np.zeros((count, 2), dtype=int)
        self.grids = np.zeros(count, dtype=int)

    def solve_on_given_steps(self, steps: int, positions: Array) -> Iterator[Certified | Failed]:
        for chunk in self.comparison.chunks(steps, positions):
            solutions, better = self.comparison.solve(steps, chunk)
            failures = {**better.failures, **solutions.failures}
            yield from _failed(failures, chunk)
            rows = np.setdiff1d(np.arange(len(chunk)), list(failures))
            if len(rows):
                pair = self._compare(steps, chunk[rows], solutions[rows], better[rows])
                unsampled = self.comparison.unsampled_errors(steps, pair.positions, pair.solutions)
                np.maximum(pair.errors, unsampled, out=pair.errors)
                yield from self._certify(pair)

    def refine(self, positions: Array) -> Iterator[Certified | Failed]:
        solver = self.solver
        least = np.maximum(solver.min_steps[positions], len(solver.points.breaks))
        for position in positions[least > self.max_steps].tolist():
            yield Failed(position, self._unstable(int(solver.min_steps[position])))
        positions, least = positions[least <= self.max_steps], least[least <= self.max_steps]
        points, modes = solver.points[positions], solver.modes[positions]
        first = first_steps(self.method, points, modes, self.request.orbit, self.request.rtol)
        first = np.minimum(grid_sizes(np.maximum(first, 1.2 * least)), max(self.max_steps, MIN_STEPS))
        pending = {steps: [positions[first == steps]] for steps in unique_integers(first)}
        while pending:
            steps = min(pending)
            for chunk in self.comparison.chunks(steps, np.concatenate(pending.pop(steps))):
                yield from self._refine_on(steps, chunk, pending)

    def _refine_on(
        self, steps: int, chunk: Array, pending: dict[int, list[Array]]
    ) -> Iterator[Certified | Failed]:
        """Solve points on one grid; those that are not accepted are added to the `pending` ones of their next
        grids."""
        solutions, better = self.comparison.solve(steps, chunk)
        failures = {**better.failures, **solutions.failures}
        rows = np.setdiff1d(np.arange(len(chunk)), list(failures))
        if 2 * steps <= self.max_steps:
            overflows = [row for row, reason in failures.items() if isinstance(reason, StepsError)]
            failures = {row: reason for row, reason in failures.items() if row not in overflows}
            if overflows:
                pending.setdefault(2 * steps, []).append(chunk[overflows])
        yield from _failed(failures, chunk)
        if not len(rows):
            return
        pair = self._compare(steps, chunk[rows], solutions[rows], better[rows])
        tolerances = np.full(pair.errors.shape, self.request.rtol)
        tolerances[:, 0] = np.maximum(tolerances[:, 0], 2 * pair.solutions.defect)
        tolerances = attainable_tolerances(pair.solutions, pair.errors, tolerances)
        growth = self._step_growth(pair, tolerances)
        accepted = self._accept(steps, pair, tolerances)
        progress.set_total(STEPS, steps, lambda: min(int(growth.max() * steps), self.max_steps))
        yield from self._certify(pair[np.flatnonzero(accepted)])
        next_steps = np.minimum(grid_sizes(np.maximum(growth * steps, steps + 1)), self.max_steps)
        for finer in unique_integers(next_steps[~accepted]):
            pending.setdefault(finer, []).append(pair.positions[~accepted & (next_steps == finer)])

    def _compare(
        self, steps: int, positions: Array, solutions: Solutions, better: Solutions
    ) -> _GridComparison:
        """Two solutions of points, with the errors of the first."""
        errors = SAFETY * self.solver.differences(solutions, better, positions)
        errors = np.maximum(errors, roundoff_errors(solutions))
        radius, modes = better.multipliers.spectral_radius, self.solver.modes[positions]
        finest = steps * self.comparison.step_ratio
        remainder = unresolved_remainder(self.method, modes, finest, self.request.rtol * radius)
        with np.errstate(over="ignore"):
            relative = np.minimum(remainder / np.maximum(radius, NEGLIGIBLE), 1.0)
        errors[:, 1] = np.maximum(errors[:, 1], np.where(np.isfinite(remainder), relative, np.inf))
        # Both solutions use the same coefficients: their difference shows a tenth of this round-off at least.
        stiff_roundoff = self._stiff_roundoff(positions)
        errors[:, 1] = np.maximum(errors[:, 1], np.minimum(stiff_roundoff, 10 * errors[:, 1]))
        # Two solutions that differ visibly may both be wrong about modes that they do not resolve.
        errors[(remainder > 0) & (errors[:, 1] > NO_DIGIT), 1] = np.inf
        errors[~(errors < 1.0)] = np.inf
        return _GridComparison(positions, solutions, better, errors, stiff_roundoff, remainder)

    def _stiff_roundoff(self, positions: Array) -> Array:
        """Round-off (k,) of the softest mode due to the coefficients of the stiffest one, relative, for
        methods that damp the stiffest one: eps/8 times the square of the number of its periods, as
        measured."""
        if not self.method.l_stable:
            return np.zeros(len(positions))
        periods = self.solver.modes[positions].phase_advance_estimate / (2 * np.pi)
        return np.asarray(EPS / 8 * np.where(np.isfinite(periods), periods, 0.0) ** 2)

    def _accept(self, steps: int, pair: _GridComparison, tolerances: Array) -> Array:
        """Points (k,) that need no finer grid.

        A point is accepted if

        1. each of its errors is at most the tolerance (k, 2), or is round-off that two grids did not reduce;
        2. features of the coefficients between the samples cause no larger errors;
        3. a finer grid would not decide an open verdict.

        On the finest possible grid every point is accepted; its errors state what is reached. Errors are
        increased in place by those of features between the samples."""
        is_last = steps >= self.max_steps
        is_reached = (pair.errors <= tolerances) | self._is_stalled_roundoff(pair) | is_last
        accepted = across(np.logical_and, is_reached)
        rows = np.flatnonzero(accepted)
        if len(rows):
            unsampled = self.comparison.unsampled_errors(steps, pair.positions[rows], pair.solutions[rows])
            pair.errors[rows] = np.maximum(pair.errors[rows], unsampled)
            accepted[rows] = across(np.logical_and, unsampled <= tolerances[rows])
        return (accepted & ~self._finer_grid_decides(pair)) | is_last

    def _is_stalled_roundoff(self, pair: _GridComparison) -> Array:
        """Errors (k, 2) that are round-off: below a limit, and not reduced by two grids.

        The limit is a thousand times the estimated round-off; larger errors may not decrease for other
        reasons, such as kinks in the coefficients. Errors below 1e-12 that one finer grid increases are
        round-off as well. Multipliers that underflow have no limit, but are refined as long as they decrease.
        """
        positions, errors, underflows = pair.positions, pair.errors, pair.underflows
        roundoff = roundoff_errors(pair.solutions)
        roundoff[:, 1] = np.maximum(roundoff[:, 1], pair.stiff_roundoff)
        is_small = errors < 1e3 * roundoff
        is_small[:, 1] |= underflows
        previous = self.previous_errors[positions]
        increases = (errors > previous) & (previous < 1e-12)
        decreases = errors < _STALLED * previous
        radii = pair.solutions.multipliers.spectral_radius + pair.better.multipliers.spectral_radius
        decreases[:, 1] |= (
            underflows & (radii > NEGLIGIBLE) & (radii < _STALLED * self.smallest_radii[positions])
        )
        self.stalled_grids[positions] = np.where(decreases, 0, self.stalled_grids[positions] + 1 + increases)
        # With kinks in the coefficients, errors decrease irregularly: the smallest one may be a coincidence.
        self.previous_errors[positions] = errors
        self.smallest_radii[positions] = np.fmin(self.smallest_radii[positions], radii)
        return is_small & (self.stalled_grids[positions] > 1)

    def _finer_grid_decides(self, pair: _GridComparison) -> Array:
        """Points (k,) with an open verdict that a grid of twice the steps would decide, if errors decrease
        with the order of the method and are not round-off."""
        solutions, order = pair.solutions, min(self.method.order, 20)
        with np.errstate(over="ignore", invalid="ignore"):
            errors = pair.errors[:, 1] * solutions.multipliers.spectral_radius
        decides = np.isfinite(errors) & (errors > KNOWN_ON_CIRCLE / 2)
        decides &= pair.errors[:, 1] > 4 * roundoff_errors(solutions)[:, 1]
        for fraction, is_open in ((1.0, True), (0.5**order, False)):
            rows = np.flatnonzero(decides)
            if len(rows):
                modes = self.solver.modes[pair.positions[rows]]
                verdicts = verdicts_of(solutions[rows], fraction * errors[rows], modes)
                decides[rows] = (verdicts == UNDETERMINED) == is_open
        return decides

    def _step_growth(self, pair: _GridComparison, tolerances: Array) -> Array:
        """Ratio of the steps (k,) of the next grid, on which errors reach the aim with the order of the
        method.

        It is 2 if the errors are small enough, but another condition fails. On the second grid of a point it
        is at least 4/3, later at least 2, because errors then decrease more slowly than with the order of the
        method."""
        orders = np.minimum(self.solver.orders, 20)
        errors, grids = pair.errors, self.grids[pair.positions]
        self.grids[pair.positions] = grids + 1
        with np.errstate(all="ignore"):
            growth = np.where(errors <= tolerances, 1.0, (errors / (AIM * tolerances)) ** (1 / orders))
        growth = np.where(np.isfinite(errors), growth, 2.0).max(axis=1)
        return np.clip(np.where(growth > 1, growth, 2.0), np.where(grids, 2.0, 4 / 3), _MAX_GROWTH)

    def _certify(self, pair: _GridComparison) -> Iterator[Certified | Failed]:
        """Certify points; those with a multiplier +1 fail if an orbit is requested."""
        rho, better = pair.solutions.multipliers, pair.better.multipliers
        resonant = self._is_resonant(pair) if self.request.orbit else np.zeros(len(pair), dtype=bool)
        yield from (Failed(position, no_orbit()) for position in pair.positions[resonant].tolist())
        with np.errstate(over="ignore", invalid="ignore"):
            absolute = np.fmax(pair.errors[:, 1] * better.spectral_radius, pair.remainder)
        # The difference of two multipliers is at most the sum of the radii.
        largest = np.maximum(SAFETY * (rho.spectral_radius + better.spectral_radius), pair.remainder)
        underflows = pair.underflows
        absolute = np.where(underflows, largest, absolute)
        errors = relative_to_smallest_scale(pair.errors, rho, better)
        for rows in (np.flatnonzero(~resonant & ~underflows), np.flatnonzero(~resonant & underflows)):
            if len(rows):
                solutions = pair.solutions[rows]
                if underflows[rows[0]]:
                    digits = solutions.multipliers.with_digits(errors[rows, 1], UNDERFLOW)
                    solutions = solutions.with_multipliers(digits)
                yield from self.solver.certify(pair.positions[rows], solutions, errors[rows], absolute[rows])

    def _is_resonant(self, pair: _GridComparison) -> Array:
        """Points (k,) with a multiplier +1, within a tenth of the change between both solutions."""
        rho, better = pair.solutions.multipliers, pair.better.multipliers
        change = better.nearest_one - rho.nearest_one
        distance = np.abs(better.nearest_one + self.comparison.remaining * change - 1)
        # Multipliers of modes that the steps do not resolve may be anywhere.
        is_accurate = np.isfinite(pair.errors[:, 1]) & (np.abs(change) < NO_DIGIT)
        roundoff = EPS * max(8, pair.better.grid.steps)
        return ((distance <= 0.1 * np.abs(change)) & is_accurate) | (distance <= roundoff)

    def _unstable(self, least: int) -> StepsError:
        return StepsError(
            f"{self.method.name} is stable from {least} steps a period on and takes at most "
            f"{self.max_steps}; use a method without limit (radau)"
        )


def _failed(failures: Mapping[int, SolveError], positions: Array) -> Iterator[Failed]:
    """Failures by row of the points at positions (k,)."""
    return (Failed(int(positions[row]), reason) for row, reason in failures.items())


def _certify_approximation(solver: PointSolver, positions: Array) -> Iterator[Certified | Failed]:
    """Certify points under a method that does not converge, by comparison with one that does.

    Without given steps there is one per degree.
    """
    request = solver.request
    steps = min(360, solver.max_steps) if request.steps is None else request.steps
    accurate = replace(request, rtol=min(request.rtol, 1e-8), steps=None)
    for chunk in solver.chunks(steps, positions):
        solutions = solver.solve(steps, chunk)
        yield from _failed(solutions.failures, chunk)
        chunk, solutions = chunk[solutions.known], solutions[solutions.known]
        for method, rows in request.reference_methods(solver.points[chunk]) if len(chunk) else ():
            for better in certified(solver.points[chunk[rows]], method, accurate):
                if isinstance(better, Failed):
                    yield _at_positions(better, chunk[rows])
                    continue
                own = rows[better.positions]
                errors = solver.differences(solutions[own], better.solutions, chunk[own])
                errors = np.maximum(errors, roundoff_errors(solutions[own]))
                radius = better.solutions.multipliers.spectral_radius
                yield from solver.certify(chunk[own], solutions[own], errors, errors[:, 1] * radius)
