"""Linear system with periodic coefficients, M(Ωt)q″ + C(Ωt)q′ + K(Ωt)q = d(Ωt) (chapter Eq. (2))."""

import math
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from typing import Any, Self, TypeVar

from solve.arguments import conforms, described, first_is, matches_annotations
from solve.arrays import Array
from solve.capabilities import Capabilities
from solve.contracts import Matrices
from solve.errors import MatricesError, ValueOutOfBoundsError, counted, require_name
from solve.labels import Labels, require_vibration
from solve.matrices import (
    changes,
    checked_phases,
    finite_phases,
    jumps_at_zero,
    real_arrays,
    require_finite_entries,
    require_inertia,
    require_shapes,
    with_neighbours,
)
from solve.samples import Samples, checked_period, sampled
from solve.units import unit_given


class PeriodicSystem:
    """Linear system with periodic coefficients and named coordinates.

    Parameters
    ----------
    matrices : callable
        matrices(phase, speed) returns M, C, K of shape (m, n, n) and d of shape (m, n) for phases φ = Ωt of
        shape (m,) and a speed Ω in rad/s. Units are SI, derivatives with respect to time.
    coordinates : sequence of str
        Names of the n coordinates.
    period : float
        Period of the matrices in phase.
    breaks : sequence of float
        Phases at which the matrices jump. Steps always end at breaks, and the matrices are sampled on both
        sides.
    inputs : sequence of str
        Names of the r inputs u of M q̈ + C q̇ + K q = d + B u. If there are inputs, `matrices` returns M, C,
        K, d and B, where B has the shape (m, n, r). Results are for u = 0; `solve.lqr` computes feedback.

    Raises
    ------
    ValueOutOfBoundsError
        If names, period or breaks are invalid.

    Notes
    -----
    `capabilities` contains the abilities that only some systems have.

    Examples
    --------
    >>> import numpy as np
    >>> def oscillator(phase, speed):
    ...     one = np.ones((len(phase), 1, 1))
    ...     return one, 0.1 * one, 4.0 * one, np.cos(phase)[:, None]
    >>> PeriodicSystem(oscillator, ["q"]).n
    1
    """

    _builder: Callable[[Mapping[str, float]], Any] | None = None
    """Function that builds the system from values of its parameters. None for systems without parameters, and
    for models, which change their setup instead."""

    _FEWEST = 1
    """Smallest number of coordinates."""

    labels: Labels = Labels()
    """Names, parameter values, units and meanings."""

    states: tuple[str, ...] = ()
    """Names of the coordinates without second derivatives, which come last."""
    inputs: tuple[str, ...] = ()
    """Names of the inputs u, such as forces of drives. Inputs are zero unless a controller sets them."""
    outputs: tuple[str, ...] = ()
    """Names of the quantities computed from the state."""

    @matches_annotations
    def __init__(
        self,
        matrices: Callable[[Array, float], Sequence[Array]],
        coordinates: Sequence[str],
        period: float = 2 * math.pi,
        breaks: Sequence[float] = (),
        inputs: Sequence[str] = (),
    ):
        self.period = checked_period(period)
        # An iterator can be read only once, and a text is one name.
        coordinates = [coordinates] if isinstance(coordinates, str) else [*coordinates]
        breaks = [*breaks]
        if len(set(coordinates)) != len(coordinates) or len(coordinates) < self._FEWEST:
            raise ValueOutOfBoundsError(
                f"coordinates are {coordinates}; give each of the n coordinates a different name"
            )
        if not all(conforms(b, float) and math.isfinite(b) for b in breaks):
            raise ValueOutOfBoundsError(f"breaks are {described(breaks)}; allowed: finite phases")
        self._matrices = matrices
        self.coordinates = tuple(coordinates)
        self.breaks = tuple(float(b) for b in breaks)
        self.inputs = tuple(inputs)
        require_own_names("inputs", self.inputs, coordinates)
        self._symbols = "MCKdB" if self.inputs else "MCKd"

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
        """Create a system from samples of the matrices at azimuths of the period.

        Between the azimuths, the matrices are interpolated by a Fourier series. Results state the
        interpolation error, and the number of azimuths that would suffice.

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
            Azimuths in rad, in any order. By default, they are uniform from 0, without the end of the period.

        Returns
        -------
        PeriodicSystem

        Raises
        ------
        MatricesError
            If the samples are not real arrays of equal length, or the azimuths do not determine the matrices.

        Examples
        --------
        >>> import numpy as np
        >>> one = np.ones((8, 1, 1))
        >>> PeriodicSystem.from_samples(one, 0.1 * one, 4 * one, one[:, 0], ["q"]).coordinates
        ('q',)
        """
        samples = sampled((M, C, K, d), "MCKd", period, phases)
        return cls(samples, coordinates, samples.period)

    @property
    def capabilities(self) -> Capabilities:
        """Abilities that only some systems have. An ability that this system lacks is None."""
        samples = self._matrices if isinstance(self._matrices, Samples) else None
        return Capabilities(samples=samples, input_matrix=self._inputs_at if self.inputs else None)

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return len(self.coordinates)

    @matches_annotations
    def at(self, phase: Array, speed: float) -> Matrices:
        """M, C, K (m, n, n) and d (m, n) at phases (m,), for derivatives with respect to time.

        Raises MatricesError if the function `matrices` does not return real arrays, or returns NaN or
        infinite entries."""
        M, C, K, d, *_ = self._called(phase, speed, self._symbols, "M, C, K", "d")
        return M, C, K, d

    def _inputs_at(self, phase: Array, speed: float) -> list[Array]:
        """Sequence that contains only the array B (m, n, r) at phases (m,)."""
        return self._called(phase, speed, self._symbols, "M, C, K", "d")[4:]

    def _called(self, phase: Array, speed: float, symbols: str, square: str, vector: str) -> list[Array]:
        """Call the function `matrices` at phases (m,), and return finite real arrays, one per symbol in
        `symbols`. Raises MatricesError.

        square, vector: symbols of the arrays of shape (m, n, n) and (m, n), for the message."""
        # A read-only array is copied, because the user's function may modify its argument.
        phase = finite_phases(phase)
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

    @matches_annotations
    def varied(
        self, parameters: Mapping[str, Any] | None = None, options: Mapping[str, Any] | None = None
    ) -> Self:
        """System with some parameters and options changed. Raises UnknownNameError."""
        for name in (*(parameters or {}), *(options or {})):
            require_name(f"parameter or option of {self.labels.name}", name, self.labels.parameters)
        if self._builder is None or not parameters:
            return self
        return self._builder({**self.labels.parameters, **parameters})

    def _check(self, speed: float) -> None:
        """Raise MatricesError unless the matrices have the required shapes and are periodic, and M is
        regular."""
        n, phase = self.n, checked_phases(self.period, self.breaks)
        matrices = dict(zip("MCKd", self.at(phase, speed), strict=True))
        shapes = dict.fromkeys("MCK", (4, n, n)) | {"d": (4, n)}
        require_shapes(matrices, shapes, f"{counted(n, 'coordinate')} ({', '.join(self.coordinates)})")
        self._require_periodicity(phase, speed, "MCKd")
        require_inertia(matrices["M"])

    def _require_periodicity(self, phase: Array, speed: float, symbols: str) -> None:
        """Raise MatricesError unless M, C, K and d are periodic. symbols: letters for M, C, K and d, in this
        order, in messages."""
        if jumps_at_zero(self.period, self.breaks):
            return
        ends = in_phase(self, with_neighbours(phase[:1], phase[-1:], self.period), speed)
        for symbol, change in changes(ends, speed):
            raise MatricesError(
                f"{symbols['MCKd'.index(symbol)]} is not periodic: between phase 0 and {self.period:.6g} it "
                f"changes by {change:.3g}; give the correct period, or state the jump at 0 as a break"
            )


def require_own_names(kind: str, names: Sequence[str], others: Sequence[str]) -> None:
    """Raise ValueOutOfBoundsError unless `names` is a sequence of distinct strings, none of which is in
    `others`."""
    texts = not isinstance(names, str) and all(isinstance(name, str) for name in names)
    if not texts or len({*others, *names}) != len(others) + len(names):
        raise ValueOutOfBoundsError(
            f"{kind} are {names!r}; give a list of distinct names that are not used for other quantities"
        )


def multiplier_count(system: PeriodicSystem) -> int:
    """Number of Floquet multipliers: two per coordinate with second derivatives, one per coordinate without
    second derivatives."""
    return 2 * system.n - len(system.states)


System = TypeVar("System", bound=PeriodicSystem)


def relabelled(system: System, **labels: Any) -> System:
    """Copy of a system with some labels changed."""
    labelled = copy(system)
    labelled.labels = replace(system.labels, **labels)
    return labelled


def built_by(
    system: System, builder: Callable[[Mapping[str, float]], Any], parameters: Mapping[str, float]
) -> System:
    """Copy of a system that stores the values of its parameters, and the function that builds the system from
    values of its parameters."""
    built = relabelled(system, parameters=dict(parameters))
    built._builder = builder
    return built


def shown_in(system: System, speed: float) -> System:
    """Copy of a system that displays speeds in the unit of `speed`, if `speed` was given with a unit."""
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
    """Whether a copy and a system have equal attributes. The display unit and cached values are not
    compared."""
    return replace(copied.labels, speed_unit=system.labels.speed_unit) == system.labels and all(
        vars(copied).get(name) is value
        for name, value in vars(system).items()
        if name != "labels" and not isinstance(getattr(type(system), name, None), cached_property)
    )


def in_phase(system: PeriodicSystem, phase: Array, speed: float) -> Matrices:
    """Ω²M, ΩC, K (m, n, n) and d (m, n), for derivatives with respect to the phase. Raises the exceptions of
    `PeriodicSystem.at`."""
    M, C, K, d = system.at(phase, speed)
    return speed**2 * M, speed * C, K, d


def check(system: PeriodicSystem, speed: float) -> None:
    """Raise MatricesError unless the matrices have the required shapes and are periodic, and M is regular.
    The matrices of a model must also pass the checks of generated matrices."""
    system._check(speed)


def with_samples(system: System, samples: Samples) -> System:
    """Copy of a system with other samples of its matrices."""
    sampled = copy(system)
    sampled._matrices = samples
    return sampled


of_any_system = first_is(PeriodicSystem, such_as="solve.load('cam')")
"""Decorator for public functions of a system."""

of_system = first_is(PeriodicSystem, such_as="solve.load('cam')", demand=require_vibration)
"""Decorator for public functions that require a system that can vibrate."""
