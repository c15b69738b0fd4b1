"""Base classes of methods. A method solves one period for many points on one grid."""

from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property
from operator import attrgetter
from typing import Any

import numpy as np

from solve.arguments import most_numbers, require_steps
from solve.arrays import Array, across, covers_all
from solve.errors import MatricesError, ResonanceError, SolveError, StepsError, ValueOutOfBoundsError, counted
from solve.kernel.engines import NUMPY
from solve.kernel.multipliers import Conditioned
from solve.matrices import leading
from solve.period.curve import Curve, PeriodicCurve
from solve.period.eigenvalues import conditioned, multiplier_roundoff
from solve.period.frozen import FrozenModes
from solve.period.grid import Grid
from solve.period.multipliers import Multipliers
from solve.period.period_map import SINGULAR, Steps, monodromy, period
from solve.period.points import Points, affine, matrices, state_size
from solve.period.rigid_body import Free

MOST_STEPS = 2**40
"""Upper limit of the number of steps, larger than any memory permits."""

_LARGE_SYSTEMS, _ENOUGH_STEPS = 4, 2**13
"""Factor by which large systems may exceed the memory limit, and number of steps up to which this is
permitted, because fewer steps would not suffice. Chosen by judgement."""


@dataclass(frozen=True)
class Solutions:
    """Solutions of P points by one method on one grid.

    Phi (P, N, N): monodromy matrices; zero for failed points. curve: curves of the periodic solutions, if
    requested. steps: one-step maps whose product is Φ, if the method computes them. condition (P,): condition
    numbers of the linear systems for the curves; NaN without curves. defect (P,): relative error of the curve
    that a finer grid does not reduce. rounding (P,): relative error of the multipliers from the computation
    of Φ, in addition to the round-off of Φ itself; 1 if the grid does not determine Φ. notes: notes of the
    method, none or one per point. failures: mapping from indices of failed points to reasons. units (P, N):
    powers of 2 that balance Φ, if known. engine: engine for the eigenvalues of Φ. free: rigid-body modes, if
    there are any; Φ and `steps` then describe the motion relative to the modes.

    secular (P, r): steady velocity of each mode with C e ≠ 0, or acceleration of each other mode, with
    respect to the phase. driven (P,): largest of these accelerations, relative to the accelerations of the
    motion."""

    grid: Grid
    Phi: Array
    curve: PeriodicCurve | None
    condition: Array
    steps: Steps | None = None
    defect: Array = field(default_factory=lambda: np.zeros(1))
    rounding: Array = field(default_factory=lambda: np.zeros(1))
    notes: tuple[str, ...] = ()
    failures: Mapping[int, SolveError] = field(default_factory=dict)
    units: Array | None = None
    engine: str = NUMPY
    free: Free | None = None
    secular: Array | None = None
    driven: Array | None = None

    def __post_init__(self) -> None:
        count = len(self.Phi)
        if len(self.defect) != count:
            object.__setattr__(self, "defect", np.broadcast_to(self.defect, count))
        if len(self.rounding) != count:
            object.__setattr__(self, "rounding", np.broadcast_to(self.rounding, count))

    def __len__(self) -> int:
        return len(self.Phi)

    def __getitem__(self, points: Array) -> "Solutions":
        """Solutions of the selected points, which must not have failed."""
        if covers_all(points, len(self)):
            return self
        subset = Solutions(
            self.grid,
            self.Phi[points],
            None if self.curve is None else self.curve[points],
            self.condition[points],
            None if self.steps is None else Steps(self.steps.A[points], self.steps.b[points]),
            self.defect[points],
            self.rounding[points],
            tuple(np.array(self.notes)[points].tolist()) if self.notes else (),
            {},
            None if self.units is None else self.units[points],
            self.engine,
            None if self.free is None else self.free[points],
            None if self.secular is None else self.secular[points],
            None if self.driven is None else self.driven[points],
        )
        return subset.with_multipliers(self.multipliers[points])

    @property
    def known(self) -> Array:
        """Indices (k,) of the points with a solution."""
        has_solution = np.ones(len(self), dtype=bool)
        has_solution[list(self.failures)] = False
        return np.flatnonzero(has_solution)

    def checked(self) -> "Solutions":
        """Return these solutions, or raise the SolveError of the first failed point."""
        for reason in self.failures.values():
            raise reason
        return self

    def with_multipliers(self, multipliers: Multipliers) -> "Solutions":
        """Solutions with given multipliers in place of the eigenvalues of Φ."""
        changed = copy(self)
        changed.__dict__["multipliers"] = multipliers
        return changed

    @cached_property
    def _conditioned(self) -> Conditioned | None:
        """Eigenvalues of Φ and their condition numbers, if compiled code provides them."""
        return conditioned(self.Phi, self.units, self.engine)

    @cached_property
    def multipliers(self) -> Multipliers:
        """Floquet multipliers, the eigenvalues of Φ."""
        return Multipliers.from_matrices(self.Phi, self.units, self._conditioned)

    @cached_property
    def multiplier_rounding(self) -> Array:
        """Round-off errors of the multipliers (P,), relative to the spectral radius."""
        roundoff = multiplier_roundoff(self.Phi, self.units, self.grid.steps, self._conditioned)
        return np.maximum(roundoff, 8 * self.rounding)


class Method:
    """Numerical method for M q″ + C q′ + K q = d; derivatives are with respect to the phase.

    order: order of convergence at the nodes and of the multipliers; infinite for spectral convergence
    (`spectral`). curve_order: order of the continuous curve. converges: False for an approximation that does
    not converge with finer steps. l_stable: whether unresolved stiff modes are damped rather than preserved.
    follows: largest ω_max h for which the steps resolve the fastest mode. samples_evenly: whether all samples
    of a grid are equidistant, so that harmonics of the matrices can alias. phase_constant: the constant c
    of the phase error c (ω h)^(order + 1) per step, for methods that preserve the amplitude of a mode; 0 for
    methods that damp modes before the phase error becomes important.

    stages: number of stages of a collocation method; None for other methods. with_another_stage: collocation
    method of the same family with one more stage; None for other methods. warnings: warnings about the
    settings of the method. symmetric: whether the method requires symmetric matrices, which real modes
    diagonalise. first_order: whether the method solves systems with first-order coordinates."""

    name: str
    order: Any
    curve_order: float
    converges: bool = True
    spectral: bool = False
    l_stable: bool = False
    follows: float = 1.0
    samples_evenly: bool = True
    stages: Any = None
    with_another_stage: Any = None
    phase_constant: float = 0.0
    warnings: tuple[str, ...] = ()
    symmetric: bool = False
    first_order: bool = False

    @property
    def settings(self) -> dict[str, Any]:
        """Mapping from names to values of the settings, which are the fields of the dataclass."""
        return {name: getattr(self, name) for name in getattr(self, "__dataclass_fields__", ())}

    def _set(self, **facts: Any) -> None:
        """Set attributes that follow from the settings. The dataclass is frozen."""
        for name, value in facts.items():
            object.__setattr__(self, name, value)

    @property
    def linear(self) -> bool:
        """Whether the method solves the equations of points directly, without linearisation about an
        orbit."""
        return True

    def linearised(self, points: Points, solutions: "Solutions") -> Points:
        """Points with linear equations, which the solutions satisfy. Points whose equations are linear are
        returned unchanged."""
        return points

    @property
    def corrector(self) -> "Method":
        """Method that solves the linear equations from `linearised`."""
        return self

    def in_phase(self, steps: Array, error: float) -> Array:
        """Largest phase advance (…) of a mode per period, in rad, for which the phase error of this mode on
        `steps` steps (…) is at most `error` (rad)."""
        if not self.phase_constant:
            return np.full(np.shape(steps), np.inf)
        return steps * (error / (self.phase_constant * steps)) ** (1 / (self.order + 1))

    def least_steps(self, modes: FrozenModes) -> Array:
        """Smallest number of steps per period (P,) for which the method can be stable; 1 without a stability
        limit. modes: frozen modes of the points."""
        return np.ones(len(modes), dtype=int)

    def bytes_a_step(self, n: int, orbit: bool = True, engine: str = NUMPY) -> int:
        """Approximate peak memory in bytes per step, for n coordinates."""
        return 80 * (2 * n + 1) ** 2

    def most_steps(self, n: int, first_order: int = 0) -> int:
        """Largest number of steps per period for n coordinates, limited by memory and time. The last
        `first_order` coordinates have no second derivatives."""
        steps = int(8 * most_numbers() / self.bytes_a_step(n))
        return max(steps, min(_LARGE_SYSTEMS * steps, _ENOUGH_STEPS))

    def require_order(self, points: Points) -> None:
        """Raise ValueOutOfBoundsError if points have first-order coordinates that the method cannot solve."""
        if points.first_order and not self.first_order:
            raise ValueOutOfBoundsError(
                f"{self.name} solves equations of second order only, and this system has first-order states; "
                "use auto, radau, gauss, rk4, hsu, fourier or hill"
            )

    def require_steps(self, steps: Any, points: Points) -> None:
        """Raise StepsError for a number of steps for which the error at some point cannot be estimated."""
        require_steps(steps, max(1, len(points.breaks)))
        most = self.most_steps(points.n, points.first_order) // (2 if self.converges else 1)
        if steps > most:
            raise StepsError(
                f"{self.name} takes at most {most} steps per period for {counted(points.n, 'coordinate')}; "
                f"given: {steps}; use fewer, raise --limit, or omit steps for automatic selection"
            )

    def solutions(self, points: Points, grid: Grid, orbit: bool, engine: str = NUMPY) -> Solutions:
        """Compute monodromy matrices and, if `orbit` is true, periodic solutions."""
        raise NotImplementedError

    def _no_map(self, point: Points, grid: Grid) -> SolveError:
        """Exception for a point with one-step maps that are not finite."""
        phase = grid.stages(np.array([0.0, 0.25, 0.5, 0.75])).ravel()
        M, C, _, _ = (part[0] for part in matrices(point, phase))
        M = leading(M, C, point.first_order)
        if not np.isfinite(M).all():
            return MatricesError("the matrices have NaN or infinite entries; check the parameters")
        singular = np.flatnonzero(np.linalg.slogdet(M)[0] == 0)
        if len(singular):
            return singular_inertia_error(f"at phase {phase[singular[0]]:.6g}", point.first_order)
        return self._overflow(grid.steps)

    def _overflow(self, steps: int) -> StepsError:
        other = "" if self.l_stable else ", or a method that damps stiff modes (radau)"
        return StepsError(
            f"{self.name} with {counted(steps, 'step')} overflows within one period: some motion exceeds the "
            f"floating-point range, or the matrices are infinite at some phase; use more steps{other}, "
            "or other parameters"
        )


@dataclass(frozen=True)
class Discretisation:
    """Discretisation of P points by a one-step method on a grid.

    steps: affine maps of the state. curve: function that converts states at the nodes (P, m+1, N) to
    continuous curves of q."""

    steps: Steps
    curve: Callable[[Array], PeriodicCurve]

    @classmethod
    def of_rates(
        cls, grid: Grid, maps: Array, start: Array, end: Array, first_order: int = 0
    ) -> "Discretisation":
        """Discretisation for the states x = (q, q′). Its curves interpolate q, q′ and q″ at both ends of
        every step or, for the last `first_order` coordinates, q and q′.

        maps: (A | b) of the steps. start, end: rates (P | f) of x′ = P x + f at the start and at the end of
        every step. All are (P, m, N, N+1)."""
        n = (maps.shape[-2] + first_order) // 2
        p = n - first_order

        def curve(x: Array) -> PeriodicCurve:
            before, after = affine(start[..., p:, :], x[:, :-1]), affine(end[..., p:, :], x[:, 1:])
            second = before[..., first_order:], after[..., first_order:]
            curve = Curve.quintic(grid.nodes, x[..., :p], x[..., n:], *second)
            if not first_order:
                return curve
            rates = before[..., :first_order], after[..., :first_order]
            return curve.joined(Curve.cubic(grid.nodes, x[..., p:n], *rates))

        return cls(Steps(maps[..., :-1], maps[..., -1]), curve)


class OneStep(Method):
    """Base class of methods that represent a period as a chain of affine maps, which `discretise` returns."""

    def discretise(self, points: Points, grid: Grid) -> Discretisation:
        """Compute one-step maps and curves of the points on a grid."""
        raise NotImplementedError

    def solutions(self, points: Points, grid: Grid, orbit: bool, engine: str = NUMPY) -> Solutions:
        with np.errstate(all="ignore"):
            chain = self.discretise(points, grid)
            if not orbit:
                return self.sound(points, grid, monodromy(chain.steps), steps=chain.steps)
            Phi, states, condition = period(chain.steps)
            return self.sound(points, grid, Phi, chain.curve(states), condition, chain.steps)

    def sound(
        self,
        points: Points,
        grid: Grid,
        Phi: Array,
        curve: PeriodicCurve | None = None,
        condition: Array | None = None,
        steps: Steps | None = None,
        units: Array | None = None,
        engine: str = NUMPY,
    ) -> Solutions:
        """Assemble solutions. For points without a finite, unique solution, the reason for the failure is
        stored."""
        is_unique = succeeds = is_finite = across(np.logical_and, np.isfinite(Phi).reshape(len(Phi), -1))
        if curve is not None and condition is not None:
            is_unique = is_finite & (condition < 1 / SINGULAR)
            succeeds = is_unique & curve.finite
        failures: dict[int, SolveError] = {}
        for point in (~succeeds).nonzero()[0].tolist() if not succeeds.all() else ():
            if not is_finite[point]:
                failures[point] = self._no_map(points[np.array([point])], grid)
            else:
                failures[point] = self._overflow(grid.steps) if is_unique[point] else no_orbit()
        if failures:
            Phi = np.where(succeeds[:, None, None], Phi, 0.0)
        if condition is None:
            condition = np.full(len(Phi), np.nan)
        return Solutions(grid, Phi, curve, condition, steps, failures=failures, units=units, engine=engine)


def singular_inertia_error(where: str, first_order: int) -> MatricesError:
    """Exception for equations that do not determine the highest derivatives at some phase."""
    if first_order:
        return MatricesError(
            "the columns of M (coordinates) and of C (first-order states) are linearly dependent "
            f"{where}; the equations must determine every highest derivative"
        )
    return MatricesError(
        f"M is singular {where}: some coordinate has no inertia there; give every coordinate a mass at every "
        "phase"
    )


def one_by_one(points: Points, solve_one: Callable[[Points], Solutions]) -> Solutions:
    """Solve points on one grid one at a time, with the function `solve_one`."""
    solved: list[Solutions] = []
    failures: dict[int, SolveError] = {}
    for at in range(len(points)):
        try:
            solved.append(solve_one(points[np.array([at])]))
        except SolveError as error:
            failures[at] = error
    if not solved:
        zeros = np.zeros((len(points), state_size(points), state_size(points)))
        return Solutions(Grid.uniform(1, points.period), zeros, None, zeros[:, 0, 0], failures=failures)
    if len(points) == 1:
        return solved[0]
    # Failed points contain the values of another point; only their Φ is zero.
    positions = np.cumsum([at not in failures for at in range(len(points))]) - 1
    parts = [solved[max(place, 0)] for place in positions.tolist()]

    def concatenated(field: Callable[[Any], Array]) -> Array:
        return np.concatenate([field(part) for part in parts])

    curve, steps = parts[0].curve, parts[0].steps
    if curve is not None:
        drift = None
        if any(part.curve is not None and part.curve.drift is not None for part in parts):
            drift = concatenated(
                lambda part: np.zeros((1, points.n)) if part.curve.drift is None else part.curve.drift
            )
        coefficients = concatenated(lambda part: part.curve.coefficients)
        curve = type(curve)(curve.nodes, coefficients, drift=drift)  # type: ignore[call-arg]
    if steps is not None:
        steps = Steps(concatenated(lambda part: part.steps.A), concatenated(lambda part: part.steps.b))
    Phi = concatenated(lambda part: part.Phi)
    Phi[list(failures)] = 0.0
    condition, defect, rounding = (
        concatenated(attrgetter(name)) for name in ("condition", "defect", "rounding")
    )
    notes = tuple(note for part in parts for note in part.notes)
    return Solutions(parts[0].grid, Phi, curve, condition, steps, defect, rounding, notes, failures)


def no_orbit(singular: str = "I - Φ") -> ResonanceError:
    """Exception for a point without a unique periodic solution."""
    return ResonanceError(
        f"{singular} is singular: a Floquet multiplier is at +1, so that the forced motion grows without "
        "bound or is not unique; change the speed or add damping"
    )
