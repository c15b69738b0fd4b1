"""Source code of one generated function: inputs, series, common subexpressions, results."""

import json
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import sympy

from derive.declarations import Option
from derive.discontinuities import Passage
from derive.domains import guarded, signs_of
from derive.functions import Loop, Order
from derive.mechanism import MechanismStatement
from derive.printer import CasadiPrinter, loop_calls, series_calls, series_operations
from derive.symbols import ACCELERATION
from derive.units import size

WIDTH = 106
NO_LOOPS: Mapping[Loop, list[Order]] = MappingProxyType({})
VECTORS = {"q": "coordinates", "qd": "rates", "qdd": "accelerations", "p": "parameters"}
VECTORS["acceleration"] = ACCELERATION.name


@dataclass(frozen=True)
class GeneratedFunction:
    """Function of the generated module, with its CasADi inputs and named results.

    definitions: mapping from symbols in the results that are not inputs to the source code of their values.
    """

    name: str
    doc: str
    inputs: tuple[str, ...]
    results: Mapping[str, Any]
    definitions: Mapping[sympy.Symbol, str] = field(default_factory=dict)

    @property
    def matrices(self) -> list[Any]:
        return [sympy.Matrix([result]) for result in self.results.values()]


def function_text(
    mechanism: MechanismStatement, function: GeneratedFunction, loops: Mapping[Loop, list[Order]] = NO_LOOPS
) -> tuple[str, int]:
    """Return the source code of one function, and its number of operations. Common subexpressions are counted
    once.

    loops: mapping from loops to the orders of the derivatives that their generated functions return.
    """
    taken = (
        mechanism.names()
        | {"phase", "speed", ACCELERATION.name}
        | {symbol.name for symbol in function.definitions}
    )
    signs = signs_of(mechanism.declared_parameters)
    matrices = [matrix.applyfunc(lambda entry: guarded(entry, signs)) for matrix in function.matrices]
    solved, positions = loop_calls(matrices, loops, taken)
    results = [matrix.xreplace(positions) for matrix in matrices]
    calls, values = series_calls(results, taken)
    used = set().union(*(matrix.free_symbols for matrix in results))
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
        *(f"{symbol} = {text}" for symbol, text in function.definitions.items() if symbol in used),
        *solved,
        *calls,
        *(f"{symbol} = {printer.doprint(expression)}" for symbol, expression in common),
        *_return(function, [_matrix(printer, matrix) for matrix in reduced]),
    ]
    expressions = [expression for _, expression in common]
    expressions += [entry for matrix in reduced for entry in matrix]
    text = textwrap.indent("\n".join(body), "    ")
    count = int(sympy.count_ops(expressions)) + series_operations(values)
    return f"def {function.name}({options_text(mechanism)}):\n{text}", count


def tuple_lines(name: str, entries: Sequence[str]) -> list[str]:
    """Source lines of a tuple `name` in the generated module, with one entry per line."""
    return [f"{name} = (", *(f"    {entry}," for entry in entries), ")"] if entries else [f"{name} = ()"]


def breaks_text(mechanism: MechanismStatement, passages: Sequence[Passage]) -> str:
    """Source code of the constant BREAKS, or of a function `breaks` if the phases depend on speed or
    parameters."""
    symbols = set().union(*(passage.symbols for passage in passages))
    phases = ["0.0", *(passage.text for passage in passages)]
    if not symbols:
        return "\n".join(tuple_lines("BREAKS", phases))
    names = [parameter.symbol.name for parameter in mechanism.declared_parameters]
    body = [
        '"""Phases at which the matrices jump or have kinks; a phase may occur more than once."""',
        *(_option_line(option) for option in mechanism.declared_options if symbols & {*option.indicators}),
        f"{_wrapped(names)} = p" if names else "",
        *in_si(mechanism),
        "return [",
        *(f"    {phase}," for phase in phases),
        "]",
    ]
    options = options_text(mechanism)
    signature = f"speed, p, {options}" if options else "speed, p"
    return f"def breaks({signature}):\n" + textwrap.indent("\n".join(filter(None, body)), "    ")


VARYING = '''\
def _varying(steady, added):
    """Function at varying speed: `steady`, the function at constant speed, plus `added`, the contribution of
    the acceleration."""
    inputs = [casadi.SX.sym(name, added.size1_in(name)) for name in added.name_in()]
    phase, speed, _, *state = inputs
    parts = zip(steady.call([phase, speed, *state]), added.call(inputs))
    results = [each + more for each, more in parts]
    return casadi.Function(
        f"{steady.name()}_varying", inputs, results, added.name_in(), added.name_out(),
        {"allow_duplicate_io_names": True},
    )'''


def varying_text(name: str, given: str, options: Iterable[str]) -> str:
    """Source code of a function's variant for varying speed.

    given: source code of the function's parameters; options: names of the module's options.
    """
    passed = ", ".join(f"{option}={option}" for option in options)
    return f'''\
def {name}_varying({given}):
    """The function `{name}` at varying speed."""
    return _varying({name}({passed}), {name}_accelerated({passed}))'''


def options_text(mechanism: MechanismStatement) -> str:
    """Source code of the options with their defaults, as parameters of a function."""
    options = [f"{option.name}={json.dumps(option.default)}" for option in mechanism.declared_options]
    return ", ".join(["*", *options]) if options else ""


def _inputs(mechanism: MechanismStatement, inputs: Sequence[str]) -> list[str]:
    """Source lines that define the option indicators and the inputs, and split the inputs into scalars."""
    moving = [coordinate.symbol for coordinate in mechanism.declared_coordinates]
    names = {
        "q": [q.name for q in moving],
        "qd": [q.rate.name for q in moving],
        "qdd": [q.rate.rate.name for q in moving],
        "p": [parameter.symbol.name for parameter in mechanism.declared_parameters],
    }
    lines = [_option_line(option) for option in mechanism.declared_options]
    for name in inputs:
        size = f", {len(names[name])}" if name in names else ""
        if mechanism.declared_field and name in ("q", "qd", "qdd"):
            names[name], size = [], f", {mechanism.declared_field.modes}"
        lines.append(f'{VECTORS.get(name, name)} = casadi.SX.sym("{name}"{size})')
        if names.get(name):
            lines.append(f"{_wrapped(names[name])} = casadi.vertsplit({VECTORS[name]})")
        if name == "p":
            lines += in_si(mechanism)
    return lines


def in_si(mechanism: MechanismStatement) -> list[str]:
    """Source lines that convert parameters to coherent SI units; parameters in such units have none."""
    sizes = {parameter.symbol.name: size(parameter.unit) for parameter in mechanism.declared_parameters}
    return [f"{name} = {factor!r}*{name}" for name, factor in sizes.items() if factor != 1.0]


def _option_line(option: Option) -> str:
    if not option.indicators:
        return f'{option.name} = _count("{option.name}", {option.name})'
    indicators = _listed(indicator.name for indicator in option.indicators)
    return f'{indicators} = _choice("{option.name}", {option.name})'


def _wrapped(names: Sequence[str]) -> str:
    """Source code of a tuple of names, on several lines if it is long."""
    if len(names) < 10:
        return f"({_listed(names)})"
    rows = textwrap.wrap(", ".join(names) + ",", WIDTH - 8)
    return "(\n" + "".join(f"    {row}\n" for row in rows) + ")"


def _listed(names: Iterable[str]) -> str:
    names = tuple(names)
    return ", ".join(names) + ("," if len(names) == 1 else "")


def _return(function: GeneratedFunction, printed: Sequence[str]) -> list[str]:
    names = (function.inputs, tuple(function.results))
    # An output may have the same name as an input, such as acceleration.
    options = '    {"allow_duplicate_io_names": True},' if {*function.inputs} & {*function.results} else ""
    return [
        "return casadi.Function(",
        f'    "{function.name}",',
        f"    [{', '.join(VECTORS.get(name, name) for name in function.inputs)}],",
        "    [",
        *(textwrap.indent(result, "        ") + "," for result in printed),
        "    ],",
        *(f"    [{', '.join(map(json.dumps, result_names))}]," for result_names in names),
        *([options] if options else []),
        ")",
    ]


def _matrix(printer: CasadiPrinter, matrix: Any) -> str:
    rows = [[str(printer.doprint(entry)) for entry in matrix.row(i)] for i in range(matrix.rows)]
    if matrix.rows == 0:
        return f"casadi.SX(0, {matrix.cols})"
    if matrix.shape == (1, 1):
        return f"casadi.SX({rows[0][0]})"
    if matrix.cols == 1:
        return "casadi.vertcat(\n" + "".join(f"    {row[0]},\n" for row in rows) + ")"
    return "casadi.blockcat([\n" + "".join(f"    [{', '.join(row)}],\n" for row in rows) + "])"
