"""Refinement of grids until the errors, which are estimated from two solutions, meet the tolerance."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace

import numpy as np

from solve.arrays import EPS, Array, across, covers_all, others, unique_integers
from solve.certify.certified import Certified, Failed, SolveRequest, verdicts_of
from solve.certify.comparison import (
    SAFETY,
    Comparison,
    differences,
    roundoff_errors,
)
from solve.certify.point_solver import PointSolver
from solve.certify.resolution import (
    AIM,
    MIN_STEPS,
    first_steps,
    grid_sizes,
    unresolved_remainder,
)
from solve.errors import SolveError, StepsError
from solve.methods.method import Method, Solutions, no_orbit
from solve.period.frozen import FrozenModes
from solve.period.multipliers import KNOWN_ON_CIRCLE, NEGLIGIBLE, UNDERFLOW, UNDETERMINED
from solve.period.points import Points
from solve.terminal import progress

STEPS = "steps"
"""Name of the progress counter for the steps of a single solution."""

_MAX_GROWTH = 6.0
"""Largest ratio of the numbers of steps of successive grids. With 3 or 12, the errors of 65 results on 14
random test systems stay within their estimates, and the verdicts are the same."""

_UNKNOWN = 0.5
"""Error estimate above which an error is reported as infinite, because the error may then be as large as the
result. With 0.25 or 1, the errors of 65 results on 14 random test systems stay within their estimates, and
the verdicts are the same."""


def certified(points: Points, method: Method, request: SolveRequest) -> Iterator[Certified | Failed]:
    """Yield solutions with error estimates. Each point is yielded once, in groups that are yielded as soon as
    they are completed.

    The grid has the requested number of steps, or is the first grid on which the errors are at most `rtol` or
    are round-off. Errors are estimated as differences from a more accurate solution, see `Comparison`. A
    point fails with ResonanceError if an orbit is requested and a multiplier equals +1 within a tenth of the
    difference between the two solutions. Raises StepsError for a requested number of steps that the method
    cannot use at any point."""
    solver = (_Refinement if method.converges else PointSolver)(points, method, request)
    groups = _rigid_body_groups(solver)
    if len(groups) > 1:
        for group in groups:
            for result in certified(points[group], method, request):
                yield _at_positions(result, group)
        return
    failures = solver.invalid_points()
    yield from failures
    positions = others(len(points), [failure.position for failure in failures])
    if isinstance(solver, _Refinement):
        yield from solver.refine(positions)
    else:
        yield from _certify_approximation(solver, positions)


def on_one_grid(
    points: Points, method: Method, request: SolveRequest, steps: int
) -> Iterator[tuple[Array, Solutions]]:
    """Yield solutions by the more accurate method on one grid, without error estimates. They are computed in
    chunks, and yielded with the indices (k,) of their points. Points without a solution are omitted."""
    solver = PointSolver(points, method.with_another_stage or method, request)
    for chunk in solver.chunks(steps, np.arange(len(points))):
        solutions = solver.solve(steps, chunk)
        yield chunk[solutions.known], solutions[solutions.known]


def _rigid_body_groups(solver: PointSolver) -> list[Array]:
    """Return the indices of the points in up to three groups: points with rigid-body modes but no conserved
    momentum, points with conserved momentum, and points without rigid-body modes. Empty groups are omitted.
    """
    if solver.free is None:
        return []
    has_modes, conserves = solver.free.modes.any, solver.free.modes.conserving
    groups = (kind.nonzero()[0] for kind in (has_modes & ~conserves, conserves, ~has_modes))
    return [group for group in groups if len(group)]


def _at_positions(result: Certified | Failed, positions: Array) -> Certified | Failed:
    """Convert the point indices in a result: from indices within a group to indices among all points.
    positions: indices of the points of the group among all points."""
    if isinstance(result, Failed):
        return Failed(int(positions[result.position]), result.reason)
    return replace(result, positions=positions[result.positions])


@dataclass(frozen=True)
class _GridComparison:
    """Two solutions of the same k points on related grids.

    positions (k,): indices of the points. solutions, better: first solution, and the more accurate one.
    errors (k, 2): errors of the first solution. roundoff (k, 2): round-off errors of the first solution.
    tolerances (k, 2): allowed errors, at least the round-off. remainder (k,): size, after a period, of a unit
    perturbation in modes that the steps do not resolve."""

    positions: Array
    modes: FrozenModes
    solutions: Solutions
    better: Solutions
    errors: Array
    roundoff: Array
    tolerances: Array
    remainder: Array

    def __len__(self) -> int:
        return len(self.positions)

    def __getitem__(self, rows: Array) -> "_GridComparison":
        if covers_all(rows, len(self)):
            return self
        return _GridComparison(*(getattr(self, field.name)[rows] for field in fields(self)))

    @property
    def underflows(self) -> Array:
        """Mask (k,) of the points all of whose multipliers are below the round-off of the entries of Φ."""
        return self.solutions.multipliers.spectral_radius < UNDERFLOW


class _Refinement(Comparison):
    """Solver that refines the grid of each point as required, unless the number of steps is prescribed.

    previous_errors (P, 2): errors on the last grid of each point. unresolved (P,): remainder of modes that
    are left unresolved because they would require too many steps."""

    def __init__(self, points: Points, method: Method, request: SolveRequest):
        super().__init__(points, method, request)
        self.previous_errors = np.full((len(points), 2), np.inf)
        self.unresolved = np.zeros(len(points))

    def refine(self, positions: Array) -> Iterator[Certified | Failed]:
        pending: dict[int, list[Array]] = {}
        if self.request.steps is None:
            least = np.maximum(self.min_steps[positions], len(self.points.breaks))
            for position in positions[least > self.max_steps].tolist():
                yield Failed(position, self._unstable(int(self.min_steps[position])))
            positions, least = positions[least <= self.max_steps], least[least <= self.max_steps]
            _add(pending, self._first_grids(positions, least), positions)
        elif len(positions):
            pending = {self.request.steps: [positions]}
        while pending:
            steps = min(pending)
            positions = np.concatenate(pending.pop(steps))
            if singular := self.singular_points(steps, positions):
                yield from singular
                positions = np.setdiff1d(positions, [failure.position for failure in singular])
            for chunk in self.pair_chunks(steps, positions):
                yield from self._refine_on(steps, chunk, pending)

    def _first_grids(self, positions: Array, least: Array) -> Array:
        """Return the numbers of steps (k,) of the first grids of the points at `positions` (k,). They are at
        least 1.2 times `least` (k,), the number that stability requires."""
        points, modes, request = self.points[positions], self.modes[positions], self.request
        first, self.unresolved[positions] = first_steps(
            self.method, points, modes, request.orbit, request.rtol, self.max_steps
        )
        return np.minimum(grid_sizes(np.maximum(first, 1.2 * least)), max(self.max_steps, MIN_STEPS))

    def _refine_on(
        self, steps: int, chunk: Array, pending: dict[int, list[Array]]
    ) -> Iterator[Certified | Failed]:
        """Solve points on one grid, and yield results and failures. Points that are not accepted are added to
        `pending`, under the number of steps of their next grid."""
        is_given = self.request.steps is not None
        with np.errstate(all="ignore"), progress.task(f"{self.method.name} on {steps} steps"):
            solutions, better = self.pair(steps, chunk)
            failures = {**better.failures, **solutions.failures}
            rows = others(len(chunk), list(failures))
            results: list[Certified | Failed] = []
            next_steps = rows[:0]
            if len(rows):
                pair = self._compare(steps, chunk[rows], solutions[rows], better[rows])
                accepted = self._accept(steps, pair, is_last=is_given or steps >= self.max_steps)
                if accepted.any():
                    results += self._certify(pair[accepted.nonzero()[0]])
                if not accepted.all():
                    next_steps = self._postpone(steps, pair[(~accepted).nonzero()[0]], pending)
        if failures and not is_given and 2 * steps <= self.max_steps:
            overflows = [row for row, reason in failures.items() if isinstance(reason, StepsError)]
            failures = {row: reason for row, reason in failures.items() if row not in overflows}
            if overflows:
                pending.setdefault(2 * steps, []).append(chunk[overflows])
        yield from _failed(failures, chunk)
        yield from results
        progress.set_total(STEPS, steps, lambda: int(next_steps.max(initial=steps)))

    def _compare(
        self, steps: int, positions: Array, solutions: Solutions, better: Solutions
    ) -> _GridComparison:
        """Return the comparison of both solutions of points, with the errors of the first solution."""
        modes = self.modes[positions]
        errors = SAFETY * differences(solutions, better, modes, self.request.engine)
        roundoff = self.roundoff(steps, positions, solutions, errors)
        errors = np.maximum(errors, roundoff)
        tolerances = np.maximum(self.request.rtol, roundoff)
        tolerances[:, 0] = np.maximum(tolerances[:, 0], 2 * solutions.defect)
        radius, finest = better.multipliers.spectral_radius, steps * self.step_ratio
        remainder = unresolved_remainder(self.method, modes, finest)
        relative = np.minimum(remainder / np.maximum(radius, NEGLIGIBLE), 1.0)
        errors[:, 1] = np.maximum(errors[:, 1], np.where(np.isfinite(remainder), relative, np.inf))
        is_left = relative <= self.unresolved[positions]
        tolerances[:, 1] = np.maximum(tolerances[:, 1], np.where(is_left, relative, 0.0))
        return _GridComparison(positions, modes, solutions, better, errors, roundoff, tolerances, remainder)

    def _accept(self, steps: int, pair: _GridComparison, is_last: bool) -> Array:
        """Return a mask (k,) of the points that are accepted without a finer grid.

        An accepted point meets three conditions:

        1. Each error is at most the tolerance, or counts as round-off. An error counts as round-off under two
           conditions: this grid did not halve it, and it is below a thousand times the estimated round-off
           unless all multipliers underflow. Larger errors may not decrease for other reasons, such as kinks
           in the coefficients.
        2. Features of the coefficients between the samples do not cause larger errors.
        3. A finer grid would not decide an undetermined verdict.

        On the last grid, every point is accepted, and its errors state the accuracy reached. The errors of
        accepted points are raised, in place, to the errors due to features between the samples, if these are
        larger."""
        is_roundoff = pair.errors < 1e3 * pair.roundoff
        is_roundoff[:, 1] |= pair.underflows
        is_roundoff &= 2 * pair.errors > self.previous_errors[pair.positions]
        accepted = across(np.logical_and, (pair.errors <= pair.tolerances) | is_roundoff | is_last)
        rows = accepted.nonzero()[0]
        if len(rows):
            unsampled = self.unsampled_errors(steps, pair.positions[rows], pair.solutions[rows])
            accepted[rows] = is_last | across(np.logical_and, unsampled <= pair.tolerances[rows])
            unsampled[~accepted[rows]] = 0.0
            pair.errors[rows] = np.maximum(pair.errors[rows], unsampled)
        return accepted if is_last else accepted & ~self._finer_grid_decides(pair)

    def _finer_grid_decides(self, pair: _GridComparison) -> Array:
        """Return a mask (k,) of the points whose undetermined verdict would be decided on a grid with twice
        as many steps. The errors are assumed to decrease with the order of the method; errors that are
        round-off do not decrease."""
        order = min(self.method.order, 20)
        errors = pair.errors[:, 1] * pair.solutions.multipliers.spectral_radius
        decides = np.isfinite(errors) & (errors > KNOWN_ON_CIRCLE / 2)
        decides &= pair.errors[:, 1] > 4 * pair.roundoff[:, 1]
        for fraction, is_open in ((1.0, True), (0.5**order, False)):
            rows = decides.nonzero()[0]
            if len(rows):
                verdicts = verdicts_of(pair.solutions[rows], fraction * errors[rows], pair.modes[rows])
                decides[rows] = (verdicts == UNDETERMINED) == is_open
        return decides

    def _postpone(self, steps: int, pair: _GridComparison, pending: dict[int, list[Array]]) -> Array:
        """Add points to `pending`. Return the numbers of steps (k,) of their next grids, on which the errors
        reach the target `AIM` if they decrease with the order of the method.

        The number of steps is doubled if the errors are small enough but another condition fails. The second
        grid of a point has at least 4/3 as many steps as the first. Each later grid has at least twice as
        many steps as the one before, because errors then decrease more slowly than the order of the method
        implies."""
        orders, errors, tolerances = np.minimum(self.orders, 20), pair.errors, pair.tolerances
        growth = np.where(errors <= tolerances, 1.0, (errors / (AIM * tolerances)) ** (1 / orders))
        growth = np.where(np.isfinite(errors), growth, 2.0).max(axis=1)
        is_first = np.isinf(self.previous_errors[pair.positions, 0])
        growth = np.clip(np.where(growth > 1, growth, 2.0), np.where(is_first, 4 / 3, 2.0), _MAX_GROWTH)
        next_steps = np.minimum(grid_sizes(np.maximum(growth * steps, steps + 1)), self.max_steps)
        self.previous_errors[pair.positions] = errors
        _add(pending, next_steps, pair.positions)
        return next_steps

    def _certify(self, pair: _GridComparison) -> Iterator[Certified | Failed]:
        """Certify points, and yield the results. If an orbit is requested, points with a multiplier +1
        fail."""
        solutions, underflows = pair.solutions, pair.underflows
        rho, better = solutions.multipliers, pair.better.multipliers
        resonant = self._is_resonant(pair) if self.request.orbit else np.zeros(len(pair), dtype=bool)
        yield from (Failed(position, no_orbit()) for position in pair.positions[resonant].tolist())
        absolute = np.fmax(pair.errors[:, 1] * better.spectral_radius, pair.remainder)
        errors = np.where(pair.errors < _UNKNOWN, pair.errors, np.inf)
        if underflows.any():
            # The difference of two multipliers is at most the sum of the radii.
            largest = np.maximum(SAFETY * (rho.spectral_radius + better.spectral_radius), pair.remainder)
            absolute = np.where(underflows, largest, absolute)
            digits = rho.with_digits(np.where(underflows, errors[:, 1], 0.0))
            solutions = solutions.with_multipliers(digits)
        rows = (~resonant).nonzero()[0]
        if len(rows):
            yield from self.certify(pair.positions[rows], solutions[rows], errors[rows], absolute[rows])

    def _is_resonant(self, pair: _GridComparison) -> Array:
        """Return a mask (k,) of the points at which a multiplier equals +1 within a tenth of its change
        between the two solutions, or within round-off."""
        nearest = pair.better.multipliers.nearest_one
        change = nearest - pair.solutions.multipliers.nearest_one
        distance = np.abs(nearest + self.remaining * change - 1)
        # Multipliers of modes that the steps do not resolve are arbitrary.
        is_accurate = pair.errors[:, 1] < _UNKNOWN
        roundoff = EPS * max(8, pair.better.grid.steps)
        return ((distance <= 0.1 * np.abs(change)) & is_accurate) | (distance <= roundoff)

    def _unstable(self, least: int) -> StepsError:
        return StepsError(
            f"{self.method.name} requires at least {least} steps per period for stability, but allows at "
            f"most {self.max_steps}; use a method without a stability limit (radau)"
        )


def _add(pending: dict[int, list[Array]], steps: Array, positions: Array) -> None:
    """Add points at `positions` (k,) to `pending`, each under the number of steps (k,) of its grid."""
    for size in unique_integers(steps) if len(steps) else ():
        pending.setdefault(size, []).append(positions[steps == size])


def _failed(failures: Mapping[int, SolveError], positions: Array) -> Iterator[Failed]:
    """Return failures with the indices of their points. The keys of `failures` are indices in `positions`."""
    return (Failed(int(positions[row]), reason) for row, reason in failures.items())


def _certify_approximation(solver: PointSolver, positions: Array) -> Iterator[Certified | Failed]:
    """Solve points by a method that does not converge, and certify them by comparison with a convergent
    method. If the number of steps is not prescribed, there is one step per degree."""
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
                answered = rows[better.positions]
                errors = differences(solutions[answered], better.solutions, better.modes, request.engine)
                errors = np.maximum(errors, roundoff_errors(solutions[answered]))
                radius = better.solutions.multipliers.spectral_radius
                yield from solver.certify(chunk[answered], solutions[answered], errors, errors[:, 1] * radius)
