"""Phases where steps and kinks of the phase lie: the `breaks` of a generated module.

A switch is brought to the form A cos(aφ+b) + B sin(aφ+b) + c, or to an angle less whole turns, whose
zeros are known. Where a switch holds another, the zeros of all branches are taken: these may be more than
there are, which does no harm.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

import sympy

from derive.errors import UnsupportedExpressionError
from derive.kinks import resting
from derive.printer import CasadiPrinter
from derive.switches import STEPPING, Wrapped, outermost, switches
from derive.symbols import PHASE, SPEED, Moving
from derive.units import short

PASSES = '''\
def _passes(known):
    """Phases from 0 to PERIOD at which slope*phase + offset is a target and whole turns; none where these are
    no numbers, as on a branch that is not taken."""
    found = []
    try:
        slope, offset, targets, turn = known()
        targets = [float(target) for target in targets]
    except (TypeError, ValueError, ZeroDivisionError):
        return found
    for target in targets if slope else ():
        first, last = sorted(((offset - target)/turn, (slope*PERIOD + offset - target)/turn))
        if last - first > 10000:
            raise ValueError(f"there are {last - first:.3g} jumps a period; at most 10000 can be followed")
        turns = range(math.floor(first), math.ceil(last) + 1)
        found += [(target + k*turn - offset)/slope for k in turns]
    return [phase for phase in found if 0 <= phase < PERIOD]'''
ANGLES = '''\
def _angles(cosine, sine, rest):
    """Angles x at which cosine*cos(x) + sine*sin(x) + rest is zero."""
    size = math.hypot(cosine, sine)
    if abs(rest) > size or size == 0:
        return ()
    middle, half = math.atan2(sine, cosine), math.acos(-rest/size)
    return (middle - half, middle + half)'''


class MathPrinter(CasadiPrinter):
    """The same expressions on numbers."""

    def doprint(self, expr: Any, assign_to: Any = None) -> str:
        return super().doprint(expr, assign_to).replace("casadi.", "math.")


@dataclass(frozen=True)
class Passage:
    """slope φ + offset is one of the targets, an expression each or a call of _angles, and whole turns."""

    slope: Any
    offset: Any
    targets: str
    turn: Any
    symbols: frozenset[Any]

    @property
    def text(self) -> str:
        slope, offset, turn = (MathPrinter().doprint(each) for each in (self.slope, self.offset, self.turn))
        return f"*_passes(lambda: ({slope}, {offset}, {self.targets}, {turn}))"


def passages(matrices: Iterable[Any], outputs: Iterable[Any], moving: Iterable[Any]) -> list[Passage]:
    """Where the matrices switch with the phase, and outputs where that depends on nothing else that moves.

    Raises UnsupportedExpressionError where the phase of a switch is not known in closed form.
    """
    rest = resting([*moving])
    found: dict[str, Passage] = {}
    for matrix in matrices:
        for switch in switches(matrix, (PHASE,)):
            found |= {each.text: each for each in _passages(switch)}
    for output in outputs:
        for switch in switches(output, (PHASE,)):
            if not switch.free_symbols & {*rest, SPEED}:
                found |= {each.text: each for each in _passages(switch)}
    return [found[text] for text in sorted(found)]


def _passages(switch: Any) -> Iterator[Passage]:
    for branch in _branches(switch):
        for factor in sympy.Mul.make_args(sympy.factor_terms(branch)):
            base = factor.base if isinstance(factor, sympy.Pow) else factor
            if PHASE in base.free_symbols:
                yield _passage(base, switch)


def _passage(zero: Any, switch: Any) -> Passage:
    """Of a function that does not itself switch."""
    zero = sympy.expand(zero)
    if SPEED not in zero.free_symbols:
        for wrapped in zero.atoms(Wrapped):
            angle, turn = wrapped.args
            value, factor = zero.coeff(wrapped, 0), zero.coeff(wrapped, 1)
            if sympy.expand(zero - value - factor * wrapped) == 0 and _free(value, factor, turn):
                targets = f"({MathPrinter().doprint(-value / factor)},)"
                return _linear(angle, targets, turn, zero, switch)
        for angle in {each.args[0] for each in zero.atoms(sympy.sin, sympy.cos)}:
            parts = [zero.coeff(function(angle), 1) for function in (sympy.cos, sympy.sin)]
            rest = sympy.expand(zero - parts[0] * sympy.cos(angle) - parts[1] * sympy.sin(angle))
            if _free(*parts, rest):
                targets = f"_angles({', '.join(map(MathPrinter().doprint, (*parts, rest)))})"
                return _linear(angle, targets, 2 * sympy.pi, zero, switch)
    raise _unknown(switch)


def _linear(angle: Any, targets: str, turn: Any, zero: Any, switch: Any) -> Passage:
    slope, offset = sympy.expand(angle).coeff(PHASE, 1), sympy.expand(angle).coeff(PHASE, 0)
    if not _free(slope, offset):
        raise _unknown(switch)
    return Passage(slope, offset, targets, turn, frozenset(zero.free_symbols - {PHASE}))


def _free(*expressions: Any) -> bool:
    return not any(each.atoms(Moving) for each in expressions)


def _unknown(switch: Any) -> UnsupportedExpressionError:
    return UnsupportedExpressionError(
        f"the phases where {short(switch)} = 0 are not known; let steps and kinks depend on the phase by "
        "sin or cos of an angle, or by wrapped(angle) alone, the angle a multiple of phase and a constant",
        switch,
    )


def _branches(switch: Any) -> Iterator[Any]:
    """The switch with every step, kink and piecewise function within it on every one of its branches."""
    nodes = outermost(switch)
    for chosen in product(*map(_alternatives, nodes)):
        branch = switch.xreplace(dict(zip(nodes, chosen, strict=True)))
        if not branch.has(*STEPPING):
            yield branch
        else:
            yield from _branches(branch)


def _alternatives(node: Any) -> list[Any]:
    if isinstance(node, sympy.Piecewise):
        return [each.args[0] for each in node.args]
    if isinstance(node, sympy.Max | sympy.Min):
        return list(node.args)
    if isinstance(node, sympy.Abs):
        return [node.args[0], -node.args[0]]
    return [sympy.S.One, sympy.S.Zero] if isinstance(node, sympy.Heaviside) else [sympy.S.One, -sympy.S.One]
