"""Data classes and protocols shared by systems and solvers, so that neither imports the other."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from solve.arrays import Array

Matrices = tuple[Array, Array, Array, Array]
"""M, C, K (m, n, n) and d (m, n) at m phases."""


class Statistics(NamedTuple):
    """Statistics over a period of the continuous curve of a quantity.

    Attributes
    ----------
    max, min, max_abs, mean : float
        Maximum, minimum, largest modulus and mean.
    max_phase, min_phase : float
        Phases of the maximum and of the minimum in rad.
    rms : float
        Root mean square.
    """

    max: float
    min: float
    max_abs: float
    mean: float
    max_phase: float
    min_phase: float
    rms: float


class Limit(NamedTuple):
    """Limit on the statistics of a quantity.

    exceeded: function of the statistics of one solution, or of arrays of the statistics of many, that returns
    whether they violate the limit. message: function that returns the warning for one solution.
    """

    quantity: str
    exceeded: Callable[[Statistics], Any]
    message: Callable[[Statistics], str]

    @classmethod
    def finite(cls, name: str) -> "Limit":
        """Limit that requires a quantity to be finite."""
        text = f"{name} is not finite at some phases, so it has no statistics"
        return cls(name, lambda values: ~np.isfinite(values.max - values.min), lambda _: text)


class ModeShape(NamedTuple):
    """Mode shape with its frequency (rad/s), scaled so that its largest displacement is 1.

    places: positions x, y along each link, (points, 2), in m. displacements: displacements x, y at these
    positions, relative to the largest displacement. transverse: displacements perpendicular to each link,
    (points,). modal_mass: kg.
    """

    frequency: float
    modal_mass: float
    places: tuple[Array, ...]
    displacements: tuple[Array, ...]
    transverse: tuple[Array, ...]


class DrawnLink(NamedTuple):
    """Name of a link, and supports of its start and end. A support is "pinned" or "clamped" to the ground,
    "joined" to other links by a pin, or "" if the end is welded to other links or free."""

    name: str
    ends: tuple[str, str]


class Formulas(NamedTuple):
    """C function `void formulas(const lane *const *in, lane *out)` of a model, and names and values of its
    parameters.

    text: source. outputs: number of outputs. names, values (p,), or (P, p) at many points: names and values
    of the parameters, which are the last input. The other inputs are phase, speed and, for the outputs of a
    model, q, q̇, q̈. `lane` is a vector of doubles, one per point.
    """

    text: str
    outputs: int
    names: tuple[str, ...]
    values: Array


Columns = Callable[..., Array | None]
"""Type of functions that evaluate formulas by compiled code for inputs (width, k), one column per evaluation.
They return values (outputs, k) or weighted sums (outputs, c); None where compiled code is unavailable. See
`solve.kernel.formulas.columns`."""


class Integrator(Protocol):
    """Protocol of time integration of a system over a period, with states at nodes (k,) from 0 to the period.

    Derivatives are with respect to time multiplied by the mean speed, which is the phase at constant speed.
    """

    @property
    def nodes(self) -> Array: ...

    def __call__(self, state: Array, start: float, speed: float, last: float | None = None) -> Array:
        """Integrate q, v, a (3, n, k) over a period, including both ends, from the state (q, v) (2n,) at the
        phase `start`. The speed changes linearly in time to `last` (default: constant speed). Raises
        TransientError if the integration fails."""
        ...


class Dependence(Protocol):
    """Derivatives of the equations and outputs of a system with respect to quantities θ (r,).

    States (k, 3, n) at phases (k,) are q″, q′ and q, with derivatives with respect to the phase. They are
    held constant unless stated otherwise. linear: whether the equations are linear. partial_outputs: whether
    `output` is available.
    """

    linear: bool
    partial_outputs: bool

    @property
    def less_accurate(self) -> "Dependence":
        """Derivatives by differences of lower order, for error estimates; the object itself if its
        derivatives are exact."""
        return self

    def residual(self, phase: Array, speed: float, states: Array) -> Array:
        """Derivatives (k, n, r) of M q″ + C q′ + K q - d, or of the residual of nonlinear equations."""
        ...

    def weighted_residual(self, phase: Array, speed: float, states: Array, weights: Array) -> Array:
        """Sums (r, c), over phases and rows with weights (k, n, c), of the derivatives that `residual`
        returns."""
        return np.einsum("knr,knc->rc", self.residual(phase, speed, states), weights)

    def matrices(self, phase: Array, speed: float, states: Array, weights: Array) -> tuple[Array, Array]:
        """Derivatives of the sum of the entries of M, C and K with weights (k, 3, n, n), where M, C and K are
        the derivatives of the residual with respect to the states. Returns derivatives with respect to θ
        (r,), and with respect to the states (k, 3, n); the latter are 0 for linear equations."""
        ...

    def output(self, name: str, phase: Array, speed: float, states: Array) -> tuple[Array, Array]:
        """Partial derivatives of an output: with respect to θ (k, r), and to the states (k, 3, n)."""
        ...

    def output_with_states(self, name: str, phase: Array, speed: float, states: Array, moved: Array) -> Array:
        """Total derivatives (k, r) of an output. moved (k, 3, n, r): derivatives of the states."""
        by_parameters, by_states = self.output(name, phase, speed, states)
        return by_parameters + np.einsum("kcn,kcnr->kr", by_states, moved)


class ParameterDerivatives(Protocol):
    """Derivatives of a system with respect to its parameters."""

    @property
    def names(self) -> tuple[str, ...]:
        """Parameters with respect to which the equations are differentiable."""
        ...

    def of_breaks(self, names: Sequence[str]) -> Array:
        """Derivatives (b, r) of the phases of the breaks with respect to parameters or, for the name "speed",
        the speed."""
        ...

    def by(self, names: Sequence[str], compiled: Columns | None = None) -> Dependence:
        """Derivatives with respect to the named parameters or, for the name "speed", the speed. compiled:
        compiled evaluation of formulas, if available. Raises UnknownNameError, NoDerivativeError."""
        ...


class Structure(Protocol):
    """Beam structure of a mechanism held at given positions."""

    @property
    def freedoms(self) -> int:
        """Number of degrees of freedom at rest."""
        ...

    @property
    def most_frequencies(self) -> int:
        """Maximum number of natural frequencies that can be computed."""
        ...

    def frequencies(self, positions: Array, count: int) -> Array:
        """Natural frequencies (m, count) in rad/s at positions (m,)."""
        ...

    def mode_shapes(self, position: float, frequencies: Array) -> list[ModeShape]:
        """Mode shapes of the links at a position, for the lowest frequencies (k,)."""
        ...

    def pinned_frequencies(self) -> dict[str, float]:
        """Lowest bending frequency (rad/s) of each separate link, pinned at both ends."""
        ...


def driven(s: Any, first: Any, last: Any, period: float) -> tuple[Any, Any, Any]:
    """Phase within a period, speed and acceleration (rad, rad/s, rad/s²) of a drive whose speed changes
    linearly in time from `first` to `last`. s: time multiplied by the mean speed, from 0 to the period; a
    number or a symbol."""
    mean, slope = (first + last) / 2, (last - first) / period
    return (first * s + slope * s**2 / 2) / mean, first + slope * s, slope * mean


@runtime_checkable
class Motion(Protocol):
    """Periodic motion over phases from 0 to the last of its nodes (m+1,).

    An optional method `states` returns q, q′, q″ (n, k) at phases (k,) at once.
    """

    @property
    def nodes(self) -> Array: ...

    def __call__(self, phase: Array, derivative: int = 0) -> Array:
        """q (n, k), or its derivative with respect to the phase, at phases (k,) of any period."""
        ...


class Reduction(Protocol):
    """Reduction of a system to fewer coordinates.

    modes_a_link: number of modes retained per link. full_coordinates: number of coordinates before the
    reduction. discarded: lowest frequency of the discarded modes, rad/s. enriched: larger reduced system, for
    the error estimate.
    """

    modes_a_link: int

    @property
    def sentence(self) -> str:
        """Sentence on the error of the natural frequencies."""
        ...

    @property
    def full_coordinates(self) -> int: ...

    @property
    def discarded(self) -> float: ...

    @property
    def enriched(self) -> Any: ...

    def expanded(self, phase: Array, speed: Array | float, *state: Array) -> Any:
        """State in all coordinates at phases (k,), from q, q̇, q̈ (n, k). Its `q` has the shape
        (full_coordinates, k)."""
        ...


class Events(NamedTuple):
    """Phases (rad) at which a motion passes switches of the equations, such as stops, and phases at which the
    motion grazes a switch. sides: sides of each switch on which the motion lies, as the signs of the smallest
    and largest value of the switch."""

    phases: tuple[float, ...] = ()
    grazing: tuple[float, ...] = ()
    sides: tuple[tuple[float, float], ...] = ()
