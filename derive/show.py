"""The linearised equations as LaTeX, for reading."""

import sympy

from derive.lagrange import residual
from derive.linearise import linearise
from derive.mechanism import Mechanism


def equations(mechanism: Mechanism) -> str:
    """M, C, K, d of M q̈ + C q̇ + K q = d, entries gathered by factors, series at the phase with primes only."""
    names = {each.symbol: _greek(each.symbol.name) for each in mechanism.declared_coordinates}
    vector = sympy.latex(sympy.Matrix(list(names)), symbol_names=names)
    lines = [f"% {mechanism.title}", rf"% M \ddot q + C \dot q + K q = d,\quad \varphi = \Omega t,\quad q = {vector}"]
    symbols = {mechanism.phase: r"\varphi", mechanism.speed: r"\Omega"}
    for name, matrix in linearise(mechanism, residual(mechanism))._asdict().items():
        gathered = matrix.applyfunc(lambda entry: sympy.factor_terms(sympy.expand(entry)))
        lines.append(f"{name} = {sympy.latex(gathered, symbol_names=symbols)}")
    return "\n".join(lines)


def _greek(name: str) -> str:
    return sympy.latex(sympy.Symbol(name))
