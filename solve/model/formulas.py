"""Instructions of CasADi functions: conversion to C code for vector lanes, and bounds on round-off errors."""

import math
from collections.abc import Collection
from functools import cache
from typing import TYPE_CHECKING, Any

from solve.model.sampling import inputs_of, symbol

if TYPE_CHECKING:
    import casadi

_MAX_INSTRUCTIONS = 5000
"""Number of instructions above which formulas are not compiled: compilation would take more time than it
saves. Chosen by judgement."""

_UNARY = (
    *("sin", "cos", "tan", "asin", "acos", "atan"),
    *("sinh", "cosh", "tanh", "asinh", "acosh", "atanh"),
    *("sqrt", "exp", "log", "fabs", "floor", "ceil"),
)
_BINARY = "pow", "atan2", "fmin", "fmax", "fmod", "copysign", "hypot"
_TEXTS = {
    "ADD": "{0} + {1}",
    "SUB": "{0} - {1}",
    "MUL": "{0} * {1}",
    "DIV": "{0} / {1}",
    "ASSIGN": "{0}",
    "NEG": "-{0}",
    "SQ": "{0} * {0}",
    "TWICE": "{0} + {0}",
    "INV": "1.0 / {0}",
    "LT": "where({0} < {1}, one)",
    "LE": "where({0} <= {1}, one)",
    "EQ": "where({0} == {1}, one)",
    "NE": "where({0} != {1}, one)",
    "NOT": "where({0} == 0.0, one)",
    "AND": "where(({0} != 0.0) & ({1} != 0.0), one)",
    "OR": "where(({0} != 0.0) | ({1} != 0.0), one)",
    "SIGN": "where({0} > 0.0, one) - where({0} < 0.0, one)",
    "IF_ELSE_ZERO": "where({0} != 0.0, {1})",
    **{name.upper(): f"call_1({name}, {{0}})" for name in _UNARY},
    **{name.upper(): f"call_2({name}, {{0}}, {{1}})" for name in _BINARY},
    "CONSTPOW": "call_2(pow, {0}, {1})",
}
"""Mapping from CasADi's names of operations to C expressions."""


def c_text(function: "casadi.Function") -> str | None:
    """C code of a function with one output: `void formulas(const lane *const *in, lane *out)`. `lane` is a
    vector of doubles.

    Returns None for functions with unsupported operations, or with too many operations."""
    count = function.n_instructions()
    if count > _MAX_INSTRUCTIONS:
        return None
    operations = operation_names()
    lines = []
    for k in range(count):
        operation = operations[function.instruction_id(k)]
        inputs, outputs = function.instruction_input(k), function.instruction_output(k)
        if operation == "OUTPUT":
            lines.append(f"out[{outputs[1]}] = w[{inputs[0]}];")
            continue
        if operation == "CONST":
            constant = function.instruction_constant(k)
            value = f"none + {constant!r}" if math.isfinite(constant) else None
        elif operation == "INPUT":
            value = f"in[{inputs[0]}][{inputs[1]}]"
        else:
            template = _TEXTS.get(operation)
            value = template and template.format(*(f"w[{register}]" for register in inputs))
        if value is None:
            return None
        lines.append(f"w[{outputs[0]}] = {value};")
    body = "\n    ".join(
        ["const lane none = {0}, one = none + 1.0;", f"lane w[{max(1, function.sz_w())}];", *lines]
    )
    return f"static void formulas(const lane *const *in, lane *out) {{\n    {body}\n}}\n"


def operation_names() -> dict[int, str]:
    """Mapping from CasADi's codes of operations to their names."""
    import casadi

    return {getattr(casadi, name): name[3:] for name in dir(casadi) if name.startswith("OP_")}


_EXACT_OPERATIONS = ("ASSIGN", "NEG", "TWICE", "FABS")
"""CasADi's names of operations with an exact result."""


def roundoff_bound(function: "casadi.Function", rounded: Collection[str]) -> "casadi.Function":
    """First-order bound on the round-off of a function, as a function of the same inputs (SX, scalar
    operations).

    It is computed by running error analysis (N. J. Higham, Accuracy and Stability of Numerical Algorithms,
    2nd ed., 3.3): Σ |∂f/∂z| |z| in units of the machine precision. The sum is over the results z of
    operations, the constants, and the inputs named in `rounded`. Other inputs are exact."""
    import casadi

    operations = operation_names()
    inputs, derivatives_of = inputs_of(function), cache(_with_derivatives)
    symbols = list(inputs.values())
    # Value of each register, and bound on the round-off of the value.
    registers: dict[int, tuple[Any, Any]] = {}
    results, rows = casadi.SX(function.size1_out(0), 1), function.sparsity_out(0).row()
    for k in range(function.n_instructions()):
        operation, code = operations[function.instruction_id(k)], function.instruction_id(k)
        at, to = function.instruction_input(k), function.instruction_output(k)
        if operation == "OUTPUT":
            results[rows[to[1]]] = registers[at[0]][1]
        elif operation == "CONST":
            constant = casadi.SX(function.instruction_constant(k))
            # Integers are exact; other constants, such as π, have a round-off error.
            exact = function.instruction_constant(k).is_integer()
            registers[to[0]] = constant, 0 if exact else casadi.fabs(constant)
        elif operation == "INPUT":
            value = symbols[at[0]].nz[at[1]]
            registers[to[0]] = value, casadi.fabs(value) if list(inputs)[at[0]] in rounded else 0
        else:
            arguments, bounds = zip(*(registers[register] for register in at), strict=True)
            value, *slopes = derivatives_of(code, len(at))(*arguments)
            propagated = sum(casadi.fabs(slope) * bound for slope, bound in zip(slopes, bounds, strict=True))
            registers[to[0]] = (
                value,
                propagated + (0 if operation in _EXACT_OPERATIONS else casadi.fabs(value)),
            )
    return casadi.Function("roundoff", symbols, [casadi.cse(results)], list(inputs), ["bound"])


def _with_derivatives(code: int, count: int) -> "casadi.Function":
    """Function that returns the result of a CasADi operation and its derivatives with respect to its
    arguments."""
    import casadi

    arguments = [symbol(f"x{k}") for k in range(count)]
    value = casadi.SX.unary(code, *arguments) if count == 1 else casadi.SX.binary(code, *arguments)
    return casadi.Function("operation", arguments, [value, *(casadi.gradient(value, x) for x in arguments)])
