"""Taylor's expansion to first order about the fundamental motion: M q̈ + C q̇ + K q = d."""

from collections.abc import Sequence
from typing import NamedTuple

import sympy

from derive.declarations import Condition
from derive.domains import Signs, signs_of
from derive.errors import ExpansionError, SingularMassError
from derive.gather import simplified, unshifted
from derive.kinematics import LoopFunction
from derive.kinks import at_desired_motion, inactive, open_clearances, require_tangents
from derive.mechanism import MechanismStatement
from derive.pieces import is_finite
from derive.switches import beside, known_real
from derive.symbols import Moving
from derive.transmission import PeriodicFunction


class Linearised(NamedTuple):
    """Matrices of the vibration about the fundamental motion, in phase and speed (chapter Eq. (64))."""

    M: sympy.Matrix
    C: sympy.Matrix
    K: sympy.Matrix
    d: sympy.Matrix


def linearise(mechanism: MechanismStatement, residual: sympy.Matrix) -> Linearised:
    """Jacobians of the residual by q̈, q̇ and q where all three vanish; d is minus the residual there.

    Raises ExpansionError where an entry is not finite, SingularMassError where M is singular whatever
    the parameters.
    """
    if not mechanism.declared_coordinates:
        none = sympy.zeros(0, 0)
        return Linearised(none, none, none, sympy.zeros(0, 1))
    signs = signs_of(mechanism.declared_parameters)
    matrices = expanded(residual, [each.symbol for each in mechanism.declared_coordinates], signs)
    _require_expansion(mechanism, matrices)
    linearised = Linearised(*simplified(matrices))
    _require_inertia(mechanism, linearised.M)
    return linearised


def expanded(residual: sympy.Matrix, q: Sequence[Moving], signs: Signs | None = None) -> Linearised:
    """First-order Taylor expansion of rows in coordinates q, their rates and accelerations, away from
    switches.

    signs: signs of the parameters. Raises ExpansionError if a step or kink in the coordinates leaves no
    tangent.
    """
    jacobian, moving = _jacobian(residual, q)
    require_tangents(residual, jacobian, moving)
    parts = [jacobian[:, k * len(q) : (k + 1) * len(q)] for k in range(3)] + [-residual]
    return Linearised(*(unshifted(at_desired_motion(part, moving, signs)) for part in parts))


def clearances(mechanism: MechanismStatement, residual: sympy.Matrix) -> list[Condition]:
    """Conditions under which the expansion exists."""
    if not mechanism.declared_coordinates:
        return []
    jacobian, moving = _jacobian(residual, [each.symbol for each in mechanism.declared_coordinates])
    signs = signs_of(mechanism.declared_parameters)
    found = [
        *open_clearances(residual, jacobian, moving, signs),
        *inactive([*residual, *jacobian], moving, signs),
    ]
    return list({each.text: each for each in found}.values())


def _jacobian(residual: sympy.Matrix, q: Sequence[Moving]) -> tuple[sympy.Matrix, list[Moving]]:
    """Derivatives beside switches by q̈, q̇ and q, and these."""
    qd = [symbol.rate for symbol in q]
    moving = [*(symbol.rate for symbol in qd), *qd, *q]
    return known_real(residual).jacobian(moving).applyfunc(beside), moving


def _require_expansion(mechanism: MechanismStatement, matrices: Linearised) -> None:
    names = [each.symbol.name for each in mechanism.declared_coordinates]
    for symbol, matrix in matrices._asdict().items():
        for row, name in enumerate(names):
            if not is_finite(matrix.row(row)):
                raise ExpansionError(
                    f"the equation of {name} cannot be linearised: {symbol} is not finite in the "
                    "fundamental motion; use energies and forces that are smooth there (sqrt(q) is not at "
                    "q = 0)"
                )


def _require_inertia(mechanism: MechanismStatement, M: sympy.Matrix) -> None:
    """Look for massless directions at an arbitrary rational point, where no rank is lost by chance."""
    unknown = sorted(M.atoms(PeriodicFunction, LoopFunction), key=sympy.default_sort_key)
    unknown += sorted(M.free_symbols, key=lambda symbol: symbol.name)
    point = {symbol: sympy.Rational(sympy.prime(i + 5), 7) for i, symbol in enumerate(unknown)}
    massless = M.xreplace(point).evalf(60).nullspace(iszerofunc=lambda entry: abs(entry) < 1e-40)
    if massless:
        names = [each.symbol.name for each in mechanism.declared_coordinates]
        without = [name for name, share in zip(names, massless[0], strict=True) if abs(share) > 1e-20]
        raise SingularMassError(
            f"the kinetic energy gives no inertia to {' with '.join(without)}: M is singular; "
            "add a mass there, or drop the coordinate",
            mechanism.kinetic,
        )
