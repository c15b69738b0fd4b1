"""The text of one generated function: inputs, series, common subexpressions, results."""

import json
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import sympy

from derive.mechanism import Mechanism
from derive.printer import CasadiPrinter
from derive.recurrence import operations, series_calls

WIDTH = 106
VECTORS = {"q": "coordinates", "qd": "rates", "qdd": "accelerations", "p": "parameters"}


@dataclass(frozen=True)
class Generated:
    """A function of the generated module: its CasADi inputs and its named results."""

    name: str
    doc: str
    inputs: tuple[str, ...]
    results: Mapping[str, Any]


def function_text(mechanism: Mechanism, function: Generated) -> tuple[str, int]:
    """Text of one function, and its operations after common subexpressions are taken out."""
    results = [sympy.Matrix([result]) for result in function.results.values()]
    taken = mechanism.names() | {"phase", "speed"}
    calls, values = series_calls(results, taken)
    free = sympy.numbered_symbols("x", exclude=[sympy.Symbol(name) for name in sorted(taken)])
    common, reduced = sympy.cse(
        [result.xreplace(values) for result in results],
        symbols=free,
        optimizations="basic",
        order="canonical",
    )
    printer = CasadiPrinter()
    body = [
        f'"""{function.doc}"""',
        *_inputs(mechanism, function.inputs),
        *calls,
        *(f"{symbol} = {printer.doprint(expression)}" for symbol, expression in common),
        *_return(function, [_matrix(printer, each) for each in reduced]),
    ]
    options = ", ".join(f'{each.name}="{each.values[0]}"' for each in mechanism.declared_options)
    signature = f"def {function.name}({'*, ' + options if options else ''}):"
    expressions = [expression for _, expression in common] + [entry for each in reduced for entry in each]
    text = textwrap.indent("\n".join(body), "    ")
    return f"{signature}\n{text}", int(sympy.count_ops(expressions)) + operations(values)


def _inputs(mechanism: Mechanism, inputs: Sequence[str]) -> list[str]:
    """Option indicators, and the inputs taken apart into scalars."""
    moving = [each.symbol for each in mechanism.declared_coordinates]
    names = {
        "q": [q.name for q in moving],
        "qd": [q.rate.name for q in moving],
        "qdd": [q.rate.rate.name for q in moving],
        "p": [each.symbol.name for each in mechanism.declared_parameters],
    }
    lines = [
        f'{_listed(indicator.name for indicator in each.indicators)} = _choice("{each.name}", {each.name})'
        for each in mechanism.declared_options
    ]
    for name in inputs:
        size = f", {len(names[name])}" if name in names else ""
        lines.append(f'{VECTORS.get(name, name)} = casadi.SX.sym("{name}"{size})')
        if names.get(name):
            lines.append(f"{_wrapped(names[name])} = casadi.vertsplit({VECTORS[name]})")
    return lines


def _wrapped(names: Sequence[str]) -> str:
    """A tuple of names, over several lines where it is long."""
    if len(names) < 10:
        return f"({_listed(names)})"
    rows = textwrap.wrap(", ".join(names) + ",", WIDTH - 8)
    return "(\n" + "".join(f"    {row}\n" for row in rows) + ")"


def _listed(names: Iterable[str]) -> str:
    names = tuple(names)
    return ", ".join(names) + ("," if len(names) == 1 else "")


def _return(function: Generated, printed: Sequence[str]) -> list[str]:
    names = (function.inputs, tuple(function.results))
    return [
        "return casadi.Function(",
        f'    "{function.name}",',
        f"    [{', '.join(VECTORS.get(name, name) for name in function.inputs)}],",
        "    [",
        *(textwrap.indent(result, "        ") + "," for result in printed),
        "    ],",
        *(f"    [{', '.join(map(json.dumps, each))}]," for each in names),
        ")",
    ]


def _matrix(printer: CasadiPrinter, matrix: Any) -> str:
    rows = [[str(printer.doprint(entry)) for entry in matrix.row(i)] for i in range(matrix.rows)]
    if matrix.shape == (1, 1):
        return f"casadi.SX({rows[0][0]})"
    if matrix.cols == 1:
        return "casadi.vertcat(\n" + "".join(f"    {row[0]},\n" for row in rows) + ")"
    return "casadi.blockcat([\n" + "".join(f"    [{', '.join(row)}],\n" for row in rows) + "])"
