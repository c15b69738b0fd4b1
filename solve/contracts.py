"""Data classes and protocols shared by systems and solvers, so that neither imports the other."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from solve.arrays import Array

Matrices = tuple[Array, Array, Array, Array]
"""M, C, K (m, n, n) and d (m, n) at m phases."""


class Statistics(NamedTuple):
    """Statistics of the continuous curve of a quantity over a period.

    Attributes
    ----------
    max, min, max_abs, mean : float
        Maximum, minimum, largest absolute value and mean.
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

    exceeded: function that returns whether statistics violate the limit; its argument contains numbers for
    one solution, or arrays for many. message: function that returns the warning for one solution."""

    quantity: str
    exceeded: Callable[[Statistics], Any]
    message: Callable[[Statistics], str]

    @classmethod
    def finite(cls, name: str) -> "Limit":
        """Limit that requires a quantity to be finite."""
        text = f"{name} is not finite at some phases, so it has no statistics"
        return cls(name, lambda values: ~np.isfinite(values.max - values.min), lambda _: text)


class ModeShape(NamedTuple):
    """Mode shape and its frequency in rad/s. The shape is scaled so that its largest displacement is 1.

    places: for each link, positions x, y in m, (points, 2). displacements: for each link, displacements x, y
    at these positions, relative to the largest displacement. transverse: for each link, displacements
    (points,) perpendicular to it. modal_mass: modal mass in kg."""

    frequency: float
    modal_mass: float
    places: tuple[Array, ...]
    displacements: tuple[Array, ...]
    transverse: tuple[Array, ...]


class DrawnLink(NamedTuple):
    """Name of a link, and the supports of its start and end.

    A support is "pinned" or "clamped" if it is on the ground, "joined" if a pin connects the end with other
    links, or "" if the end is free or welded to other links."""

    name: str
    ends: tuple[str, str]


class Formulas(NamedTuple):
    """C function `void formulas(const lane *const *in, lane *out)` of a model, and the values of its
    parameters.

    text: source code. outputs: number of outputs. names: names of the parameters, which are the last input.
    values: values of the parameters, (p,), or (P, p) for P points. The other inputs are phase, speed and, for
    the outputs of a model, q, q̇, q̈. `lane` is a vector of doubles, one per point."""

    text: str
    outputs: int
    names: tuple[str, ...]
    values: Array


Columns = Callable[..., Array | None]
"""Type of functions that evaluate formulas by compiled code.

Each input is an array (width, k) with one column per evaluation. The functions return values (outputs, k), or
weighted sums (outputs, c) of the values; None if compiled code is not available. See
`solve.kernel.formulas.columns`."""


class Integrator(Protocol):
    """Protocol of the time integration of a system over one period, with states at `nodes` (k,) from 0 to the
    period.

    The independent variable of the derivatives is the mean speed times time. At constant speed, this is the
    phase."""

    @property
    def nodes(self) -> Array: ...

    def __call__(self, state: Array, start: float, speed: float, last: float | None = None) -> Array:
        """Integrate over one period, from the state (q, v) (2n,) at the phase `start`. Return q, v and a, as
        an array (3, n, k), at the k nodes, which include both ends.

        The speed varies linearly in time from `speed` to `last`; by default, it is constant. Raises
        TransientError if the integration fails."""
        ...


class Dependence(Protocol):
    """Derivatives of the equations and outputs of a system with respect to quantities θ (r,).

    States (k, 3, n) at phases (k,) are q″, q′ and q, with derivatives with respect to the phase. The
    derivatives with respect to θ are at constant states unless stated otherwise. linear: whether the
    equations are linear. partial_outputs: whether `output` is available."""

    linear: bool
    partial_outputs: bool

    @property
    def less_accurate(self) -> "Dependence":
        """Derivatives by finite differences of lower order, for error estimates. If the derivatives are
        exact, the object itself is returned."""
        return self

    def residual(self, phase: Array, speed: float, states: Array) -> Array:
        """Derivatives (k, n, r) of M q″ + C q′ + K q - d, or of the residual of nonlinear equations."""
        ...

    def weighted_residual(self, phase: Array, speed: float, states: Array, weights: Array) -> Array:
        """Weighted sums (r, c) of the derivatives that `residual` returns, over phases and rows. The weights
        are (k, n, c)."""
        return np.einsum("knr,knc->rc", self.residual(phase, speed, states), weights)

    def matrices(self, phase: Array, speed: float, states: Array, weights: Array) -> tuple[Array, Array]:
        """Derivatives of a weighted sum of the entries of M, C and K. These entries are the derivatives of
        the residual with respect to the states. The weights are (k, 3, n, n).

        Return the derivatives (r,) with respect to θ, and the derivatives (k, 3, n) with respect to the
        states. The second array is 0 for linear equations.
        """
        ...

    def output(self, name: str, phase: Array, speed: float, states: Array) -> tuple[Array, Array]:
        """Return the partial derivatives of an output with respect to θ, (k, r), and to the states, (k, 3,
        n)."""
        ...

    def output_with_states(self, name: str, phase: Array, speed: float, states: Array, moved: Array) -> Array:
        """Total derivatives (k, r) of an output with respect to θ. moved (k, 3, n, r): derivatives of the
        states."""
        by_parameters, by_states = self.output(name, phase, speed, states)
        return by_parameters + np.einsum("kcn,kcnr->kr", by_states, moved)


class ParameterDerivatives(Protocol):
    """Derivatives of a system with respect to its parameters."""

    @property
    def names(self) -> tuple[str, ...]:
        """Parameters with respect to which the equations are differentiable."""
        ...

    def of_breaks(self, names: Sequence[str]) -> Array:
        """Derivatives (b, r) of the phases of the breaks, with respect to the named parameters or, for the
        name "speed", to the speed."""
        ...

    def by(self, names: Sequence[str], compiled: Columns | None = None) -> Dependence:
        """Derivatives of the equations, with respect to the named parameters or, for the name "speed", to the
        speed.

        compiled: evaluation of formulas by compiled code, if available. Raises UnknownNameError,
        NoDerivativeError.
        """
        ...


class Structure(Protocol):
    """Beam structure of a mechanism at rest in given positions."""

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
        """Mode shapes of the links at a position. `frequencies` (k,) contains the lowest natural
        frequencies."""
        ...

    def pinned_frequencies(self) -> dict[str, float]:
        """Mapping from links to the lowest bending frequency (rad/s) of the single link with pinned ends."""
        ...


def driven(s: Any, first: Any, last: Any, period: float) -> tuple[Any, Any, Any]:
    """Return the phase within a period, the speed and the acceleration (rad, rad/s, rad/s²) of a drive whose
    speed varies linearly in time from `first` to `last`.

    s: time multiplied by the mean speed, from 0 to the period. It may be a number or a symbol."""
    mean, slope = (first + last) / 2, (last - first) / period
    return (first * s + slope * s**2 / 2) / mean, first + slope * s, slope * mean


@runtime_checkable
class Motion(Protocol):
    """Periodic motion. Its `nodes` (m+1,) are phases from 0 to the period.

    An optional method `states` returns q, q′ and q″, (n, k) each, at phases (k,)."""

    @property
    def nodes(self) -> Array: ...

    def __call__(self, phase: Array, derivative: int = 0) -> Array:
        """Coordinates q (n, k), or their derivative with respect to the phase, at phases (k,) in any
        period."""
        ...


class Reduction(Protocol):
    """Reduction of a system to fewer coordinates.

    modes_a_link: number of modes retained per link. full_coordinates: number of coordinates before the
    reduction. discarded: lowest frequency of the discarded modes in rad/s. enriched: reduced system with more
    coordinates, for the error estimate."""

    modes_a_link: int

    @property
    def sentence(self) -> str:
        """Sentence about the error of the natural frequencies."""
        ...

    @property
    def full_coordinates(self) -> int: ...

    @property
    def discarded(self) -> float: ...

    @property
    def enriched(self) -> Any: ...

    def expanded(self, phase: Array, speed: Array | float, *state: Array) -> Any:
        """State in all coordinates at phases (k,), from q, q̇, q̈ (n, k). The attribute `q` of the result is
        (full_coordinates, k)."""
        ...


class Events(NamedTuple):
    """Phases in rad at which a motion passes switches of the equations, such as stops, and phases at which it
    grazes a switch.

    sides: for each switch, the signs of the smallest and the largest value of its switching function. These
    signs show on which sides of the switch the motion lies."""

    phases: tuple[float, ...] = ()
    grazing: tuple[float, ...] = ()
    sides: tuple[tuple[float, float], ...] = ()
