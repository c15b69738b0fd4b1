"""What a mechanism's author declares: each kind with its symbol, unit and meaning."""

import keyword
import re
from dataclasses import dataclass
from typing import Any

import sympy

from derive.errors import DeclarationError
from derive.symbols import Moving

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
