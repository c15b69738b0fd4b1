"""Published numbers and how they are computed here."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

import solve
from tests.digits import half_a_digit


@dataclass(frozen=True)
class Source:
    """Document (author, title, year), and `where` its text can be read."""

    author: str
    title: str
    year: str
    where: str


@dataclass(frozen=True)
class Case:
    """printed: the number with its digits, which stands at `place` in the source; found: the same by the
    public interface; within: what the number is known to, where that is not half a unit of its last digit."""

    source: Source
    place: str
    what: str
    printed: str
    computed: Callable[[], float]
    within: float | None = None
    slow: bool = False

    @property
    def tolerance(self) -> float:
        return half_a_digit(self.printed) if self.within is None else self.within


def oscillator(stiffness, damping=None, period=2 * np.pi, breaks=()):
    """Return q'' + damping(t) q' + stiffness(t) q = 0 with t as the phase, at speed 1 rad/s."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        rate = np.zeros_like(phase) if damping is None else damping(phase)
        return one, one * rate[:, None, None], one * stiffness(phase)[:, None, None], 0 * one[:, 0]

    return solve.PeriodicSystem(matrices, ["q"], period=period, breaks=breaks)


def first_order(A, rate, period, added=5.0):
    """x' = A(t) x as (d/dt + added)(x' - A x) = 0, which adds the exponent -added once for each state;
    rate: dA/dt. A and rate give (m, n, n) at phases (m,); t is the phase, at speed 1 rad/s."""

    def matrices(phase, speed):
        values = A(phase)
        n = values.shape[-1]
        one = np.broadcast_to(np.eye(n), values.shape)
        return one, added * one - values, -(rate(phase) + added * values), np.zeros(values.shape[:2])

    n = A(np.zeros(1)).shape[-1]
    return solve.PeriodicSystem(matrices, [f"x{k}" for k in range(1, n + 1)], period=period)


def band_edge(potential, period, multiplier, near, width, breaks=()):
    """Return the only λ within `width` of `near` at which q'' + (λ - potential) q = 0 has a double multiplier
    ±1."""

    def gap(value):
        system = oscillator(lambda t: value - potential(t), period=period, breaks=breaks)
        return solve.floquet(system, 1.0, rtol=1e-12).multipliers.sum().real - 2 * multiplier

    return brentq(gap, near - width, near + width, xtol=1e-12)
