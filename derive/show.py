"""The linearised equations as LaTeX, for reading."""

import sympy

from derive.galerkin import Projection, project
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
    if mechanism.declared_field:
        projection = project(mechanism, mechanism.declared_field)
        matrices, symbols = projection.linearised, symbols | _integrals(projection)
        lines.append(r"% \psi_i: mode functions of \xi = x/l; row i, column j")
    else:
        matrices = linearise(mechanism, residual(mechanism))._asdict()
    for name, matrix in matrices.items():
        lines.append(f"{name} = {sympy.latex(matrix, symbol_names=symbols)}")
    return "\n".join(lines)


def _integrals(projection: Projection) -> dict[sympy.Symbol, str]:
    """What the symbols of modal integrals stand for."""
    pairs = {
        symbol: rf"\int_0^1 \xi^{pair.power} \psi_i^{{({pair.first})}} \psi_j^{{({pair.second})}} d\xi"
        for symbol, pair in projection.pairs.items()
    }
    columns = {
        symbol: rf"\int_0^1 \xi^{moment.power} \psi_i^{{({moment.derivative})}} d\xi"
        for symbol, moment in projection.moments.items()
    }
    return pairs | columns
