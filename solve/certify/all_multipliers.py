"""All multipliers of a point, each with an error estimate and its mode.

The monodromy matrix Φ does not resolve multipliers below eps‖Φ‖. Those multipliers are computed from the
factors of the period, that is, from products of one-step maps."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from solve.arrays import Array
from solve.certify.certified import Certified
from solve.certify.comparison import NO_DIGIT, SAFETY, better_method
from solve.errors import StepsError, counted
from solve.kernel import slicot
from solve.methods.free import anchored_for, free, solutions_on
from solve.methods.method import Method, OneStep, Solutions
from solve.period.blocks import LOSS, Blocks, balanced_blocks, joined_blocks
from solve.period.floquet_modes import FloquetMode, floquet_modes
from solve.period.frozen import balanced, frozen
from solve.period.grid import Grid
from solve.period.logarithms import UNKNOWN, exponential, log_distances, matched_logarithms
from solve.period.multipliers import matched
from solve.period.points import Points, SinglePoint, state_size
from solve.period.product_eigenvalues import ProductEigenvalues, eigenvalue_logarithms, product_eigenvalues
from solve.period.rigid_body import Free, before_rigid
from solve.terminal import progress

_MAX_WORK = 3e6, 1e7, 2e8
"""Limits on (number of steps) × (number of states)²: for factors that are computed by default, for the modes
of refined multipliers, and for refined multipliers. Chosen by judgement."""

_DEFAULT_LOSS = 1e-9
"""Value of the parameter `loss` (see `solve.period.blocks.LOSS`) if the errors of individual multipliers are
not limited. For a beam structure with 54 states, this value reduces the number of factors from 768 to a
quarter. It changes all multipliers by at most 2e-11, and resolved multipliers by at most 1e-12."""

_MEMORY = 2**29
"""Memory, in bytes, of the steps that are computed in one chunk."""


@dataclass(frozen=True)
class RefinedMultipliers:
    """All multipliers of a point. Each meets the tolerance unless round-off or the limit of computational
    work prevents it.

    logarithms (N,): log ρ, -inf for an exact zero. errors (N,): estimated relative error of each ρ, NaN if ρ
    is not accurate to one digit. steps: number of steps per period. rigid (N,): whether the multiplier
    belongs to a rigid-body mode."""

    logarithms: Array
    errors: Array
    steps: int
    rigid: Array


@dataclass(frozen=True)
class Spectrum:
    """All multipliers of a point in order of decreasing modulus, positive imaginary part first.

    Multipliers that the monodromy matrix resolves are its eigenvalues. Smaller multipliers are computed from
    the factors of the period with twice as many steps. Their errors are estimated from the differences
    between these results and those with one more stage. Multipliers of rigid-body modes are exactly +1.

    each: whether `rtol` applies to each multiplier. All multipliers are then those of `refined`."""

    point: SinglePoint
    certified: Certified
    refined: RefinedMultipliers | None = None
    each: bool = False

    @property
    def values(self) -> Array:
        """Multipliers ρ (N,), complex; 0 if below the range of floating-point numbers, NaN if not accurate to
        one digit."""
        if self.refined is not None:
            return exponential(self.logarithms)
        small = exponential(self._logarithms_and_errors[0])
        return self._with_rigid(np.where(self._has_digit, self._eigenvalues, small), 1.0)

    @property
    def logarithms(self) -> Array:
        """Principal logarithms log ρ (N,); -inf for an exact zero, NaN if not accurate to one digit."""
        return self._with_rigid(self._logarithms_and_errors[0], 0.0)

    @property
    def errors(self) -> Array:
        """Estimated relative error of each ρ (N,); NaN if not accurate to one digit."""
        return self._with_rigid(self._logarithms_and_errors[1], 0.0)

    @property
    def leading(self) -> Array:
        """Largest multipliers (k,), which the monodromy matrix separates from the others; empty if
        `refined`."""
        if self.refined is not None:
            return self._eigenvalues[:0]
        is_separate = 2 * self.certified.absolute[0] < NO_DIGIT * np.abs(self._eigenvalues)
        return self._with_rigid(self._eigenvalues, 1.0)[self._with_rigid(is_separate, fill=True)]

    def logarithm(self, at: int) -> complex:
        """Return log ρ of the multiplier with index `at`. A leading one is computed without the others."""
        leading = self.leading
        return complex(np.log(leading[at]) if at < len(leading) else self.logarithms[at])

    def multiplier(self, at: int) -> complex:
        """Return the multiplier ρ with index `at`. A leading one is computed without the others."""
        leading = self.leading
        return complex(leading[at] if at < len(leading) else self.values[at])

    @property
    def unresolved(self) -> int:
        """Number of multipliers that are not accurate to one digit."""
        return int(np.isnan(self.errors).sum())

    @cached_property
    def modes(self) -> Sequence[FloquetMode]:
        """Modes of all multipliers. A mode has no harmonic if its multiplier is not accurate to one digit, or
        if the method computes no step maps."""
        rotation = 2 * math.pi * self.point.speed / self.point.period
        angles = np.imag(self.logarithms) * rotation / (2 * math.pi)
        modes = [FloquetMode(float(angle)) for angle in angles]
        if self._factored is not None:
            blocks, eigenvalues = self._factored
            solutions, order = self._solutions, self._order
            assert solutions.steps is not None
            mass = None if self.point.first_order else self.certified.modes.mean_mass[0]
            maps = solutions.steps.A[0]
            with_harmonics = floquet_modes(maps, solutions.grid, mass, blocks, eigenvalues, rotation)
            change = np.diagonal(log_distances(self.logarithms, eigenvalues.logarithms[0][order]))
            for i in np.flatnonzero(~np.isnan(self.errors) & (change < NO_DIGIT)):
                modes[i] = with_harmonics[order[i]]
            for i in np.flatnonzero(self.rigid):
                modes[i] = FloquetMode(0.0, 0.0, 0, 1.0)
        return modes

    @cached_property
    def rigid(self) -> Array:
        """Whether (N,) each multiplier belongs to a rigid-body mode."""
        if self.refined is not None:
            return self.refined.rigid
        return self._with_rigid(np.zeros(len(self._eigenvalues), dtype=bool), fill=True)

    @property
    def warnings(self) -> list[str]:
        """Warning if `rtol` applies to each multiplier and an error exceeds it; otherwise empty."""
        if self.refined is None:
            return []
        rtol, steps = self.certified.request.rtol, self.refined.steps
        if self.unresolved:
            of = f"of {len(self.errors)} multipliers"
            missed = f"{counted(self.unresolved, f'{of} is', f'{of} are')} not accurate to even one digit"
        elif (worst := float(self.errors.max())) > rtol:
            missed = f"the largest relative error of a multiplier is {worst:.1e}, above rtol {rtol:g}"
        else:
            return []
        return [f"{missed}: {steps} steps do not resolve the fastest modes, or round-off limits the accuracy"]

    @property
    def notes(self) -> list[str]:
        """Note on results that are missing without the eigenvalues of the product of the step maps."""
        is_refused = self.each and self.refined is None
        # A note alone does not justify computing the eigenvalues of the factors.
        has_failed = self._has_factors and "_factored" in self.__dict__ and self._factored is None
        is_installed = slicot.available()
        if not is_installed and (is_refused or self._has_factors):
            reason = "SLICOT is required: pip install ctrlsys (not available on all platforms)"
        elif is_refused or has_failed:
            reason = "the eigenvalues of the product of the steps did not converge"
        elif isinstance(self.certified.method, OneStep) and self._is_long:
            reason = (
                f"with {self.point.n} coordinates and {self.certified.steps} steps, small multipliers "
                "require all_multipliers"
            )
        else:
            return []
        missing = ["rtol is not applied to each multiplier"] if is_refused else []
        if self.unresolved:
            subject = counted(self.unresolved, "multiplier is", "multipliers are")
            missing.append(f"{subject} below the round-off of the monodromy matrix")
        if not (missing or is_installed):
            missing.append("orders and frequencies of the modes are unknown")
        return [f"{', and '.join(missing)}; {reason}"] if missing else []

    def _with_rigid(self, values: Array, fill: float) -> Array:
        """Insert `fill` once for each rigid-body mode into `values`, which exclude these modes. It is
        inserted after the multipliers outside the unit circle. Return the values (N,) for all multipliers."""
        count = rigid_multipliers(self.certified)
        if self.refined is not None or not count:
            return values
        return np.insert(values, np.full(count, before_rigid(self._eigenvalues)), fill)

    @cached_property
    def _solutions(self) -> Solutions:
        """Solutions with the step maps from which modes and small multipliers are computed."""
        certified, steps = self.certified, self._factor_steps
        if self.refined is not None and self._work(self.refined.steps) <= _MAX_WORK[1]:
            steps = self.refined.steps
        elif steps == certified.steps and not rigid_multipliers(certified):
            return certified.solutions
        return solved_on(self._equations, certified.method, steps, certified.request.engine)

    @property
    def _factor_steps(self) -> int:
        """Number of steps of the factors. If there are unresolved multipliers, it is twice the number of
        steps of the solution, because small multipliers belong to fast modes. If the user has specified the
        number of steps, that number is used."""
        certified = self.certified
        is_small = self.refined is None and not self._has_digit.all() and certified.request.steps is None
        return certified.steps * (2 if is_small and certified.method.with_another_stage else 1)

    @property
    def _equations(self) -> Points:
        return balanced(self.point, self.certified.modes)

    def _work(self, steps: int) -> float:
        return steps * state_size(self.point) ** 2

    @property
    def _eigenvalues(self) -> Array:
        """Eigenvalues of the monodromy matrix, excluding those of rigid-body modes."""
        values = self.certified.solutions.multipliers.values[0]
        return values[: len(values) - rigid_multipliers(self.certified)]

    @cached_property
    def _has_digit(self) -> Array:
        """Whether (N,) the monodromy matrix resolves each multiplier to at least one digit."""
        return self.certified.absolute[0] < NO_DIGIT * np.abs(self._eigenvalues)

    @property
    def _has_factors(self) -> bool:
        """Whether the monodromy matrix is available as a product of few enough one-step maps."""
        method = self.certified.method
        return isinstance(method, OneStep) and method.converges and not self._is_long

    @property
    def _is_long(self) -> bool:
        """Whether the factors would take too much computing time to be used by default."""
        return self.refined is None and self._work(self.certified.steps) > _MAX_WORK[0]

    @cached_property
    def _logarithms_and_errors(self) -> tuple[Array, Array]:
        """Logarithms log ρ (N,) of the multipliers and their errors (N,), excluding rigid-body modes."""
        if self.refined is not None:
            return self.refined.logarithms, self.refined.errors
        certified, rho, has_digit = self.certified, self._eigenvalues, self._has_digit
        with np.errstate(divide="ignore", invalid="ignore"):
            logarithms = np.where(rho != 0, np.log(rho), UNKNOWN)
            errors = np.where(has_digit, certified.absolute[0] / np.abs(rho), np.nan)
        # If the largest multipliers are not accurate to one digit, none is, even if two solutions agree.
        if has_digit.all() or not certified.errors[0, 1] < NO_DIGIT or self._factored is None:
            return logarithms, errors
        eigenvalues, order = self._factored[1], self._order[~self.rigid]
        method, ratio = better_method(certified.method)
        steps = ratio * self._factor_steps
        engine = certified.request.engine
        blocks = _blocks_on_steps(self._equations, method, engine, steps, loss=_DEFAULT_LOSS)
        try:
            small = multiplier_errors(eigenvalue_logarithms(blocks.factors[0]), eigenvalues)
        except np.linalg.LinAlgError:
            return logarithms, errors
        small = np.where(small < NO_DIGIT, small, np.nan)
        logarithms = np.where(has_digit, logarithms, eigenvalues.logarithms[0][order])
        return logarithms, np.where(has_digit, errors, small[order])

    @cached_property
    def _factored(self) -> tuple[Blocks, ProductEigenvalues] | None:
        """Factors of the period and their eigenvalues; None if they cannot be computed."""
        if not self._has_factors or not slicot.available():
            return None
        maps = self._solutions.steps
        assert maps is not None
        blocks = balanced_blocks(maps.A, loss=_DEFAULT_LOSS if self.refined is None else LOSS)
        try:
            return blocks, product_eigenvalues(blocks.factors, blocks.rounding, vectors=True)
        except np.linalg.LinAlgError:
            return None

    @cached_property
    def _order(self) -> Array:
        """Index (N,) of each multiplier among the eigenvalues of the factors."""
        assert self._factored is not None
        logarithms = self._factored[1].logarithms[0]
        if self.refined is not None:
            return matched_logarithms(self.refined.logarithms, logarithms)
        count, has_digit = rigid_multipliers(self.certified), np.flatnonzero(self._has_digit)
        large = matched_logarithms(np.log(self._eigenvalues[has_digit]), logarithms)
        others = np.setdiff1d(np.arange(len(logarithms)), large)
        nearest_one = others[np.argsort(np.abs(logarithms[others]), kind="stable")]
        order, vibrating = np.empty(len(logarithms), dtype=int), np.empty(len(self._eigenvalues), dtype=int)
        vibrating[has_digit] = large
        vibrating[~self._has_digit] = np.sort(nearest_one[count:])
        order[self.rigid], order[~self.rigid] = nearest_one[:count], vibrating
        return order


def require_step_maps(method: Method) -> None:
    """Raise StepsError if the method does not compute step maps."""
    if not isinstance(method, OneStep):
        raise StepsError(
            f"all multipliers are computed from the maps of the steps, which {method.name} does not "
            "provide; use radau or gauss"
        )


def refined_multipliers(point: SinglePoint, certified: Certified) -> RefinedMultipliers | None:
    """Return all multipliers of a solved point. The number of steps is doubled until each error is at most
    `rtol`. An error is estimated as twice the difference from a better method. Doubling ends early if it does
    not reduce the errors or would take too long. If the user has specified the number of steps, it is not
    changed.

    Return None if SLICOT is not available, or if its iteration does not converge."""
    if not slicot.available():
        return None
    try:
        return _refined_multipliers(point, certified)
    except np.linalg.LinAlgError:
        return None


def _refined_multipliers(point: SinglePoint, certified: Certified) -> RefinedMultipliers:
    method, request, steps = certified.method, certified.request, certified.steps
    max_steps, points = _MAX_WORK[2] / state_size(point) ** 2, balanced(point, frozen(point))
    rigid_modes = free(point) if method.linear else None

    def blocks(method: Method, steps: int) -> Blocks:
        return _blocks_on_steps(points, method, request.engine, steps, rigid_modes)

    finer, ratio = better_method(method)
    previous_error = math.inf
    while True:
        factors = blocks(method, steps)
        eigenvalues = product_eigenvalues(factors.factors, factors.rounding)
        better = eigenvalue_logarithms(blocks(finer, ratio * steps).factors[0])
        logarithms, errors = eigenvalues.logarithms[0].copy(), multiplier_errors(better, eigenvalues)
        nearest_one = np.argsort(np.abs(logarithms), kind="stable")[: rigid_multipliers(certified)]
        logarithms[nearest_one], errors[nearest_one] = 0.0, 0.0
        largest = float(errors.max())
        is_last = largest <= request.rtol or request.steps is not None or 2 * ratio * steps > max_steps
        # If doubling the steps does not halve the error, further doubling does not help.
        if is_last or largest > 0.5 * previous_error:
            errors = np.where(errors < NO_DIGIT, errors, np.nan)
            is_rigid = np.isin(np.arange(len(errors)), nearest_one)
            return RefinedMultipliers(logarithms, errors, steps, is_rigid)
        steps, previous_error = 2 * steps, largest if largest < NO_DIGIT else math.inf


def rigid_multipliers(certified: Certified) -> int:
    """Return the number of multipliers of a point that belong to rigid-body modes."""
    rigid_modes = certified.solutions.free
    return 0 if rigid_modes is None else int(rigid_modes.modes.multiplicity[0])


def solved_on(point: Points, method: Method, steps: int, engine: str, rigid: Free | None = None) -> Solutions:
    """Return solutions without orbits on `steps` uniform steps. Raises SolveError."""
    grid = Grid.uniform(steps, point.period, point.breaks)
    return solutions_on(method, point, grid, False, engine, rigid).checked()


def _blocks_on_steps(
    point: Points,
    method: Method,
    engine: str,
    steps: int,
    rigid: Free | None = None,
    loss: float = LOSS,
) -> Blocks:
    """Return the factors on a grid of `steps` steps. They are computed in chunks if memory requires it."""
    grid = Grid.uniform(steps, point.period, point.breaks)
    chunks = grid.parts(_MEMORY // method.bytes_a_step(point.n) + 1)
    with progress.task(f"factors of {steps} steps, for all multipliers", len(chunks)) as done:
        if len(chunks) == 1:
            maps = solved_on(point, method, steps, engine, rigid).steps
            assert maps is not None
            return balanced_blocks(maps.A, loss=loss)
        assert isinstance(method, OneStep)
        blocks, first = [], 0
        anchored = None if rigid is None else anchored_for(method, point, rigid)
        for chunk in chunks:
            with np.errstate(all="ignore"):
                A = method.discretise(anchored or point, chunk).steps.A
            A = A if anchored is None else anchored.steps(A)
            blocks.append(balanced_blocks(A, first=first, loss=loss))
            first += chunk.steps
            done.add()
        return joined_blocks(blocks, loss)


def multiplier_errors(better: Array, eigenvalues: ProductEigenvalues) -> Array:
    """Return the relative error (N,) of each multiplier: the larger of its round-off error and twice the
    difference from the more accurate logarithms `better` (N,)."""
    distances = log_distances(eigenvalues.logarithms[0], better)
    nearest, distance = distances.argmin(axis=1), distances.min(axis=1)
    is_mutual = distances.argmin(axis=0)[nearest] == np.arange(len(distances))
    # A multiplier far from all accurate ones is unresolved, however the multipliers are matched.
    if not (is_mutual | (distance >= NO_DIGIT)).all():
        distance = distances[matched(distances)]
    return np.maximum(SAFETY * distance, eigenvalues.errors[0])
