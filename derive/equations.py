"""Equations of motion by Lagrange's equations, and their expansion about the fundamental motion.

For each coordinate  d/dt ∂T/∂q̇ − ∂T/∂q + ∂V/∂q + ∂R/∂q̇ − Q = 0,  where a force F along y has
Q = F ∂y/∂q (chapter Eqs. (46)–(54)). The phase is a prescribed coordinate: its row gives the drive torque.
Taylor's expansion to first order gives M q̈ + C q̇ + K q = d.
"""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import sympy

from derive.declarations import Condition
from derive.discontinuities import at_fundamental_motion, inactive, open_clearances, require_tangents
from derive.domains import Signs, is_finite, signs_of
from derive.errors import ExpansionError, SingularMassError
from derive.functions import LoopFunction, PeriodicFunction
from derive.mechanism import MechanismStatement
from derive.switches import beside, known_real, slope
from derive.symbols import ACCELERATION, PHASE, SPEED, Moving, counted, rate, steady


def gathered(entry: sympy.Expr) -> sympy.Expr:
    """Collect the terms of an expression that depend in the same way on phase, speed and motion."""
    factors: dict[sympy.Expr, list[sympy.Expr]] = {}
    for term in sympy.Add.make_args(sympy.expand_mul(entry)):
        factor, varying = term.as_independent(PeriodicFunction, Moving, SPEED)
        factors.setdefault(varying, []).append(factor)
    terms = (varying * sympy.factor_terms(sympy.Add(*factor)) for varying, factor in factors.items())
    return sympy.Add(*terms)


def simplified(matrices: Sequence[sympy.Matrix]) -> list[sympy.Matrix]:
    """Return the matrices with collected terms, or unchanged if this form has fewer operations.

    Collecting terms shortens transmission functions but lengthens explicit kinematics.
    """
    return min([matrix.applyfunc(gathered) for matrix in matrices], list(matrices), key=operations)


def unshifted(expression: Any) -> Any:
    """Expand sines and cosines of the phase plus a constant angle.

    The terms of blades or poles at equal angles around a revolution then cancel.
    """
    return expression.replace(_shifted, sympy.expand_trig)


def _shifted(part: Any) -> bool:
    if not isinstance(part, sympy.sin | sympy.cos):
        return False
    inner: Any = part.args[0]
    angle, moving = inner.as_independent(PHASE, as_Add=True)
    return angle != 0 and angle.is_number and moving == PHASE


def operations(matrices: Sequence[sympy.Matrix]) -> int:
    """Number of operations in all entries; common subexpressions are counted once."""
    common, reduced = sympy.cse(matrices, optimizations="basic", order="canonical")
    entries = [entry for matrix in reduced for entry in matrix]
    return int(sympy.count_ops([expression for _, expression in common] + entries))


class Energies(NamedTuple):
    """Kinetic energy T, potential energy V and Rayleigh's dissipation function R of a mechanism, in total or
    per length."""

    kinetic: Any
    potential: Any
    dissipation: Any


def residuals(mechanism: MechanismStatement) -> sympy.Matrix:
    """Left-hand sides r(φ, Ω, Ω̇, q, q̇, q̈) of the equations of motion r = 0, one row per coordinate.

    Coordinates with a fundamental motion q̄(φ) are relative to it: q → q̄(φ) + q.
    """
    return _in_parts([_row(mechanism, coordinate.symbol) for coordinate in mechanism.declared_coordinates])


def _in_parts(rows: Sequence[Any]) -> sympy.Matrix:
    """Simplify rows. Terms due to an acceleration of the drive are simplified separately from the others."""
    matrix = sympy.Matrix(rows)
    return simplified([steady(matrix)])[0] + simplified([accelerated(matrix)])[0]


def accelerated(expression: Any) -> Any:
    """Terms of an expression or matrix due to the acceleration Ω̇ of the drive."""
    if isinstance(expression, sympy.MatrixBase):
        return expression.applyfunc(accelerated)
    factor = sympy.diff(expression, ACCELERATION)
    return expression - steady(expression) if factor.has(ACCELERATION) else ACCELERATION * gathered(factor)


def drive_torque(mechanism: MechanismStatement, residual: Iterable[Any]) -> sympy.Expr:
    """Torque of the drive in N m, from Lagrange's equation of the phase (chapter Eq. (51)).

    The equation of a coordinate that is added to the phase, such as the twist of a shaft, is subtracted from
    it, which leaves the torque in the shaft. The subtracted equation holds for every exact motion. For
    motions of the linear equations, inertia terms would be inaccurate without the subtraction.
    residual: left-hand sides of the equations of the coordinates; empty to omit the subtraction.
    """
    torque = _row(mechanism, PHASE)
    accelerations = [coordinate.symbol.rate.rate for coordinate in mechanism.declared_coordinates]
    for row in residual:
        without = gathered(steady(torque - row))
        if steady(torque).has(*accelerations) and not without.has(*accelerations):
            return without + accelerated(torque - row)
    whole: Any = _in_parts([torque])
    return whole[0, 0]


def from_fundamental(mechanism: MechanismStatement, expression: Any) -> Any:
    """Expression with q, q̇, q̈ relative to the fundamental motion, and with the phase modulo 2π in steps and
    kinks."""
    expression = counted(expression)
    shift: dict[sympy.Basic, sympy.Expr] = {}
    for symbol, motion in mechanism.fundamental_motion.items():
        shift[symbol] = motion + symbol
        for _ in range(2):
            symbol, motion = symbol.rate, rate(motion)
            shift[symbol] = motion + symbol
    return expression.xreplace(shift) if shift else expression


def _row(mechanism: MechanismStatement, q: Moving) -> sympy.Expr:
    """Left-hand side of one equation of motion."""
    kinetic, potential, dissipation = (
        from_fundamental(mechanism, sympy.sympify(energy))
        for energy in (mechanism.kinetic, mechanism.potential, mechanism.dissipation)
    )
    forces = [[from_fundamental(mechanism, expression) for expression in work] for work in mechanism.forces]
    return equation(Energies(kinetic, potential, dissipation), q, forces)


def equation(energies: Energies, q: Moving, forces: Iterable[Sequence[Any]] = ()) -> sympy.Expr:
    """Lagrange's expression d/dt ∂T/∂q̇ − ∂T/∂q + ∂V/∂q + ∂R/∂q̇ − Σ F ∂y/∂q. forces: pairs of F and y."""
    T, V, R = energies
    work = sympy.Add(*(force * slope(along, q) for force, along in forces))
    return rate(slope(T, q.rate)) - slope(T, q) + slope(V, q) + slope(R, q.rate) - work


class Linearised(NamedTuple):
    """Matrices of the vibration about the fundamental motion, as functions of phase and speed (chapter Eq.
    (64))."""

    M: sympy.Matrix
    C: sympy.Matrix
    K: sympy.Matrix
    d: sympy.Matrix


def linearise(mechanism: MechanismStatement, residual: sympy.Matrix) -> Linearised:
    """Linearise the residual at the fundamental motion: M, C and K are its Jacobians with respect to q̈, q̇
    and q; d is minus its value.

    Raises ExpansionError if an entry is not finite, and SingularMassError if M is singular for all
    parameters.
    """
    if not mechanism.declared_coordinates:
        none = sympy.zeros(0, 0)
        return Linearised(none, none, none, sympy.zeros(0, 1))
    signs = signs_of(mechanism.declared_parameters)
    matrices = taylor_expansion(
        residual, [coordinate.symbol for coordinate in mechanism.declared_coordinates], signs
    )
    _require_expansion(mechanism, matrices)
    linearised = Linearised(*simplified(matrices))
    _require_inertia(mechanism, linearised.M)
    return linearised


def taylor_expansion(residual: sympy.Matrix, q: Sequence[Moving], signs: Signs | None = None) -> Linearised:
    """First-order Taylor expansion of a residual about the fundamental motion in q, q̇ and q̈, valid between
    switches.

    signs: signs of the parameters. Raises ExpansionError if the residual has a step or kink in the
    coordinates at the fundamental motion.
    """
    jacobian, moving = _jacobian(residual, q)
    require_tangents(residual, jacobian, moving)
    parts = [jacobian[:, k * len(q) : (k + 1) * len(q)] for k in range(3)] + [-residual]
    return Linearised(*(unshifted(at_fundamental_motion(part, moving, signs)) for part in parts))


def input_matrix(mechanism: MechanismStatement) -> sympy.Matrix:
    """Matrix B (n, r) of the inputs u on the right-hand side of the linearised equations.

    Column j contains the derivatives with respect to q, at the fundamental motion, of the displacement along
    which input j acts.
    """
    q = [coordinate.symbol for coordinate in mechanism.declared_coordinates]
    moving = [derivative for symbol in q for derivative in symbol.motion]
    along = [from_fundamental(mechanism, declared.along) for declared in mechanism.declared_inputs]
    slopes = sympy.Matrix(len(q), len(along), lambda i, j: slope(along[j], q[i]))
    return unshifted(at_fundamental_motion(slopes, moving, signs_of(mechanism.declared_parameters)))


def clearances(mechanism: MechanismStatement, residual: sympy.Matrix) -> list[Condition]:
    """Conditions on the parameters under which the Taylor expansion exists."""
    if not mechanism.declared_coordinates:
        return []
    jacobian, moving = _jacobian(
        residual, [coordinate.symbol for coordinate in mechanism.declared_coordinates]
    )
    signs = signs_of(mechanism.declared_parameters)
    conditions = [
        *open_clearances(residual, jacobian, moving, signs),
        *inactive([*residual, *jacobian], moving, signs),
    ]
    return list({condition.text: condition for condition in conditions}.values())


def _jacobian(residual: sympy.Matrix, q: Sequence[Moving]) -> tuple[sympy.Matrix, list[Moving]]:
    """Return the derivatives of the residual with respect to q̈, q̇ and q, and these symbols. The derivatives
    are those next to the switches."""
    qd = [symbol.rate for symbol in q]
    moving = [*(symbol.rate for symbol in qd), *qd, *q]
    return known_real(residual).jacobian(moving).applyfunc(beside), moving


def _require_expansion(mechanism: MechanismStatement, matrices: Linearised) -> None:
    names = [coordinate.symbol.name for coordinate in mechanism.declared_coordinates]
    for symbol, matrix in matrices._asdict().items():
        for row, name in enumerate(names):
            if not is_finite(matrix.row(row)):
                raise ExpansionError(
                    f"the equation of {name} cannot be linearised: {symbol} is not finite in the "
                    "fundamental motion; use energies and forces that are smooth there (sqrt(q) is not "
                    "smooth at q = 0)"
                )


def _require_inertia(mechanism: MechanismStatement, M: sympy.Matrix) -> None:
    """Raise SingularMassError if M is singular at an arbitrary rational point, and therefore presumably
    everywhere."""
    unknown = sorted(M.atoms(PeriodicFunction, LoopFunction), key=sympy.default_sort_key)
    unknown += sorted(M.free_symbols, key=lambda symbol: symbol.name)
    point = {symbol: sympy.Rational(sympy.prime(i + 5), 7) for i, symbol in enumerate(unknown)}
    massless = M.xreplace(point).evalf(60).nullspace(iszerofunc=lambda entry: abs(entry) < 1e-40)
    if massless:
        names = [coordinate.symbol.name for coordinate in mechanism.declared_coordinates]
        without = [name for name, share in zip(names, massless[0], strict=True) if abs(share) > 1e-20]
        raise SingularMassError(
            f"M is singular: a motion of {' and '.join(without)} has no kinetic energy; "
            "add a mass that moves with it, or remove a coordinate",
            mechanism.kinetic,
        )
