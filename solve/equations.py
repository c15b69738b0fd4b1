"""Functions for the equations of any system. They use a capability of the system if it is available, and
otherwise a default."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from solve.arrays import Array, Plane
from solve.capabilities import Nonlinear
from solve.contracts import (
    Events,
    Formulas,
    Limit,
    Matrices,
    Motion,
    ParameterDerivatives,
    Statistics,
    Structure,
)
from solve.errors import (
    LinearModelError,
    MatricesError,
    NoDerivativeError,
    NoSketchError,
    SolveError,
    TransientError,
    ValueOutOfBoundsError,
    counted,
)
from solve.system import PeriodicSystem


def entries_of(system: PeriodicSystem, phase: Array, speed: float) -> Array:
    """Entries (m, 3n² + n) of Ω²M, ΩC and K in row order, and of d, for derivatives with respect to the
    phase."""
    evaluation, n = system.capabilities.evaluation, system.n
    entries = None if evaluation is None else evaluation.entries(phase, speed)
    if entries is None:
        entries = np.concatenate([array.reshape(len(phase), -1) for array in system.at(phase, speed)], axis=1)
        entries[:, : n**2] *= speed**2
        entries[:, n**2 : 2 * n**2] *= speed
    return entries


def used_entries_of(system: PeriodicSystem, phase: Array, speed: float) -> tuple[Array, Array]:
    """Return the values (m, R) of the entries that may be nonzero, and the indices (R,) of these entries,
    ascending."""
    evaluation = system.capabilities.evaluation
    used = None if evaluation is None else evaluation.used_entries(phase, speed)
    return used or (entries_of(system, phase, speed), np.arange(3 * system.n**2 + system.n))


def entries_over(system: PeriodicSystem, phase: Array, speeds: Array) -> Array:
    """Entries (P, k, 3n² + n), in the order of `entries_of`, at phases (k,) and speeds (P,); NaN at speeds
    for which there are no matrices."""
    evaluation = system.capabilities.evaluation
    entries = None if evaluation is None else evaluation.entries_over(phase, speeds)
    return entries_one_by_one(system, phase, speeds) if entries is None else entries


def entries_one_by_one(system: PeriodicSystem, phase: Array, speeds: Array) -> Array:
    """Result of `entries_over`, evaluated at one speed after another."""
    entries = np.full((len(speeds), len(phase), 3 * system.n**2 + system.n), np.nan)
    for rows, speed in zip(entries, speeds, strict=True):
        try:
            rows[:] = entries_of(system, phase, float(speed))
        except SolveError:
            # The solution at this speed will fail and report the reason.
            continue
    return entries


def input_matrix(system: PeriodicSystem, phase: Array, speed: float) -> Array:
    """Input matrix B (m, n, r) on the right-hand side of the equations, at phases (m,). Raises
    MatricesError."""
    shape, inputs_at = (len(phase), system.n, len(system.inputs)), system.capabilities.input_matrix
    B = np.zeros(shape) if inputs_at is None else inputs_at(phase, speed)[0]
    if B.shape != shape:
        raise MatricesError(
            f"B at {len(phase)} phases has shape {B.shape}; for {counted(system.n, 'coordinate')} and the "
            f"inputs {', '.join(system.inputs)} it must be {shape}"
        )
    return B


def output_values(
    system: PeriodicSystem, phase: Array, speed: Array | float, *state: Any
) -> Mapping[str, Array]:
    """Mapping from outputs to their values (k,) at phases (k,); empty for a system without outputs.

    state: q, q̇, q̈ (n, k), and optionally an acceleration; see `Outputs.output_values`."""
    outputs = system.capabilities.outputs
    return {} if outputs is None else outputs.output_values(phase, speed, *state)


def output_formulas(system: PeriodicSystem, varied: Sequence[str] = ()) -> Formulas | None:
    """C code of the outputs, with the parameters `varied` as inputs; None if it is not available."""
    outputs = system.capabilities.outputs
    return None if outputs is None else outputs.output_formulas(varied)


def warnings_of(system: PeriodicSystem, speed: float, linear: bool = True) -> list[str]:
    """Warnings about the equations at a speed (rad/s) that apply to any solution. linear: whether the
    linearised equations are solved."""
    validity = system.capabilities.validity
    return list(system.labels.equation_warnings) if validity is None else validity.warnings(speed, linear)


def judged_quantities(system: PeriodicSystem) -> tuple[str, ...]:
    """Coordinates and outputs that have limits of validity."""
    validity = system.capabilities.validity
    return () if validity is None else validity.judged_quantities


def limits_of(system: PeriodicSystem, quantities: Iterable[str], linear: bool = True) -> list[Limit]:
    """Limits of validity of these quantities. linear: as in `warnings_of`."""
    names, validity = list(quantities), system.capabilities.validity
    stated = [] if validity is None else validity.limits(names, linear)
    return [*map(Limit.finite, names), *stated]


def exceeded_limits(
    system: PeriodicSystem, figures: Mapping[str, Statistics], linear: bool = True
) -> list[str]:
    """Warnings about violated limits. `figures` maps quantities to their statistics. linear: as in
    `warnings_of`."""
    pairs = ((limit, figures[limit.quantity]) for limit in limits_of(system, figures, linear))
    return [limit.message(values) for limit, values in pairs if limit.exceeded(values)]


def require_bounds(system: PeriodicSystem, parameters: Mapping[str, float]) -> None:
    """Raise ValueOutOfBoundsError if a value is outside the bounds of its parameter."""
    if system.capabilities.variation is not None:
        system.capabilities.variation.require_bounds(parameters)


def require_desired_motion(system: PeriodicSystem, speeds: Array) -> None:
    """Raise DesiredMotionError if the fundamental motion does not exist at one of the speeds (P,) in
    rad/s."""
    domain = system.capabilities.domain
    if domain is not None:
        domain(speeds)


def sketched(
    system: PeriodicSystem, phase: Array, speed: float, q: Array, fineness: float = 1.0
) -> Mapping[str, Plane]:
    """Mapping from lines of the sketch to points, as `Capabilities.sketch` returns it, for q (n, k) at phases
    (k,).

    fineness: factor for the default number of points of curves. Raises NoSketchError if there is no sketch.
    """
    sketch = system.capabilities.sketch
    lines = {} if sketch is None else sketch(phase, speed, q, fineness)
    if not lines:
        raise NoSketchError(
            f"{system.labels.name} declares no lines to draw; add mechanism.sketch(name, points) to its file "
            "and run python -m derive FILE; see docs/motion.md"
        )
    return lines


def is_nonlinear(system: PeriodicSystem) -> bool:
    """Whether the system has nonlinear equations, which can be linearised about a motion."""
    return system.capabilities.nonlinear is not None


def nonlinear_of(system: PeriodicSystem) -> Nonlinear:
    """Nonlinear equations of a system. Raises LinearModelError for linear systems."""
    if system.capabilities.nonlinear is None:
        raise LinearModelError(
            f"{system.labels.name} is linear by construction and has no nonlinear equations; request linear "
            "results"
        )
    return system.capabilities.nonlinear


def varying_of(system: PeriodicSystem) -> Callable[[Array, Array, float], Matrices]:
    """Function of phases, speeds and an acceleration; see `Capabilities.varying`. Raises TransientError for
    systems without this function."""
    if system.capabilities.varying is None:
        raise TransientError(
            f"{system.labels.name} is stated for constant speeds only; for varying speeds, write it as a "
            "mechanism file, and generate its equations with python -m derive FILE"
        )
    return system.capabilities.varying


def events_of(system: PeriodicSystem) -> Events:
    """Events of the motion about which the system is linearised: the phases at which the motion passes
    switches. Empty for other systems."""
    linearisation = system.capabilities.linearisation
    return Events() if linearisation is None else linearisation.events


def event_normals(
    system: PeriodicSystem, motion: Motion, speed: float, phases: Array, names: Sequence[str] = ()
) -> Array:
    """Result of `Linearisation.event_normals`, derivatives (k, 1 + 2n + r) of switching functions at phases
    (k,); empty if there are no switches."""
    linearisation = system.capabilities.linearisation
    if linearisation is None:
        return np.zeros((0, 1 + 2 * system.n + len(names)))
    return linearisation.event_normals(motion, speed, phases, names)


def roundoff_of(system: PeriodicSystem, phase: Array, speed: float) -> Array:
    """Result of `Linearisation.roundoff`, bounds (k, n) on the round-off of the load; zero if there is no
    bound."""
    linearisation = system.capabilities.linearisation
    return np.zeros((len(phase), system.n)) if linearisation is None else linearisation.roundoff(phase, speed)


def freedoms_of(system: PeriodicSystem) -> int:
    """Number of degrees of freedom at rest."""
    structure = system.capabilities.structure
    return system.n if structure is None else structure.freedoms


def most_frequencies(system: PeriodicSystem) -> int:
    """Largest number of natural frequencies that can be computed."""
    structure = system.capabilities.structure
    return system.n if structure is None else structure.most_frequencies


def derivatives_of(system: PeriodicSystem) -> ParameterDerivatives:
    """Derivatives of the equations with respect to parameters. Raises NoDerivativeError if there are no
    generated equations."""
    if system.capabilities.variation is None:
        raise NoDerivativeError(
            f"{system.labels.name} has no generated equations that can be differentiated; write it as a "
            "mechanism file, and generate its equations with python -m derive FILE"
        )
    return system.capabilities.variation.derivatives


def structure_of(system: PeriodicSystem) -> Structure:
    """Beam structure of a system. Raises ValueOutOfBoundsError for systems without one."""
    if system.capabilities.structure is None:
        raise ValueOutOfBoundsError(
            f"{system.labels.name} has no links to draw; mode shapes require a structure of beams"
        )
    return system.capabilities.structure
