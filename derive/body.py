"""Elastic bodies described by reduced matrices (R. R. Craig, M. C. C. Bampton, AIAA J. 6 (1968)
1313-1319)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import sympy

from derive.declarations import require_plain
from derive.errors import DeclarationError
from derive.symbols import Moving, rate
from derive.units import cut

_UNITS = {
    "M": ("kg", "kg m", "kg m^2"),
    "K": ("N/m", "N/rad", "N m/rad"),
    "C": ("N s/m", "N s/rad", "N m s/rad"),
}
"""Units of a matrix entry that couples two lengths, a length and an angle, or two angles. Modal coordinates
count as angles."""

_MEANINGS = {"M": "mass", "K": "stiffness", "C": "damping"}


class Declaring(Protocol):
    """Protocol of a mechanism that declares coordinates and parameters."""

    def coordinates(self, **declared: tuple[str, str]) -> tuple[Moving, ...]: ...

    def parameter(self, name: str, unit: str, meaning: str, bound: str = "") -> sympy.Symbol: ...


@dataclass(frozen=True)
class ReducedBody:
    """Elastic body with interface displacements and component modes.

    Attributes
    ----------
    modes : tuple of symbols
        Dimensionless coordinates of the modes.
    kinetic, potential, dissipation : sympy.Expr
        Energies and dissipation function, to be added to those of the mechanism.
    entries : tuple
        (parameter, matrix, row, column) of each entry, rows and columns from 1.
    units : tuple of str
        Units of the interface displacements, "m" or "rad".
    """

    name: str
    units: tuple[str, ...]
    modes: tuple[Moving, ...]
    kinetic: sympy.Expr
    potential: sympy.Expr
    dissipation: sympy.Expr
    entries: tuple[tuple[str, str, int, int], ...]

    @property
    def row(self) -> tuple[Any, ...]:
        """Entry for this body in BODIES of the generated module."""
        return self.name, self.units, len(self.modes), self.entries


def declared_body(
    mechanism: Declaring,
    name: str,
    interface: Mapping[str, tuple[Any, str]],
    modes: int,
    damping: bool,
) -> ReducedBody:
    """Declare the modes of a body and the entries of its matrices, and return the body. Raises
    DeclarationError."""
    require_plain(name)
    pairs = [pair for pair in interface.values() if isinstance(pair, tuple) and len(pair) == 2]
    units = tuple(unit for _, unit in pairs)
    if not interface or len(pairs) < len(interface) or not set(units) <= {"m", "rad"}:
        raise DeclarationError(
            f'{name}: interface is {cut(str(interface))}; give displacements in "m" or "rad", such as '
            'interface={"tip": (y, "m")}'
        )
    if not isinstance(modes, int) or modes < 0:
        raise DeclarationError(f"{name}: modes is {modes!r}; give the number of modes, 0 or more")
    numbers = range(1, modes + 1)
    amplitudes = mechanism.coordinates(
        **{f"{name}{k}": ("1", f"{name}, mode {k} with its interface fixed") for k in numbers}
    )
    q = [*(sympy.sympify(expression) for expression, _ in pairs), *amplitudes]
    labels = [*interface, *(f"mode {k}" for k in numbers)]
    matrices = "MKC" if damping else "MK"
    totals, entries = dict.fromkeys("MKC", sympy.S.Zero), []
    for matrix in matrices:
        factors = q if matrix == "K" else [rate(coordinate) for coordinate in q]
        for i, j in _occupied(matrix, len(interface), len(q)):
            symbol = f"{name}_{matrix}{i + 1}_{j + 1}"
            unit = _UNITS[matrix][sum(k >= len(units) or units[k] == "rad" for k in (i, j))]
            meaning = f"{name}, {_MEANINGS[matrix]} of {labels[i]} and {labels[j]}"
            is_positive = i == j and (matrix == "M" or (matrix == "K" and i >= len(units)))
            entry = mechanism.parameter(symbol, unit, meaning, "> 0" if is_positive else "")
            totals[matrix] += entry * factors[i] * factors[j] / (2 if i == j else 1)
            entries.append((symbol, matrix, i + 1, j + 1))
    return ReducedBody(name, units, amplitudes, totals["M"], totals["K"], totals["C"], tuple(entries))


def _occupied(matrix: str, interface: int, size: int) -> list[tuple[int, int]]:
    """Positions (i, j) of the entries on and above the diagonal that may be nonzero.

    In M and K, entries that couple two different modes are zero; in K, so are entries that couple a mode with
    the interface.
    """
    pairs = [(i, j) for i in range(size) for j in range(i, size)]
    if matrix == "C":
        return pairs
    last = interface if matrix == "K" else size
    return [(i, j) for i, j in pairs if i == j or (i < interface and j < last)]
