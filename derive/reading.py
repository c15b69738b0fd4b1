"""The linearised equations as they stand in the literature: entry by entry, with names for long parts that
occur again. How they are printed is stated in `show` and in `mathml`."""

import string
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import count, product
from typing import Any

import sympy

from derive.checks import dimensions
from derive.kinematics import LoopFunction
from derive.mechanism import MechanismStatement
from derive.structure import StructureStatement
from derive.units import Dimension, dimension_of, parse

_SHORT = 3
"""Operations of a part that is worth a name."""

_LONG = 300
"""Operations beyond which nothing is expanded."""

_LETTERS = {
    "1": "eta", "m": "l", "m^2": "A", "kg": "mu", "kg m": "S", "kg m^2": "J", "N": "F", "N m": "T",
    "N/m": "k", "N s/m": "c", "N m s": "c", "m/s": "v", "1/s": "omega", "m/s^2": "a", "Pa": "p",
}  # fmt: skip
"""The letter of a part by its unit; of all else it is sigma."""


@dataclass(frozen=True)
class Equation:
    """What equals an expression: a name, or entries of a matrix that are the same.

    unit: of a part that has been named here.
    """

    left: tuple[sympy.Symbol, ...]
    right: Any
    unit: str = ""


def read(mechanism: MechanismStatement, linearised: Mapping[str, Any]) -> list[Equation]:
    """Named parts, then the entries of M, C, K, d that are not 0; of a deflection's projection its sums."""
    named, names = _named(mechanism, linearised.values())
    put = {
        name: _each(part, lambda entry: _shorter(entry.xreplace(names))) for name, part in linearised.items()
    }
    return named + [each for name, part in put.items() for each in _entries(name, part)]


def _each(part: Any, change: Callable[[Any], Any]) -> Any:
    """A matrix with each entry changed, or an expression."""
    return part.applyfunc(change) if isinstance(part, sympy.MatrixBase) else change(part)


def links(structure: StructureStatement) -> list[Equation]:
    """Of each link of a structure its angle, length, stiffnesses, mass per length and height."""
    names = {"angle": "theta", "length": "L", "height": "h"}
    return [
        Equation((sympy.Symbol(f"{names.get(name, name)}_{link.name}"),), expression)
        for link in structure.declared_links
        for name, (expression, _) in link.properties.items()
    ]


def with_numbers(expression: Any, numbers: Mapping[sympy.Symbol, Any]) -> Any:
    """The expression with numbers in place of parameters, but for the arguments of a loop's unknowns, by
    which these are differentiated."""
    kept = {each: each for each in expression.atoms(LoopFunction)}
    return expression.xreplace({**{each: sympy.Float(x) for each, x in numbers.items()}, **kept})


def _entries(name: str, matrix: Any) -> Iterator[Equation]:
    if not isinstance(matrix, sympy.MatrixBase):
        yield Equation((sympy.Symbol(f"{name}_i" if name == "d" else f"{name}_ij"),), matrix)
        return
    rows, columns = matrix.shape
    if matrix.is_zero_matrix or rows == 1:
        yield Equation((sympy.Symbol(name),), matrix[0, 0])
        return
    comma = "," if rows > 9 else ""
    for i, j in product(range(rows), range(columns)):
        equal = j != i and columns > 1 and matrix[i, j] == matrix[j, i]
        if matrix[i, j] == 0 or (equal and j < i):
            continue
        places = [(i, j), (j, i)] if equal else [(i, j)]
        indices = [f"{a + 1}{comma}{b + 1}" if columns > 1 else f"{a + 1}" for a, b in places]
        yield Equation(tuple(sympy.Symbol(f"{name}_{index}") for index in indices), matrix[i, j])


def _named(mechanism: MechanismStatement, parts: Iterable[Any]) -> tuple[list[Equation], dict[Any, Any]]:
    """Sums and roots that occur more than once by names that tell their units, and what takes their place."""
    known, taken = dimensions(mechanism), mechanism.names()
    repeated = _repeated(parts)
    named: list[Equation] = []
    names: dict[Any, Any] = {}
    for base, forms in repeated.items():
        if base.free_symbols <= known.keys() and sympy.sqrt(base) not in repeated:
            symbol = _shorter(base.xreplace(names))
            if isinstance(symbol, sympy.Add | sympy.Pow):
                dimension = dimension_of("a part", base, known)
                value, symbol = symbol, next(each for each in _symbols(dimension) if each.name not in taken)
                taken.add(symbol.name)
                named.append(Equation((symbol,), value, str(dimension)))
            names |= {form: factor * symbol**power for form, (factor, power) in forms.items()}
            if isinstance(base, sympy.Pow):
                names[base.base] = symbol**2
    return named, names


def _shorter(expression: Any) -> Any:
    """Expanded where that is shorter, as it is where what has been named cancels."""
    if sympy.count_ops(expression) > _LONG:
        return expression
    return min(expression, sympy.expand(expression), key=sympy.count_ops)


def _symbols(dimension: Dimension) -> Iterator[sympy.Symbol]:
    letter = next((each for unit, each in _LETTERS.items() if parse(unit) == dimension), "sigma")
    for length in count(1):
        for letters in product(string.ascii_lowercase, repeat=length):
            yield sympy.Symbol(f"{letter}_{''.join(letters)}")


def _repeated(parts: Iterable[Any]) -> dict[Any, dict[Any, tuple[Any, Any]]]:
    """Sums and square roots of some length that occur twice or more, those within others first, and the forms
    in which they occur: with a factor and to a power."""
    times: dict[Any, int] = {}
    forms: dict[Any, dict[Any, tuple[Any, Any]]] = {}
    for expression in parts:
        walk = sympy.preorder_traversal(expression)
        for part in walk:
            base, factor, power = _base(part)
            if base is not None:
                times[base] = times.get(base, 0) + 1
                forms.setdefault(base, {})[part] = factor, power
            if times.get(base, 0) > 1 or isinstance(part, LoopFunction):
                walk.skip()
    found = [base for base, often in times.items() if often > 1]
    found.sort(key=lambda base: (base.count_ops(), sympy.default_sort_key(base)))
    return {base: forms[base] for base in found}


def _base(part: Any) -> tuple[Any, Any, Any]:
    """What a part that may be named is a multiple or a power of, the factor and the power; else None."""
    base, factor, power = sympy.S.Zero, sympy.S.One, sympy.S.One
    if isinstance(part, sympy.Pow) and isinstance(part.exp, sympy.Rational) and part.exp.q == 2:
        base, power = sympy.sqrt(part.base), sympy.Integer(part.exp.p)
    elif isinstance(part, sympy.Add):
        factor, base = part.primitive()
        if base.could_extract_minus_sign():
            factor, base = -factor, -base
    return (base if base.count_ops() >= _SHORT else None), factor, power
