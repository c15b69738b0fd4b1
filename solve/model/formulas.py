"""C text of CasADi functions for numbers side by side in vector registers, of the type `lane`."""

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import casadi

_MOST = 5000
"""Instructions beyond which a compiler takes longer than it saves."""

_OF_ONE = (
    *("sin", "cos", "tan", "asin", "acos", "atan"),
    *("sinh", "cosh", "tanh", "asinh", "acosh", "atanh"),
    *("sqrt", "exp", "log", "fabs", "floor", "ceil"),
)
_OF_TWO = "pow", "atan2", "fmin", "fmax", "fmod", "copysign", "hypot"
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
    **{name.upper(): f"call_1({name}, {{0}})" for name in _OF_ONE},
    **{name.upper(): f"call_2({name}, {{0}}, {{1}})" for name in _OF_TWO},
    "CONSTPOW": "call_2(pow, {0}, {1})",
}
"""By CasADi's name of an operation."""


def c_text(function: "casadi.Function") -> str | None:
    """`void formulas(const lane *const *in, lane *out)` of a function with one output; None for one with
    operations that have no text here, or with very many."""
    import casadi

    count = function.n_instructions()
    if count > _MOST:
        return None
    names = {getattr(casadi, name): name[3:] for name in dir(casadi) if name.startswith("OP_")}
    lines = []
    for k in range(count):
        operation = names[function.instruction_id(k)]
        at = function.instruction_input(k)
        to = function.instruction_output(k)
        if operation == "OUTPUT":
            lines.append(f"out[{to[1]}] = w[{at[0]}];")
            continue
        if operation == "CONST":
            constant = function.instruction_constant(k)
            value = f"none + {constant!r}" if math.isfinite(constant) else None
        elif operation == "INPUT":
            value = f"in[{at[0]}][{at[1]}]"
        else:
            text = _TEXTS.get(operation)
            value = text and text.format(*(f"w[{each}]" for each in at))
        if value is None:
            return None
        lines.append(f"w[{to[0]}] = {value};")
    body = "\n    ".join(
        ["const lane none = {0}, one = none + 1.0;", f"lane w[{max(1, function.sz_w())}];", *lines]
    )
    return f"static void formulas(const lane *const *in, lane *out) {{\n    {body}\n}}\n"
