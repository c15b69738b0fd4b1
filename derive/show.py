"""The linearised equations as LaTeX, for reading."""

from collections.abc import Mapping, Set
from typing import Any

import sympy

from derive.beam import FAMILIES
from derive.galerkin import ZERO_COLUMN, ZERO_MATRIX, Projection, project
from derive.lagrange import residual
from derive.linearise import linearise
from derive.mechanism import Mechanism
from derive.structure import Structure


def equations(mechanism: Mechanism) -> str:
    """M, C, K, d of M q̈ + C q̇ + K q = d, series at the phase with primes only; of a structure its
    links' properties."""
    if isinstance(mechanism, Structure):
        return _links(mechanism)
    vector = sympy.latex(sympy.Matrix([each.symbol for each in mechanism.declared_coordinates]))
    lines = [
        f"% {mechanism.title}",
        rf"% M \ddot q + C \dot q + K q = d,\quad \varphi = \Omega t,\quad q = {vector}",
    ]
    symbols = {mechanism.phase: r"\varphi", mechanism.speed: r"\Omega"}
    if mechanism.declared_field:
        projection = project(mechanism, mechanism.declared_field)
        matrices, symbols = projection.linearised, symbols | _integrals(projection)
        lines.append(r"% \psi: mode functions of \xi = x/l, integrated from 0 to 1; row i, column j")
    else:
        matrices = linearise(mechanism, residual(mechanism))._asdict()
    plain = [f"{name} = {sympy.latex(matrix, symbol_names=symbols)}" for name, matrix in matrices.items()]
    short = [
        f"{name if isinstance(name, str) else sympy.latex(name)} = {sympy.latex(part, symbol_names=symbols)}"
        for name, part in abbreviated(matrices, mechanism.names()).items()
    ]
    # Abbreviations are worth their names only where they make kinematics that are written out readable.
    lines += short if 2 * len("".join(short)) < len("".join(plain)) else plain
    return "\n".join(lines)


def abbreviated(matrices: Mapping[str, Any], taken: Set[str]) -> dict[Any, Any]:
    """Common parts by new symbols s1, s2, …, none of them `taken`, then the matrices in these."""
    new = (symbol for symbol in sympy.numbered_symbols("s", start=1) if symbol.name not in taken)
    common, reduced = sympy.cse(list(matrices.values()), new, order="canonical")
    return {**dict(common), **dict(zip(matrices, reduced, strict=True))}


def _integrals(projection: Projection) -> dict[sympy.Symbol, str]:
    """What the symbols of modal integrals stand for."""
    pairs = {
        symbol: rf"\int {_weight(pair.power)}{_mode('i', pair.first)} {_mode('j', pair.second)} d\xi"
        for symbol, pair in projection.pairs.items()
    }
    columns = {
        symbol: rf"\int {_weight(moment.power)}{_mode('i', moment.derivative)} d\xi"
        for symbol, moment in projection.moments.items()
    }
    return {ZERO_MATRIX: "0", ZERO_COLUMN: "0", **pairs, **columns}


def _weight(power: int) -> str:
    return rf"\xi^{power} " if power > 1 else power * r"\xi "


def _mode(number: str, derivative: int) -> str:
    return rf"\psi_{number}{derivative * chr(39)}"


def _links(structure: Structure) -> str:
    lines = [f"% {structure.title}"]
    for link in structure.declared_links:
        lines.append(
            f"% link {link.name}, from {link.start} to {link.end}: angle, length, EA, EI, rhoA, height"
        )
        lines += [sympy.latex(expression) for expression, _ in link.properties.values()]
    return "\n".join(lines)


def elements() -> str:
    """Mass and stiffness matrices of the beam elements' families, for unit length."""
    lines = []
    for family in FAMILIES:
        lines.append(f"% {family.name}: mass over rho A L, stiffness for unit length")
        lines += [f"M = {sympy.latex(family.mass)}", f"K = {sympy.latex(family.stiffness)}"]
    return "\n".join(lines)
