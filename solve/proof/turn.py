"""Maps of the steps of a period, and their products, formed by repeated halving. Steps end at jumps.

Generated code compares rounded numbers, so that a jump may be displaced slightly from its break. In a window
of a few units in the last place around each break, all outcomes are admitted. The map of a window of width δ
is the identity with an error of at most e^{δ sup‖A‖} − 1."""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial

from solve.errors import StepsError
from solve.proof.balls import Ball, Matrix, arb, arb_mat, interval, precision, widened, working_bits
from solve.proof.equation import Equation
from solve.proof.instructions import UndecidedError
from solve.proof.step import Step, StepTooLongError, step
from solve.terminal import progress

_SHORTEST = 2.0**-36
"""Step length, as a fraction of the period, below which the search for a step ends. An undeclared jump or a
singular M is then the cause."""

_MOST_ADVANCE = 1e7
"""Largest phase advance of a mode in a period, in rad. Chosen by judgement: a step covers about 12 rad and
takes about 10 ms."""

_WINDOW = 4
"""Half width of the window around a break, in units in the last place of the period."""

_PARTS = 24
"""Number of parts of the period that are distributed to processes. Chosen by judgement: there are enough
parts for an even distribution to several processes, and each part contains many steps."""

_GROWTH = 1.5
"""Length of the next trial step, relative to the previous successful step. Chosen by judgement."""


_Part = tuple[Ball, Ball, bool]
"""Start and end of an interval, and whether it is a window at a jump."""

_Found = tuple[Ball, Ball, Step]
"""Start and length of a step, and its enclosure."""


@dataclass(frozen=True)
class Turn:
    """Steps of a period: start, length and enclosure of each step."""

    period: Ball
    starts: tuple[Ball, ...]
    lengths: tuple[Ball, ...]
    steps: tuple[Step, ...]

    def levels(self) -> list[list[Matrix]]:
        """Products of 1, 2, 4, … neighbouring maps; the last product is the map of the period. Radii grow
        with the number of levels, not exponentially with the number of steps."""
        levels = [[each.map for each in self.steps]]
        while len(levels[-1]) > 1:
            pairs = itertools.zip_longest(levels[-1][::2], levels[-1][1::2])
            levels.append([first if second is None else second * first for first, second in pairs])
        return levels

    def states(self, start: Matrix) -> list[Matrix]:
        """States (2n+1, 1) at the start of each step, from the state `start` at the start of the first
        step."""
        states = [start]
        for maps in reversed(self.levels()[:-1]):
            states = [
                state if at % 2 == 0 else maps[at - 1] * state
                for at, state in enumerate(itertools.chain.from_iterable(zip(states, states, strict=True)))
            ][: len(maps)]
        return states


@dataclass(frozen=True)
class Marching:
    """Requirements on the steps: a truncation error below 2^-bits, and h‖A‖ below `most`. allowed: see
    `step`. executor: executor that computes steps of different parts of the period in parallel."""

    bits: int
    most: float
    allowed: float | None = None
    executor: Executor | None = None


def turn(equation: Equation, period: Ball, breaks: Sequence[float], marching: Marching) -> Turn:
    """Compute the steps of a period. Raises StepsError if a step cannot be enclosed, or if too many steps
    would be necessary."""
    advance = float(equation.frequencies.max()) * float(period.mid())
    if advance > _MOST_ADVANCE:
        raise StepsError(
            f"the phase of the fastest mode advances by {advance:.2g} rad in a period; allowed for a proof: "
            f"up to {_MOST_ADVANCE:g} rad; use lower stiffnesses, or replace stiff elements by constraints"
        )
    executor, alone = marching.executor, replace(marching, executor=None)
    parts = list(_parts(equation, period, breaks, 1 if executor is None else _PARTS))
    march = partial(_march, equation, float(period.mid()), alone)
    lists = (
        map(march, parts) if executor is None else executor.map(partial(_steps, march, working_bits()), parts)
    )
    found = []
    with progress.task("% of the period", 100) as done:
        for piece in itertools.chain.from_iterable(lists):
            found.append(piece)
            done.add(100 * float(piece[1]) / float(period))
    starts, lengths, steps = zip(*found, strict=True)
    return Turn(period, starts, lengths, steps)


def _parts(equation: Equation, period: Ball, breaks: Sequence[float], count: int) -> Iterator[_Part]:
    """Start and end of intervals of at most 1/count of the period, and of windows around jumps, each with a
    mark that is True for windows. Ends of intervals between jumps are exact."""
    for start, end, window in intervals(equation, period, breaks):
        if window:
            yield start, end, True
            continue
        first, last = float(start), float(end.mid())
        pieces = math.ceil(count * (last - first) / float(period.mid()))
        inner = (arb(first + (last - first) * k / pieces) for k in range(1, pieces))
        for one, other in itertools.pairwise((start, *inner, end)):
            yield one, other, False


def _steps(march: Callable[[_Part], Iterator[_Found]], bits: int, part: _Part) -> list[_Found]:
    """Steps of one part of the period, computed in another process with a working precision of `bits`."""
    with precision(bits):
        return list(march(part))


def _march(equation: Equation, period: float, marching: Marching, part: _Part) -> Iterator[_Found]:
    """Steps of one part of the period."""
    start, end, window = part
    if window:
        yield _window(equation, start, end - start)
    else:
        yield from _between(equation, float(start), end, period, marching)


def intervals(equation: Equation, period: Ball, breaks: Sequence[float]) -> Iterator[_Part]:
    """Start and end of the intervals between the jumps, and of the windows around the jumps, each with a mark
    that is True for windows."""
    end, first = float(period.mid()), 0.0
    width = _WINDOW * math.ulp(end)
    if _jumps(equation, arb(-width), arb(width)):
        yield arb(0), arb(width), True
        first = width
    for at in (each for each in breaks if width < each < end - width):
        yield arb(first), arb(at - width), False
        first = at + width
        yield arb(at - width), arb(first), True
    if _jumps(equation, arb(end - width), period):
        yield arb(first), arb(end - width), False
        yield arb(end - width), period, True
    else:
        yield arb(first), period, False


def _jumps(equation: Equation, start: Ball, end: Ball) -> bool:
    """Whether a piecewise operation may change its branch between two phases."""
    try:
        equation.outcomes(start, end, 0)
    except UndecidedError:
        return True
    return False


def _between(
    equation: Equation, phase: float, end: Ball, period: float, marching: Marching
) -> Iterator[_Found]:
    """Steps from one phase to another phase."""
    h, stop = period / 16, float(end.mid())
    while phase < stop:
        last = phase + h >= stop
        following = stop if last else phase + h
        length = (end if last else arb(following)) - arb(phase)
        try:
            taken = step(equation, arb(phase), length, marching.bits, marching.most, marching.allowed)
        except StepTooLongError:
            h = (following - phase) / 2
            if h < _SHORTEST * period:
                raise StepsError(
                    f"no enclosure of the solution beyond phase {phase:.9g}: M is singular there, the "
                    "equations change too fast, or they have an undeclared jump; declare the jump as a break"
                ) from None
            continue
        yield arb(phase), length, taken
        phase, h = following, _GROWTH * (following - phase)


def homogeneous(map: Matrix) -> Matrix:
    """Map of the state, without the load."""
    return arb_mat([row[:-1] for row in map.table()[:-1]])


def _window(equation: Equation, start: Ball, length: Ball) -> _Found:
    n = equation.n
    try:
        error = ((equation.largest_rate(interval(start, start + length)) * length).exp() - 1).upper()
    except (ZeroDivisionError, UndecidedError):
        error = arb.pos_inf()
    if not error < 1:
        raise StepsError(
            f"no bound on the equations was found near the jump at phase {float(start):.9g}: M may be "
            "singular there, or an expression is undefined beyond the jump"
        )
    identity = arb_mat([[int(i == j) for j in range(2 * n + 1)] for i in range(2 * n)])
    rows = [*widened(identity, error).table(), [arb(0)] * (2 * n) + [arb(1)]]
    return start, length, Step(arb_mat(rows), [identity], error, arb(0), arb(1), [])
