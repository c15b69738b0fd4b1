"""What a mechanism looks like: lines through points that are expressions of its motion."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import sympy

from derive.declarations import scalar
from derive.errors import DeclarationError

AROUND = sympy.Symbol("around a curve", real=True)
"""Angle from 0 to 2π by which the point of a closed curve runs."""

RUNNING = sympy.Symbol("running", real=True)
"""From 0 to 1 along whatever is drawn as a curve."""

METRE = sympy.Symbol("1 m", real=True)
"""The unit of sizes that belong to the picture alone."""

POINTS, CURVE, BEAM = "points", "curve", "beam"


@dataclass(frozen=True)
class Sketch:
    """A line by its points x, y in the plane of motion; one that runs along a curve or beam has one point.

    kind: POINTS, or CURVE where the point runs `around`, or BEAM where it runs along an elastic link.
    """

    name: str
    points: tuple[tuple[Any, Any], ...]
    unit: str
    kind: str

    @property
    def numbers(self) -> list[Any]:
        """x and y of every point, one after another."""
        return [number for point in self.points for number in point]

    def at(self, replace: Callable[[Any], Any]) -> sympy.Matrix:
        """The numbers as a column, sizes in the coherent unit."""
        return sympy.Matrix([replace(each).xreplace({METRE: sympy.S.One}) for each in self.numbers])


def sketch_of(name: str, points: Sequence[Any], unit: str, along_beam: set[Any]) -> Sketch:
    """The declared line. along_beam: symbols that mean something at one place of an elastic link only. Raises
    DeclarationError."""
    try:
        pairs = [
            tuple(sympy.sympify(scalar(name, number), strict=True) for number in each) for each in points
        ]
    except (TypeError, sympy.SympifyError):
        pairs = []
    numbers = [number for pair in pairs for number in pair]
    good = all(len(pair) == 2 for pair in pairs)
    good &= all(isinstance(each, sympy.Expr) and not each.has(sympy.I) for each in numbers)
    symbols = set().union(*(each.free_symbols for pair in pairs if good for each in pair))
    kind = BEAM if symbols & along_beam else CURVE if AROUND in symbols else POINTS
    if not pairs or not good or (kind == POINTS) == (len(pairs) == 1) or (kind == BEAM and AROUND in symbols):
        raise DeclarationError(
            f"sketch {name}: give the points of a line, such as [(0, 0), (x, y)], two or more; or the one "
            "point of a curve, such as [(r*cos(m.around), r*sin(m.around))] or beam.line(start, direction)"
        )
    return Sketch(name, tuple(pairs), unit, kind)
