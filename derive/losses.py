"""What the linearised equations do not know of what a mechanism states."""

from collections.abc import Iterable
from typing import Any

import sympy

from derive.mechanism import MechanismStatement
from derive.switches import outermost, switches
from derive.symbols import counted
from derive.transmission import PeriodicFunction
from derive.units import short


def losses(mechanism: MechanismStatement, residual: Iterable[Any], linearised: Iterable[Any]) -> list[str]:
    """A sentence for each parameter, series and function of coordinates whose part in the residual M, C, K, d
    do not have."""
    kept = _names(mechanism, linearised)
    lost = [name for name in _names(mechanism, residual) if name not in kept]
    return [*map(_ignored, lost), *map(_one_sided, _steps(mechanism, _energies(mechanism)))]


def idle(mechanism: MechanismStatement, results: Iterable[Any]) -> list[str]:
    """A sentence for each parameter and series of the energies that is in none of the results."""
    used = _names(mechanism, results)
    return [_idle(name) for name in _names(mechanism, _energies(mechanism)) if name not in used]


def _energies(mechanism: MechanismStatement) -> list[Any]:
    works = [part for work in mechanism.forces for part in work]
    stated = (mechanism.kinetic, mechanism.potential, mechanism.dissipation, *works)
    return [counted(sympy.sympify(each)) for each in stated]


def _ignored(name: str) -> str:
    return f"{name} is in the energies but not in the linearised equations; the linear answer ignores it"


def _idle(name: str) -> str:
    return f"{name} is in the energies but moves nothing: it is in no equation of motion and in no output"


def _one_sided(function: Any) -> str:
    return (
        f"{short(function)} is in the energies; the linear answer uses its slope at the fundamental motion "
        "and ignores steps and kinks that the vibration passes"
    )


def _names(mechanism: MechanismStatement, expressions: Iterable[Any]) -> list[str]:
    """Parameters and series that the expressions hold, in the order of their declaration."""
    given = [sympy.sympify(each) for each in expressions]
    symbols = set().union(*(each.free_symbols for each in given))
    series = set().union(*({type(part) for part in each.atoms(PeriodicFunction)} for each in given))
    names = [each.symbol.name for each in mechanism.declared_parameters if each.symbol in symbols]
    return names + [each.__name__ for each in mechanism.declared_series if each in series]


def _steps(mechanism: MechanismStatement, energies: Iterable[Any]) -> list[Any]:
    """Steps and kinks that hold coordinates or their rates."""
    moving = {s for each in mechanism.declared_coordinates for s in (each.symbol, each.symbol.rate)}
    nodes = dict.fromkeys(node for each in energies for node in outermost(each))
    return sorted((node for node in nodes if switches(node, moving)), key=sympy.default_sort_key)
