"""Conversion of functions of the phase that are not generated to CasADi functions. Examples are a user's
function and an interpolant of samples.

A function `matrices(phase, speed)` is called with arrays of symbols. Its operations on the symbols form a
graph, like that of generated code. A proof evaluates every operation of the graph in ball arithmetic.
Operations that a graph cannot contain raise an error: comparisons, conversions to numbers, and NumPy
functions that accept only numbers."""

import functools
import math
import operator
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import casadi
import numpy as np

from solve.approximation import Trigonometric
from solve.errors import LinearModelError
from solve.model.model import Model
from solve.samples import Samples
from solve.system import PeriodicSystem
from solve.threads import symbolic

_PLACES = 2
"""Number of phases for which a function is called. It is checked that the entries at one phase do not depend
on the other phase."""

_MOST_FACTORS = 16
"""Largest integer exponent of a power that is written as a product. Chosen by judgement."""


class Symbol:
    """Symbolic number, used as an element of NumPy arrays of objects. NumPy's functions call its methods."""

    def __init__(self, value: Any):
        self.value = value

    def __neg__(self) -> "Symbol":
        return Symbol(-self.value)

    def __pos__(self) -> "Symbol":
        return self

    def __abs__(self) -> "Symbol":
        return Symbol(casadi.fabs(self.value))

    def __mod__(self, other: Any) -> "Symbol":
        return NotImplemented if isinstance(other, np.ndarray) else self - other * math.floor(self / other)

    def __pow__(self, other: Any) -> "Symbol":
        if isinstance(other, np.ndarray):
            return NotImplemented
        exponent = _plain(other)
        if isinstance(exponent, float) and exponent.is_integer() and 0 < exponent <= _MOST_FACTORS:
            return Symbol(functools.reduce(operator.mul, [self.value] * int(exponent)))
        root = isinstance(exponent, float) and exponent == 0.5
        return Symbol(casadi.sqrt(self.value) if root else operator.pow(self.value, exponent))

    def arctan2(self, other: Any) -> "Symbol":
        return Symbol(casadi.atan2(self.value, _plain(other)))

    def _undecided(self, *_: Any) -> bool:
        raise TypeError("a comparison of symbolic numbers has no truth value")

    __bool__ = __eq__ = __ne__ = __lt__ = __le__ = __gt__ = __ge__ = _undecided  # type: ignore[assignment]
    __hash__ = object.__hash__


def _plain(x: Any) -> Any:
    """Return the CasADi expression of a symbol, or a real number unchanged. Raises TypeError for a number
    that is not a double."""
    if isinstance(x, Symbol):
        return x.value
    if np.iscomplexobj(x) or (value := float(x)) != x:
        raise TypeError(f"{x!r} is not a number of double precision")
    return value


def _forward(operation: Callable[[Any, Any], Any]) -> Callable[[Symbol, Any], Symbol]:
    """Method for an operation between a symbol and a number. NumPy applies it to each element of an array."""
    return lambda self, other: (
        NotImplemented if isinstance(other, np.ndarray) else Symbol(operation(self.value, _plain(other)))
    )


def _reflected(operation: Callable[[Any, Any], Any]) -> Callable[[Symbol, Any], Symbol]:
    return lambda self, other: Symbol(operation(_plain(other), self.value))


def _method(function: Callable[[Any], Any]) -> Callable[[Symbol], Symbol]:
    return lambda self: Symbol(function(self.value))


for _name in ("add", "sub", "mul", "truediv", "pow"):
    if _name != "pow":
        setattr(Symbol, f"__{_name}__", _forward(getattr(operator, _name)))
    setattr(Symbol, f"__r{_name}__", _reflected(getattr(operator, _name)))

for _name in ("sin", "cos", "tan", "sinh", "cosh", "tanh", "exp", "log", "sqrt"):
    setattr(Symbol, _name, _method(getattr(casadi, _name)))

for _name in ("floor", "ceil"):
    setattr(Symbol, f"__{_name}__", _method(getattr(casadi, _name)))

for _name in ("sin", "cos", "tan"):
    setattr(Symbol, f"arc{_name}", _method(getattr(casadi, f"a{_name}")))


@symbolic
def linearised(system: PeriodicSystem) -> casadi.Function:
    """CasADi function of phase, speed and parameters that returns M, C, K and d. For a generated model, it is
    the generated function. Raises LinearModelError for a user's function with operations that symbols do not
    support."""
    if isinstance(system, Model):
        return system.setup.function("linearised")
    phase, speed = casadi.SX.sym("phase"), casadi.SX.sym("speed")
    with _unsimplified():
        outputs = (
            _called(system, phase, speed)
            if system.capabilities.samples is None
            else _matrices(system, _interpolated(system.capabilities.samples, phase))
        )
        parameters = casadi.SX.sym("p", 0)
        return casadi.Function("linearised", [phase, speed, parameters], casadi.cse(outputs))


@contextmanager
def _unsimplified() -> Iterator[None]:
    """Context manager that disables CasADi's simplification. Simplification rounds products of constants, as
    in 5 (0.2 x) = x."""
    before = casadi.GlobalOptions.getSimplificationOnTheFly()
    casadi.GlobalOptions.setSimplificationOnTheFly(False)
    try:
        yield
    finally:
        casadi.GlobalOptions.setSimplificationOnTheFly(before)


def _called(system: PeriodicSystem, phase: casadi.SX, speed: casadi.SX) -> list[casadi.SX]:
    phases = [phase, *(casadi.SX.sym("other") for _ in range(1, _PLACES))]
    given = np.empty(_PLACES, dtype=object)
    given[:] = [Symbol(x) for x in phases]
    try:
        returned = list(system._matrices(given, Symbol(speed)))  # type: ignore[arg-type]
        arrays = [np.asarray(array) for array in returned[: len(returned) - bool(system.inputs)]]
        by_phase = [_matrices(system, [array[k] for array in arrays]) for k in range(_PLACES)]
    except (ArithmeticError, AttributeError, IndexError, RuntimeError, TypeError, ValueError) as error:
        first = str(error).partition("\n")[0]
        raise LinearModelError(
            "the function of the matrices cannot be evaluated at symbolic phases, as a proof requires: "
            f"{first}; docs/proof.md lists the operations that are allowed"
        ) from None
    for k, matrices in enumerate(by_phase):
        others = casadi.vertcat(*(phases[:k] + phases[k + 1 :]))
        if any(casadi.depends_on(matrix, others) for matrix in matrices):
            raise LinearModelError("the matrices at one phase depend on other phases of the array")
    return by_phase[0]


def _matrices(system: PeriodicSystem, arrays: list[np.ndarray]) -> list[casadi.SX]:
    """Symbolic M, C, K and d at one phase, from arrays."""
    shapes = ((system.n, system.n),) * 3 + ((system.n, 1),)
    return [_matrix(array, shape) for array, shape in zip(arrays, shapes, strict=True)]


def _interpolated(samples: Samples, phase: casadi.SX) -> list[np.ndarray]:
    curves = (Trigonometric(array, samples.period) for array in samples.arrays)
    values = (curve.at(phase, casadi.cos, casadi.sin) for curve in curves)
    return [
        np.array([Symbol(casadi.SX(x)) for x in entries], dtype=object).reshape(array.shape[1:])
        for entries, array in zip(values, samples.arrays, strict=True)
    ]


def _matrix(array: np.ndarray, shape: tuple[int, int]) -> casadi.SX:
    """Symbolic matrix from an array. Entries that are the number zero become structural zeros."""
    matrix = casadi.SX(*shape)
    for (i, j), x in np.ndenumerate(np.reshape(array, shape)):
        value = _plain(x)
        if isinstance(x, Symbol) or value != 0.0:
            matrix[i, j] = value
    return matrix
