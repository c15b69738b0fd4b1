"""Euler–Lagrange equations on plain symbols q, qd, qdd, with phase and speed.

For each coordinate  d/dt ∂T/∂q̇ − ∂T/∂q + ∂V/∂q + ∂R/∂q̇ − Q = 0,  where a force F along y has
Q = F ∂y/∂q (chapter Eqs. (46)–(54)). The phase is a coordinate too, but a prescribed one:
its row gives the drive torque.
"""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import sympy

from derive.gather import gathered, simplified
from derive.mechanism import MechanismStatement
from derive.switches import slope
from derive.symbols import ACCELERATION, PHASE, Moving, counted, rate, steady


class Energies(NamedTuple):
    """T, V and Rayleigh's R, of a mechanism or of a unit of length."""

    kinetic: Any
    potential: Any
    dissipation: Any


def residuals(mechanism: MechanismStatement) -> sympy.Matrix:
    """Left-hand sides r(φ, Ω, Ω̇, q, q̇, q̈) of the equations of motion r = 0, one row a coordinate.

    Coordinates with a fundamental motion are counted from it: q → q̄(φ) + q before anything else.
    """
    return _in_parts([_row(mechanism, each.symbol) for each in mechanism.declared_coordinates])


def _in_parts(rows: Sequence[Any]) -> sympy.Matrix:
    """The rows, simplified: at constant speed, and what an acceleration of the drive adds."""
    given = sympy.Matrix(rows)
    return simplified([steady(given)])[0] + simplified([accelerated(given)])[0]


def accelerated(expression: Any) -> Any:
    """What the acceleration Ω̇ of the drive adds to an expression, or to each entry of a matrix."""
    if isinstance(expression, sympy.MatrixBase):
        return expression.applyfunc(accelerated)
    factor = sympy.diff(expression, ACCELERATION)
    return expression - steady(expression) if factor.has(ACCELERATION) else ACCELERATION * gathered(factor)


def drive_torque(mechanism: MechanismStatement, residual: Iterable[Any]) -> sympy.Expr:
    """Torque of the drive, N m, from the row of the phase (chapter Eq. (51)) and those of the coordinates.

    The row of a coordinate that merely adds to the phase, as the twist of a shaft does, is subtracted. It
    vanishes on every motion, and what remains is the torque in that shaft. On a motion of the linear
    equations the inertia terms would leave an error without that. residual: the rows of the coordinates, none
    where they lack a part of what acts.
    """
    torque = _row(mechanism, PHASE)
    accelerations = [each.symbol.rate.rate for each in mechanism.declared_coordinates]
    for row in residual:
        without = gathered(steady(torque - row))
        if steady(torque).has(*accelerations) and not without.has(*accelerations):
            return without + accelerated(torque - row)
    whole: Any = _in_parts([torque])
    return whole[0, 0]


def from_fundamental(mechanism: MechanismStatement, expression: Any) -> Any:
    """The expression with q, q̇, q̈ replaced by q̄ + q and their rates, and the phase counted at steps."""
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
    forces = [[from_fundamental(mechanism, each) for each in work] for work in mechanism.forces]
    return equation(Energies(kinetic, potential, dissipation), q, forces)


def equation(energies: Energies, q: Moving, forces: Iterable[Sequence[Any]] = ()) -> sympy.Expr:
    """d/dt ∂T/∂q̇ − ∂T/∂q + ∂V/∂q + ∂R/∂q̇ − Σ F ∂y/∂q, for forces given as pairs of F and y."""
    T, V, R = energies
    work = sympy.Add(*(force * slope(along, q) for force, along in forces))
    return rate(slope(T, q.rate)) - slope(T, q) + slope(V, q) + slope(R, q.rate) - work
