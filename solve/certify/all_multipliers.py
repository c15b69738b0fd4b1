"""All multipliers of a point, each with an error estimate and its mode.

The monodromy matrix Φ does not resolve multipliers below eps‖Φ‖. Those multipliers are computed from the
factors of the period, that is, from products of one-step maps."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from solve.arrays import Array
from solve.certify.certified import Certified
from solve.certify.comparison import NO_DIGIT, SAFETY, better_method
from solve.errors import SolveError, StepsError, counted
from solve.kernel import slicot
from solve.methods.free import anchored_for, solutions_on
from solve.methods.method import Method, OneStep
from solve.period.anchored import Anchored
from solve.period.blocks import LOSS, Blocks, balanced_blocks
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
class Factors:
    """Factors of the period of a point on a uniform grid, and all multipliers in order of decreasing modulus.
    The multipliers are the eigenvalues of the product of the factors.

    point: equations and speed. certified: solution of the point, by the method that also computes the
    factors. steps: number of steps. loss: see `solve.period.blocks.LOSS`. anchored: rigid-body modes that are
    anchored. Other multipliers near +1 are then accurate, but modes are not available. Properties raise
    LinAlgError if the eigenvalues do not converge."""

    point: SinglePoint
    certified: Certified
    steps: int
    loss: float = LOSS
    anchored: Free | None = None

    @cached_property
    def blocks(self) -> Blocks:
        """Products of neighbouring one-step maps."""
        return balanced_blocks(self._maps[1], self.loss)

    @cached_property
    def eigenvalues(self) -> ProductEigenvalues:
        """Eigenvalues of the product, with eigenvectors."""
        return product_eigenvalues(self.blocks.factors, self.blocks.rounding, vectors=True)

    @cached_property
    def _order(self) -> tuple[Array, Array]:
        """Return the indices (N,) that sort the eigenvalues, and a mask (N,) of the sorted eigenvalues that
        belong to rigid-body modes: the eigenvalues nearest to +1. They are placed after the eigenvalues
        outside the unit circle."""
        logarithms = self.eigenvalues.logarithms[0]
        rigid, others = np.split(np.abs(logarithms).argsort(kind="stable"), [_rigid_count(self.certified)])
        others.sort()
        order = np.insert(others, before_rigid(exponential(logarithms[others])), rigid)
        return order, np.isin(order, rigid)

    @property
    def rigid(self) -> Array:
        """Mask (N,) of the multipliers that belong to rigid-body modes."""
        return self._order[1]

    @property
    def logarithms(self) -> Array:
        """Logarithms log ρ (N,); -inf for an exact zero."""
        return np.where(self.rigid, 0.0, self.eigenvalues.logarithms[0][self._order[0]])

    @cached_property
    def errors(self) -> Array:
        """Estimated relative error (N,) of each ρ, from a comparison with factors of a better method."""
        method, ratio = better_method(self.certified.method)
        better = balanced_blocks(self._maps_by(method, ratio * self.steps)[1], self.loss)
        errors = multiplier_errors(eigenvalue_logarithms(better.factors[0]), self.eigenvalues)
        return np.where(self.rigid, 0.0, errors[self._order[0]])

    def modes(self) -> Sequence[FloquetMode]:
        """Return the N modes, one per multiplier. A mode contains no harmonic if the steps do not resolve the
        mode."""
        mass = None if self.point.first_order else self.certified.modes.mean_mass[0]
        rotation = 2 * math.pi * self.point.speed / self.point.period
        grid, maps = self._maps
        modes = floquet_modes(maps[0], grid, mass, self.blocks, self.eigenvalues, rotation)
        of_rigid = FloquetMode(0.0, 0.0, 0, 1.0)
        return [of_rigid if rigid else modes[at] for at, rigid in zip(*self._order, strict=True)]

    @property
    def work(self) -> float:
        """Measure of the computing time: the number of steps times the square of the number of states."""
        return self.steps * state_size(self.point) ** 2

    @cached_property
    def _maps(self) -> tuple[Grid, Array]:
        """Return the uniform grid, and the one-step maps on this grid by the method of the solution."""
        return self._maps_by(self.certified.method, self.steps)

    def _maps_by(self, method: Method, steps: int) -> tuple[Grid, Array]:
        equations = balanced(self.point, self.certified.modes)
        return step_maps(equations, method, steps, self.certified.request.engine, self.anchored)


@dataclass(frozen=True)
class Spectrum:
    """All multipliers of a point in order of decreasing modulus, positive imaginary part first.

    Multipliers that the monodromy matrix resolves are its eigenvalues. Smaller multipliers are computed from
    the factors of the period with twice as many steps. Multipliers of rigid-body modes are exactly +1.

    each: whether `rtol` applies to each multiplier. All multipliers are then those of the factors `refined`;
    see `refined_multipliers`. iteration: method that computes the maps of the factors, if these include jumps
    of perturbations at events; by default, it is the method of the solution."""

    point: SinglePoint
    certified: Certified
    refined: Factors | None = None
    each: bool = False
    iteration: Method | None = None

    @property
    def values(self) -> Array:
        """Multipliers ρ (N,), complex; 0 if below the range of floating-point numbers, NaN if not accurate to
        one digit."""
        return exponential(self.logarithms)

    @property
    def logarithms(self) -> Array:
        """Principal logarithms log ρ (N,); -inf for an exact zero, NaN if not accurate to one digit."""
        return self._logarithms_and_errors[0]

    @cached_property
    def errors(self) -> Array:
        """Estimated relative error (N,) of each ρ, including the error of a reduction; NaN if not accurate to
        one digit."""
        logarithms, errors = self._logarithms_and_errors
        errors = np.maximum(errors, self._reduction_errors(logarithms))
        return np.where(errors < NO_DIGIT, errors, np.nan)

    @property
    def leading(self) -> Array:
        """Largest multipliers (k,), which the monodromy matrix separates from the others; empty if
        `refined`."""
        rho, _, errors = self._of_monodromy
        return rho[(2 * errors < NO_DIGIT * np.abs(rho)) & (self.refined is None)]

    def logarithm(self, at: int) -> complex:
        """Return log ρ of the multiplier with index `at`. A leading multiplier is computed without the
        others."""
        leading = self.leading
        return complex(np.log(leading[at]) if at < len(leading) else self.logarithms[at])

    def multiplier(self, at: int) -> complex:
        """Return the multiplier ρ with index `at`. A leading multiplier is computed without the others."""
        return complex(exponential(np.array(self.logarithm(at))))

    @property
    def unresolved(self) -> int:
        """Number of multipliers that are not accurate to one digit."""
        return int(np.isnan(self.errors).sum())

    @property
    def rigid(self) -> Array:
        """Mask (N,) of the multipliers that belong to rigid-body modes."""
        return self._of_monodromy[1] if self.refined is None else self.refined.rigid

    @cached_property
    def modes(self) -> Sequence[FloquetMode]:
        """Modes of all multipliers. A mode has no harmonic if its multiplier is not accurate to one digit, or
        if the method computes no step maps."""
        angles = np.imag(self.logarithms) * (self.point.speed / self.point.period)
        modes = [FloquetMode(float(angle)) for angle in angles]
        if self._factors is not None:
            known, candidates = np.flatnonzero(~np.isnan(self.errors)), self._factors.modes()
            distances = log_distances(self.logarithms[known], self._factors.logarithms)
            for row, column in zip(*matched(distances), strict=True):
                if distances[row, column] < NO_DIGIT:
                    modes[known[row]] = candidates[column]
        return modes

    @property
    def warnings(self) -> list[str]:
        """Warning if `rtol` applies to each multiplier and an error exceeds it; otherwise empty."""
        rtol, errors = self.certified.request.rtol, self._logarithms_and_errors[1]
        if self.refined is None or (worst := errors.max()) <= rtol:
            return []
        missed = f"the largest relative error of a multiplier is {worst:.1e}, above rtol {rtol:g}"
        if unresolved := int(np.isnan(errors).sum()):
            of = f"of {len(errors)} multipliers"
            missed = f"{counted(unresolved, f'{of} is', f'{of} are')} not accurate to even one digit"
        many = f"{self.refined.steps} steps"
        return [f"{missed}: {many} do not resolve the fastest modes, or round-off limits the accuracy"]

    @property
    def notes(self) -> list[str]:
        """Note on results that are missing without the eigenvalues of the product of the step maps."""
        is_refused = self.each and self.refined is None
        # A note alone does not justify computing the eigenvalues of the factors.
        has_failed = self._has_factors and "_factors" in self.__dict__ and self._factors is None
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
        if unresolved := int(np.isnan(self._logarithms_and_errors[1]).sum()):
            subject = counted(unresolved, "multiplier is", "multipliers are")
            missing.append(f"{subject} below the round-off of the monodromy matrix")
        if not (missing or is_installed):
            missing.append("orders and frequencies of the modes are unknown")
        return [f"{', and '.join(missing)}; {reason}"] if missing else []

    @cached_property
    def _of_monodromy(self) -> tuple[Array, Array, Array]:
        """Return the eigenvalues (N,) of the monodromy matrix, with +1 for each rigid-body mode; a mask (N,)
        of the eigenvalues of rigid-body modes; and the absolute errors (N,) of the eigenvalues."""
        values, count = self.certified.solutions.multipliers.values[0], _rigid_count(self.certified)
        values = values[: len(values) - count]
        at = np.full(count, before_rigid(values))
        is_rigid = np.insert(np.zeros(len(values), dtype=bool), at, values=True)
        return np.insert(values, at, 1.0), is_rigid, np.where(is_rigid, 0.0, self.certified.absolute[0])

    @property
    def _has_digit(self) -> Array:
        """Mask (N,) of the multipliers that the monodromy matrix resolves to at least one digit."""
        rho, _, errors = self._of_monodromy
        return errors < NO_DIGIT * np.abs(rho)

    @cached_property
    def _logarithms_and_errors(self) -> tuple[Array, Array]:
        """Logarithms log ρ (N,) of the multipliers and their numerical errors (N,)."""
        if self.refined is not None:
            return self.refined.logarithms, self._with_interpolation(self.refined)
        (rho, _, absolute), has_digit = self._of_monodromy, self._has_digit
        with np.errstate(divide="ignore", invalid="ignore"):
            logarithms = np.where(rho != 0, np.log(rho), UNKNOWN)
            errors = np.where(has_digit, absolute / np.abs(rho), np.nan)
        # If the largest multipliers are not accurate to one digit, none is, even if two solutions agree.
        is_needed = not has_digit.all() and self.certified.errors[0, 1] < NO_DIGIT
        if is_needed and (factors := self._factors) is not None:
            large = matched_logarithms(logarithms[has_digit], factors.logarithms)
            small = np.setdiff1d(np.arange(len(rho)), large)
            logarithms[~has_digit] = factors.logarithms[small]
            errors[~has_digit] = self._with_interpolation(factors)[small]
        return logarithms, errors

    def _with_interpolation(self, factors: Factors) -> Array:
        """Return the relative errors (N,) of the multipliers of the factors, including the error of
        interpolation. An error is NaN if the multiplier is not accurate to one digit."""
        sizes, errors = np.real(factors.logarithms), factors.errors
        for interpolation in self.certified.interpolation:
            if interpolation.multipliers > 0:
                with np.errstate(over="ignore"):
                    added = interpolation.multipliers * np.exp(sizes.max() - sizes)
                errors = np.where(factors.rigid, 0.0, errors + added)
        return np.where(errors < NO_DIGIT, errors, np.nan)

    def _reduction_errors(self, logarithms: Array) -> Array | float:
        """Return the relative errors (N,) that a reduction causes in multipliers with these `logarithms`
        (N,): twice the differences from the multipliers of the enriched system, or 0 without a reduction. If
        the small multipliers of the enriched system cannot be computed, the largest absolute error of the
        multipliers is assumed."""
        reduction, certified = self.point.system.capabilities.reduction, self.certified
        if reduction is None or reduction.full_coordinates == self.point.n:
            return 0.0
        sizes = np.real(logarithms)
        with np.errstate(over="ignore", invalid="ignore"):
            errors = SAFETY * certified.reduction[0].multipliers * np.exp(np.nanmax(sizes) - sizes)
        if not (self._has_factors and slicot.available()):
            return errors
        point = SinglePoint(reduction.enriched, self.point.speed)
        try:
            solved = replace(certified, modes=frozen(point))
            blocks = Factors(point, solved, certified.steps, _DEFAULT_LOSS).blocks
            enriched = eigenvalue_logarithms(blocks.factors[0])
        except (SolveError, np.linalg.LinAlgError):
            return errors
        is_known = ~np.isnan(sizes)
        distances = log_distances(logarithms[is_known], enriched)
        errors[is_known] = SAFETY * distances[matched(distances)]
        return errors

    @property
    def _has_factors(self) -> bool:
        """Whether the monodromy matrix is available as a product of few enough one-step maps."""
        method = self.certified.method
        return isinstance(method, OneStep) and method.converges and not self._is_long

    @property
    def _is_long(self) -> bool:
        """Whether the factors would take too much computing time to be used by default."""
        work = self.certified.steps * state_size(self.point) ** 2
        return self.refined is None and work > _MAX_WORK[0]

    @cached_property
    def _factors(self) -> Factors | None:
        """Factors for the modes and the small multipliers; None if their eigenvalues cannot be computed.

        If the monodromy matrix does not resolve all multipliers, there are twice as many steps as in the
        solution, because small multipliers belong to fast modes. If the user has specified the number of
        steps, that number is used."""
        certified = self.certified
        short = self.refined if self.refined is not None and self.refined.work <= _MAX_WORK[1] else None
        if short is not None and short.anchored is None:
            return short
        if not self._has_factors or not slicot.available():
            return None
        is_small = self.refined is None and not self._has_digit.all()
        steps = certified.steps if short is None else short.steps
        if is_small and certified.request.steps is None and certified.method.with_another_stage is not None:
            steps *= 2
        mapped = replace(certified, method=self.iteration or certified.method)
        factors = Factors(self.point, mapped, steps, _DEFAULT_LOSS)
        try:
            return factors if len(factors.errors if is_small else factors.logarithms) else None
        except np.linalg.LinAlgError:
            return None


def require_step_maps(method: Method) -> None:
    """Raise StepsError if the method does not compute step maps."""
    if not isinstance(method, OneStep):
        raise StepsError(
            f"all multipliers are computed from the maps of the steps, which {method.name} does not "
            "provide; use radau or gauss"
        )


def refined_multipliers(point: SinglePoint, certified: Certified) -> Factors | None:
    """Return factors of a solved point that yield each multiplier with an error of at most `rtol`. The number
    of steps is doubled until this is the case. Doubling ends early if it does not reduce the errors or would
    take too long. If the user has specified the number of steps, it is not changed.

    Return None if SLICOT is not available, or if its iteration does not converge."""
    request, steps, previous_error = certified.request, certified.steps, math.inf
    ratio = better_method(certified.method)[1]
    anchored = certified.solutions.free if certified.method.linear else None
    try:
        while slicot.available():
            with progress.task(f"factors of {steps} steps, for all multipliers"):
                factors = Factors(point, certified, steps, anchored=anchored)
                largest = float(factors.errors.max())
            is_last = largest <= request.rtol or 2 * ratio * factors.work > _MAX_WORK[2]
            # If doubling the steps does not halve the error, further doubling does not help.
            if is_last or request.steps is not None or largest > 0.5 * previous_error:
                return factors
            steps, previous_error = 2 * steps, largest if largest < NO_DIGIT else math.inf
    except np.linalg.LinAlgError:
        pass
    return None


def _rigid_count(certified: Certified) -> int:
    """Return the number of multipliers of a point that belong to rigid-body modes."""
    rigid_modes = certified.solutions.free
    return 0 if rigid_modes is None else int(rigid_modes.modes.multiplicity[0])


def step_maps(
    points: Points, method: Method, steps: int, engine: str, anchored: Free | None = None
) -> tuple[Grid, Array]:
    """Return a uniform grid and the one-step maps (P, m, N, N) on this grid, computed in chunks if memory
    requires it. anchored: rigid-body modes relative to which the motion is described. Raises SolveError."""
    grid = Grid.uniform(steps, points.period, points.breaks)
    chunks = grid.parts(_MEMORY // method.bytes_a_step(points.n) + 1)
    if isinstance(method, OneStep) and len(chunks) > 1:
        solved = points if anchored is None else anchored_for(method, points, anchored)
        with np.errstate(all="ignore"):
            maps = np.concatenate([method.discretise(solved, chunk).steps.A for chunk in chunks], axis=1)
            return grid, solved.steps(maps) if isinstance(solved, Anchored) else maps
    solutions = solutions_on(method, points, grid, False, engine, anchored).checked()
    assert solutions.steps is not None
    return solutions.grid, solutions.steps.A


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
