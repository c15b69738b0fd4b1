"""Linearised equations in the notation of the literature, and their MathML form.

There is one equation per matrix entry. Long subexpressions that occur repeatedly are named.
"""

import re
import string
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from html import unescape
from itertools import count, product
from typing import Any
from xml.dom.minidom import Element

import sympy
from sympy.printing.mathml import MathMLPresentationPrinter

from derive.checks import dimensions
from derive.functions import LoopFunction, PeriodicFunction
from derive.galerkin import ZERO_COLUMN, ZERO_MATRIX, Projection
from derive.mechanism import MechanismStatement
from derive.structure import StructureStatement
from derive.switches import Wrapped
from derive.symbols import PHASE, SPEED
from derive.units import Dimension, dimension_of, parse

_MIN_NAMED = 3
"""Smallest number of operations for which a subexpression is named. For eight mechanisms of `models/`, the
total length of the MathML is 58.0 to 58.3 kB with 2 to 4, and 69 kB with 10."""

_MAX_EXPANDED = 300
"""Number of operations above which expressions are not expanded, to save time. For eight mechanisms of
`models/`, the equations are the same with 30 to 3000."""

_LETTERS = {
    "1": "eta", "m": "l", "m^2": "A", "kg": "mu", "kg m": "S", "kg m^2": "J", "N": "F", "N m": "T",
    "N/m": "k", "N s/m": "c", "N m s": "c", "m/s": "v", "1/s": "omega", "m/s^2": "a", "Pa": "p",
}  # fmt: skip
"""Letters for named subexpressions, by unit; sigma for all other units."""


@dataclass(frozen=True)
class Equation:
    """Equation that defines a named subexpression, or one or two equal entries of a matrix.

    unit: unit of a named subexpression; "" for entries of a matrix.
    """

    left: tuple[sympy.Symbol, ...]
    right: Any
    unit: str = ""


def read(mechanism: MechanismStatement, linearised: Mapping[str, Any]) -> list[Equation]:
    """Return the equations for the named subexpressions and for the nonzero entries of M, C, K and d.

    For a projection, M, C, K and d are sums, with one equation each.
    """
    named, names = _named(mechanism, linearised.values())
    put = {
        name: _each(part, lambda entry: _shorter(entry.xreplace(names))) for name, part in linearised.items()
    }
    return named + [equation for name, part in put.items() for equation in _entries(name, part)]


def _each(part: Any, change: Callable[[Any], Any]) -> Any:
    """Apply `change` to every entry of a matrix, or to an expression."""
    return part.applyfunc(change) if isinstance(part, sympy.MatrixBase) else change(part)


def links(structure: StructureStatement) -> list[Equation]:
    """Equations for the angle, length, stiffnesses, mass per unit length and height of each link."""
    names = {"angle": "theta", "length": "L", "height": "h"}
    return [
        Equation((sympy.Symbol(f"{names.get(name, name)}_{link.name}"),), expression)
        for link in structure.declared_links
        for name, (expression, _) in link.properties.items()
    ]


def with_numbers(expression: Any, numbers: Mapping[sympy.Symbol, Any]) -> Any:
    """Substitute numbers for parameters, except in the arguments of the unknown functions of loops."""
    unchanged = {atom: atom for atom in expression.atoms(LoopFunction)}
    floats = {parameter: sympy.Float(number) for parameter, number in numbers.items()}
    return expression.xreplace({**floats, **unchanged})


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
        positions = [(i, j), (j, i)] if equal else [(i, j)]
        indices = [f"{a + 1}{comma}{b + 1}" if columns > 1 else f"{a + 1}" for a, b in positions]
        yield Equation(tuple(sympy.Symbol(f"{name}_{index}") for index in indices), matrix[i, j])


def _named(mechanism: MechanismStatement, parts: Iterable[Any]) -> tuple[list[Equation], dict[Any, Any]]:
    """Return the equations that name repeated sums and roots, and the mapping from these to their names. The
    letter of a name depends on the unit."""
    known, taken = dimensions(mechanism), mechanism.names()
    repeated = _repeated(parts)
    named: list[Equation] = []
    names: dict[Any, Any] = {}
    for base, forms in repeated.items():
        if base.free_symbols <= known.keys() and sympy.sqrt(base) not in repeated:
            symbol = _shorter(base.xreplace(names))
            if isinstance(symbol, sympy.Add | sympy.Pow):
                dimension = dimension_of("a part", base, known)
                value = symbol
                symbol = next(unused for unused in _symbols(dimension) if unused.name not in taken)
                taken.add(symbol.name)
                named.append(Equation((symbol,), value, str(dimension)))
            names |= {form: factor * symbol**power for form, (factor, power) in forms.items()}
            if isinstance(base, sympy.Pow):
                names[base.base] = symbol**2
    return named, names


def _shorter(expression: Any) -> Any:
    """Return an expression or, if this is shorter, its expansion. Named subexpressions may cancel in the
    expansion."""
    if sympy.count_ops(expression) > _MAX_EXPANDED:
        return expression
    return min(expression, sympy.expand(expression), key=sympy.count_ops)


def _symbols(dimension: Dimension) -> Iterator[sympy.Symbol]:
    letter = next((candidate for unit, candidate in _LETTERS.items() if parse(unit) == dimension), "sigma")
    for length in count(1):
        for letters in product(string.ascii_lowercase, repeat=length):
            yield sympy.Symbol(f"{letter}_{''.join(letters)}")


def _repeated(parts: Iterable[Any]) -> dict[Any, dict[Any, tuple[Any, Any]]]:
    """Return the long sums and square roots that occur at least twice, shortest first.

    The values map each form in which a sum or root occurs to its factor and its power.
    """
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
    repeated = [base for base, count in times.items() if count > 1]
    repeated.sort(key=lambda base: (base.count_ops(), sympy.default_sort_key(base)))
    return {base: forms[base] for base in repeated}


def _base(part: Any) -> tuple[Any, Any, Any]:
    """Base, factor and power of a subexpression. The base is None if it is not to be named."""
    base, factor, power = sympy.S.Zero, sympy.S.One, sympy.S.One
    if isinstance(part, sympy.Pow) and isinstance(part.exp, sympy.Rational) and part.exp.q == 2:
        base, power = sympy.sqrt(part.base), sympy.Integer(part.exp.p)
    elif isinstance(part, sympy.Add):
        factor, base = part.primitive()
        if base.could_extract_minus_sign():
            factor, base = -factor, -base
    return (base if base.count_ops() >= _MIN_NAMED else None), factor, power


_NAMED = r"&(?!amp;|lt;|gt;|#)\w+;"
_TIMES, _APPLY = "&#x2062;", "&#x2061;"
_PRIMES = ("", "&#x2032;", "&#x2033;", "&#x2034;")


def mathml(equations: Iterable[Equation], projection: Projection | None = None) -> tuple[str, ...]:
    """Return one `<math>` element per equation, in ASCII. A projection defines the integrals of mode
    functions in the equations."""
    names = {PHASE: "<mi>&#x3C6;</mi>", SPEED: "<mi>&#x3A9;</mi>"}
    printer = _Printer(names | (_integrals(projection) if projection else {}))
    return tuple(
        f"<math><mrow>{'<mo>=</mo>'.join(_sides(printer, equation))}</mrow></math>" for equation in equations
    )


def _sides(printer: "_Printer", equation: Equation) -> list[str]:
    return [printer.doprint(each) for each in (*equation.left, equation.right)]


class _Printer(MathMLPresentationPrinter):
    """MathML printer for the functions of derive and for symbols with prescribed MathML text."""

    def __init__(self, names: Mapping[Any, str]):
        super().__init__({"mul_symbol": _TIMES})
        self._names = names

    def _print_Symbol(self, sym: Any, style: str = "plain") -> Any:
        if sym in self._names:
            return self._element("mrow", self._names[sym])
        return super()._print_Symbol(sym, style)

    def mathml_tag(self, e: Any) -> str:
        return super().mathml_tag(e).replace("<", "&lt;").replace(">", "&gt;")

    def doprint(self, expr: Any) -> str:
        # XML predefines only these character names; names of several letters require a space between them.
        text = re.sub(_NAMED, lambda name: f"&#{ord(unescape(name[0]))};", super().doprint(expr))
        return text.replace(f"<mo>{_TIMES}</mo>", f'<mo rspace="0.12em">{_TIMES}</mo>')

    def series(self, expr: PeriodicFunction) -> Element:
        name = self._primed(sympy.Symbol(type(expr).__name__), expr.order)
        return name if expr.args[0] == PHASE else self._element("mrow", name, self._bracketed(expr.args[0]))

    def unknown(self, expr: LoopFunction) -> Element:
        primes, others = expr.derivatives
        by = [
            self._element("msubsup", self._element("mo", "&#x2202;"), self._print(by), self._print(times))
            if times > 1
            else self._element("msub", self._element("mo", "&#x2202;"), self._print(by))
            for by, times in others
        ]
        return self._element("mrow", *by, self._primed(sympy.Symbol(type(expr).__name__), primes))

    def _print_Wrapped(self, expr: Wrapped) -> Element:
        angle, turn = map(self._print, expr.args)
        return self._element("mrow", "<mo>(</mo>", angle, "<mo>mod</mo>", turn, "<mo>)</mo>")

    def _print_Heaviside(self, expr: Any) -> Element:
        return self._element("mrow", "<mi>&#x398;</mi>", self._bracketed(expr.args[0]))

    def _print_Piecewise(self, expr: Any) -> Element:
        cells = [
            [self._element("mtd", self._print(part)), self._element("mtd", self._case(condition))]
            for part, condition in expr.args
        ]
        rows = [self._element("mtr", *row) for row in cells]
        return self._element("mrow", "<mo>{</mo>", self._element("mtable", *rows))

    def _case(self, condition: Any) -> Any:
        return self._element("mtext", "else") if condition == sympy.true else self._print(condition)

    def _primed(self, symbol: sympy.Symbol, order: int) -> Any:
        mark = _PRIMES[order] if order < len(_PRIMES) else f"({order})"
        name = self._print(symbol)
        return self._element("msup", name, self._element("mo", mark)) if mark else name

    def _bracketed(self, argument: Any) -> Element:
        return self._element("mrow", f"<mo>{_APPLY}</mo><mo>(</mo>", self._print(argument), "<mo>)</mo>")

    def _element(self, tag: str, *parts: str | Element) -> Element:
        element = self.dom.createElement(tag)
        for part in parts:
            # SymPy's printer writes text nodes unescaped.
            element.appendChild(self.dom.createTextNode(part) if isinstance(part, str) else part)
        return element


def _integrals(projection: Projection) -> dict[Any, str]:
    pairs = {
        symbol: _integral(each.power, _mode("i", each.first), _mode("j", each.second))
        for symbol, each in projection.pairs.items()
    }
    columns = {
        symbol: _integral(each.power, _mode("i", each.derivative))
        for symbol, each in projection.moments.items()
    }
    return {ZERO_MATRIX: "<mn>0</mn>", ZERO_COLUMN: "<mn>0</mn>", **pairs, **columns}


def _integral(power: int, *modes: str) -> str:
    position = "<mi>&#x3BE;</mi>"
    weight = f"<msup>{position}<mn>{power}</mn></msup>" if power > 1 else power * position
    return f"<mo>&#x222B;</mo>{weight}{''.join(modes)}<mi>d</mi>{position}"


def _mode(number: str, derivative: int) -> str:
    name = f"<mi>&#x3C8;</mi><mi>{number}</mi>"
    return (
        f"<msubsup>{name}<mo>{_PRIMES[derivative]}</mo></msubsup>" if derivative else f"<msub>{name}</msub>"
    )
