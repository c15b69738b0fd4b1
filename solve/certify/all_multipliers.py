"""Every multiplier of a point with an error of its own, and its mode: from the factors of the period where
the monodromy matrix, which holds none below eps‖Φ‖, has no digit."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from solve.arrays import Array
from solve.certify.certified import Certified, Request
from solve.certify.estimates import NO_DIGIT
from solve.errors import StepsError
from solve.kernel import slicot
from solve.methods.free import anchored_for, free, solutions_on
from solve.methods.method import Method, OneStep, Solutions
from solve.period.blocks import LOSS, Blocks, balanced_blocks, joined_blocks
from solve.period.floquet_modes import FloquetMode, floquet_modes
from solve.period.frozen import balanced, frozen
from solve.period.grid import Grid
from solve.period.multipliers import matched
from solve.period.points import OnePoint, Points, matrices
from solve.period.product_eigenvalues import (
    ProductEigenvalues,
    eigenvalue_logarithms,
    product_eigenvalues,
)
from solve.period.rigid_body import Free, before_rigid
from solve.terminal import progress

_GAIN = 0.5
"""Part of itself to which twice the steps must bring the largest error, for more to be tried."""

_EXACT_ZERO = -1e6
"""Logarithm that stands for that of an exact zero where multipliers of two solutions are matched."""

_QUICK, _WITH_MODES, _MOST = 3e6, 1e7, 2e8
"""Steps times the square of the states up to which factors are asked in any case; up to which, where every
multiplier is wanted, modes are of these steps; and up to which steps are added for them."""

_DEFAULT_LOSS = 1e-9
"""The same as `solve.period.blocks.LOSS` where errors of single multipliers are not limited. With a beam
structure of 54 states it leaves a quarter of the 768 factors and changes no multiplier by more than 2e-11,
none that the steps follow by more than 1e-12."""

_MEMORY = 2**29
"""Bytes that steps taken together may need."""

_TURNING = FloquetMode(0.0, 0.0, 0, 1.0)
"""A rigid-body mode: e at every phase."""

_MEAN_PHASES = 32
"""Phases at which M is sampled for its mean."""


@dataclass(frozen=True)
class Refined:
    """What `refined` gives: logarithms (N,) of the multipliers ρ, -inf for an exact zero; errors (N,):
    estimated relative error of each ρ, NaN where it has no digit; steps a period; rigid (N,): which of them
    are those of rigid-body modes."""

    logarithms: Array
    errors: Array
    steps: int
    rigid: Array


@dataclass(frozen=True)
class Spectrum:
    """All multipliers of a point, falling in modulus, + imaginary part first.

    Multipliers with a digit in the monodromy matrix are its eigenvalues. Others come from the factors of the
    period on twice the steps; their errors are the differences from those with one stage more. refined: all
    from the factors, if `rtol` applies to each. Multipliers of rigid-body modes are exactly +1.
    """

    point: OnePoint
    certified: Certified
    refined: Refined | None = None

    @property
    def values(self) -> Array:
        """ρ (N,), complex: 0 where it underflows, NaN where nothing is known of it."""
        if self.refined is not None:
            return _exponential(self.logarithms)
        small = _exponential(self._known[0])
        return self._with_rigid(np.where(self._digits, self._eigenvalues, small), 1.0)

    @property
    def logarithms(self) -> Array:
        """log ρ (N,), the principal branch: -inf for an exact zero, NaN where nothing is known."""
        return self._with_rigid(self._known[0], 0.0)

    @property
    def errors(self) -> Array:
        """Estimated relative error of each ρ (N,); NaN where it has no digit."""
        return self._with_rigid(self._known[1], 0.0)

    @property
    def leading(self) -> Array:
        """The largest multipliers (k,), of which the monodromy matrix tells that they meet none of the
        others; none where all were asked for."""
        known = 2 * self.certified.absolute[0] < NO_DIGIT * np.abs(self._eigenvalues)
        every = self._with_rigid(self._eigenvalues, 1.0)
        return every[self._with_rigid(known, fill=True)] if self.refined is None else every[:0]

    def logarithm(self, at: int) -> complex:
        """log ρ of one, without the others where it is among the leading."""
        leading = self.leading
        return complex(np.log(leading[at]) if at < len(leading) else self.logarithms[at])

    def multiplier(self, at: int) -> complex:
        """ρ of one, in the same way."""
        leading = self.leading
        return complex(leading[at] if at < len(leading) else self.values[at])

    @property
    def unresolved(self) -> int:
        """How many have no digit."""
        return int(np.isnan(self.errors).sum())

    @cached_property
    def modes(self) -> Sequence[FloquetMode]:
        """Of each multiplier; without an order where it has no digit, or the method no maps of steps."""
        folded = np.imag(self.logarithms) * self._rotation / (2 * math.pi)
        without = [FloquetMode(float(angle)) for angle in folded]
        if self._factored is None:
            return without
        solutions, order = self._solutions, self._order
        assert solutions.steps is not None
        phases = np.arange(_MEAN_PHASES) * (self.point.period / _MEAN_PHASES)
        mass = matrices(self.point, phases)[0][0].mean(axis=0)
        modes = floquet_modes(solutions.steps.A[0], solutions.grid, mass, *self._factored, self._rotation)
        apart = np.diagonal(_apart(self.logarithms, self._factored[1].logarithms[0][order]))
        known = ~np.isnan(self.errors) & (apart < NO_DIGIT)
        found = [modes[at] if known[i] else without[i] for i, at in enumerate(order)]
        rigid = self.rigid.tolist()
        return [_TURNING if turning else mode for turning, mode in zip(rigid, found, strict=True)]

    @cached_property
    def rigid(self) -> Array:
        """Which of the multipliers are those of rigid-body modes (N,)."""
        if self.refined is not None:
            return self.refined.rigid
        return self._with_rigid(np.zeros(len(self._eigenvalues), dtype=bool), fill=True)

    @property
    def _count(self) -> int:
        """How many these are."""
        return rigid_multipliers(self.certified)

    def _with_rigid(self, values: Array, fill: float) -> Array:
        """Values of the other multipliers, with one for each of these after those outside the unit circle."""
        if self.refined is not None or not self._count:
            return values
        return np.insert(values, np.full(self._count, before_rigid(self._eigenvalues)), fill)

    @property
    def warnings(self) -> list[str]:
        """A sentence where each was asked for to `rtol`, and an error is above it."""
        if self.refined is None:
            return []
        rtol, steps = self.certified.request.rtol, self.refined.steps
        if self.unresolved:
            missed = f"{self.unresolved} of {len(self.errors)} multipliers have no digit"
        elif (worst := float(self.errors.max())) > rtol:
            missed = f"every multiplier is known to {worst:.1e} of itself, not to rtol {rtol:g}"
        else:
            return []
        return [f"{missed}: {steps} steps do not follow the fastest modes, or rounding is in the way"]

    @cached_property
    def _solutions(self) -> Solutions:
        """Those whose steps tell the modes, and the multipliers without a digit in the monodromy matrix."""
        certified, equations = self.certified, self._equations
        if self.refined is not None and self._work(self.refined.steps) <= _WITH_MODES:
            return _solutions(equations, certified.method, certified.request, self.refined.steps)
        if self._steps == certified.steps and not self._count:
            return certified.solutions
        return _solutions(equations, certified.method, certified.request, self._steps)

    @property
    def _steps(self) -> int:
        """Steps of these: small multipliers are those of fast modes, which need twice the steps of the
        solution, unless these are given."""
        certified = self.certified
        small = self.refined is None and not self._digits.all() and certified.request.steps is None
        return certified.steps * (2 if small and certified.method.with_another_stage else 1)

    @property
    def _equations(self) -> Points:
        return balanced(self.point, self.certified.modes)

    def _work(self, steps: int) -> float:
        return steps * (2 * self.point.n) ** 2

    @property
    def _rotation(self) -> float:
        return 2 * math.pi * self.point.speed / self.point.period

    @property
    def _eigenvalues(self) -> Array:
        every = self.certified.solutions.multipliers.values[0]
        return every[: len(every) - self._count]

    @cached_property
    def _digits(self) -> Array:
        """Of which multipliers (N,) the monodromy matrix holds a digit."""
        return self.certified.absolute[0] < NO_DIGIT * np.abs(self._eigenvalues)

    @property
    def _factors_serve(self) -> bool:
        """Whether the factors of the period are those of the system's coordinates, and not too many."""
        method = self.certified.method
        quick = self.refined is not None or self._work(self.certified.steps) <= _QUICK
        return isinstance(method, OneStep) and method.converges and quick

    @cached_property
    def _known(self) -> tuple[Array, Array]:
        if self.refined is not None:
            return self.refined.logarithms, self.refined.errors
        rho, digits = self._eigenvalues, self._digits
        with np.errstate(divide="ignore", invalid="ignore"):
            logarithms = np.where(rho != 0, np.log(rho), np.nan)
            errors = np.where(digits, self.certified.absolute[0] / np.abs(rho), np.nan)
        # If the largest multipliers are unknown, so are all others, even if two solutions agree.
        certified = self.certified
        if digits.all() or not certified.errors[0, 1] < NO_DIGIT or self._factored is None:
            return logarithms, errors
        own, order = self._factored[1], self._order[~self.rigid]
        better, steps = certified.method.with_another_stage, self._steps
        grid = (certified.method, 2 * steps) if better is None else (better, steps)
        blocks = _blocks_on_steps(self._equations, grid[0], certified.request, grid[1], loss=_DEFAULT_LOSS)
        try:
            small = _known(_errors(eigenvalue_logarithms(blocks.factors[0]), own))
        except np.linalg.LinAlgError:
            return logarithms, errors
        return np.where(digits, logarithms, own.logarithms[0][order]), np.where(digits, errors, small[order])

    @cached_property
    def _factored(self) -> tuple[Blocks, ProductEigenvalues] | None:
        """None where there are no factors, or their eigenvalues are not found."""
        if not self._factors_serve or not slicot.available():
            return None
        blocks = _blocks(self._solutions, _DEFAULT_LOSS if self.refined is None else LOSS)
        try:
            return blocks, product_eigenvalues(blocks.factors, blocks.rounding, vectors=True)
        except np.linalg.LinAlgError:
            return None

    @property
    def notes(self) -> list[str]:
        """A sentence where multipliers are unknown since the factors give no eigenvalues; of those that did
        not converge once these were computed."""
        installed = slicot.available()
        if not self._factors_serve or (installed and "_factored" not in self.__dict__):
            return []
        if self._factored is not None or not self.unresolved:
            return []
        below = f"{self.unresolved} multipliers are below the round-off of the monodromy matrix"
        if installed:
            return [f"{below}; the eigenvalues of the product of the steps did not converge"]
        return [f"{below}; finding them needs SLICOT: pip install ctrlsys, which some platforms lack"]

    @cached_property
    def _order(self) -> Array:
        """Which eigenvalue of the factors each multiplier is (N,)."""
        assert self._factored is not None
        own = self._factored[1].logarithms[0]
        if self.refined is not None:
            return matched_logarithms(self.refined.logarithms, own)
        digits = np.flatnonzero(self._digits)
        matched = matched_logarithms(np.log(self._eigenvalues[digits]), own)
        others = np.setdiff1d(np.arange(len(own)), matched)
        by_distance = others[np.argsort(np.abs(own[others]), kind="stable")]
        order, rest = np.empty(len(own), dtype=int), np.empty(len(self._eigenvalues), dtype=int)
        rest[digits] = matched
        rest[~self._digits] = np.sort(by_distance[self._count :])
        order[self.rigid], order[~self.rigid] = by_distance[: self._count], rest
        return order


def checked_maps(method: Method) -> None:
    """Raise StepsError for a method that has no maps of steps."""
    if not isinstance(method, OneStep):
        raise StepsError(
            f"{method.name} has no maps of steps from which all multipliers could come; use radau or gauss"
        )


def refined(point: OnePoint, method: Method, request: Request, steps: int, rigid: int = 0) -> Refined | None:
    """Multipliers, of which `rigid` are those of rigid-body modes, on `steps` and as many more as bring the
    error of each to `rtol`; fewer where twice the steps gain nothing or take too long. With steps of the
    request's own: on twice as many. None without SLICOT, or where its iteration does not converge."""
    if not slicot.available():
        return None
    try:
        return _refined(point, method, request, steps, rigid)
    except np.linalg.LinAlgError:
        return None


def _refined(point: OnePoint, method: Method, request: Request, steps: int, rigid: int) -> Refined:
    most, points = _MOST / (2 * point.n) ** 2, balanced(point, frozen(point))
    held = free(point) if method.linear else None
    coarse, before = _on_steps(points, method, request, steps, held), math.inf
    while True:
        steps *= 2
        fine = _on_steps(points, method, request, steps, held)
        logarithms, errors = fine.logarithms[0].copy(), _errors(coarse.logarithms[0], fine)
        turning = np.isin(np.arange(len(errors)), np.argsort(np.abs(logarithms), kind="stable")[:rigid])
        logarithms[turning], errors[turning] = 0.0, 0.0
        largest = float(errors.max())
        done = largest <= request.rtol or request.steps is not None
        if done or 2 * steps > most or largest > _GAIN * before:
            return Refined(logarithms, _known(errors), steps, turning)
        coarse, before = fine, largest if largest < NO_DIGIT else math.inf


def rigid_multipliers(certified: Certified) -> int:
    """How many multipliers of one point are those of rigid-body modes."""
    found = certified.solutions.free
    return 0 if found is None else int(found.modes.multiplicity[0])


def _solutions(
    point: Points, method: Method, request: Request, steps: int, held: Free | None = None
) -> Solutions:
    grid = Grid.uniform(steps, point.period, point.breaks)
    solutions = solutions_on(method, point, grid, False, request.engine, held)
    for reason in solutions.failures.values():
        raise reason
    return solutions


def _blocks(solutions: Solutions, loss: float = LOSS) -> Blocks:
    assert solutions.steps is not None
    return balanced_blocks(solutions.steps.A, loss=loss)


def _on_steps(
    point: Points, method: Method, request: Request, steps: int, held: Free | None = None
) -> ProductEigenvalues:
    """Multipliers from the factors on this number of steps."""
    blocks = _blocks_on_steps(point, method, request, steps, held)
    return product_eigenvalues(blocks.factors, blocks.rounding)


def _blocks_on_steps(
    point: Points, method: Method, request: Request, steps: int, held: Free | None = None, loss: float = LOSS
) -> Blocks:
    """The factors on this number of steps, which are taken in parts where memory requires it."""
    grid = Grid.uniform(steps, point.period, point.breaks)
    parts = grid.parts(_MEMORY // method.bytes_a_step(point.n) + 1)
    with progress.task(f"parts of {steps} steps, for every multiplier", len(parts)) as done:
        if len(parts) == 1:
            return _blocks(_solutions(point, method, request, steps, held), loss)
        assert isinstance(method, OneStep)
        taken, anchored = [], None if held is None else anchored_for(method, point, held)
        for part in parts:
            with np.errstate(all="ignore"):
                A = method.discretise(anchored or point, part).steps.A
            A = A if anchored is None else anchored.steps(A)
            first = sum(each.steps for each in parts[: len(taken)])
            taken.append(balanced_blocks(A, first=first, loss=loss))
            done.add()
        return joined_blocks(taken, loss)


def _exponential(logarithms: Array) -> Array:
    """ρ (N,) of its logarithms, real where these are of a real number; NaN where nothing is known."""
    angle = np.imag(logarithms)
    return np.exp(np.real(logarithms)) * np.where(angle == math.pi, -1.0, np.exp(1j * angle))


def _errors(others: Array, own: ProductEigenvalues) -> Array:
    """Relative errors (N,) of multipliers from rounding and from the logarithms (N,) on other steps."""
    apart = _apart(own.logarithms[0], others)
    nearest, distance = apart.argmin(axis=1), apart.min(axis=1)
    mutual = apart.argmin(axis=0)[nearest] == np.arange(len(apart))
    # A multiplier far from all others has no digit in any assignment.
    if not (mutual | (distance >= NO_DIGIT)).all():
        distance = apart[matched(apart)]
    return np.maximum(distance, own.errors[0])


def _known(errors: Array) -> Array:
    """NaN where errors leave no digit."""
    return np.where(errors < NO_DIGIT, errors, np.nan)


def matched_logarithms(some: Array, every: Array) -> Array:
    """Positions (k,) among the logarithms `every` (N,) of those that match the logarithms `some` (k,)."""
    return matched(_apart(some, every))[1]


def _apart(ours: Array, theirs: Array) -> Array:
    """Distances (k, N) between logarithms (k,) and (N,), the angle modulo a turn."""
    ours, theirs = (np.where(np.isneginf(np.real(part)), _EXACT_ZERO, part) for part in (ours, theirs))
    apart = ours[:, None] - theirs
    return np.hypot(np.real(apart), np.angle(np.exp(1j * np.imag(apart))))
