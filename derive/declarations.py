"""Declared quantities, conditions and sketches of a mechanism, with their source lines."""

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
"""Names that are reserved because generated code or result files use them."""

ARGUMENTS = ("q", "qd", "qdd", "p")
"""Names of arguments of generated functions. Outputs, inputs, options and sketched lines must not have these
names."""

_CLAUSE = r"\s*(?:(integer)|([<>]=?)\s*(-?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?))\s*"


def require_plain(name: str) -> None:
    """Raise DeclarationError unless the name can be used in generated code."""
    plain = isinstance(name, str) and re.fullmatch("[A-Za-z][A-Za-z0-9_]*", name)
    if not plain or keyword.iskeyword(name) or name in RESERVED:
        raise DeclarationError(
            f'"{name}" cannot be a name: it is reserved, or not a word of letters, digits and _'
        )


def require_result(name: str) -> None:
    """Raise DeclarationError unless the name is permitted for an input, an output, an option or a
    sketched line."""
    require_plain(name)
    if name in ARGUMENTS:
        raise DeclarationError(
            f'"{name}" cannot be the name of an input, an output, an option or a line: generated functions '
            "take arguments of that name; choose a longer one"
        )


def bound_of(name: str, text: str) -> str:
    """Return a bound in the normal form, such as "> 0" or "integer, >= 1"; "" if the text is empty.

    Raises DeclarationError.

    >>> bound_of("z1", "integer,>=1")
    'integer, >= 1'
    """
    clauses = [re.fullmatch(_CLAUSE, part) for part in str(text).split(",")] if text != "" else []
    parts = [clause[1] or f"{clause[2]} {clause[3]}" for clause in clauses if clause]
    if len(parts) < len(clauses):
        raise DeclarationError(
            f'{name}: the bound "{text}" is not understood; give "> 0", ">= 0", "< 1" or "integer, >= 1"'
        )
    return ", ".join(parts)


def scalar(what: str, value: Any) -> Any:
    """Return the entry of a 1 by 1 matrix, or a value that is not a matrix unchanged. Raises DeclarationError
    for a larger matrix."""
    if not isinstance(value, sympy.MatrixBase):
        return value
    if value.shape != (1, 1):
        raise DeclarationError(
            f"{what} is a matrix of {value.rows} by {value.cols}; give one entry, such as q.T * K * q / 2"
        )
    return value[0, 0]


@dataclass(frozen=True)
class Coordinate:
    """Declared coordinate."""

    symbol: Moving
    unit: str
    meaning: str


@dataclass(frozen=True)
class Parameter:
    """Declared parameter, with its bound as text."""

    symbol: sympy.Symbol
    unit: str
    meaning: str
    bound: str


@dataclass(frozen=True)
class Output:
    """Declared output."""

    name: str
    expression: Any
    unit: str
    meaning: str


@dataclass(frozen=True)
class Input:
    """Declared input: a force, and the displacement along which it acts."""

    name: str
    along: Any
    unit: str
    meaning: str


@dataclass(frozen=True)
class Option:
    """Option of the generated module, with its allowed values."""

    name: str
    values: tuple[str, ...] | range
    default: str | int

    @property
    def indicators(self) -> tuple[sympy.Symbol, ...]:
        """Symbols, one per word of the option, with the value 1 if the word is selected and 0 otherwise.
        Empty if the values of the option are integers."""
        words = () if isinstance(self.values, range) else self.values
        return tuple(sympy.Symbol(f"{self.name}_{value}", real=True) for value in words)

    def choose(self, **expressions: Any) -> Any:
        """Return an expression whose value is that of the selected word. `expressions` has one entry per
        word. Raises DeclarationError."""
        if set(expressions) != set(self.values):
            raise DeclarationError(
                f"option {self.name} requires one expression for each of {', '.join(map(str, self.values))}; "
                f"given: {', '.join(expressions) or 'none'}"
            )
        chosen = zip(self.indicators, self.values, strict=True)
        return sympy.Add(*(indicator * expressions[str(value)] for indicator, value in chosen))


@dataclass(frozen=True)
class Condition:
    """Condition that the parameters must satisfy: `margin` > 0 at every phase."""

    text: str
    meaning: str
    margin: Any
    parameters: tuple[str, ...]


_HERE = f"{Path(__file__).parent}{os.sep}"
_MADE = "<string>"
"""File name that tracebacks show for functions generated by dataclasses."""


def note(lines: dict[Any, int], expression: Any) -> None:
    """Record the line of the mechanism file at which an expression is stated."""
    frame: Any = sys._getframe(1)
    while frame and (frame.f_code.co_filename.startswith(_HERE) or frame.f_code.co_filename == _MADE):
        frame = frame.f_back
    if frame and isinstance(expression, Hashable):
        lines[expression] = frame.f_lineno


def line_of(lines: Mapping[Any, int], error: DeriveError) -> int | None:
    """Recorded line of the expression to which an error refers; None if unknown."""
    about = error.about
    if about is None or not isinstance(about, Hashable):
        return None
    switching = [line for expression, line in lines.items() if _switches(expression, about)]
    return switching[-1] if switching else lines.get(about)


def _switches(expression: Any, switch: Any) -> bool:
    """Whether a recorded expression contains the given switch."""
    if not (isinstance(expression, sympy.Expr) and isinstance(switch, sympy.Expr)):
        return False
    stated = counted(expression)
    return bool({switch, -switch} & {*switches(stated, stated.free_symbols)})


AROUND = sympy.Symbol("around a curve", real=True)
"""Symbol of the angle from 0 to 2π along a closed curve."""

RUNNING = sympy.Symbol("running", real=True)
"""Symbol of the position along a curve, as a fraction from 0 to 1."""

METRE = sympy.Symbol("1 m", real=True)
"""Symbol of the unit metre, for lengths that occur only in the sketch."""

POINTS, CURVE, BEAM = "points", "curve", "beam"


@dataclass(frozen=True)
class Sketch:
    """Line through points x, y in the plane of motion, or curve traced by one moving point.

    kind: POINTS, CURVE for a closed curve, or BEAM for an elastic link.
    """

    name: str
    points: tuple[tuple[Any, Any], ...]
    unit: str
    kind: str

    @property
    def numbers(self) -> list[Any]:
        """Coordinates x1, y1, x2, y2, … of all points."""
        return [number for point in self.points for number in point]

    def at(self, replace: Callable[[Any], Any]) -> sympy.Matrix:
        """Coordinates of all points in the coherent unit, as a column. The function `replace` is applied to
        each coordinate."""
        return sympy.Matrix([replace(number).xreplace({METRE: sympy.S.One}) for number in self.numbers])


def sketch_of(name: str, points: Sequence[Any], unit: str, along_beam: set[Any]) -> Sketch:
    """Return the sketch with the given points. Raises DeclarationError.

    along_beam: symbols that are defined only at positions along an elastic link.
    """
    try:
        pairs = [
            tuple(sympy.sympify(scalar(name, number), strict=True) for number in point) for point in points
        ]
    except (TypeError, sympy.SympifyError):
        pairs = []
    numbers = [number for pair in pairs for number in pair]
    good = all(len(pair) == 2 for pair in pairs)
    good &= all(isinstance(number, sympy.Expr) and not number.has(sympy.I) for number in numbers)
    symbols = set().union(*(number.free_symbols for number in numbers)) if good else set()
    kind = BEAM if symbols & along_beam else CURVE if AROUND in symbols else POINTS
    if not pairs or not good or (kind == POINTS) == (len(pairs) == 1) or (kind == BEAM and AROUND in symbols):
        raise DeclarationError(
            f"sketch {name}: give two or more points of a line, such as [(0, 0), (x, y)]; or the moving "
            "point of a curve, such as [(r*cos(m.around), r*sin(m.around))]; or, for an elastic link, "
            "beam.line(start, direction)"
        )
    return Sketch(name, tuple(pairs), unit, kind)


def highest_mode(name: str, shape: Callable[[Any, Any], Any], modes: Any) -> int:
    """Return the largest number of modes of a field that is being declared. Raises DeclarationError for an
    invalid option or mode function."""
    values = getattr(modes, "values", modes)
    if not (isinstance(modes, Option) and isinstance(values, range) and values[0] >= 1):
        raise DeclarationError(
            f"{name}: modes is {values}; give an option with a range from 1 on, such as "
            'modes=mechanism.option("modes", range(1, 6))'
        )
    numbers = sympy.symbols("k xi")
    if sympy.sympify(shape(*numbers)).free_symbols != set(numbers):
        raise DeclarationError(
            f"{name}: the shape {shape(*numbers)} must depend on both k and xi, and on nothing else"
        )
    return int(values[-1])
