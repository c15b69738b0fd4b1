"""What systems and solvers give each other, beside the matrices, so that neither needs to know the other."""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

from solve.arrays import Array

Matrices = tuple[Array, Array, Array, Array]
"""M, C, K (m, n, n) and d (m, n) at m phases."""


class ModeShape(NamedTuple):
    """A mode with its frequency (rad/s), scaled so that its largest displacement is 1.

    places and displacements: for each link x, y along it, (points, 2), in m and in units of the largest.
    transverse: the displacements across each link, (points,). modal_mass: kg.
    """

    frequency: float
    modal_mass: float
    places: tuple[Array, ...]
    displacements: tuple[Array, ...]
    transverse: tuple[Array, ...]


class DrawnLink(NamedTuple):
    """A link, and how its start and its end are held: "pinned" or "clamped" to the ground, "joined" to
    other links by a pin, or "" where it is welded to them or free."""

    name: str
    ends: tuple[str, str]


class Formulas(NamedTuple):
    """C text `void formulas(const lane *const *in, lane *out)`, how many outputs it has, and names and values
    (p,), or (P, p) of many points, of the parameters, its last input; the others are phase, speed and, for
    outputs of a model, q, q̇, q̈. `lane` is a type of several doubles, one a point."""

    text: str
    outputs: int
    names: tuple[str, ...]
    values: Array


Columns = Callable[..., Array | None]
"""What evaluates formulas of inputs (width, k), a column each, in compiled code: (outputs, k), or their sums
(outputs, c) with weights, see `solve.kernel.formulas.columns`; None where it cannot."""


class ManyPoints(Protocol):
    """A system at many points at once: each has its speed, (P,) in rad/s, and values (P, v) of its own for
    some parameters."""

    @property
    def formulas(self) -> Formulas | None:
        """M, C, K by rows and d, of derivatives by time, as C text of phase, speed and parameters, with those
        that vary among these; None where there is none."""
        ...

    def entries(self, phase: Array, speeds: Array, values: Array, by_time: Array | None = None) -> Array:
        """Ω²M, ΩC, K by rows and d at phases (k,): (P, k, 3n² + n); NaN at points without a system. by_time:
        what the formulas give, where it is known; it may be overwritten."""
        ...

    def exist(self, speeds: Array, values: Array) -> Array:
        """Whether the fundamental motion exists (P,)."""
        ...

    def breaks(self, values: Array) -> list[tuple[float, ...] | None]:
        """Phases at which the matrices jump, of each point; None of points without a system."""
        ...

    def outputs(self, phase: Array, speeds: Array, values: Array, q: Array, qd: Array, qdd: Array) -> Array:
        """Outputs (P, o, k) at phases (P, k) and states (P, n, k), derivatives by time."""
        ...


class Marcher(Protocol):
    """A system followed in time, with its states at nodes (k,) from 0 to the period. Derivatives are by
    time times the mean speed, which is the phase at constant speed."""

    @property
    def nodes(self) -> Array: ...

    def __call__(self, state: Array, start: float, speed: float, last: float | None = None) -> Array:
        """q, v, a (3, n, k) over a period, both ends included, from the state (q, v) (2n,) at the phase
        `start`, while the speed goes linearly in time to `last`, by default not at all. Raises TransientError
        where the motion cannot be followed."""
        ...


class Dependence(Protocol):
    """How the equations and outputs of a system depend on quantities θ (r,). States (k, 3, n) at phases (k,)
    are q″, q′ and q, derivatives by the phase; they are held where nothing else is said.

    linear: whether the equations are; parted: whether derivatives of outputs by θ and by the states are known
    apart."""

    linear: bool
    parted: bool

    @property
    def less_accurate(self) -> "Dependence":
        """The same by differences of lower order, for error estimates; itself where derivatives are exact."""
        ...

    def residual(self, phase: Array, speed: float, states: Array) -> Array:
        """Derivatives (k, n, r) of M q″ + C q′ + K q - d, of derivatives by the phase, or of the residual of
        nonlinear equations."""
        ...

    def residual_along(self, phase: Array, speed: float, states: Array, weights: Array) -> Array:
        """Sums (r, c) of these over phases and rows, with weights (k, n, c)."""
        ...

    def matrices(self, phase: Array, speed: float, states: Array, weights: Array) -> tuple[Array, Array]:
        """Of sums over the entries of M, C and K, the derivatives of the residual by the states, with weights
        (k, 3, n, n): derivatives of their sum by θ (r,), and of each by the states (k, 3, n), 0 for linear
        equations."""
        ...

    def output(self, name: str, phase: Array, speed: float, states: Array) -> tuple[Array, Array]:
        """Derivatives of an output by θ (k, r), and by the states (k, 3, n), where they are known apart."""
        ...

    def output_along(self, name: str, phase: Array, speed: float, states: Array, moved: Array) -> Array:
        """Derivatives (k, r) of an output whose states move with θ by `moved` (k, 3, n, r)."""
        ...


def driven(s: Any, first: Any, last: Any, period: float) -> tuple[Any, Any, Any]:
    """Phase within a period, speed and acceleration (rad, rad/s, rad/s²) at s, time times the mean speed, 0
    to the period, where the speed goes linearly in time from the first to the last; of symbols too."""
    mean, slope = (first + last) / 2, (last - first) / period
    return (first * s + slope * s**2 / 2) / mean, first + slope * s, slope * mean


class Motion(Protocol):
    """A motion over phases from 0 to the last of its nodes (m+1,), where it repeats. One that has `states`,
    q, q′, q″ (n, k) each at phases (k,), is asked for these at once."""

    @property
    def nodes(self) -> Array: ...

    def __call__(self, phase: Array, derivative: int = 0) -> Array:
        """q or its derivative by the phase at phases (k,) of any turn: (n, k)."""
        ...


class Reduction(Protocol):
    """Reduction of a system: modes_a_link modes of each link are retained, full_coordinates is the number of
    coordinates before, discarded the lowest frequency in rad/s of the discarded modes. enriched: a larger
    reduced system for the error estimate."""

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
        """State with all coordinates, as `q` (full_coordinates, k), at phases (k,) for q, q̇, q̈ (n, k)."""
        ...
