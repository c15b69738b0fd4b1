"""The text of generated functions that solve loops, and the calls of them."""

import textwrap
from collections.abc import Iterable, Mapping, Sequence, Set
from typing import Any

import sympy

from derive.kinematics import Loop, LoopFunction, Order, lower_orders
from derive.printer import CasadiPrinter
from derive.recurrence import series_calls
from derive.symbols import nesting, unused_symbol

Assignment = tuple[sympy.Symbol, Any]


def loop_orders(matrices: Iterable[Any]) -> dict[Loop, list[Order]]:
    """The loops in the matrices and the orders of derivatives that they need, in a fixed order."""
    orders: dict[Loop, set[Order]] = {}
    for each in set().union(*(matrix.atoms(LoopFunction) for matrix in matrices)):
        orders.setdefault(each.loop, set()).add(each.order)
    loops = sorted(orders, key=lambda loop: loop.name)
    return {loop: sorted(orders[loop], key=lambda order: (sum(order), order)) for loop in loops}


def loop_text(loop: Loop, orders: Sequence[Order]) -> tuple[str, int]:
    """A function that returns the unknowns' derivatives of the given orders, and its operations."""
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
        f'"""{unknowns} of a closed loop and their derivatives by {given}."""',
        *(line for lines, _ in blocks for line in lines),
        "return " + ", ".join(names[each].name for order in orders for each in loop.at(loop.given, order)),
    ]
    text = textwrap.indent("\n".join(body), "    ")
    return f"def {loop.name}({signature}):\n{text}", sum(count for _, count in blocks)


def loop_calls(
    matrices: Sequence[Any], wanted: Mapping[Loop, list[Order]], taken: set[str]
) -> tuple[list[str], dict[Any, sympy.Symbol]]:
    """Lines that solve every loop in the matrices, and the symbol that holds each value.

    `taken` are names that the symbols must not have; the new ones are added to it. A loop that others or a
    series drive comes after these.
    """
    printer, lines = CasadiPrinter(), []
    values: dict[Any, Any] = {}
    unknowns = set().union(*(matrix.atoms(LoopFunction) for matrix in matrices))
    calls = {(each.loop.name, each.arguments): each.loop for each in unknowns}
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
    """A fixed number of steps, so that the function can be differentiated and mapped like any other."""
    following = [sympy.Symbol(f"{symbol.name}_new", real=True) for symbol in loop.unknowns]
    step = [value.xreplace(formal) for value in loop.newton_step]
    lines, count = _lines(list(zip(following, step, strict=True)), taken)
    unknowns, renewed = (", ".join(symbol.name for symbol in each) for each in (loop.unknowns, following))
    indented = [f"    {line}" for line in (*lines, f"{unknowns} = {renewed}")]
    return [f"for _ in range({loop.iterations}):", *indented], loop.iterations * count


def _lines(assignments: Sequence[Assignment], taken: Set[str]) -> tuple[list[str], int]:
    """Assignments with their common subexpressions taken out under names that the function has not taken,
    each line after those that it needs."""
    fresh = sympy.numbered_symbols("x", exclude={sympy.Symbol(name) for name in taken})
    expressions = [value for _, value in assignments]
    common, reduced = sympy.cse(expressions, symbols=fresh, optimizations="basic", order="canonical")
    waiting = [*common, *zip((symbol for symbol, _ in assignments), reduced, strict=True)]
    count, printer, lines = int(sympy.count_ops([value for _, value in waiting])), CasadiPrinter(), []
    while waiting:
        later = {symbol for symbol, _ in waiting}
        symbol, value = ready = next(each for each in waiting if not each[1].free_symbols & later)
        lines.append(f"{symbol} = {printer.doprint(value)}")
        waiting.remove(ready)
    return lines, count


def _named(loop: Loop, arguments: Sequence[Any], order: Order, taken: set[str]) -> dict[Any, sympy.Symbol]:
    """A symbol such as phi3_1_0 for each unknown's derivative of an order."""
    suffix = "".join(f"_{times}" for times in order)
    functions = loop.at(arguments, order)
    return {each: unused_symbol(type(each).__name__ + suffix, taken) for each in functions}
