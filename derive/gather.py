"""One form for sums: terms that vary alike are added up, so that what cancels is gone."""

import sympy

from derive.symbols import SPEED, Moving
from derive.transmission import PeriodicFunction


def gathered(entry: sympy.Expr) -> sympy.Expr:
    """Sum of terms that each vary differently with phase, speed and motion, times constant factors."""
    factors: dict[sympy.Expr, list[sympy.Expr]] = {}
    for term in sympy.Add.make_args(sympy.expand_mul(entry)):
        factor, varying = term.as_independent(PeriodicFunction, Moving, SPEED)
        factors.setdefault(varying, []).append(factor)
    terms = (varying * sympy.factor_terms(sympy.Add(*factor)) for varying, factor in factors.items())
    return sympy.Add(*terms)
