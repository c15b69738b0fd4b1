"""Domains of functions: conditions on the arguments of roots, quotients and arccosines, and the pieces of an
expression to which they apply."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple, Protocol

import sympy

from derive.symbols import SPEED

NOT_NEGATIVE, POSITIVE, NOT_ZERO = ">= 0", "> 0", "!= 0"

LARGEST_EXPONENT = 709
"""Largest integer x for which exp(x) is finite in double precision: log(1.8e308) = 709.8."""

Signs = Mapping[Any, Any]
"""Symbols with a known sign, by the symbols in the mechanism, which are only declared real."""


class Need(NamedTuple):
    """Domain of a function: it is real and finite where `margin` satisfies `relation`. safe: value of its
    first argument at which the function and its derivatives are finite."""

    margin: Any
    relation: str
    safe: int


def need(node: Any) -> Need | None:
    """Domain condition of a function; None if it is finite for every argument."""
    if isinstance(node, sympy.Pow):
        return _power(*node.args)
    if not isinstance(node, sympy.Function):
        return None
    x: Any = node.args[0]
    if isinstance(node, sympy.log):
        return Need(x, POSITIVE, 1)
    if isinstance(node, sympy.asin | sympy.acos):
        return Need(1 - sympy.Abs(x), NOT_NEGATIVE, 0)
    if isinstance(node, sympy.atanh):
        return Need(1 - sympy.Abs(x), POSITIVE, 0)
    if isinstance(node, sympy.acosh):
        return Need(x - 1, NOT_NEGATIVE, 2)
    if isinstance(node, sympy.tan):
        return Need(sympy.cos(x), NOT_ZERO, 0)
    if isinstance(node, sympy.exp):
        return Need(LARGEST_EXPONENT - x, NOT_NEGATIVE, 0)
    if isinstance(node, sympy.sinh | sympy.cosh):
        return Need(LARGEST_EXPONENT - sympy.Abs(x), NOT_NEGATIVE, 0)
    return None


def _power(base: Any, exponent: Any) -> Need | None:
    if exponent.is_integer:
        return None if exponent.is_nonnegative else Need(base, NOT_ZERO, 1)
    return Need(base, NOT_NEGATIVE if exponent.is_positive else POSITIVE, 1)


class Bounded(Protocol):
    """Parameter with a bound."""

    @property
    def symbol(self) -> Any: ...

    @property
    def bound(self) -> str: ...


def signs_of(parameters: Iterable[Bounded]) -> dict[Any, Any]:
    """Signs of the speed and of the parameters, from their bounds."""
    found: dict[Any, Any] = {SPEED: sympy.Dummy(positive=True)}
    for each in parameters:
        for clause in filter(None, each.bound.split(", ")):
            relation, _, limit = clause.partition(" ")
            if relation.startswith(">") and (float(limit) > 0 or clause == "> 0"):
                found[each.symbol] = sympy.Dummy(positive=True)
            elif relation == ">=" and float(limit) == 0:
                found[each.symbol] = sympy.Dummy(nonnegative=True)
            elif relation.startswith("<") and (float(limit) < 0 or clause == "< 0"):
                found[each.symbol] = sympy.Dummy(negative=True)
    return found


def is_met(need: Need, signs: Signs) -> bool:
    """Whether the signs of the symbols alone guarantee that a function is real and finite."""
    margin = substituted(sympy.sympify(need.margin), dict(signs))
    if need.relation == NOT_ZERO:
        return bool(margin.is_nonzero)
    return bool(margin.is_positive if need.relation == POSITIVE else margin.is_nonnegative)


def substituted(part: Any, rest: Mapping[Any, Any]) -> Any:
    """Expression evaluated at the values `rest` of symbols. Where SymPy cannot compare log(0) or 1/0, their
    limits are used; the result is NaN if the sign of a limit is unknown."""
    try:
        return part.xreplace(rest)
    except (TypeError, ValueError):
        return limit(part, rest)


def limit(part: Any, rest: Mapping[Any, Any]) -> Any:
    """Expression evaluated at the values `rest` of symbols, with the limits of log(0) and 1/0."""
    if not part.args:
        return part.xreplace(rest)
    args = [limit(each, rest) for each in part.args]
    if isinstance(part, sympy.log) and args[0] == 0:
        return -sympy.oo
    if isinstance(part, sympy.Pow) and args[0] == 0 and args[1].is_negative:
        return sympy.oo if part.base.is_nonnegative or not args[1].is_integer else sympy.zoo
    return rebuilt(part, args)


def rebuilt(part: Any, args: Iterable[Any]) -> Any:
    """Expression with other arguments; NaN if they cannot be compared."""
    try:
        return part.func(*args)
    except (TypeError, ValueError):
        return sympy.nan


def gate(factor: Any) -> Any:
    """Condition under which a factor of a product is nonzero, for Heaviside(x), Max(0, x), Min(0, x) and
    their powers; None for other factors."""
    base = factor.base if isinstance(factor, sympy.Pow) and factor.exp.is_positive else factor
    arguments: Any = base.args
    if isinstance(base, sympy.Heaviside):
        return arguments[0] > 0
    if isinstance(base, sympy.Max | sympy.Min) and sympy.S.Zero in arguments:
        others = [each for each in arguments if each != 0]
        return sympy.Or(*(each > 0 if isinstance(base, sympy.Max) else each < 0 for each in others))
    return None


def branches(pieces: Iterable[Any]) -> Iterator[tuple[Any, Any]]:
    """Each value of a piecewise function with the condition under which it is active."""
    before: list[Any] = []
    for value, condition in pieces:
        yield value, sympy.And(condition, *map(sympy.Not, before))
        before.append(condition)


def needs(expression: Any) -> list[tuple[Any, Need]]:
    """Functions of an expression that have a domain condition, inner ones first, each with its condition
    where its piece is active."""
    found: dict[Any, tuple[Any, Need]] = {}
    for node, guards in _guarded(expression, ()):
        needed = need(node)
        if needed is not None:
            margin = needed.margin
            if guards:
                margin = sympy.Piecewise((margin, sympy.And(*guards)), (sympy.S.One, True))
            found.setdefault((margin, needed.relation), (node, needed._replace(margin=margin)))
    return list(found.values())


def _guarded(part: Any, guards: tuple[Any, ...]) -> Iterator[tuple[Any, tuple[Any, ...]]]:
    """Every subexpression with the conditions under which it is active, arguments before functions."""
    if isinstance(part, sympy.Piecewise):
        for value, condition in branches(part.args):
            yield from _guarded(value, guards if condition == sympy.true else (*guards, condition))
        return
    gates = [gate(each) for each in part.args] if isinstance(part, sympy.Mul) else []
    conditions = tuple(each for each in gates if each is not None)
    for position, each in enumerate(part.args):
        free = not conditions or gates[position] is not None
        yield from _guarded(each, guards if free else (*guards, *conditions))
    yield part, guards
