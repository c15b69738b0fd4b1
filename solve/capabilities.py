"""Capabilities that only some systems have."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

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
    Structure,
)
from solve.errors import TransientError
from solve.samples import Samples


class Outputs(Protocol):
    """Outputs of a system: quantities that are functions of phase, speed and state."""

    def output_values(
        self, phase: Array, speed: Array | float, q: Array, qd: Array, qdd: Array, acceleration: float = 0.0
    ) -> Mapping[str, Array]:
        """Mapping from outputs to their values (k,) at phases (k,).

        speed: Ω in rad/s, a number or (k,). q, qd, qdd (n, k): coordinates and their derivatives with respect
        to time. acceleration: Ω̇ in rad/s²."""
        ...

    def output_formulas(self, varied: Sequence[str] = ()) -> Formulas | None:
        """C code of the outputs, with the parameters `varied` as inputs; None if it is not available."""
        return None


class Validity(Protocol):
    """Limits of the validity of the equations."""

    @property
    def judged_quantities(self) -> tuple[str, ...]:
        """Coordinates and outputs that have limits of validity."""
        return ()

    def limits(self, quantities: Iterable[str], linear: bool = True) -> list[Limit]:
        """Limits of validity of these quantities. linear: whether the linearised equations are solved."""
        return []

    def warnings(self, speed: float, linear: bool = True) -> list[str]:
        """Warnings about the equations at a speed (rad/s) that apply to any solution. linear: as in
        `limits`."""
        ...


class Evaluation(Protocol):
    """Evaluation of entries that is faster than the evaluation of matrices. Methods return None if no faster
    evaluation is available."""

    def entries(self, phase: Array, speed: float) -> Array | None:
        """Entries (m, 3n² + n) of Ω²M, ΩC and K in row order, and of d, for derivatives with respect to the
        phase."""
        return None

    def entries_over(self, phase: Array, speeds: Array) -> Array | None:
        """Entries (P, k, 3n² + n), in the order of `entries`, at phases (k,) and speeds (P,); NaN at speeds
        without matrices."""
        return None

    def terms(self, phase: Array, speeds: Array) -> tuple[Array, Array, Array] | None:
        """Decompose the entries into sums of products. Return the terms (k, R) at phases (k,), the
        coefficients (P, R) at speeds (P,), and the index (R,), ascending, of the entry to which each term
        belongs."""
        return None

    def used_entries(self, phase: Array, speed: float) -> tuple[Array, Array] | None:
        """Return the values (m, R) of the entries that may be nonzero, and the indices (R,) of these entries,
        ascending."""
        return None


class Variation(Protocol):
    """Dependence of the equations on parameters."""

    @property
    def derivatives(self) -> ParameterDerivatives:
        """Derivatives with respect to parameters."""
        ...

    @property
    def moves_breaks(self) -> bool:
        """Whether the phases at which the matrices jump depend on parameters."""
        ...

    def require_bounds(self, parameters: Mapping[str, float]) -> None:
        """Raise ValueOutOfBoundsError if a value is outside the bounds of its parameter."""
        ...

    def many_points(self, names: Sequence[str]) -> Any:
        """Vectorised evaluation, `ModelPoints`, at points where the parameters `names` vary. None if each
        point requires its own system."""
        ...


class Nonlinear(Protocol):
    """Equations of motion r(φ, Ω, q, q̇, q̈) = 0."""

    def along(self, motion: Motion, compiled: Columns | None = None) -> Any:
        """System linearised about a motion q_k, with its period.

        M = ∂r/∂q̈, C = ∂r/∂q̇, K = ∂r/∂q and d = M q̈_k + C q̇_k + K q_k - r(q_k), so that the periodic
        solution is the next iterate of Newton's method (U. Ascher, R. Mattheij, R. Russell, Numerical
        Solution of Boundary Value Problems, 2.3.4). compiled: evaluation of formulas by compiled code, if
        available."""
        ...

    def along_events(self, motion: Motion, speed: float, compiled: Columns | None = None) -> Any:
        """Result of `along` with additional breaks: the phases at which the motion passes switches, at a
        speed in rad/s."""
        return self.along(motion, compiled)

    def marcher(self, sizes: Array, count: int, rtol: float) -> Integrator:
        """Integrator of the equations of motion, one period at a time from any state, with `count` states per
        period.

        sizes (n,): scales of the coordinates; rtol is relative to them. Raises TransientError if there is no
        generated code."""
        raise TransientError(
            "the system has no generated equations of motion that can be integrated in time; write it as a "
            "mechanism file, and generate its equations with python -m derive FILE"
        )


class Linearisation(Protocol):
    """Linearisation about a motion."""

    events: Events
    """Phases at which the motion passes switches."""

    def event_normals(self, motion: Motion, speed: float, phases: Array, names: Sequence[str] = ()) -> Array:
        """Derivatives (k, 1 + 2n + r) of switching functions at phases (k,) of a motion, at a speed in rad/s.
        At each phase, only the switching function nearest to zero is differentiated.

        The derivatives are with respect to the phase, q, dq/dφ and r named parameters; the name "speed" is
        the speed. Derivatives with respect to the speed are at constant q and dq/dφ."""
        ...

    def roundoff(self, phase: Array, speed: float) -> Array:
        """Bounds (k, n) on the round-off of the load d at phases (k,), in units of the machine precision.
        Terms of d may cancel."""
        ...


class Capabilities(NamedTuple):
    """Capabilities of a system. The attribute of a capability that the system lacks is None.

    Attributes
    ----------
    outputs, validity, evaluation, variation, nonlinear, linearisation, structure, reduction
        Objects that implement the protocols of this module.
    samples : Samples or None
        Samples from which the matrices are interpolated.
    input_matrix : callable or None
        Function of phases (m,) and a speed in rad/s that returns a sequence whose only element is the array B
        (m, n, r).
    domain : callable or None
        Function of speeds (P,) in rad/s that raises DesiredMotionError if the fundamental motion does not
        exist at one of these speeds.
    sketch : callable or None
        Function of phases (k,), a speed, q (n, k), and a factor that multiplies the default number of points
        per curve. It returns a mapping from the names of lines of the sketch to points x + iy (points, k).
    varying : callable or None
        Function of phases (m,), speeds (m,) and an acceleration in rad/s² that returns the matrices, for
        derivatives with respect to time.
    """

    outputs: Outputs | None = None
    validity: Validity | None = None
    evaluation: Evaluation | None = None
    variation: Variation | None = None
    nonlinear: Nonlinear | None = None
    linearisation: Linearisation | None = None
    structure: Structure | None = None
    reduction: Reduction | None = None
    samples: Samples | None = None
    input_matrix: Callable[[Array, float], Sequence[Array]] | None = None
    domain: Callable[[Array], None] | None = None
    sketch: Callable[[Array, float, Array, float], Mapping[str, Plane]] | None = None
    varying: Callable[[Array, Array, float], Matrices] | None = None
