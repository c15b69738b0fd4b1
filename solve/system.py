"""A linear system with periodic coefficients, M(Ωt)q″ + C(Ωt)q′ + K(Ωt)q = d(Ωt) (chapter Eq. (2))."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Self

import numpy as np

from solve.argument import first_is
from solve.arrays import Array, Plane
from solve.contracts import (
    Columns,
    Dependence,
    Formulas,
    ManyPoints,
    Marcher,
    Matrices,
    ModeShape,
    Motion,
    Reduction,
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
from solve.statistics import Limit, Statistics
from solve.trigonometric import Trigonometric

_EPS = float(np.finfo(float).eps)

_ROUNDING = 64 * _EPS
"""Part of the whole equation that counts as rounding."""

_MEMORY = 2**24
"""Bytes of matrices that are asked for at a time."""

_LOOKS = 128
"""Phases of a period at which a load is looked for."""

PERIODIC = 1e-9
"""Relative difference between the matrices at both ends of the period that counts as none."""


class PeriodicSystem(Labels):
    """Matrices over the phase φ = Ωt, and the names of the coordinates.

    matrices(phase, speed): for phases of shape (m,) and a speed Ω in rad/s returns M, C, K of shape
    (m, n, n) and d of shape (m, n), in SI units, for derivatives by time.
    coordinates: n names. period: of the matrices, in phase. breaks: phases where the matrices jump;
    they are always ends of steps, and matrices are sampled on either side only.

    >>> import numpy as np
    >>> def oscillator(phase, speed):
    ...     one = np.ones((len(phase), 1, 1))
    ...     return one, 0.1 * one, 4.0 * one, np.cos(phase)[:, None]
    >>> PeriodicSystem(oscillator, ["q"]).n
    1
    """

    reduction: Reduction | None = None
    """Reduction from a larger system; None for a full system."""

    def __init__(
        self,
        matrices: Callable[[Array, float], Sequence[Array]],
        coordinates: Sequence[str],
        period: float = 2 * math.pi,
        breaks: Sequence[float] = (),
    ):
        self.period = _checked_period(period)
        texts = all(isinstance(name, str) for name in coordinates)
        if not texts or len(set(coordinates)) != len(coordinates) or len(coordinates) < self.vibrates:
            raise ValueOutOfBoundsError(
                f"coordinates are {list(coordinates)}; give each of the n coordinates a name of its own"
            )
        if not all(math.isfinite(b) for b in breaks):
            raise ValueOutOfBoundsError(f"breaks are {list(breaks)}; allowed: finite phases")
        self._matrices = matrices
        self.coordinates = tuple(coordinates)
        self.breaks = tuple(float(b) for b in breaks)

    @classmethod
    def from_samples(
        cls, M: Array, C: Array, K: Array, d: Array, coordinates: Sequence[str], period: float = 2 * math.pi
    ) -> "PeriodicSystem":
        """From samples (k, n, n), d (k, n) on a uniform grid over the period without its end point.

        Between the samples the matrices are their trigonometric interpolant, so that at least as many
        samples are needed as twice the highest harmonic that matters. They hold for the speed at
        which they were taken; a sweep over speeds needs a function instead.
        """
        period = _checked_period(period)
        samples = _real((M, C, K, d), "samples")
        counts = {len(part) if part.ndim else 0 for part in samples}
        if len(counts) != 1 or 0 in counts:
            raise MatricesError(
                f"samples of M, C, K, d have shapes {[part.shape for part in samples]}; "
                "give the same number of phases, 1 or more, first in each"
            )
        curves = [Trigonometric(part, period) for part in samples]

        def matrices(phase: Array, speed: float) -> Matrices:
            M, C, K, d = (curve(phase) for curve in curves)
            return M, C, K, d

        return cls(matrices, coordinates, period)

    def at(self, phase: Array, speed: float) -> Matrices:
        """M, C, K (m, n, n) and d (m, n) at phases (m,), for derivatives by time.

        Raises MatricesError where the function gives something else, or NaN or infinite entries.
        """
        # A function of the user may change its argument in place.
        given = phase if phase.flags.writeable else phase.copy()
        try:
            found = self._matrices(given, speed)
        except (IndexError, TypeError, ValueError) as error:
            m = len(phase)
            error.add_note(
                f"The function was asked for its matrices at {m} phases at once: M, C, K must have the shape "
                f"({m}, {self.n}, {self.n}) and d ({m}, {self.n})."
            )
            raise
        M, C, K, d = _real(found, "matrices")
        for symbol, part in zip("MCKd", (M, C, K, d), strict=True):
            if not np.isfinite(part).all():
                first = int(np.argmin(np.isfinite(part).reshape(len(part), -1).all(axis=1)))
                raise MatricesError(
                    f"{symbol} has NaN or infinite entries at phase {phase[first % len(phase)]:.6g}; "
                    "check the parameters and the function that gives the matrices"
                )
        return M, C, K, d

    def in_phase(self, phase: Array, speed: float) -> Matrices:
        """The same for derivatives by the phase: Ω²M, ΩC, K, d."""
        M, C, K, d = self.at(phase, speed)
        return speed**2 * M, speed * C, K, d

    def output_values(
        self, phase: Array, speed: Array | float, q: Array, qd: Array, qdd: Array, acceleration: float = 0.0
    ) -> Mapping[str, Array]:
        """Outputs (k,) by name at phases (k,), Ω, one or (k,), in rad/s, and states q, q̇, q̈ (n, k),
        derivatives by time, while Ω̇ in rad/s² acts."""
        return {}

    def output_formulas(self, varied: Sequence[str] = ()) -> Formulas | None:
        """The outputs as C text in which parameters of these names may take any values; None where there is
        none."""
        return None

    def warnings(self, speed: float, linear: bool = True) -> list[str]:
        """About the equations themselves at a speed (rad/s), whatever their solution. linear: whether it is
        the linearised equations that are solved."""
        return list(self.equation_warnings)

    @property
    def judged_quantities(self) -> tuple[str, ...]:
        """Coordinates and outputs whose bounds tell whether a solution is to be trusted."""
        return ()

    def limits(self, quantities: Iterable[str], linear: bool = True) -> list[Limit]:
        """Those within which the model is trusted, of these quantities; linear: whether the linearised
        equations give the figures."""

        def not_finite(found: Statistics) -> Any:
            return ~np.isfinite(found.max - found.min)

        def says(name: str) -> Callable[[Statistics], str]:
            return lambda _: f"{name} is no finite number at some phases, and has no figures"

        return [Limit(name, not_finite, says(name)) for name in quantities]

    def judged(self, figures: Mapping[str, Statistics], linear: bool = True) -> list[str]:
        """Warnings where a solution with these figures by quantity leaves the limits, or gives a quantity no
        value; quantities without figures are not judged. linear: as in `limits`."""
        asked = ((limit, figures[limit.quantity]) for limit in self.limits(figures, linear))
        return [limit.says(found) for limit, found in asked if limit.left(found)]

    def varied(
        self, parameters: Mapping[str, float] | None = None, options: Mapping[str, Any] | None = None
    ) -> Self:
        """The same system with some parameters and options changed. Raises UnknownNameError."""
        for name in (*(parameters or {}), *(options or {})):
            require_name(f"parameter or option of {self.name}", name, [])
        return self

    def require_bounds(self, parameters: Mapping[str, float]) -> None:
        """Raise ValueOutOfBoundsError where a value leaves the bounds of its parameter."""

    def require_desired_motion(self, speeds: Array) -> None:
        """Raise DesiredMotionError if the fundamental motion does not exist at one of the speeds (P,),
        rad/s."""

    def require_load(self, speed: float) -> None:
        """Raise NoLoadError where d is zero all over the period, and the periodic vibration with it."""
        phase = (np.arange(_LOOKS) + 0.5) * (self.period / _LOOKS)
        if not self.at(phase, speed)[3].any():
            raise NoLoadError(f"{self.name} has no load: its periodic vibration is zero at every speed")

    def sketched(self, phase: Array, speed: float, q: Array) -> Mapping[str, Plane]:
        """The lines of its picture by name: places x + iy (points, k) for q (n, k) at phases (k,). Raises
        NoSketchError where it states none."""
        raise NoSketchError(
            f"{self.name} states no lines to draw; add mechanism.sketch(name, points) to its file and derive "
            "it again, see docs/motion.md"
        )

    def entries(self, phase: Array, speed: float) -> Array:
        """Ω²M, ΩC, K by rows and d beside each other, (m, 3n² + n), for derivatives by the phase."""
        made = np.concatenate([part.reshape(len(phase), -1) for part in self.at(phase, speed)], axis=1)
        made[:, : self.n**2] *= speed**2
        made[:, self.n**2 : 2 * self.n**2] *= speed
        return made

    def terms(self, phase: Array, speeds: Array) -> tuple[Array, Array, Array] | None:
        """What the entries are sums of: terms (k, R), their coefficients (P, R) at speeds (P,), and to which
        entry each belongs (R,), rising; None where there are the entries alone."""
        return None

    def entries_over(self, phase: Array, speeds: Array) -> Array:
        """The same at speeds (P,): (P, k, 3n² + n); NaN at speeds without matrices."""
        entries = np.full((len(speeds), len(phase), 3 * self.n**2 + self.n), np.nan)
        for rows, speed in zip(entries, speeds, strict=True):
            try:
                rows[:] = self.entries(phase, float(speed))
            except SolveError:
                # The solution at this speed fails for the same reason, and says so.
                continue
        return entries

    def along(self, motion: Motion, compiled: Columns | None = None) -> "PeriodicSystem":
        """The equations of motion r(φ, Ω, q, q̇, q̈) = 0 linearised along a motion q_k, with its period:
        M = ∂r/∂q̈, C = ∂r/∂q̇, K = ∂r/∂q and d = M q̈_k + C q̇_k + K q_k - r(q_k), so that its periodic
        solution is the next iterate of Newton's method (U. Ascher, R. Mattheij, R. Russell, Numerical
        Solution of Boundary Value Problems, 2.3.4). compiled: what evaluates formulas, where that is to be
        used. Raises LinearModelError for linear systems."""
        raise LinearModelError(
            f"{self.name} is linear by construction, its orbit is the linear one; leave out what asks for "
            "nonlinear equations"
        )

    def roundoff(self, phase: Array, speed: float) -> Array:
        """Bounds (k, n) on the round-off in the load d of equations linearised along a motion, at phases
        (k,), in units of the machine precision; terms of the load may cancel. Zero if the bounds are
        unknown."""
        return np.zeros((len(phase), self.n))

    @property
    def smooth_parameters(self) -> tuple[str, ...]:
        """Names of the parameters by which the equations have derivatives."""
        return ()

    def break_slopes(self, names: Sequence[str]) -> Array:
        """Derivatives (b, r) of the phases of the breaks by parameters of a dependence, or the speed."""
        return np.zeros((len(self.breaks), len(names)))

    def dependence(self, names: Sequence[str], compiled: Columns | None = None) -> Dependence:
        """On parameters, or "speed", by their names; compiled: what evaluates formulas, where that is to be
        used. Raises UnknownNameError, NoDerivativeError."""
        raise NoDerivativeError(
            f"{self.name} has no generated equations that could be differentiated; state it as a mechanism "
            "and derive it"
        )

    def varying(self, phase: Array, speed: Array, acceleration: float) -> Matrices:
        """M, C, K (m, n, n) and d (m, n), for derivatives by time, where the drive turns at speeds (m,) in
        rad/s that change by an acceleration in rad/s². Raises TransientError for systems of which that is not
        known."""
        raise TransientError(
            f"{self.name} states nothing of speeds that vary; state it as a mechanism and derive it"
        )

    def marcher(self, sizes: Array, count: int, rtol: float) -> Marcher:
        """Period after period of the equations of motion from any state, `count` states a period; sizes (n,)
        of the coordinates, to which rtol is relative. Raises TransientError for systems without generated
        code."""
        raise TransientError(
            f"{self.name} has no generated equations of motion that could be followed in time; state it as a "
            "mechanism and derive it"
        )

    @property
    def nonlinear(self) -> bool:
        """Whether there are nonlinear equations, which `along` linearises along any motion."""
        return False

    def many_points(self, names: Sequence[str]) -> ManyPoints | None:
        """What gives matrices and outputs at all points at once, where parameters of these names vary; None
        where every point needs a system of its own."""
        return None

    @property
    def moves_breaks(self) -> bool:
        """Whether the phases at which the matrices jump depend on parameters."""
        return False

    @property
    def freedoms(self) -> int:
        """How many ways to move the system has at rest."""
        return self.n

    @property
    def most_frequencies(self) -> int:
        """How many natural frequencies can be asked for."""
        return self.freedoms

    def frequencies(self, positions: Array, count: int) -> Array | None:
        """Natural frequencies (m, count) in rad/s at positions (m,) from the elements of a structure; None if
        they are those of M and K at speed 0."""
        return None

    def mode_shapes(self, position: float, frequencies: Array) -> list[ModeShape]:
        """How the links move at the lowest frequencies (k,) of a position. Raises ValueOutOfBoundsError
        where there are no links."""
        raise ValueOutOfBoundsError(
            f"{self.name} has no links to draw; ask a structure of beams for its mode shapes"
        )

    def pinned_frequencies(self) -> dict[str, float]:
        """Lowest frequency (rad/s) of each link by itself, pinned at both ends."""
        return {}

    def checked(self, speed: float) -> None:
        """Raise MatricesError unless the matrices have their shapes and are periodic, and M can be
        inverted."""
        n, inset = self.n, 1e-12 * self.period
        jumps_at_zero = any(abs(math.remainder(b, self.period)) <= inset for b in self.breaks)
        phase = np.array([0.0, 0.281, 0.618, 1.0]) * self.period
        if self.breaks:
            phase[[0, -1]] += [inset, -inset]
        parts = dict(zip("MCKd", self.at(phase, speed), strict=True))
        for symbol, part in parts.items():
            expected = (4, n) if symbol == "d" else (4, n, n)
            if part.shape != expected:
                raise MatricesError(
                    f"{symbol} at 4 phases has shape {part.shape}; for {n} coordinates "
                    f"({', '.join(self.coordinates)}) it must be {expected}"
                )
        for symbol, change in () if jumps_at_zero else self.changes(phase[:1], phase[-1:], speed):
            raise MatricesError(
                f"{symbol} is not periodic: between phase 0 and {self.period:.6g} it changes by "
                f"{change:.3g}; give the right period, or the jump at 0 as a break"
            )
        require_inertia(parts["M"])

    def changes(self, phase: Array, later: Array, speed: float) -> list[tuple[str, float]]:
        """Which of M, C, K, d differ between phases (k,) and those a period later, and by how much: beyond
        1e-9 of their size, beyond rounding of the whole equation (a load that cancels is zero but for
        that), and beyond what a rounding of the phase makes (within a narrow pulse)."""
        every = self.in_phase(self.beside(phase, later), speed)
        first, second, beside = zip(*(np.split(part, 3) for part in every), strict=True)
        found, rates = [], (speed**2, speed, 1.0, 1.0)
        none = _negligible(first)
        for symbol, allowed, rate, *parts in zip("MCKd", none, rates, first, second, beside, strict=True):
            one, other, near = parts
            if (np.abs(other - one) > allowed + 2 * np.abs(near - one)).any():
                found.append((symbol, float(np.abs(parts[1] - parts[0]).max()) / rate))
        return found

    def negligible(self, matrices: Matrices, speed: float) -> Matrices:
        """Changes (n, n) and (n,) of M, C, K (m, n, n) and d (m, n) that count as none, as in `changes`."""
        rates = speed**2, speed, 1.0, 1.0
        none = _negligible([rate * part for rate, part in zip(rates, matrices, strict=True)])
        M, C, K, d = (part / rate for rate, part in zip(rates, none, strict=True))
        return M, C, K, d

    def beside(self, phase: Array, later: Array) -> Array:
        """Phases (k,), those about a period later, and behind them phases beside the first (3k,), which are
        apart by what rounding leaves of the period."""
        apart = phase + np.maximum(np.abs(later - phase - self.period), 8 * _EPS * self.period)
        return np.concatenate((phase, later, apart))


of_any_system = first_is(PeriodicSystem, such_as="solve.load('cam')")
"""Before a public function of a system."""

of_system = first_is(PeriodicSystem, such_as="solve.load('cam')", demand=require_vibration)
"""Decorator of public functions that require a vibrating system."""


def _checked_period(period: float) -> float:
    if isinstance(period, str) or not (math.isfinite(period) and period > 0):
        raise ValueOutOfBoundsError(f"period is {period!r}; allowed: a finite phase > 0, such as 2π")
    return float(period)


def _real(given: Sequence[Array], kind: str) -> Matrices:
    """Four arrays of floats. Raises MatricesError."""
    try:
        M, C, K, d = (np.asarray(part).astype(float, casting="same_kind", copy=False) for part in given)
    except (TypeError, ValueError) as error:
        raise MatricesError(f"the {kind} are no four real arrays M, C, K, d: {error}") from None
    return M, C, K, d


def _negligible(matrices: Sequence[Array]) -> list[Array]:
    """Changes of M, C, K and d, in the same unit, that count as none: 1e-9 of their size and the rounding of
    the whole equation."""
    inertia = np.abs(np.einsum("kii->ki", matrices[0])).max(axis=0)
    unit = 1 / np.sqrt(np.where(inertia > 0, inertia, 1.0))
    scales = [unit[:, None] * unit] * 3 + [unit]
    sizes = [float(np.abs(part * scale).max()) for part, scale in zip(matrices, scales, strict=True)]
    return [
        max(PERIODIC * size, _ROUNDING * max(sizes)) / scale
        for size, scale in zip(sizes, scales, strict=True)
    ]


def require_inertia(M: Array) -> None:
    """Raise MatricesError where one of the matrices (k, n, n) is singular."""
    diagonal = np.sqrt(np.abs(np.einsum("kii->ki", M)))
    diagonal[diagonal == 0.0] = 1.0
    scaled = M / (diagonal[:, :, None] * diagonal[:, None, :])
    singular = np.linalg.cond(scaled) > 0.1 / _EPS
    # Equations need not be in the units that an energy of the coordinates would give them.
    for axis in (2, 1, 2, 1) if singular.any() else ():
        largest = np.abs(scaled).max(axis=axis, keepdims=True)
        scaled = scaled / np.where(largest > 0, largest, 1.0)
    if singular.any() and np.linalg.cond(scaled).max() > 0.1 / _EPS:
        raise MatricesError(
            "M is singular: some coordinate has no inertia; give every coordinate a mass, "
            "or leave a massless coordinate out"
        )
