"""The choice that a user who names no method gets."""

from collections.abc import Callable, Iterator

import numpy as np

from solve.arrays import Array
from solve.methods.gauss import Gauss
from solve.methods.method import Method
from solve.methods.radau import Radau
from solve.period.frozen import frozen
from solve.period.points import Points

Choice = Callable[[Points], Iterator[tuple[Method, Array]]]
"""From points to methods, each with the positions (k,) of the points that it is to solve."""

Rule = Method | Choice

RESOLVABLE = 512
"""ω_max T up to which a grid of moderate size follows even the fastest mode, so that Gauss is safe."""

_PHASES = 32
"""At which the coefficients are frozen to see how fast their modes are."""


def auto(points: Points) -> Iterator[tuple[Method, Array]]:
    """Gauss where ω_max T, the angle that the fastest frozen mode turns in one period, is at most 512:
    then 512 steps have ω_max h ≤ 1. Radau IIA otherwise, which keeps no mode that it does not resolve."""
    stiff = frozen(points, _PHASES).faster(RESOLVABLE / points.period)
    for method, chosen in ((Radau(), stiff), (Gauss(), ~stiff)):
        if chosen.any():
            yield method, np.flatnonzero(chosen)


def chosen_for(method: Rule, points: Points) -> Iterator[tuple[Method, Array]]:
    """The method for all of the points, or those that a choice makes."""
    return iter([(method, np.arange(len(points)))]) if isinstance(method, Method) else method(points)
