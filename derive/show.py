"""The linearised equations as LaTeX, for reading."""

import sympy

from derive.lagrange import residual
from derive.linearise import linearise
from derive.mechanism import Mechanism


def equations(mechanism: Mechanism) -> str:
    """M, C, K, d of M q̈ + C q̇ + K q = d, series at the phase with primes only."""
    vector = sympy.latex(sympy.Matrix([each.symbol for each in mechanism.declared_coordinates]))
    lines = [
        f"% {mechanism.title}",
        rf"% M \ddot q + C \dot q + K q = d,\quad \varphi = \Omega t,\quad q = {vector}",
    ]
    symbols = {mechanism.phase: r"\varphi", mechanism.speed: r"\Omega"}
    for name, matrix in linearise(mechanism, residual(mechanism))._asdict().items():
        lines.append(f"{name} = {sympy.latex(matrix, symbol_names=symbols)}")
    return "\n".join(lines)
