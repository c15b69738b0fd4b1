"""What a mechanism's author declares: each kind with its symbol, unit and meaning."""

from dataclasses import dataclass
from typing import Any

import sympy

from derive.errors import DeclarationError
from derive.symbols import Moving


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
