"""The text of a generated module: constants and functions that build CasADi functions."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

import sympy

from derive.freshness import banner, seal
from derive.lagrange import drive_torque, from_fundamental, residual
from derive.linearise import linearise
from derive.mechanism import Mechanism, Output
from derive.printer import CasadiPrinter
from derive.recurrence import COMPONENTS, FOURIER, operations, series_calls

CHOICE = '''
def _choice(option, value):
    """One indicator, 1.0 or 0.0, for each allowed value of an option."""
    allowed = next(values for name, values, _ in OPTIONS if name == option)
    if value not in allowed:
        raise ValueError(f"option {option} is {value!r}; allowed: {', '.join(map(str, allowed))}")
    return [float(value == each) for each in allowed]
'''
STATE = ("q", "qd", "qdd")
VECTORS = {"q": "coordinates", "qd": "rates", "qdd": "accelerations", "p": "parameters"}


@dataclass(frozen=True)
class _Function:
    """One function of the generated module: its inputs, and named matrices or scalars."""

    name: str
    doc: str
    inputs: tuple[str, ...]
    results: dict[str, sympy.Matrix | sympy.Expr]


def module_text(mechanism: Mechanism, source_sha256: str, derive_sha256: str, command: str) -> str:
    """Whole text of the generated module; `command` is what renews it, after `python -m derive`."""
    functions = _functions(mechanism)
    printed = [_print_function(mechanism, function) for function in functions]
    count = {function.name: number for function, (_, number) in zip(functions, printed, strict=True)}
    bodies = "\n".join(text for text, _ in printed)
    tools = [(FOURIER, "_fourier("), (COMPONENTS, "_components("), (CHOICE, "_choice(")]
    needed = [text + "\n" for text, call in tools if call in bodies]
    body = "\n".join([_constants(mechanism, count), *needed, bodies])
    head = banner(mechanism.title, command)
    return seal(head, source_sha256, derive_sha256, sympy.__version__, body)


def outputs_of(mechanism: Mechanism) -> list[Output]:
    """The declared outputs, after the drive torque where the mechanism has one."""
    declared = list(mechanism.declared_outputs)
    if mechanism.no_drive_torque:
        return declared
    torque = Output("drive_torque", drive_torque(mechanism), "N m", "torque of the drive that keeps the speed constant")
    return [torque, *declared]


def _functions(mechanism: Mechanism) -> list[_Function]:
    r = residual(mechanism)
    outputs = {
        each.name: from_fundamental(mechanism, each.expression) if each in mechanism.declared_outputs else each.expression
        for each in outputs_of(mechanism)
    }
    state = ("phase", "speed", *STATE, "p")
    return [
        _Function("linearised", "M, C, K, d of M q̈ + C q̇ + K q = d.", ("phase", "speed", "p"), linearise(mechanism, r)._asdict()),
        _Function("residual", "Nonlinear r of the equation of motion r = 0.", state, {"r": r}),
        _Function("outputs", "One scalar for each of OUTPUTS.", state, outputs),
    ]


def _constants(mechanism: Mechanism, count: dict[str, int]) -> str:
    outputs = outputs_of(mechanism)
    rows = {
        "COORDINATES": [(each.symbol.name, each.unit, each.meaning) for each in mechanism.declared_coordinates],
        "PARAMETERS": [(each.symbol.name, each.unit, each.meaning, each.bound) for each in mechanism.declared_parameters],
        "OPTIONS": [(each.name, each.values, each.values[0]) for each in mechanism.declared_options],
        "OUTPUTS": [(each.name, each.unit, each.meaning) for each in outputs],
        "LIMITS": [(each.name, each.bound, each.beyond) for each in outputs if each.bound],
    }
    lines = [f"NAME = {mechanism.name!r}", f"TITLE = {mechanism.title!r}"]
    for name, tuples in rows.items():
        lines += [f"{name} = (", *(f"    {row!r}," for row in tuples), ")"] if tuples else [f"{name} = ()"]
    lines += [
        f"VALIDITY = {dict(sorted(mechanism.validity.items()))!r}",
        f"PERIOD = {CasadiPrinter().doprint(sympy.sympify(mechanism.period))}",
        f"OPERATIONS = {count!r}",
    ]
    if mechanism.no_drive_torque:
        lines += textwrap.wrap(f"No drive torque: {mechanism.no_drive_torque}", 98, initial_indent="# ", subsequent_indent="# ")
    return "\n".join(lines) + "\n"


def _print_function(mechanism: Mechanism, function: _Function) -> tuple[str, int]:
    """Text of one function, and its operations after common subexpressions are taken out."""
    results = {name: sympy.Matrix([result]) for name, result in function.results.items()}
    taken = {symbol.name for result in results.values() for symbol in result.free_symbols} | mechanism.names()
    calls, values = series_calls(list(results.values()), taken)
    free = sympy.numbered_symbols("x", exclude=[sympy.Symbol(name) for name in sorted(taken)])
    plain = [result.xreplace(values) for result in results.values()]
    common, reduced = sympy.cse(plain, symbols=free, optimizations="basic", order="canonical")
    printer = CasadiPrinter()
    lines = [
        *_signature(mechanism, function),
        *_unpack(mechanism, function.inputs),
        *calls,
        *(f"{symbol} = {printer.doprint(expression)}" for symbol, expression in common),
        *_return(function, [_printed(printer, matrix) for matrix in reduced]),
    ]
    count = sympy.count_ops([expression for _, expression in common]) + sum(sympy.count_ops(list(m)) for m in reduced)
    text = lines[0] + "\n" + textwrap.indent("\n".join(lines[1:]), "    ") + "\n"
    return "\n" + text, int(count) + operations(values)


def _signature(mechanism: Mechanism, function: _Function) -> list[str]:
    options = ", ".join(f"{each.name}={each.values[0]!r}" for each in mechanism.declared_options)
    return [f"def {function.name}({'*, ' + options if options else ''}):", f'"""{function.doc}"""']


def _unpack(mechanism: Mechanism, inputs: Sequence[str]) -> list[str]:
    moving = [each.symbol for each in mechanism.declared_coordinates]
    names = {
        "q": [q.name for q in moving],
        "qd": [q.rate.name for q in moving],
        "qdd": [q.rate.rate.name for q in moving],
        "p": [each.symbol.name for each in mechanism.declared_parameters],
    }
    lines = [
        f"{', '.join(indicator.name for indicator in each.indicators)} = _choice({each.name!r}, {each.name})"
        for each in mechanism.declared_options
    ]
    for name in inputs:
        vector = VECTORS.get(name, name)
        lines.append(f"{vector} = casadi.SX.sym({name!r}{f', {len(names[name])}' if name in names else ''})")
        if names.get(name):
            listed = textwrap.wrap(", ".join(names[name]) + ",", 96, break_long_words=False)
            lines += ["(", *("    " + row for row in listed), f") = casadi.vertsplit({vector})"]
    return lines


def _return(function: _Function, printed: Sequence[str]) -> list[str]:
    inputs = ", ".join(VECTORS.get(name, name) for name in function.inputs)
    return [
        "return casadi.Function(",
        f"    {function.name!r},",
        f"    [{inputs}],",
        "    [",
        *(textwrap.indent(result, "        ") + "," for result in printed),
        "    ],",
        f"    {list(function.inputs)!r},",
        f"    {list(function.results)!r},",
        ")",
    ]


def _printed(printer: CasadiPrinter, matrix: sympy.Matrix) -> str:
    rows = [[printer.doprint(entry) for entry in matrix.row(i)] for i in range(matrix.rows)]
    if matrix.shape == (1, 1):
        return f"casadi.SX({rows[0][0]})"
    listed = "\n".join(f"    [{', '.join(row)}]," for row in rows)
    return f"casadi.blockcat([\n{listed}\n])"
