"""Linear system with periodic coefficients, M(Ωt)q″ + C(Ωt)q′ + K(Ωt)q = d(Ωt) (chapter Eq. (2))."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from typing import Any, Self, TypeVar

import numpy as np

from solve.arguments import first_is
from solve.arrays import Array, Plane
from solve.contracts import (
    Columns,
    Events,
    Formulas,
    Integrator,
    Limit,
    Matrices,
    Motion,
    ParameterDerivatives,
    Reduction,
    Statistics,
    Structure,
)
from solve.errors import (
    LinearModelError,
    MatricesError,
    NoDerivativeError,
    NoLoadError,
    NoSketchError,
    SolveError,
    TransientError,
    ValueOutOfBoundsError,
    require_name,
)
from solve.labels import Labels, require_vibration
from solve.matrices import (
    changes,
    checked_phases,
    jumps_at_zero,
    real_arrays,
    require_finite_entries,
    require_inertia,
    require_shapes,
    with_neighbours,
)
from solve.samples import Samples, checked_period, sampled
from solve.units import unit_given

_LOAD_PHASES = 128
"""Phases per period at which a load is sampled to determine whether it is zero. A choice."""


class PeriodicSystem:
    """Linear system with periodic coefficients and named coordinates.

    Parameters
    ----------
    matrices : callable
        matrices(phase, speed) returns M, C, K of shape (m, n, n) and d of shape (m, n) at phases φ = Ωt of
        shape (m,) and a speed Ω in rad/s, in SI units, for derivatives with respect to time.
    coordinates : sequence of str
        Names of the n coordinates.
    period : float
        Period of the matrices in phase.
    breaks : sequence of float
        Phases at which the matrices jump. They are always ends of steps; matrices are sampled on either side.
    inputs : sequence of str
        Names of the r inputs u of M q̈ + C q̇ + K q = d + B u. If there are any, `matrices` returns M, C, K, d
        and B of shape (m, n, r). Results are for u = 0; `solve.lqr` computes feedback.

    Raises
    ------
    ValueOutOfBoundsError
        For invalid names, period or breaks.

    Notes
    -----
    Capabilities of some systems are None for others: `structure`, `derivatives`, `reduction`, `samples`.

    Examples
    --------
    >>> import numpy as np
    >>> def oscillator(phase, speed):
    ...     one = np.ones((len(phase), 1, 1))
    ...     return one, 0.1 * one, 4.0 * one, np.cos(phase)[:, None]
    >>> PeriodicSystem(oscillator, ["q"]).n
    1
    """

    _FEWEST = 1
    """Smallest number of coordinates."""

    labels: Labels = Labels()
    """Names, parameter values, units and meanings."""

    states: tuple[str, ...] = ()
    """Coordinates without second derivatives, which are the last ones."""
    inputs: tuple[str, ...] = ()
    """Names of the inputs u, such as forces of drives, which are zero unless a controller sets them."""
    outputs: tuple[str, ...] = ()
    """Names of the quantities computed from the state."""

    events: Events = Events()
    """Phases at which the motion passes switches, for systems linearised about a motion."""

    reduction: Reduction | None = None
    """Reduction from a larger system; None for a full system."""
    structure: Structure | None = None
    """Frequencies and mode shapes from the elements of a structure; None for other systems."""

    samples: Samples | None = None
    """Samples from which the matrices are interpolated; None for other systems."""

    derivatives: Any = None
    """Derivatives with respect to parameters, `ParameterDerivatives`; None without generated equations."""

    def __init__(
        self,
        matrices: Callable[[Array, float], Sequence[Array]],
        coordinates: Sequence[str],
        period: float = 2 * math.pi,
        breaks: Sequence[float] = (),
        inputs: Sequence[str] = (),
    ):
        self.period = checked_period(period)
        texts = all(isinstance(name, str) for name in coordinates)
        if not texts or len(set(coordinates)) != len(coordinates) or len(coordinates) < self._FEWEST:
            raise ValueOutOfBoundsError(
                f"coordinates are {list(coordinates)}; give each of the n coordinates a different name"
            )
        if not all(math.isfinite(b) for b in breaks):
            raise ValueOutOfBoundsError(f"breaks are {list(breaks)}; allowed: finite phases")
        self._matrices = matrices
        self.coordinates = tuple(coordinates)
        self.breaks = tuple(float(b) for b in breaks)
        require_own_names("inputs", inputs, coordinates)
        self.inputs, self._symbols = tuple(inputs), "MCKdB" if inputs else "MCKd"

    @classmethod
    def from_samples(
        cls,
        M: Array,
        C: Array,
        K: Array,
        d: Array,
        coordinates: Sequence[str],
        period: float = 2 * math.pi,
        phases: Sequence[float] | Array | None = None,
    ) -> Self:
        """Create a system from samples at azimuths of the period, between which the matrices are their
        trigonometric interpolant. Results state its error, and how many azimuths suffice.

        Parameters
        ----------
        M, C, K : (k, n, n) arrays
            Samples in SI units, valid at the speed at which they were taken.
        d : (k, n) array
            Samples of the load.
        coordinates : sequence of str
            Names of the n coordinates.
        period : float
            Period in phase.
        phases : (k,) array, optional
            Azimuths in rad, in any order; by default uniform from 0 without the end of the period.

        Returns
        -------
        PeriodicSystem

        Raises
        ------
        MatricesError
            For samples that are not real arrays of one length, and for unsuitable azimuths.

        Examples
        --------
        >>> one = np.ones((8, 1, 1))
        >>> PeriodicSystem.from_samples(one, 0.1 * one, 4 * one, one[:, 0], ["q"]).coordinates
        ('q',)
        """
        samples = sampled((M, C, K, d), "MCKd", period, phases)
        return cls(samples.function, coordinates, samples.period).from_interpolant(samples)

    def from_interpolant(self, samples: Samples) -> Self:
        """Copy of the system with other samples of its matrices."""
        made = copy(self)
        made._matrices, made.samples = samples.function, samples
        return made

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return len(self.coordinates)

    def at(self, phase: Array, speed: float) -> Matrices:
        """M, C, K (m, n, n) and d (m, n) at phases (m,), for derivatives with respect to time.

        Raises MatricesError if the function returns no real arrays, or NaN or infinite entries.
        """
        M, C, K, d, *_ = self._called(phase, speed, self._symbols, "M, C, K", "d")
        return M, C, K, d

    def input_matrix(self, phase: Array, speed: float) -> Array:
        """B (m, n, r) of the inputs on the right of the equations, at phases (m,). Raises MatricesError."""
        return self._checked_inputs(self._called(phase, speed, self._symbols, "M, C, K", "d")[4:], phase)

    def _checked_inputs(self, arrays: Sequence[Array], phase: Array) -> Array:
        """B (m, n, r), the only array, or no columns without inputs. Raises MatricesError for another
        shape."""
        shape = len(phase), self.n, len(self.inputs)
        B = arrays[0] if arrays else np.zeros(shape)
        if B.shape != shape:
            raise MatricesError(
                f"B at {len(phase)} phases has shape {B.shape}; for {self.n} coordinates and the inputs "
                f"{', '.join(self.inputs)} it must be {shape}"
            )
        return B

    def _called(self, phase: Array, speed: float, symbols: str, square: str, vector: str) -> list[Array]:
        """Finite real arrays of the function `matrices` at phases (m,), one per symbol. square, vector:
        symbols of the arrays of shape (m, n, n) and (m, n). Raises MatricesError."""
        # A function of the user may modify its argument.
        argument = phase if phase.flags.writeable else phase.copy()
        try:
            values = self._matrices(argument, speed)
        except (IndexError, TypeError, ValueError) as error:
            m = len(phase)
            error.add_note(
                f"The function was called for {m} phases at once: {square} must have the shape "
                f"({m}, {self.n}, {self.n}) and {vector} ({m}, {self.n})."
            )
            raise
        arrays = real_arrays(values, symbols, "matrices")
        require_finite_entries(arrays, symbols, phase)
        return arrays

    def in_phase(self, phase: Array, speed: float) -> Matrices:
        """Ω²M, ΩC, K (m, n, n) and d (m, n), for derivatives with respect to the phase. Raises as `at`
        does."""
        M, C, K, d = self.at(phase, speed)
        return speed**2 * M, speed * C, K, d

    def output_values(
        self, phase: Array, speed: Array | float, q: Array, qd: Array, qdd: Array, acceleration: float = 0.0
    ) -> Mapping[str, Array]:
        """Outputs (k,) by name at phases (k,), a speed in rad/s, a number or (k,), and states q, q̇, q̈ (n,
        k), derivatives with respect to time. acceleration: Ω̇ in rad/s²."""
        return {}

    def output_formulas(self, varied: Sequence[str] = ()) -> Formulas | None:
        """Outputs as C code in which the parameters `varied` are inputs; None if unavailable."""
        return None

    def warnings(self, speed: float, linear: bool = True) -> list[str]:
        """Warnings about the equations at a speed (rad/s), for any solution. linear: whether the linearised
        equations are solved."""
        return list(self.labels.equation_warnings)

    @property
    def judged_quantities(self) -> tuple[str, ...]:
        """Coordinates and outputs with bounds on a valid solution."""
        return ()

    def limits(self, quantities: Iterable[str], linear: bool = True) -> list[Limit]:
        """Limits of these quantities within which a solution is valid. linear: whether the linearised
        equations are solved."""
        return [Limit.finite(name) for name in quantities]

    def judged(self, figures: Mapping[str, Statistics], linear: bool = True) -> list[str]:
        """Warnings about the limits that a solution with these statistics by quantity exceeds. linear: as in
        `limits`."""
        pairs = ((limit, figures[limit.quantity]) for limit in self.limits(figures, linear))
        return [limit.message(values) for limit, values in pairs if limit.exceeded(values)]

    def varied(
        self, parameters: Mapping[str, float] | None = None, options: Mapping[str, Any] | None = None
    ) -> Self:
        """System with some parameters and options changed. Raises UnknownNameError."""
        for name in (*(parameters or {}), *(options or {})):
            require_name(f"parameter or option of {self.labels.name}", name, [])
        return self

    def require_bounds(self, parameters: Mapping[str, float]) -> None:
        """Raise ValueOutOfBoundsError for values outside the bounds of their parameters."""

    def require_desired_motion(self, speeds: Array) -> None:
        """Raise DesiredMotionError if the fundamental motion does not exist at one of the speeds (P,),
        rad/s."""

    def sketched(self, phase: Array, speed: float, q: Array, fineness: float = 1.0) -> Mapping[str, Plane]:
        """Lines of the sketch by name: points x + iy (points, k) for q (n, k) at phases (k,). fineness:
        fraction of the usual points of curves. Raises NoSketchError without a sketch."""
        raise NoSketchError(
            f"{self.labels.name} declares no lines to draw; add mechanism.sketch(name, points) to its file "
            "and derive it again, see docs/motion.md"
        )

    def entries(self, phase: Array, speed: float) -> Array:
        """Ω²M, ΩC, K by rows and d, concatenated (m, 3n² + n), for derivatives with respect to the phase."""
        entries = np.concatenate([array.reshape(len(phase), -1) for array in self.at(phase, speed)], axis=1)
        entries[:, : self.n**2] *= speed**2
        entries[:, self.n**2 : 2 * self.n**2] *= speed
        return entries

    def used_entries(self, phase: Array, speed: float) -> tuple[Array, Array]:
        """Columns (m, R) of the entries that may differ from zero, and the indices (R,) of these entries,
        ascending."""
        return self.entries(phase, speed), np.arange(3 * self.n**2 + self.n)

    def terms(self, phase: Array, speeds: Array) -> tuple[Array, Array, Array] | None:
        """Decomposition of the entries into products: terms (k, R) of the phase, their coefficients (P, R) at
        speeds (P,), and the entry of each term (R,), ascending; None if unavailable."""
        return None

    def entries_over(self, phase: Array, speeds: Array) -> Array:
        """Entries at speeds (P,): (P, k, 3n² + n); NaN at speeds without matrices."""
        entries = np.full((len(speeds), len(phase), 3 * self.n**2 + self.n), np.nan)
        for rows, speed in zip(entries, speeds, strict=True):
            try:
                rows[:] = self.entries(phase, float(speed))
            except SolveError:
                # The solution at this speed fails for the same reason and reports it.
                continue
        return entries

    def along(self, motion: Motion, compiled: Columns | None = None) -> "PeriodicSystem":
        """Linearise the equations of motion r(φ, Ω, q, q̇, q̈) = 0 about a motion q_k, with its period.

        M = ∂r/∂q̈, C = ∂r/∂q̇, K = ∂r/∂q and d = M q̈_k + C q̇_k + K q_k - r(q_k), so that the periodic
        solution is the next iterate of Newton's method (U. Ascher, R. Mattheij, R. Russell, Numerical
        Solution of Boundary Value Problems, 2.3.4). compiled: optional compiled evaluation of formulas.
        Raises LinearModelError for linear systems.
        """
        raise LinearModelError(
            f"{self.labels.name} is linear by construction and has no nonlinear equations; use the study of "
            "its linear equations"
        )

    def along_events(self, motion: Motion, speed: float, compiled: Columns | None = None) -> "PeriodicSystem":
        """System as from `along`, whose breaks include the phases at which the motion passes switches at a
        speed in rad/s."""
        return self.along(motion, compiled)

    def event_normals(self, motion: Motion, speed: float) -> Array:
        """Derivatives (k, 1 + 2n) with respect to phase, q and dq/dφ of the switches that a motion passes at
        its events, at a speed in rad/s."""
        return np.zeros((0, 1 + 2 * self.n))

    def meet(self, events: Events) -> None:
        """Add the phases at which the motion passes switches to the breaks."""
        self.events, self.breaks = events, tuple(sorted({*self.breaks, *events.phases}))

    def roundoff(self, phase: Array, speed: float) -> Array:
        """Bounds (k, n) on the round-off in the load d of equations linearised about a motion, at phases
        (k,), in units of the machine precision; terms of the load may cancel. Zero without a bound."""
        return np.zeros((len(phase), self.n))

    def varying(self, phase: Array, speed: Array, acceleration: float) -> Matrices:
        """M, C, K (m, n, n) and d (m, n), for derivatives with respect to time, at speeds (m,) in rad/s that
        change by an acceleration in rad/s². Raises TransientError if these are unavailable."""
        raise TransientError(
            f"{self.labels.name} is stated for constant speeds only; for varying speeds, state it as a "
            "mechanism and derive it"
        )

    def marcher(self, sizes: Array, count: int, rtol: float) -> Integrator:
        """Integrator of the equations of motion, period after period from any state, with `count` states per
        period. sizes (n,): sizes of the coordinates, to which rtol is relative. Raises TransientError for
        systems without generated code."""
        raise TransientError(
            f"{self.labels.name} has no generated equations of motion that can be integrated in time; state "
            "it as a mechanism and derive it"
        )

    @property
    def nonlinear(self) -> bool:
        """Whether there are nonlinear equations, which `along` linearises."""
        return False

    def many_points(self, names: Sequence[str]) -> Any:
        """Vectorised evaluation, `ModelPoints`, at points where parameters of these names vary; None if each
        point requires a system of its own."""
        return None

    @property
    def moves_breaks(self) -> bool:
        """Whether the phases at which the matrices jump depend on parameters."""
        return False

    @property
    def freedoms(self) -> int:
        """Number of degrees of freedom at rest."""
        return self.n

    @property
    def most_frequencies(self) -> int:
        """Maximum number of natural frequencies that can be computed."""
        return self.freedoms

    def checked(self, speed: float) -> None:
        """Raise MatricesError unless the matrices have their shapes, are periodic, and M is regular."""
        n, phase = self.n, checked_phases(self.period, self.breaks)
        matrices = dict(zip("MCKd", self.at(phase, speed), strict=True))
        shapes = dict.fromkeys("MCK", (4, n, n)) | {"d": (4, n)}
        require_shapes(matrices, shapes, f"{n} coordinates ({', '.join(self.coordinates)})")
        self._require_periodicity(phase, speed, "MCKd")
        require_inertia(matrices["M"])

    def _require_periodicity(self, phase: Array, speed: float, symbols: str) -> None:
        """Raise MatricesError unless M, C, K and d, with these symbols in messages, are periodic."""
        if jumps_at_zero(self.period, self.breaks):
            return
        ends = self.in_phase(with_neighbours(phase[:1], phase[-1:], self.period), speed)
        for symbol, change in changes(ends, speed):
            raise MatricesError(
                f"{symbols['MCKd'.index(symbol)]} is not periodic: between phase 0 and {self.period:.6g} it "
                f"changes by {change:.3g}; give the right period, or the jump at 0 as a break"
            )


def require_own_names(kind: str, names: Sequence[str], others: Sequence[str]) -> None:
    """Raise ValueOutOfBoundsError unless names are texts that differ from each other and from others."""
    texts = not isinstance(names, str) and all(isinstance(name, str) for name in names)
    if not texts or len({*others, *names}) != len(others) + len(names):
        raise ValueOutOfBoundsError(f"{kind} are {names!r}; give each a name of its own")


def multiplier_count(system: PeriodicSystem) -> int:
    """Number of Floquet multipliers: one per coordinate without second derivatives, two per other
    coordinate."""
    return 2 * system.n - len(system.states)


System = TypeVar("System", bound=PeriodicSystem)


def relabelled(system: System, **labels: Any) -> System:
    """Copy of a system with some labels changed."""
    made = copy(system)
    made.labels = replace(system.labels, **labels)
    return made


def shown_in(system: System, speed: float) -> System:
    """Copy of a system whose display unit is the unit of a given speed, if it has one."""
    unit = unit_given(speed, system.labels.speed_unit)
    if unit == system.labels.speed_unit:
        return system
    copies = vars(system).setdefault("_by_speed_unit", {system.labels.speed_unit: system})
    copied = copies.get(unit)
    if copied is None or not _agree(copied, system):
        copied = copies[unit] = object.__new__(type(system))
        vars(copied).update(vars(system), labels=replace(system.labels, speed_unit=unit))
    return copied


def _agree(copied: PeriodicSystem, system: PeriodicSystem) -> bool:
    """Whether the attributes equal those of another system, except the unit and cached values."""
    return replace(copied.labels, speed_unit=system.labels.speed_unit) == system.labels and all(
        vars(copied).get(name) is value
        for name, value in vars(system).items()
        if name != "labels" and not isinstance(getattr(type(system), name, None), cached_property)
    )


def derivatives_of(system: PeriodicSystem) -> ParameterDerivatives:
    """Derivatives of the equations with respect to parameters. Raises NoDerivativeError without generated
    equations."""
    if system.derivatives is None:
        raise NoDerivativeError(
            f"{system.labels.name} has no generated equations that can be differentiated; state it as a "
            "mechanism and derive it"
        )
    return system.derivatives


def structure_of(system: PeriodicSystem) -> Structure:
    """Beam structure of a system. Raises ValueOutOfBoundsError for systems without one."""
    if system.structure is None:
        raise ValueOutOfBoundsError(
            f"{system.labels.name} has no links to draw; mode shapes require a structure of beams"
        )
    return system.structure


def require_load(system: PeriodicSystem, speed: float) -> None:
    """Raise NoLoadError if d is zero over the entire period, and hence the periodic vibration too."""
    phase = (np.arange(_LOAD_PHASES) + 0.5) * (system.period / _LOAD_PHASES)
    if not system.at(phase, speed)[3].any():
        raise NoLoadError(f"{system.labels.name} has no load: its periodic vibration is zero at every speed")


of_any_system = first_is(PeriodicSystem, such_as="solve.load('cam')")
"""Decorator of public functions of a system."""

of_system = first_is(PeriodicSystem, such_as="solve.load('cam')", demand=require_vibration)
"""Decorator of public functions that require a vibrating system."""
