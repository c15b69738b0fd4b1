"""First-order bounds on the round-off of generated functions by running error analysis (N. J. Higham,
Accuracy and Stability of Numerical Algorithms, 2nd ed., 3.3)."""

from collections.abc import Collection
from functools import cache
from typing import TYPE_CHECKING, Any

from solve.model.sampling import inputs_of, symbol

if TYPE_CHECKING:
    import casadi

_EXACT = ("ASSIGN", "NEG", "TWICE", "FABS")
"""Operations with an exact result, by CasADi's names."""


def roundoff_bound(function: "casadi.Function", rounded: Collection[str] = ()) -> "casadi.Function":
    """Function of the same inputs whose output bounds the round-off in the column that a scalar (SX) function
    returns, in units of the machine precision: Σ |∂f/∂z| |z| over the results z of its operations, its
    constants, and the inputs named in `rounded`; other inputs are exact."""
    import casadi

    operations = {getattr(casadi, name): name[3:] for name in dir(casadi) if name.startswith("OP_")}
    inputs, of_one = inputs_of(function), cache(_operation)
    symbols = list(inputs.values())
    # Value in each register, and the bound on its round-off.
    registers: dict[int, tuple[Any, Any]] = {}
    results, rows = casadi.SX(function.size1_out(0), 1), function.sparsity_out(0).row()
    for k in range(function.n_instructions()):
        operation, code = operations[function.instruction_id(k)], function.instruction_id(k)
        at, to = function.instruction_input(k), function.instruction_output(k)
        if operation == "OUTPUT":
            results[rows[to[1]]] = registers[at[0]][1]
        elif operation == "CONST":
            constant = casadi.SX(function.instruction_constant(k))
            # Integers are exact; other constants, such as π, are rounded.
            exact = function.instruction_constant(k).is_integer()
            registers[to[0]] = constant, 0 if exact else casadi.fabs(constant)
        elif operation == "INPUT":
            value = symbols[at[0]].nz[at[1]]
            registers[to[0]] = value, casadi.fabs(value) if list(inputs)[at[0]] in rounded else 0
        else:
            arguments, bounds = zip(*(registers[each] for each in at), strict=True)
            value, *slopes = of_one(code, len(at))(*arguments)
            carried = sum(casadi.fabs(slope) * bound for slope, bound in zip(slopes, bounds, strict=True))
            registers[to[0]] = value, carried + (0 if operation in _EXACT else casadi.fabs(value))
    return casadi.Function("roundoff", symbols, [casadi.cse(results)], list(inputs), ["bound"])


def _operation(code: int, count: int) -> "casadi.Function":
    """Result of a CasADi operation and its derivatives with respect to its arguments."""
    import casadi

    arguments = [symbol(f"x{k}") for k in range(count)]
    value = casadi.SX.unary(code, *arguments) if count == 1 else casadi.SX.binary(code, *arguments)
    return casadi.Function("operation", arguments, [value, *(casadi.gradient(value, x) for x in arguments)])
