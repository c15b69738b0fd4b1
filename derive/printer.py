"""Python source code of expressions in CasADi symbols, and of calls of the functions for series and loops."""

import textwrap
from collections.abc import Iterable, Mapping, Sequence, Set
from typing import Any

import sympy
from sympy.core.numbers import Exp1, Pi
from sympy.core.relational import GreaterThan, LessThan, StrictGreaterThan, StrictLessThan
from sympy.functions.elementary.piecewise import ExprCondPair
from sympy.logic.boolalg import BooleanTrue
from sympy.printing.pycode import AbstractPythonCodePrinter

from derive.domains import Selected
from derive.errors import UnsupportedExpressionError
from derive.functions import Loop, LoopFunction, Order, PeriodicFunction, lower_orders
from derive.switches import Wrapped
from derive.symbols import nesting, unused_symbol

SAME = ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "exp", "log", "sign")
HYPERBOLIC = ("sinh", "cosh", "tanh", "asinh", "acosh", "atanh")
FUNCTIONS = {"Abs": "casadi.fabs", **{name: f"casadi.{name}" for name in SAME + HYPERBOLIC}}
NODES = (
    sympy.Symbol,
    sympy.Rational,
    sympy.Float,
    sympy.Add,
    sympy.Mul,
    sympy.Pow,
    sympy.Max,
    sympy.Min,
    sympy.Heaviside,
    sympy.Piecewise,
    ExprCondPair,
    StrictGreaterThan,
    GreaterThan,
    StrictLessThan,
    LessThan,
    sympy.And,
    sympy.Or,
    BooleanTrue,
    Wrapped,
    Selected,
    Pi,
    Exp1,
)


class CasadiPrinter(AbstractPythonCodePrinter):
    """Printer that writes functions with the prefix `casadi.`, and rational numbers as divisions.

    Raises UnsupportedExpressionError for an expression without a counterpart in CasADi.
    """

    def __init__(self) -> None:
        super().__init__({"precision": 17})

    def doprint(self, expr: Any, assign_to: Any = None) -> str:
        for node in sympy.preorder_traversal(expr):
            if not isinstance(node, NODES) and type(node).__name__ not in FUNCTIONS:
                raise UnsupportedExpressionError(
                    f"{node} cannot be generated; known functions: {', '.join(FUNCTIONS)}, sqrt, Max, Min, "
                    "Heaviside, Piecewise of conditions with < and >"
                )
        return str(super().doprint(expr, assign_to))

    def _print_Pow(self, expr: sympy.Pow, rational: bool = False) -> str:
        if expr.exp == sympy.S.Half and not rational:
            return f"casadi.sqrt({self._print(expr.base)})"
        if expr.exp == -sympy.S.Half and not rational:
            return f"1/casadi.sqrt({self._print(expr.base)})"
        return super()._print_Pow(expr, rational=rational)

    def _print_Pi(self, expr: Pi) -> str:
        return "math.pi"

    def _print_Exp1(self, expr: Exp1) -> str:
        return "math.e"

    def _print_Max(self, expr: sympy.Max) -> str:
        return self._nested("casadi.fmax", expr)

    def _print_Min(self, expr: sympy.Min) -> str:
        return self._nested("casadi.fmin", expr)

    def _print_Heaviside(self, expr: sympy.Heaviside) -> str:
        return f"({self._print(expr.args[0])} > 0)"

    def _print_Wrapped(self, expr: Wrapped) -> str:
        angle, turn = map(self._print, expr.args)
        return f"({angle} - {turn}*casadi.floor(({angle})/({turn})))"

    def _print_Piecewise(self, expr: Any) -> Any:
        *pieces, (last, always) = expr.args
        text = self._print(last) if always == sympy.true else "math.nan"
        for piece, condition in reversed(pieces if always == sympy.true else expr.args):
            text = f"casadi.if_else({self._print(condition)}, {self._print(piece)}, {text})"
        return text

    def _print_Selected(self, expr: Selected) -> str:
        condition, value, otherwise = map(self._print, expr.args)
        return f"casadi.if_else({condition}, {value}, {otherwise})"

    def _print_And(self, expr: sympy.And) -> str:
        return self._nested("casadi.logic_and", expr)

    def _print_Or(self, expr: sympy.Or) -> str:
        return self._nested("casadi.logic_or", expr)

    def _nested(self, function: str, expr: sympy.Basic) -> str:
        """Source code of nested calls of a function of two arguments."""
        text, *rest = (self._print(part) for part in expr.args)
        for part in rest:
            text = f"{function}({text}, {part})"
        return text

    def _print_Function(self, expr: sympy.Function) -> str:
        return f"{FUNCTIONS[type(expr).__name__]}({', '.join(self._print(part) for part in expr.args)})"


FOURIER = '''\
def _fourier(angle, mean, cosine, sine, orders):
    """Derivatives of mean + sum of a_k cos kx + b_k sin kx, k = 1, 2, ..., one for each of the given orders.

    Order -1 is the integral with zero mean. Cosines and sines of kx are computed from those of x by angle
    addition.
    """
    cos_x, sin_x = casadi.cos(angle), casadi.sin(angle)
    cos_kx, sin_kx = 1.0, 0.0
    sums = [mean if order == 0 else 0.0 for order in orders]
    for k, (a, b) in enumerate(zip(cosine, sine), 1):
        cos_kx, sin_kx = cos_kx * cos_x - sin_kx * sin_x, sin_kx * cos_x + cos_kx * sin_x
        even, odd = a * cos_kx + b * sin_kx, b * cos_kx - a * sin_kx
        for i, order in enumerate(orders):
            sums[i] += float(k) ** order * (even, odd, -even, -odd)[order % 4]
    return sums'''
COMPONENTS = '''\
def _components(amplitudes, angles):
    """Cosine and sine coefficients of the sum of A_k cos(kx + angle_k)."""
    pairs = list(zip(amplitudes, angles))
    return [a * casadi.cos(g) for a, g in pairs], [-a * casadi.sin(g) for a, g in pairs]'''


def series_calls(
    matrices: Sequence[sympy.Matrix], taken: set[str]
) -> tuple[list[str], dict[PeriodicFunction, sympy.Symbol]]:
    """Return source lines that evaluate the series in the matrices, and the symbol of each value.

    taken: names in use; the names of the new symbols are added.
    """
    direct: set[Any] = set().union(*(matrix.atoms(PeriodicFunction) for matrix in matrices))
    inner = {inside for value in direct for inside in value.args[0].atoms(PeriodicFunction)}
    together: dict[tuple[type[PeriodicFunction], Any], set[int]] = {}
    for value in direct | inner:
        together.setdefault((type(value), value.args[0]), set()).add(value.order)
    lines, values = [], {}
    for series, argument in sorted(together, key=_inner_series_first):
        orders = sorted(together[series, argument])
        symbols = [unused_symbol(f"{series.__name__}_{order}", taken) for order in orders]
        values |= {series(argument, order): symbol for order, symbol in zip(orders, symbols, strict=True)}
        call = _call(series, argument.xreplace(values), orders)
        lines.append(f"[{', '.join(symbol.name for symbol in symbols)}] = {call}")
    return lines, values


def series_operations(values: Mapping[PeriodicFunction, sympy.Symbol]) -> int:
    """Number of operations of the recurrences that evaluate series, including trigonometric calls."""
    arguments = {(type(value), value.args[0]) for value in values}
    harmonics = [len(series.first) for series, _ in arguments]
    return sum(2 + 6 * count for count in harmonics) + sum(5 * len(value.first) for value in values)


def _inner_series_first(key: tuple[type[PeriodicFunction], sympy.Expr]) -> tuple:
    series, argument = key
    return nesting(argument, PeriodicFunction), series.__name__, sympy.default_sort_key(argument)


def _call(series: type[PeriodicFunction], argument: sympy.Expr, orders: Sequence[int]) -> str:
    first, second = (f"({', '.join(map(str, family))},)" for family in (series.first, series.second))
    coefficients = f"*_components(\n        {first},\n        {second},\n    )"
    if series.form == "cosine-sine":
        coefficients = f"{first},\n    {second}"
    shifted = [order - 1 if series.integrated else order for order in orders]
    angle = CasadiPrinter().doprint(argument)
    return f"_fourier(\n    {angle}, {series.mean or 0.0},\n    {coefficients},\n    {shifted},\n)"


Assignment = tuple[sympy.Symbol, Any]


def loop_orders(matrices: Iterable[Any]) -> dict[Loop, list[Order]]:
    """Mapping from the loops in the matrices to the required orders of derivatives, in a fixed sequence."""
    orders: dict[Loop, set[Order]] = {}
    for function in set().union(*(matrix.atoms(LoopFunction) for matrix in matrices)):
        orders.setdefault(function.loop, set()).add(function.order)
    loops = sorted(orders, key=lambda loop: loop.name)
    return {loop: sorted(orders[loop], key=lambda order: (sum(order), order)) for loop in loops}


def loop_text(loop: Loop, orders: Sequence[Order]) -> tuple[str, int]:
    """Source code of the function that returns derivatives of the unknowns of a loop, and its number of
    operations. `orders` are the orders of the derivatives."""
    taken = {symbol.name for symbol in (*loop.parameters, *loop.unknowns)}
    formal = {symbol: unused_symbol(symbol.name, taken) for symbol in loop.given}
    lower = lower_orders(orders)
    names: dict[Any, sympy.Symbol] = {}
    for order in lower:
        names |= _named(loop, loop.given, order, taken)
    names |= zip(loop.at(loop.given), loop.unknowns, strict=True)
    derivatives = [
        (names[each], value.xreplace(names).xreplace(formal))
        for order in lower[1:]
        for each, value in zip(loop.at(loop.given, order), loop.derivative(order), strict=True)
    ]
    start = [(z, value.xreplace(formal)) for z, value in zip(loop.unknowns, loop.start, strict=True)]
    blocks = [_lines(start + derivatives, taken)]
    if loop.iterations:
        blocks = [_lines(start, taken), _newton(loop, formal, taken), _lines(derivatives, taken)]
    unknowns, given = (", ".join(symbol.name for symbol in each) for each in (loop.unknowns, formal.values()))
    signature = ", ".join(symbol.name for symbol in (*formal.values(), *loop.parameters))
    body = [
        f'"""{unknowns} of a closed loop and their derivatives with respect to {given}."""',
        *(line for lines, _ in blocks for line in lines),
        "return " + ", ".join(names[each].name for order in orders for each in loop.at(loop.given, order)),
    ]
    text = textwrap.indent("\n".join(body), "    ")
    return f"def {loop.name}({signature}):\n{text}", sum(count for _, count in blocks)


def loop_calls(
    matrices: Sequence[Any], wanted: Mapping[Loop, list[Order]], taken: set[str]
) -> tuple[list[str], dict[Any, sympy.Symbol]]:
    """Return source lines that solve the loops in the matrices, and the symbol of each value.

    wanted: orders of the derivatives that the generated function of each loop returns. taken: names in use;
    the names of the new symbols are added. A loop is solved after the loops and series on which its arguments
    depend.
    """
    printer, lines = CasadiPrinter(), []
    values: dict[Any, Any] = {}
    unknowns = set().union(*(matrix.atoms(LoopFunction) for matrix in matrices))
    calls = {(unknown.loop.name, unknown.arguments): unknown.loop for unknown in unknowns}
    for (name, arguments), loop in sorted(calls.items(), key=_inner_first):
        named = [_named(loop, arguments, order, taken) for order in wanted[loop]]
        symbols = ", ".join(symbol.name for each in named for symbol in each.values())
        driven_by = sympy.Matrix(arguments).xreplace(values)
        driving, series = series_calls([driven_by], taken)
        lines += driving
        inputs = ", ".join(printer.doprint(each) for each in (*driven_by.xreplace(series), *loop.parameters))
        lines.append(f"({symbols}) = {name}(\n    {inputs},\n)")
        values |= {function: symbol for each in named for function, symbol in each.items()}
    return lines, values


def _inner_first(call: tuple[tuple[str, tuple[Any, ...]], Loop]) -> tuple[int, Any]:
    (name, arguments), _ = call
    return nesting(sympy.Tuple(*arguments), LoopFunction), sympy.default_sort_key((name, arguments))


def _newton(loop: Loop, formal: dict[sympy.Symbol, sympy.Symbol], taken: Set[str]) -> tuple[list[str], int]:
    """Source lines of Newton's method, and their number of operations.

    The number of iterations is fixed, so that CasADi can differentiate the function and map it over many
    phases.
    """
    following = [sympy.Symbol(f"{symbol.name}_new", real=True) for symbol in loop.unknowns]
    step = [value.xreplace(formal) for value in loop.newton_step]
    lines, count = _lines(list(zip(following, step, strict=True)), taken)
    unknowns, renewed = (", ".join(symbol.name for symbol in each) for each in (loop.unknowns, following))
    indented = [f"    {line}" for line in (*lines, f"{unknowns} = {renewed}")]
    return [f"for _ in range({loop.iterations}):", *indented], loop.iterations * count


def _lines(assignments: Sequence[Assignment], taken: Set[str]) -> tuple[list[str], int]:
    """Source lines of assignments and of their common subexpressions, and the number of operations.

    A line depends only on earlier lines. taken: names in use in the function.
    """
    fresh = sympy.numbered_symbols("x", exclude={sympy.Symbol(name) for name in taken})
    expressions = [value for _, value in assignments]
    common, reduced = sympy.cse(expressions, symbols=fresh, optimizations="basic", order="canonical")
    waiting = [*common, *zip((symbol for symbol, _ in assignments), reduced, strict=True)]
    count, printer, lines = int(sympy.count_ops([value for _, value in waiting])), CasadiPrinter(), []
    while waiting:
        later = {symbol for symbol, _ in waiting}
        symbol, value = ready = next(
            assignment for assignment in waiting if not assignment[1].free_symbols & later
        )
        lines.append(f"{symbol} = {printer.doprint(value)}")
        waiting.remove(ready)
    return lines, count


def _named(loop: Loop, arguments: Sequence[Any], order: Order, taken: set[str]) -> dict[Any, sympy.Symbol]:
    """Mapping from the derivatives of the unknowns for one order to symbols such as phi3_1_0."""
    suffix = "".join(f"_{times}" for times in order)
    functions = loop.at(arguments, order)
    return {function: unused_symbol(type(function).__name__ + suffix, taken) for function in functions}
