"""The linearised equations as MathML, one element an equation, for reports in HTML."""

import re
from collections.abc import Iterable, Mapping
from html import unescape
from typing import Any
from xml.dom.minidom import Element

import sympy
from sympy.printing.mathml import MathMLPresentationPrinter

from derive.galerkin import ZERO_COLUMN, ZERO_MATRIX, Projection
from derive.kinematics import LoopFunction
from derive.reading import Equation
from derive.switches import Wrapped
from derive.symbols import PHASE, SPEED
from derive.transmission import PeriodicFunction

_NAMED = r"&(?!amp;|lt;|gt;|#)\w+;"
_TIMES, _APPLY = "&#x2062;", "&#x2061;"
_PRIMES = ("", "&#x2032;", "&#x2033;", "&#x2034;")


def mathml(equations: Iterable[Equation], projection: Projection | None = None) -> tuple[str, ...]:
    """`<math>` elements in ASCII; integrals of mode functions from a projection."""
    names = {PHASE: "<mi>&#x3C6;</mi>", SPEED: "<mi>&#x3A9;</mi>"}
    printer = _Printer(names | (_integrals(projection) if projection else {}))
    return tuple(
        f"<math><mrow>{'<mo>=</mo>'.join(_sides(printer, each))}</mrow></math>" for each in equations
    )


def _sides(printer: "_Printer", equation: Equation) -> list[str]:
    return [printer.doprint(each) for each in (*equation.left, equation.right)]


class _Printer(MathMLPresentationPrinter):
    """Knows the functions of derive, and symbols with texts of their own."""

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
        # XML knows no names of characters but these; names of several letters need room between them.
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
        made = self.dom.createElement(tag)
        for part in parts:
            # Texts are written as they are, see SymPy's printer.
            made.appendChild(self.dom.createTextNode(part) if isinstance(part, str) else part)
        return made


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
