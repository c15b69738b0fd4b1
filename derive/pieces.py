"""Inactive pieces of piecewise expressions contribute nothing, even if they are singular.

A contact `Heaviside(r - gap)*k*(r - gap)*x/r` is 0·(0/0) at r = 0. It becomes a selection of its value or 0.
Within the value, arguments at which a function or its derivatives would not be finite are replaced while the
piece is inactive. Values and automatic derivatives of any order are then finite.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import sympy

from derive.domains import (
    NOT_ZERO,
    POSITIVE,
    Signs,
    branches,
    gate,
    is_met,
    limit,
    need,
    rebuilt,
    substituted,
)

STEPS = (sympy.Abs, sympy.sign, sympy.Heaviside)
PIECEWISE = (sympy.Max, sympy.Min, sympy.Piecewise, *STEPS)


class Selected(sympy.Function):
    """Selected(condition, value, otherwise)."""

    nargs = 3
    is_real = True

    @classmethod
    def eval(cls, *args: Any) -> Any:
        condition, value, otherwise = args
        if condition in (sympy.true, sympy.false):
            return value if condition else otherwise
        return None


def guarded(expression: Any, signs: Signs) -> Any:
    """Expression in which pieces that may be singular are replaced by selections that are finite on both
    sides; the expression itself if there are none."""
    return _Selection(signs, True).of(sympy.sympify(expression))


def at_rest(expression: Any, rest: Mapping[Any, Any], signs: Signs) -> tuple[Any, list[Any]]:
    """Expression evaluated at the values `rest` of all moving symbols, and the conditions under which it is
    finite there: that singular pieces are inactive."""
    conditions: list[Any] = []

    def value(part: Any) -> Any:
        if not part.has(Selected):
            return substituted(part, rest)
        if not isinstance(part, Selected):
            return rebuilt(part, [value(each) for each in part.args])
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

    return value(_Selection(signs, False).of(expression)), conditions


def is_finite(expression: Any) -> bool:
    """Whether an expression contains no infinite or undefined value."""
    return not expression.has(sympy.nan, sympy.zoo, sympy.oo, -sympy.oo)


def margin_of(condition: Any) -> Any:
    """Expression that is positive where inequalities hold strictly; None for other conditions."""
    if isinstance(condition, sympy.And | sympy.Or):
        margins: Sequence[Any] = [margin_of(each) for each in condition.args]
        if any(each is None for each in margins):
            return None
        return (sympy.Min if isinstance(condition, sympy.And) else sympy.Max)(*margins)
    return condition.gts - condition.lts if hasattr(condition, "gts") else None


def _may_hold(condition: Any, signs: Signs) -> bool:
    """Whether the signs of the symbols permit the inequalities to hold strictly."""
    margin = margin_of(condition)
    return margin is not None and not margin.xreplace(dict(signs)).is_nonpositive


@dataclass(frozen=True)
class _Selection:
    """Replacement of singular pieces by selections. safe: whether inactive values are made finite."""

    signs: Signs
    safe: bool

    def of(self, part: Any) -> Any:
        if not part.has(*PIECEWISE):
            return part
        arguments: Any = part.args
        if isinstance(part, sympy.Piecewise):
            return self._pieces(arguments, part)
        if isinstance(part, sympy.Max | sympy.Min):
            return self._extreme(part)
        if isinstance(part, sympy.Mul):
            gates = {each: condition for each in arguments if (condition := gate(each)) is not None}
            if any(map(self._is_singular, arguments)):
                if gates:
                    return self._product(part, gates)
                whole: Any = next((each for each in arguments if isinstance(each, sympy.Piecewise)), None)
                if whole is not None:
                    rest = sympy.Mul(*(each for each in arguments if each is not whole))
                    return self._pieces([(value * rest, condition) for value, condition in whole.args], part)
        if isinstance(part, sympy.Mul | sympy.Add) and part.has(*STEPS):
            split = self._split(part)
            if split is not None:
                return split
        args = [self.of(each) for each in arguments]
        return part if args == list(arguments) else part.func(*args)

    def _product(self, product: sympy.Mul, gates: Mapping[Any, Any]) -> Any:
        # Max(0, x) is x where its condition holds.
        factors = [_opened(each) if each in gates else each for each in product.args]
        value, condition = sympy.Mul(*map(self.of, factors)), sympy.And(*gates.values())
        return Selected(condition, self._finite(value, condition), sympy.S.Zero)

    def _split(self, part: Any) -> Any:
        """Selection for a sum or product that is regular on one side of a step or kink, as in (|x| + x)*y;
        None if there is none."""
        terms = [each for each in sympy.Add.make_args(part) if self._is_singular(each)]
        singular, others = (
            sympy.Add(*terms),
            [each for each in sympy.Add.make_args(part) if each not in terms],
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
                    value = self._finite(self.of(value), condition)
                    chosen: Any = Selected(condition, value, left)
                    return sympy.Add(chosen, *map(self.of, others))
        return None

    def _extreme(self, extreme: Any) -> Any:
        """Selection that makes singular arguments inactive unless they are the extreme one."""
        if not any(map(self._is_singular, extreme.args)):
            return extreme
        value, *others = map(self.of, sorted(extreme.args, key=sympy.default_sort_key))
        for other in others:
            condition = value > other if isinstance(extreme, sympy.Max) else value < other
            beyond = self._finite(other, sympy.Not(condition))
            value = Selected(condition, self._finite(value, condition), beyond)
        return value

    def _pieces(self, pieces: Sequence[tuple[Any, Any]], stated: Any) -> Any:
        """Selections for the values and conditions of a piecewise function, or of its product with a
        factor."""
        if not any(self._is_singular(value) for value, _ in pieces):
            return stated
        values = [self._finite(self.of(value), condition) for value, condition in branches(pieces)]
        result = values[-1]
        for value, (_, condition) in reversed([*zip(values[:-1], pieces[:-1], strict=True)]):
            result = Selected(condition, value, result)
        return result

    def _is_singular(self, part: Any) -> bool:
        """Whether a function in the expression, or a derivative of it, may be singular."""
        return self._may_fail(part) or any(map(self._is_singular, part.args))

    def _may_fail(self, node: Any) -> bool:
        needed = need(node)
        if needed is None or isinstance(node, sympy.exp | sympy.sinh | sympy.cosh):
            return False
        relation = NOT_ZERO if needed.relation == NOT_ZERO else POSITIVE
        return not is_met(needed._replace(relation=relation), self.signs)

    def _finite(self, part: Any, condition: Any) -> Any:
        """Value under a condition, made finite where the condition does not hold."""
        if not self.safe or isinstance(part, Selected) or not part.args or condition == sympy.true:
            return part
        args, needed = [self._finite(each, condition) for each in part.args], need(part)
        if needed is not None and self._may_fail(part):
            args[0] = Selected(condition, args[0], sympy.Integer(needed.safe))
        return part if args == list(part.args) else part.func(*args)


def _opened(factor: Any) -> Any:
    base, exponent = factor.as_base_exp()
    if isinstance(base, sympy.Heaviside):
        return sympy.S.One
    others = [each for each in base.args if each != 0]
    return others[0] ** exponent if len(others) == 1 else factor
