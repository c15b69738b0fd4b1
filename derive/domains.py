"""Domain conditions of functions, and replacement of pieces of expressions that may be singular.

A domain condition restricts the argument of a root, quotient or arccosine. Inactive pieces of piecewise
expressions should contribute nothing, even if they are singular: the contact `Heaviside(r - gap)*k*(r -
gap)*x/r` would be 0·(0/0) at r = 0. Such a piece is replaced by a selection: its value if it is active,
otherwise 0. Where the piece is inactive, arguments at which a function or its derivatives would be infinite
are replaced by safe arguments. Values and automatic derivatives of any order are then finite.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import sympy

from derive.symbols import SPEED

NOT_NEGATIVE, POSITIVE, NOT_ZERO = ">= 0", "> 0", "!= 0"

LARGEST_EXPONENT = 709
"""Largest integer x for which exp(x) is finite in double precision: log(1.8e308) = 709.8."""

Signs = Mapping[Any, Any]
"""Type of mappings from symbols of a mechanism to symbols whose sign is known to SymPy."""


class Need(NamedTuple):
    """Domain condition of a function: it is real and finite where `margin` satisfies `relation`.

    safe: value of the first argument for which the function and its derivatives are finite.
    """

    margin: Any
    relation: str
    safe: int


def need(node: Any) -> Need | None:
    """Domain condition of a function; None if the function is finite for every argument."""
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


def signs_of(parameters: Iterable[Any]) -> dict[Any, Any]:
    """Map the speed, and each parameter whose bound implies a sign, to a symbol with this sign."""
    signs: dict[Any, Any] = {SPEED: sympy.Dummy(positive=True)}
    for parameter in parameters:
        for clause in filter(None, parameter.bound.split(", ")):
            relation, _, limit = clause.partition(" ")
            if relation.startswith(">") and (float(limit) > 0 or clause == "> 0"):
                signs[parameter.symbol] = sympy.Dummy(positive=True)
            elif relation == ">=" and float(limit) == 0:
                signs[parameter.symbol] = sympy.Dummy(nonnegative=True)
            elif relation.startswith("<") and (float(limit) < 0 or clause == "< 0"):
                signs[parameter.symbol] = sympy.Dummy(negative=True)
    return signs


def is_met(need: Need, signs: Signs) -> bool:
    """Whether the signs of the symbols imply that a function is real and finite."""
    margin = substituted(sympy.sympify(need.margin), dict(signs))
    if need.relation == NOT_ZERO:
        return bool(margin.is_nonzero)
    return bool(margin.is_positive if need.relation == POSITIVE else margin.is_nonnegative)


def substituted(part: Any, rest: Mapping[Any, Any]) -> Any:
    """Expression evaluated at the values `rest` of symbols. If SymPy cannot compare log(0) or 1/0, their
    limits are used; NaN if the sign of a limit is unknown."""
    try:
        return part.xreplace(rest)
    except (TypeError, ValueError):
        return limit(part, rest)


def limit(part: Any, rest: Mapping[Any, Any]) -> Any:
    """Expression evaluated at the values `rest` of symbols, with the limits of log(0) and 1/0."""
    if not part.args:
        return part.xreplace(rest)
    args = [limit(argument, rest) for argument in part.args]
    if isinstance(part, sympy.log) and args[0] == 0:
        return -sympy.oo
    if isinstance(part, sympy.Pow) and args[0] == 0 and args[1].is_negative:
        return sympy.oo if part.base.is_nonnegative or not args[1].is_integer else sympy.zoo
    return rebuilt(part, args)


def rebuilt(part: Any, args: Iterable[Any]) -> Any:
    """Expression with new arguments; NaN if SymPy cannot compare the arguments."""
    try:
        return part.func(*args)
    except (TypeError, ValueError):
        return sympy.nan


def gate(factor: Any) -> Any:
    """Return the condition under which a factor is nonzero.

    The factor is Heaviside(x), Max(0, x), Min(0, x), or a power of one of these; None for other factors.
    """
    base = factor.base if isinstance(factor, sympy.Pow) and factor.exp.is_positive else factor
    arguments: Any = base.args
    if isinstance(base, sympy.Heaviside):
        return arguments[0] > 0
    if isinstance(base, sympy.Max | sympy.Min) and sympy.S.Zero in arguments:
        others = [argument for argument in arguments if argument != 0]
        return sympy.Or(*(other > 0 if isinstance(base, sympy.Max) else other < 0 for other in others))
    return None


def branches(pieces: Iterable[Any]) -> Iterator[tuple[Any, Any]]:
    """Yield the values of a piecewise function, each with the condition under which it is active."""
    before: list[Any] = []
    for value, condition in pieces:
        yield value, sympy.And(condition, *map(sympy.Not, before))
        before.append(condition)


def needs(expression: Any) -> list[tuple[Any, Need]]:
    """Return the functions in an expression, inner functions first, with their domain conditions.

    The margin of a condition is 1 where the piece that contains the function is inactive.
    """
    collected: dict[Any, tuple[Any, Need]] = {}
    for node, guards in _guarded(expression, ()):
        condition = need(node)
        if condition is not None:
            margin = condition.margin
            if guards:
                margin = sympy.Piecewise((margin, sympy.And(*guards)), (sympy.S.One, True))
            collected.setdefault((margin, condition.relation), (node, condition._replace(margin=margin)))
    return list(collected.values())


def _guarded(part: Any, guards: tuple[Any, ...]) -> Iterator[tuple[Any, tuple[Any, ...]]]:
    """Yield all subexpressions, arguments before functions, with the conditions under which they are
    active."""
    if isinstance(part, sympy.Piecewise):
        for value, condition in branches(part.args):
            yield from _guarded(value, guards if condition == sympy.true else (*guards, condition))
        return
    gates = [gate(argument) for argument in part.args] if isinstance(part, sympy.Mul) else []
    conditions = tuple(condition for condition in gates if condition is not None)
    for position, argument in enumerate(part.args):
        free = not conditions or gates[position] is not None
        yield from _guarded(argument, guards if free else (*guards, *conditions))
    yield part, guards


STEPS = (sympy.Abs, sympy.sign, sympy.Heaviside)
PIECEWISE = (sympy.Max, sympy.Min, sympy.Piecewise, *STEPS)


class Selected(sympy.Function):
    """Function Selected(condition, value, otherwise): `value` where the condition holds, `otherwise`
    elsewhere."""

    nargs = 3
    is_real = True

    @classmethod
    def eval(cls, *args: Any) -> Any:
        condition, value, otherwise = args
        if condition in (sympy.true, sympy.false):
            return value if condition else otherwise
        return None


def guarded(expression: Any, signs: Signs) -> Any:
    """Return an expression in which pieces that may be singular are replaced by selections.

    Both alternatives of a selection are finite everywhere.
    """
    return _Selection(signs, True).selected(sympy.sympify(expression))


def value_at_rest(expression: Any, rest: Mapping[Any, Any], signs: Signs) -> tuple[Any, list[Any]]:
    """Return an expression evaluated at the values `rest` of the time-varying symbols, and the conditions
    under which its singular pieces are inactive."""
    conditions: list[Any] = []

    def value(part: Any) -> Any:
        if not part.has(Selected):
            return substituted(part, rest)
        if not isinstance(part, Selected):
            return rebuilt(part, [value(argument) for argument in part.args])
        condition, taken, otherwise = map(value, part.args)
        if not is_finite(condition):
            condition = limit(part.args[0], {**rest, **signs})
            if condition not in (sympy.true, sympy.false):
                return sympy.nan
            return taken if condition else otherwise
        demand, chosen = sympy.Not(condition), otherwise
        if is_finite(taken):
            demand, chosen = condition, taken
        if is_finite(taken) == is_finite(otherwise) or not _may_hold(demand, signs):
            return sympy.Piecewise((taken, condition), (otherwise, True))
        conditions.append(demand)
        return chosen

    return value(_Selection(signs, False).selected(expression)), conditions


def is_finite(expression: Any) -> bool:
    """Whether an expression contains no infinite or undefined value."""
    return not expression.has(sympy.nan, sympy.zoo, sympy.oo, -sympy.oo)


def margin_of(condition: Any) -> Any:
    """Return an expression that is positive where a combination of inequalities holds strictly.

    None for other conditions.
    """
    if isinstance(condition, sympy.And | sympy.Or):
        margins: Sequence[Any] = [margin_of(argument) for argument in condition.args]
        if any(margin is None for margin in margins):
            return None
        return (sympy.Min if isinstance(condition, sympy.And) else sympy.Max)(*margins)
    return condition.gts - condition.lts if hasattr(condition, "gts") else None


def _may_hold(condition: Any, signs: Signs) -> bool:
    """Whether the inequalities can hold strictly, given the signs of the symbols."""
    margin = margin_of(condition)
    return margin is not None and not margin.xreplace(dict(signs)).is_nonpositive


@dataclass(frozen=True)
class _Selection:
    """Replacement of singular pieces by selections.

    safe: whether the value of a piece is made finite where the piece is inactive.
    """

    signs: Signs
    safe: bool

    def selected(self, part: Any) -> Any:
        if not part.has(*PIECEWISE):
            return part
        arguments: Any = part.args
        if isinstance(part, sympy.Piecewise):
            return self._pieces(arguments, part)
        if isinstance(part, sympy.Max | sympy.Min):
            return self._extreme(part)
        if isinstance(part, sympy.Mul):
            gates = {
                argument: condition for argument in arguments if (condition := gate(argument)) is not None
            }
            if any(map(self._is_singular, arguments)):
                if gates:
                    return self._product(part, gates)
                whole: Any = next(
                    (argument for argument in arguments if isinstance(argument, sympy.Piecewise)), None
                )
                if whole is not None:
                    rest = sympy.Mul(*(argument for argument in arguments if argument is not whole))
                    return self._pieces([(value * rest, condition) for value, condition in whole.args], part)
        if isinstance(part, sympy.Mul | sympy.Add) and part.has(*STEPS):
            split = self._split(part)
            if split is not None:
                return split
        args = [self.selected(argument) for argument in arguments]
        return part if args == list(arguments) else part.func(*args)

    def _product(self, product: sympy.Mul, gates: Mapping[Any, Any]) -> Any:
        # Where the condition holds, Max(0, x) is replaced by x.
        factors = [_opened(argument) if argument in gates else argument for argument in product.args]
        value, condition = sympy.Mul(*map(self.selected, factors)), sympy.And(*gates.values())
        return Selected(condition, self._finite(value, condition), sympy.S.Zero)

    def _split(self, part: Any) -> Any:
        """Selection for a sum or product that is regular on one side of a step or kink, as in (|x| + x)*y.

        None if it is singular on both sides.
        """
        terms = [argument for argument in sympy.Add.make_args(part) if self._is_singular(argument)]
        singular, others = (
            sympy.Add(*terms),
            [argument for argument in sympy.Add.make_args(part) if argument not in terms],
        )
        inner: set[Any] = {node.args[0] for node in singular.atoms(*STEPS)} if terms else set()
        for x in sorted(inner, key=sympy.default_sort_key):
            above, below = (
                singular.xreplace({sympy.Abs(x): s * x, sympy.sign(x): s, sympy.Heaviside(x): (1 + s) / 2})
                for s in (sympy.S.One, sympy.S.NegativeOne)
            )
            for value, other, condition in ((above, below, x > 0), (below, above, x < 0)):
                left = sympy.expand(other)
                if not self._is_singular(left):
                    value = self._finite(self.selected(value), condition)
                    chosen: Any = Selected(condition, value, left)
                    return sympy.Add(chosen, *map(self.selected, others))
        return None

    def _extreme(self, extreme: Any) -> Any:
        """Max or Min as selections, in which singular arguments are inactive unless they are the extremum."""
        if not any(map(self._is_singular, extreme.args)):
            return extreme
        value, *others = map(self.selected, sorted(extreme.args, key=sympy.default_sort_key))
        for other in others:
            condition = value > other if isinstance(extreme, sympy.Max) else value < other
            beyond = self._finite(other, sympy.Not(condition))
            value = Selected(condition, self._finite(value, condition), beyond)
        return value

    def _pieces(self, pieces: Sequence[tuple[Any, Any]], stated: Any) -> Any:
        """Selections for the pieces of a piecewise function, or of its product with a factor."""
        if not any(self._is_singular(value) for value, _ in pieces):
            return stated
        values = [self._finite(self.selected(value), condition) for value, condition in branches(pieces)]
        result = values[-1]
        for value, (_, condition) in reversed([*zip(values[:-1], pieces[:-1], strict=True)]):
            result = Selected(condition, value, result)
        return result

    def _is_singular(self, part: Any) -> bool:
        """Whether a function in the expression, or a derivative of a function, may be singular."""
        return self._may_fail(part) or any(map(self._is_singular, part.args))

    def _may_fail(self, node: Any) -> bool:
        needed = need(node)
        if needed is None or isinstance(node, sympy.exp | sympy.sinh | sympy.cosh):
            return False
        relation = NOT_ZERO if needed.relation == NOT_ZERO else POSITIVE
        return not is_met(needed._replace(relation=relation), self.signs)

    def _finite(self, part: Any, condition: Any) -> Any:
        """Value of a piece, made finite where the condition of the piece does not hold."""
        if not self.safe or isinstance(part, Selected) or not part.args or condition == sympy.true:
            return part
        args, needed = [self._finite(argument, condition) for argument in part.args], need(part)
        if needed is not None and self._may_fail(part):
            args[0] = Selected(condition, args[0], sympy.Integer(needed.safe))
        return part if args == list(part.args) else part.func(*args)


def _opened(factor: Any) -> Any:
    base, exponent = factor.as_base_exp()
    if isinstance(base, sympy.Heaviside):
        return sympy.S.One
    others = [argument for argument in base.args if argument != 0]
    return others[0] ** exponent if len(others) == 1 else factor
