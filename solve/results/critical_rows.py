"""What a critical speed is: maxima, and the resonances that explain them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from solve.results.lasting import lasting


@lasting
@dataclass(frozen=True)
class Combination:
    """A combination resonance (ω̄i + sign · ω̄j)/order, modes counted from 1, at a speed in rad/s; with i = j
    the parametric resonance of one mode, principal at order 1."""

    speed: float
    modes: tuple[int, int]
    sign: int
    order: int

    @property
    def is_division(self) -> bool:
        """Whether this is an integer division of one frequency, of half its order."""
        return self.modes[0] == self.modes[1] and self.order % 2 == 0

    def same(self, other: "Combination | None") -> bool:
        """Whether both name the same resonance, wherever the frequencies were taken."""
        return other is not None and self == replace(other, speed=self.speed)


@lasting
@dataclass(frozen=True)
class Maximum:
    """A speed (rad/s) at which something has a local maximum, and its height there, infinite where it grows
    beyond all bounds."""

    speed: float
    height: float


@lasting
@dataclass(frozen=True)
class Critical:
    """One critical speed in three ways (rad/s), None where a way does not show it.

    mode (from 1) and order: of the integer division, with the frequencies' means at this speed; at_rest:
    the same division with those at rest. ratios: the means over the row's speed, from the lowest mode on.
    combination: what explains the maximum where no division does, None where nothing does. radius: the
    maximum of the spectral radius. candidates: combinations of which each explains the maximum as well.
    """

    response: Maximum | None = None
    multiplier: Maximum | None = None
    division: float | None = None
    mode: int | None = None
    order: int | None = None
    at_rest: float | None = None
    ratios: Sequence[float] = ()
    combination: Combination | None = None
    radius: Maximum | None = None
    candidates: Sequence[Combination] = ()

    @property
    def explained(self) -> tuple[str, str]:
        """Modes and order of what explains the row, in few characters."""
        if self.candidates:
            orders = {one.order for one in self.candidates}
            return "?", str(*orders) if len(orders) == 1 else "?"
        if self.combination is None:
            return str(self.mode or "–"), str(self.order or "–")
        (high, low), sign = self.combination.modes, "+" if self.combination.sign > 0 else "−"
        return f"{high}{sign}{low}", str(self.combination.order)

    @property
    def unbounded(self) -> bool:
        """Whether the response grows beyond all bounds here."""
        return self.response is not None and math.isinf(self.response.height)

    @property
    def speed(self) -> float:
        """The first that there is."""
        ways = [way.speed for way in (self.response, self.multiplier, self.radius) if way]
        return ways[0] if ways else float(self.division or np.nan)
