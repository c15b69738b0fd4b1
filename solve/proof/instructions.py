"""Evaluation of a CasADi function for balls, discs and power series.

A function of scalars is a list of instructions. The same list is evaluated for real balls, complex balls and
power series. Piecewise operations (comparisons, |x|, floor, min, max) are analytic only where their outcome
is constant. The outcomes are determined by an evaluation on a real interval, on which they must not change.
They are then used in evaluations on discs and with power series."""

import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi

from solve.errors import LinearModelError
from solve.proof.balls import Ball, acb, arb


class UndecidedError(Exception):
    """Raised if the branch of a piecewise operation may change within an interval."""


Outcomes = tuple[Any, ...]
"""Outcomes of the piecewise operations, in the order of the instructions."""

Entries = list[tuple[int, int, Ball]]
"""Rows, columns and values of a matrix."""

ANY: Outcomes = ("any",)
"""Value that admits every outcome that is possible on an interval. Results then contain the results of all
possible outcomes."""


def _power(x: Ball, y: Ball) -> Ball:
    whole = y.unique_fmpz() if isinstance(y, arb) and y.is_exact() else None
    if whole is not None:
        return _whole_power(x, int(whole))
    return (_log(x) * y).exp()


def _whole_power(x: Ball, k: int) -> Ball:
    if k < 0:
        return 1 / _whole_power(x, -k)
    result = arb(1)
    while k:
        result, x, k = (result * x if k & 1 else result), (x * x if k > 1 else x), k >> 1
    return result


def _analytic(name: str) -> Callable[[Ball], Ball]:
    """Wrap a function that is not analytic on a branch cut. The result of the wrapped function is undefined
    on discs that meet the branch cut."""

    def apply(x: Ball) -> Ball:
        function = getattr(x, name)
        return function(analytic=True) if isinstance(x, acb) else function()

    return apply


def _inverse(name: str) -> Callable[[Ball], Ball]:
    """Wrap asin, acos or atan so that the result is undefined on discs that may meet a branch cut. The branch
    cuts are the real axis beyond ±1 and, for atan, the imaginary axis beyond ±i."""

    def apply(x: Ball) -> Ball:
        if isinstance(x, acb):
            along, across = (x.imag, x.real) if name == "atan" else (x.real, x.imag)
            if not abs(along) < 1 and across.contains(0):
                return acb(arb.nan())
        return getattr(x, name)()

    return apply


_log, _atan = _analytic("log"), _inverse("atan")

_SMOOTH: dict[int, Callable[..., Ball]] = {
    casadi.OP_ASSIGN: lambda x: x,
    casadi.OP_ADD: operator.add,
    casadi.OP_SUB: operator.sub,
    casadi.OP_MUL: operator.mul,
    casadi.OP_DIV: operator.truediv,
    casadi.OP_NEG: operator.neg,
    casadi.OP_SQ: lambda x: x * x,
    casadi.OP_TWICE: lambda x: 2 * x,
    casadi.OP_INV: lambda x: 1 / x,
    casadi.OP_POW: _power,
    casadi.OP_CONSTPOW: _power,
    casadi.OP_SQRT: _analytic("sqrt"),
    casadi.OP_EXP: lambda x: x.exp(),
    casadi.OP_LOG: _log,
    casadi.OP_SIN: lambda x: x.sin(),
    casadi.OP_COS: lambda x: x.cos(),
    casadi.OP_TAN: lambda x: x.tan(),
    casadi.OP_ASIN: _inverse("asin"),
    casadi.OP_ACOS: _inverse("acos"),
    casadi.OP_ATAN: _atan,
    casadi.OP_SINH: lambda x: (x.exp() - (-x).exp()) / 2,
    casadi.OP_COSH: lambda x: (x.exp() + (-x).exp()) / 2,
    casadi.OP_TANH: lambda x: 1 - 2 / ((2 * x).exp() + 1),
}
"""Mapping from analytic operations to functions of their operands."""


def _certain(yes: bool, no: bool) -> bool:
    if not yes and not no:
        raise UndecidedError
    return yes


def _true(condition: Ball) -> bool:
    return _certain(not condition.contains(0), condition.is_zero())


def _sign(x: Ball) -> int:
    return 0 if x.is_zero() else 1 if _certain(x > 0, x < 0) else -1


def _nonnegative(x: Ball) -> int:
    return 1 if _certain(x >= 0, x < 0) else -1


def _floor(x: Ball) -> int:
    found = x.floor().unique_fmpz()
    if found is None:
        raise UndecidedError
    return int(found)


def _towards_zero(x: Ball, y: Ball) -> int:
    quotient = x / y
    return _floor(quotient) if _nonnegative(quotient) > 0 else -_floor(-quotient)


def _half_plane(y: Ball, x: Ball) -> str:
    """Name of a half plane that contains all points (x, y); its edge is as far from the points as possible.
    In the left half plane, the points must lie on one side of the branch cut of atan2."""
    halves = {"right": x, "upper": y, "lower": -y}
    if y >= 0 or y < 0:
        halves["above the cut" if y >= 0 else "below the cut"] = -x
    inside = [half for half, distance in halves.items() if distance > 0]
    if not inside:
        raise UndecidedError
    return max(inside, key=lambda half: float(halves[half].lower()))


def _angle(half: str, y: Ball, x: Ball) -> Ball:
    if half == "right":
        return _atan(y / x)
    if half.endswith("cut"):
        return _atan(y / x) + (arb.pi() if half.startswith("above") else -arb.pi())
    quarter = arb.pi() / 2
    return (quarter if half == "upper" else -quarter) - _atan(x / y)


_PIECES: dict[int, tuple[Callable[..., Any], Callable[..., Ball]]] = {
    casadi.OP_FABS: (_nonnegative, lambda sign, x: x if sign > 0 else -x),
    casadi.OP_SIGN: (_sign, lambda sign, x: arb(sign)),
    casadi.OP_FLOOR: (_floor, lambda k, x: arb(k)),
    casadi.OP_CEIL: (lambda x: -_floor(-x), lambda k, x: arb(k)),
    casadi.OP_FMOD: (_towards_zero, lambda k, x, y: x - k * y),
    casadi.OP_FMIN: (lambda x, y: _certain(x <= y, x > y), lambda first, x, y: x if first else y),
    casadi.OP_FMAX: (lambda x, y: _certain(x >= y, x < y), lambda first, x, y: x if first else y),
    casadi.OP_ATAN2: (_half_plane, _angle),
    casadi.OP_LT: (lambda x, y: _certain(x < y, x >= y), lambda yes, x, y: arb(int(yes))),
    casadi.OP_LE: (lambda x, y: _certain(x <= y, x > y), lambda yes, x, y: arb(int(yes))),
    casadi.OP_NOT: (lambda x: not _true(x), lambda yes, x: arb(int(yes))),
    casadi.OP_AND: (
        lambda x, y: _true(x) and _true(y),
        lambda yes, x, y: arb(int(yes)),
    ),
    casadi.OP_OR: (
        lambda x, y: _true(x) or _true(y),
        lambda yes, x, y: arb(int(yes)),
    ),
    casadi.OP_IF_ELSE_ZERO: (
        lambda condition, x: _true(condition),
        lambda yes, condition, x: x if yes else arb(0),
    ),
}
"""Mapping from piecewise operations to two functions. The first returns the outcome for real balls. The
second returns the result for an outcome and the operands. Conditions are exact (0 or 1), because their
comparisons are decided."""


def _decided(decide: Callable[..., Any], operands: Sequence[Ball]) -> Any:
    """Branch of an operation. For complex balls, which represent parameters near real values, it is the
    branch for the real parts."""
    if any(isinstance(operand, acb) for operand in operands):
        raise UndecidedError
    return decide(*operands)


def _real_only(hull: Callable[..., Ball]) -> Callable[..., Ball]:
    """Wrap a function whose hull encloses its values for real operands only. For complex operands, the
    wrapped function returns an undefined ball."""
    return lambda *operands: (
        acb(arb.nan()) if any(isinstance(operand, acb) for operand in operands) else hull(*operands)
    )


_HULLS: dict[int, Callable[..., Ball]] = {
    casadi.OP_FABS: lambda x: x.union(-x),
    casadi.OP_SIGN: lambda x: arb(-1).union(arb(1)),
    casadi.OP_FLOOR: lambda x: x.real.floor(),
    casadi.OP_CEIL: lambda x: x.real.ceil(),
    casadi.OP_ATAN2: _real_only(lambda y, x: arb(0, arb.pi().upper())),
    casadi.OP_FMOD: _real_only(lambda x, y: arb(0, y.abs_upper())),
    casadi.OP_FMIN: lambda x, y: x.union(y),
    casadi.OP_FMAX: lambda x, y: x.union(y),
    casadi.OP_LT: lambda x, y: arb(0).union(arb(1)),
    casadi.OP_LE: lambda x, y: arb(0).union(arb(1)),
    casadi.OP_NOT: lambda x: arb(0).union(arb(1)),
    casadi.OP_AND: lambda x, y: arb(0).union(arb(1)),
    casadi.OP_OR: lambda x, y: arb(0).union(arb(1)),
    casadi.OP_IF_ELSE_ZERO: lambda condition, x: x.union(arb(0)),
}
"""Mapping from piecewise operations to functions that return a ball which contains the results of all
possible outcomes."""

_NAMES = {value: name for name, value in vars(casadi).items() if name.startswith("OP_")}


@dataclass(frozen=True)
class Instructions:
    """Function as a list of lines (operation, indices of the operands, index of the result, constant or
    function).

    For a line that writes an output, the index of the result consists of the number of the output and of the
    row and column of the entry. The entry is stored immediately, because later lines reuse storage. entries:
    number of structurally nonzero entries of each output."""

    lines: tuple[tuple[int, tuple[int, ...], Any, Any], ...]
    storage: int
    entries: tuple[int, ...]

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle without the table of functions, which is rebuilt on loading."""
        lines = [line if line[0] not in _SMOOTH else (*line[:3], None) for line in self.lines]
        return _instructions, (lines, self.storage, self.entries)

    @classmethod
    def from_function(
        cls, function: casadi.Function, number: Callable[[float], Ball] = arb
    ) -> "Instructions":
        """Instructions of a CasADi function. `number` converts the constants of the function to balls. Raises
        LinearModelError for an operation without an enclosure rule."""
        function = function if function.is_a("SXFunction") else function.expand()
        sparsities = map(function.sparsity_out, range(function.n_out()))
        triplets = [list(zip(*each.get_triplet(), strict=True)) for each in sparsities]
        lines = []
        for k in range(function.n_instructions()):
            operation = function.instruction_id(k)
            operands, results = function.instruction_input(k), function.instruction_output(k)
            if operation == casadi.OP_OUTPUT:
                lines.append(
                    (operation, tuple(operands), (results[0], *triplets[results[0]][results[1]]), None)
                )
            elif operation == casadi.OP_CONST:
                lines.append((operation, (), results[0], number(function.instruction_constant(k))))
            elif operation == casadi.OP_INPUT or operation in _SMOOTH or operation in _PIECES:
                lines.append((operation, tuple(operands), results[0], _SMOOTH.get(operation)))
            else:
                raise LinearModelError(
                    f"the equations contain {_NAMES.get(operation, operation)}, for which no enclosure is "
                    "implemented; state the equations with other functions"
                )
        return cls(tuple(lines), function.sz_w(), tuple(map(len, triplets)))

    def __call__(
        self, inputs: Sequence[Sequence[Ball]], outcomes: Outcomes | None = None
    ) -> tuple[list[Entries], Outcomes]:
        """Return the entries (row, column, value) of each output, and the outcomes of the piecewise
        operations.

        Parameters
        ----------
        inputs : sequence of sequences of balls
            Elements of each input.
        outcomes : tuple, optional
            Outcomes of an earlier evaluation, or ANY. By default, they are determined from the inputs, which
            must then be real balls.

        Raises
        ------
        UndecidedError
            If an outcome is not the same for all numbers in the inputs.
        """
        work: list[Any] = [None] * self.storage
        values: list[Entries] = [[] for _ in self.entries]
        recorded: list[Any] = []
        replayed = None if outcomes is None or outcomes is ANY else iter(outcomes)
        for operation, positions, result, known in self.lines:
            if operation in _SMOOTH:
                if len(positions) == 2:
                    work[result] = known(work[positions[0]], work[positions[1]])
                else:
                    work[result] = known(work[positions[0]])
            elif operation == casadi.OP_CONST:
                work[result] = known
            elif operation == casadi.OP_OUTPUT:
                output, row, column = result
                values[output].append((row, column, work[positions[0]]))
            elif operation == casadi.OP_INPUT:
                work[result] = inputs[positions[0]][positions[1]]
            else:
                decide, apply = _PIECES[operation]
                operands = [work[place] for place in positions]
                try:
                    outcome = _decided(decide, operands) if replayed is None else next(replayed)
                except UndecidedError:
                    if outcomes is not ANY or operation not in _HULLS:
                        raise
                    work[result] = _HULLS[operation](*operands)
                    continue
                recorded.append(outcome)
                work[result] = apply(outcome, *operands)
        return values, tuple(recorded)


def _instructions(lines: Sequence[tuple[Any, ...]], storage: int, entries: tuple[int, ...]) -> Instructions:
    known = ((*line[:3], _SMOOTH.get(line[0], line[3])) for line in lines)
    return Instructions(tuple(known), storage, entries)
