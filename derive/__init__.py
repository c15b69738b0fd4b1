"""Derivation of the equations of motion from the energies of a mechanism, as CasADi code.

A mechanism file imports from here: `Mechanism`, `Structure`, `rate` and SymPy's elementary functions. SymPy
is imported at the first use, for a short start-up of the command.
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sympy import (
        Abs,
        Heaviside,
        Matrix,
        Max,
        Min,
        Piecewise,
        Rational,
        acos,
        acosh,
        asin,
        asinh,
        atan,
        atan2,
        atanh,
        cos,
        cosh,
        exp,
        log,
        pi,
        sign,
        sin,
        sinh,
        sqrt,
        tan,
        tanh,
    )

    from derive.public import Mechanism, Structure
    from derive.structure import Section
    from derive.switches import rectangle, trapezoid, wrapped
    from derive.symbols import rate

__all__ = [
    "Abs",
    "Heaviside",
    "Matrix",
    "Max",
    "Mechanism",
    "Min",
    "Piecewise",
    "Rational",
    "Section",
    "Structure",
    "acos",
    "acosh",
    "asin",
    "asinh",
    "atan",
    "atan2",
    "atanh",
    "cos",
    "cosh",
    "exp",
    "log",
    "pi",
    "rate",
    "rectangle",
    "sign",
    "sin",
    "sinh",
    "sqrt",
    "tan",
    "tanh",
    "trapezoid",
    "wrapped",
]

_HOME = {
    "Mechanism": "derive.public",
    "Section": "derive.structure",
    "Structure": "derive.public",
    "rate": "derive.symbols",
    "rectangle": "derive.switches",
    "trapezoid": "derive.switches",
    "wrapped": "derive.switches",
}


def __dir__() -> list[str]:
    return sorted(__all__)


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(f"module 'derive' has no attribute '{name}'; it has {', '.join(__all__)}")
    return getattr(importlib.import_module(_HOME.get(name, "sympy")), name)
