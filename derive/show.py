"""Linearised equations as LaTeX, with symbols or with the numbers of a case."""

import re
import textwrap
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import sympy

from derive.beam import FAMILIES
from derive.emit import derive_equations
from derive.errors import CaseError
from derive.galerkin import ZERO_COLUMN, ZERO_MATRIX, Projection
from derive.mechanism import MechanismStatement
from derive.reading import Equation, links, read, with_numbers
from derive.structure import StructureStatement
from derive.symbols import PHASE, SPEED
from derive.units import parse, size

WIDTH = 80
_INDENT = "    "
_DEEPEST = 4
_TALL = r"\\frac|\\begin|\\sum"
_FRACTION = r"\\frac\{((?:[^{}]|\{[^{}]*\})*)\}\{([^{} ]*)\}"
"""Pattern of a fraction with a single short factor in the denominator."""

_BRACES = r"(\\(?:sin|cos|tan|exp)(?:\^\d)? ?|\|)\{((?:[^{}]|\{[^{}]*\})*)\}"
"""Pattern of the braces around the complete argument of a function."""


def equations(
    mechanism: MechanismStatement, numbers: Mapping[sympy.Symbol, float] = MappingProxyType({})
) -> str:
    """Return LaTeX of the entries of M, C, K and d of M q̈ + C q̇ + K q = d.

    For a structure, return LaTeX of the properties of its links. numbers: values of parameters; with them,
    options have their default values.
    """
    numbers = {**numbers, **_defaults(mechanism)} if numbers else {}
    names: dict[sympy.Symbol, str] = {PHASE: r"\varphi", SPEED: r"\Omega"}
    comments = [mechanism.title]
    if isinstance(mechanism, StructureStatement):
        listed = links(mechanism)
        comments.append("angle, length, stiffnesses, mass per unit length and height of each link")
    else:
        derived = derive_equations(mechanism)
        listed = read(mechanism, derived.linearised)
        names |= _integrals(derived.projection) if derived.projection else {}
        comments += _comments(mechanism, numbers)
    lines = [
        line for comment in comments for line in textwrap.wrap(f"% {comment}", WIDTH, subsequent_indent="% ")
    ]
    return "\n".join([*lines, *(line for each in _numbered(listed, numbers) for line in _lines(each, names))])


def _numbered(listed: Iterable[Equation], numbers: Mapping[sympy.Symbol, float]) -> Iterator[Equation]:
    """Yield the equations with numbers rounded to six digits. Named subexpressions that are numbers are
    substituted."""
    values = dict(numbers)
    if not numbers:
        yield from listed
        return
    for equation in listed:
        value = with_numbers(equation.right, values)
        if equation.unit and value.is_number:
            values[equation.left[0]] = value
        else:
            rounded = value.xreplace({number: _rounded(number) for number in value.atoms(sympy.Float)})
            yield replace(equation, right=rounded)


def _rounded(number: sympy.Float) -> Any:
    text = f"{float(number):.6g}"
    return sympy.Integer(text) if re.fullmatch(r"-?\d+", text) else sympy.Float(text, 6)


def _defaults(mechanism: MechanismStatement) -> dict[sympy.Symbol, float]:
    return {
        indicator: float(value == option.default)
        for option in mechanism.declared_options
        for indicator, value in zip(option.indicators, option.values, strict=False)
    }


def _comments(mechanism: MechanismStatement, numbers: Mapping[sympy.Symbol, float]) -> list[str]:
    """Comments that explain symbols that the mechanism does not declare."""
    if mechanism.declared_field:
        vector = r"\psi: mode functions of \xi = x/l, integrals from 0 to 1; row i, column j"
    else:
        vector = (
            "q = ("
            + ", ".join(latex(coordinate.symbol) for coordinate in mechanism.declared_coordinates)
            + ")"
        )
    return [
        r"M \ddot q + C \dot q + K q = d, \varphi = \Omega t, primes: d/d\varphi; entries not given are 0",
        vector,
        *_modal(mechanism),
        *(
            f"{latex(indicator)} is 1 for the option {option.name}={value}, otherwise 0"
            for option in mechanism.declared_options
            for indicator, value in zip(option.indicators, option.values, strict=False)
            if indicator not in numbers
        ),
    ]


def _modal(mechanism: MechanismStatement) -> list[str]:
    """LaTeX comment that explains the modal damping."""
    ratios = ", ".join(map(latex, mechanism.damping_ratios))
    added = r"C also contains M \Phi diag(2 \zeta \omega) \Phi^T M, modes of M and K at \Omega = 0, \zeta = "
    return [added + ratios] if ratios else []


def latex(expression: Any, names: Mapping[sympy.Symbol, str] | None = None) -> str:
    """LaTeX of an expression, without superfluous braces or bracket sizes.

    >>> x, y = sympy.symbols("x_1 y")
    >>> print(latex(sympy.sin(x + y) ** 2 / 2))
    \\sin^2(x_1 + y) / 2
    """
    text = sympy.latex(expression, symbol_names=dict(names or {}), fold_short_frac=True)
    text = re.sub(_FRACTION, _in_line, re.sub(r"([_^])\{(\w)\}", r"\1\2", text))
    if not re.search(_TALL, text):
        text = re.sub(r"\\(left|right)(?=[()|])", "", text)
    return re.sub(_BRACES, r"\1\2", re.sub(r" +(?=[ )]|\\right)", "", text))


def _in_line(fraction: re.Match[str]) -> str:
    above, below = fraction.groups()
    return f"({above}) / {below}" if len(_terms(above, 0)) > 1 else f"{above} / {below}"


def _lines(equation: Equation, names: Mapping[sympy.Symbol, str]) -> list[str]:
    """Lines of an equation, with the unit of a named subexpression as a comment."""
    text = " = ".join([*map(latex, equation.left), latex(equation.right, names)])
    first, *others = _folded(text, WIDTH)
    lines = [first, *(_INDENT + other for other in others)]
    unit = f" % {equation.unit}" if equation.unit else ""
    return (
        [*lines[:-1], lines[-1] + unit]
        if len(lines[-1] + unit) <= WIDTH
        else [*lines, _INDENT + unit.strip()]
    )


def _folded(text: str, width: int, depth: int = 0) -> list[str]:
    """Break a text into lines before + and −, outside brackets if possible."""
    if len(text) <= width:
        return [text]
    if depth > _DEEPEST:
        return textwrap.wrap(text, width - len(_INDENT), break_long_words=False, break_on_hyphens=False)
    lines = [""]
    for term in _terms(text, depth):
        if lines[-1] and len(lines[-1] + term) > width - len(_INDENT):
            lines.append(term.lstrip())
        else:
            lines[-1] += term
    return [part for line in lines for part in _folded(line, width - len(_INDENT), depth + 1)]


def _terms(text: str, depth: int) -> list[str]:
    """Split a text before each + or − that has spaces on both sides and lies within at most `depth`
    brackets."""
    inside, start, terms = 0, 0, []
    for position, letter in enumerate(text):
        inside += (letter in "({") - (letter in ")}")
        if inside <= depth and re.match(" [-+] ", text[position:]):
            terms.append(text[start:position])
            start = position
    return [*terms, text[start:]]


def _integrals(projection: Projection) -> dict[sympy.Symbol, str]:
    """Mapping from the symbols of integrals of mode functions to LaTeX."""
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


def elements() -> str:
    """LaTeX of the mass and stiffness matrices of the element families, for unit length, ρA and EA or EI."""
    lines = []
    for family in FAMILIES:
        lines.append(f"% {family.name}: mass and stiffness matrices for L = 1, rho A = 1 and EA or EI = 1")
        lines += [f"M = {sympy.latex(family.mass)}", f"K = {sympy.latex(family.stiffness)}"]
    return "\n".join(lines)


def case_numbers(path: Path, case: str, mechanism: MechanismStatement) -> dict[sympy.Symbol, float]:
    """Return the parameters of a case in coherent SI units.

    Two kinds of parameters are omitted: those from a table of measured values, and those in hertz whose
    declared unit is not, or the reverse. Raises UnitError, and CaseError if the file cannot be read or does
    not contain the case.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8-sig"))
        cases = {name: {**entry.get("parameters", {})} for name, entry in content["case"].items()}
        shared = {**content.get("common", {}).get("parameters", {})}
    except (OSError, UnicodeDecodeError, ValueError, KeyError, AttributeError, TypeError) as error:
        raise CaseError(f"{path} cannot be read as a case file: {_cause(error)}") from None
    if case not in cases:
        raise CaseError(f'{path} has no case "{case}"; it has: {", ".join(cases)}')
    declared = {parameter.symbol.name: parameter for parameter in mechanism.declared_parameters}
    numbers = {}
    for name, entry in {**shared, **cases[case]}.items():
        for member, value in _members(name, entry):
            if member not in declared or not isinstance(value, int | float):
                raise CaseError(
                    f"{path}: {member} = {value!r} is not the number of a parameter of {mechanism.name}"
                )
            unit = entry.get("unit", "")
            if parse(unit) != parse(declared[member].unit):
                raise CaseError(f'{path}: {member} is in "{unit}"; it must be in "{declared[member].unit}"')
            # Hertz and rad/s are not converted into each other, because a hertz may be 1/s or 2π rad/s.
            if ("Hz" in unit) == ("Hz" in declared[member].unit):
                numbers[declared[member].symbol] = float(value) * size(unit)
    return numbers


def _members(name: str, entry: Any) -> Iterator[tuple[str, Any]]:
    """Yield the names and values of the parameters in one entry of a case file."""
    kinds = {"unit": str, "values": list, "count": int}
    if not isinstance(entry, dict) or not all(
        isinstance(entry[key], kind) for key, kind in kinds.items() if key in entry
    ):
        raise CaseError(f"{name} is {entry!r}; give a table with value or values, and unit")
    if "count" in entry:
        yield from ((f"{name}{k + 1}", entry.get("value")) for k in range(entry["count"]))
    elif "values" in entry:
        yield from ((f"{name}{k}", value) for k, value in enumerate(entry["values"], start=1))
    elif "table" not in entry:
        yield name, entry.get("value")


def _cause(error: Exception) -> str:
    """Reason why a case file cannot be read."""
    if isinstance(error, OSError):
        return (error.strerror or "no access").lower()
    if isinstance(error, KeyError):
        return f"it has no {error}"
    return str(error) if isinstance(error, ValueError) else "a table is missing"
