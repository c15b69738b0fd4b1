"""One form for sums: terms that vary alike are added up, so that what cancels is gone."""

from collections.abc import Sequence
from typing import Any

import sympy

from derive.symbols import PHASE, SPEED, Moving
from derive.transmission import PeriodicFunction


def gathered(entry: sympy.Expr) -> sympy.Expr:
    """Sum of terms that each vary differently with phase, speed and motion, times constant factors."""
    factors: dict[sympy.Expr, list[sympy.Expr]] = {}
    for term in sympy.Add.make_args(sympy.expand_mul(entry)):
        factor, varying = term.as_independent(PeriodicFunction, Moving, SPEED)
        factors.setdefault(varying, []).append(factor)
    terms = (varying * sympy.factor_terms(sympy.Add(*factor)) for varying, factor in factors.items())
    return sympy.Add(*terms)


def simplified(matrices: Sequence[sympy.Matrix]) -> list[sympy.Matrix]:
    """The matrices gathered, or as they are where that takes fewer operations.

    Gathering is shorter for transmission functions, and longer where kinematics are written out.
    """
    return min([matrix.applyfunc(gathered) for matrix in matrices], list(matrices), key=operations)


def unshifted(expression: Any) -> Any:
    """Sines and cosines of the phase with a fixed angle added by those of the phase alone, so that blades or
    poles evenly around a turn cancel."""
    return expression.replace(_shifted, sympy.expand_trig)


def _shifted(part: Any) -> bool:
    if not isinstance(part, sympy.sin | sympy.cos):
        return False
    inner: Any = part.args[0]
    angle, moving = inner.as_independent(PHASE, as_Add=True)
    return angle != 0 and angle.is_number and moving == PHASE


def operations(matrices: Sequence[sympy.Matrix]) -> int:
    """Operations of all entries together, common subexpressions counted once."""
    common, reduced = sympy.cse(matrices, optimizations="basic", order="canonical")
    entries = [entry for matrix in reduced for entry in matrix]
    return int(sympy.count_ops([expression for _, expression in common] + entries))
