"""Declarations of a mechanism's author, with symbol, unit, meaning, and line in the author's file."""

import keyword
import os
import re
import sys
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import sympy

from derive.errors import DeclarationError, DeriveError
from derive.switches import switches
from derive.symbols import Moving, counted

RESERVED = (
    *("phase", "speed", "coordinates", "rates", "accelerations", "parameters", "casadi", "math", "running"),
    *("time", "speedd", "multiplier_re", "multiplier_im", "exponent_re", "exponent_im"),
)
"""Names of generated code, and of what files of results hold besides coordinates and outputs."""

ARGUMENTS = ("q", "qd", "qdd", "p")
"""Names of what generated functions take, beside those that are reserved."""

_CLAUSE = r"\s*(?:(integer)|([<>]=?)\s*(-?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?))\s*"


def require_plain(name: str) -> None:
    """Raise DeclarationError unless generated code can use the name."""
    plain = isinstance(name, str) and re.fullmatch("[A-Za-z][A-Za-z0-9_]*", name)
    if not plain or keyword.iskeyword(name) or name in RESERVED:
        raise DeclarationError(
            f'"{name}" cannot be a name: it is reserved, or no plain word of letters and digits'
        )


def require_result(name: str) -> None:
    """Raise DeclarationError unless a generated function can give, or be made for, something of the name."""
    require_plain(name)
    if name in ARGUMENTS:
        raise DeclarationError(
            f'"{name}" cannot be the name of an output, an option or a line: generated functions take '
            "arguments of that name; choose a longer one"
        )


def bound_of(name: str, text: str) -> str:
    """A bound in the one form that generated modules hold: "> 0", "integer, >= 1"; "" where there is none.

    Raises DeclarationError.

    >>> bound_of("z1", "integer,>=1")
    'integer, >= 1'
    """
    clauses = [re.fullmatch(_CLAUSE, part) for part in str(text).split(",")] if text != "" else []
    parts = [each[1] or f"{each[2]} {each[3]}" for each in clauses if each]
    if len(parts) < len(clauses):
        raise DeclarationError(
            f'{name}: the bound "{text}" is not understood; give "> 0", ">= 0", "< 1" or "integer, >= 1"'
        )
    return ", ".join(parts)


def scalar(what: str, value: Any) -> Any:
    """The one entry of a matrix of one entry, anything else as it is. Raises DeclarationError for a matrix of
    several."""
    if not isinstance(value, sympy.MatrixBase):
        return value
    if value.shape != (1, 1):
        raise DeclarationError(
            f"{what} is a matrix of {value.rows} by {value.cols}; give one entry, such as q.T * K * q / 2"
        )
    return value[0, 0]


@dataclass(frozen=True)
class Coordinate:
    symbol: Moving
    unit: str
    meaning: str


@dataclass(frozen=True)
class Parameter:
    symbol: sympy.Symbol
    unit: str
    meaning: str
    bound: str


@dataclass(frozen=True)
class Output:
    name: str
    expression: Any
    unit: str
    meaning: str


@dataclass(frozen=True)
class Option:
    """A choice that the user of the generated module makes by name."""

    name: str
    values: tuple[str, ...] | range
    default: str | int

    @property
    def indicators(self) -> tuple[sympy.Symbol, ...]:
        """One symbol a value, 1 where it is chosen and 0 elsewhere; none where the option is a number."""
        words = () if isinstance(self.values, range) else self.values
        return tuple(sympy.Symbol(f"{self.name}_{value}", real=True) for value in words)

    def choose(self, **expressions: Any) -> Any:
        """The expression of the chosen value; DeclarationError unless each value has one."""
        if set(expressions) != set(self.values):
            raise DeclarationError(
                f"option {self.name} needs one expression for each of {', '.join(map(str, self.values))}; "
                f"given: {', '.join(expressions) or 'none'}"
            )
        chosen = zip(self.indicators, self.values, strict=True)
        return sympy.Add(*(indicator * expressions[str(value)] for indicator, value in chosen))


@dataclass(frozen=True)
class Condition:
    """What a mechanism's parameters, by name, must satisfy at every phase: `margin` > 0."""

    text: str
    meaning: str
    margin: Any
    parameters: tuple[str, ...]


_HERE = f"{Path(__file__).parent}{os.sep}"
_MADE = "<string>"
"""File of functions that dataclasses make."""


def note(lines: dict[Any, int], expression: Any) -> None:
    """Keep the line outside this package from which an expression is stated."""
    frame: Any = sys._getframe(1)
    while frame and (frame.f_code.co_filename.startswith(_HERE) or frame.f_code.co_filename == _MADE):
        frame = frame.f_back
    if frame and isinstance(expression, Hashable):
        lines[expression] = frame.f_lineno


def line_of(lines: Mapping[Any, int], error: DeriveError) -> int | None:
    """Line, of those noted, on which what an error is about was stated; None where that is not known."""
    about = error.about
    if about is None or not isinstance(about, Hashable):
        return None
    switching = [line for each, line in lines.items() if _switches(each, about)]
    return switching[-1] if switching else lines.get(about)


def _switches(expression: Any, switch: Any) -> bool:
    """Whether a stated expression switches there."""
    if not (isinstance(expression, sympy.Expr) and isinstance(switch, sympy.Expr)):
        return False
    stated = counted(expression)
    return bool({switch, -switch} & {*switches(stated, stated.free_symbols)})


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
