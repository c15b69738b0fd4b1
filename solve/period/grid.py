"""Grids of steps over one period, with every jump of the matrices at the end of a step."""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from solve.arguments import require_size
from solve.arrays import Array

_MAX_CACHED = 4096
"""Number of steps up to which a grid and its phases are cached. Chosen by judgement."""

_INSIDE = 1e-13
"""Distance, as a fraction of the period, by which a stage at a jump is moved away from the jump, into its
step."""


@dataclass(frozen=True)
class Grid:
    """Grid of m steps over one period.

    Attributes
    ----------
    nodes : (m+1,)
        Phases in ascending order, from 0 to the period.
    at_break : (m,)
        For each node except the last: whether the matrices jump there.
    """

    nodes: Array
    at_break: Array

    @classmethod
    def uniform(cls, steps: int, period: float, breaks: tuple[float, ...] = ()) -> "Grid":
        """Grid of about `steps` steps, with equal step lengths between neighbouring breaks.

        Every piece between breaks has more steps if `steps` is doubled. If every piece has at least 6 steps,
        an increase of `steps` by a third suffices. Two grids with the same number of steps in a piece would
        agree there even if neither resolved the motion. Raises ValueOutOfBoundsError above the memory limit.
        """
        require_size("steps", steps)
        return (_cached if steps <= _MAX_CACHED else cls._new)(steps, period, tuple(breaks))

    @classmethod
    def _new(cls, steps: int, period: float, breaks: tuple[float, ...]) -> "Grid":
        if not breaks:
            return cls(np.linspace(0.0, period, steps + 1), np.zeros(steps, dtype=bool))
        ends, jump_at_zero = pieces(period, breaks)
        counts = steps_of(steps, np.diff(ends) / period)
        parts = [
            np.linspace(a, b, k, endpoint=False) for a, b, k in zip(ends, ends[1:], counts, strict=False)
        ]
        at_break = np.zeros(counts.sum(), dtype=bool)
        at_break[np.concatenate(([0], np.cumsum(counts)[:-1]))] = True
        at_break[0] = jump_at_zero
        return cls(np.append(np.concatenate(parts), period), at_break)

    @cached_property
    def steps(self) -> int:
        return len(self.nodes) - 1

    @cached_property
    def period(self) -> float:
        return float(self.nodes[-1])

    @cached_property
    def h(self) -> Array:
        """Step lengths in phase (m,)."""
        return np.diff(self.nodes)

    @cached_property
    def lengths(self) -> Array:
        """Step lengths in phase (m,). Without jumps of the matrices, they are exactly equal."""
        return np.full(self.steps, self.period / self.steps) if self.smooth else self.h

    @cached_property
    def smooth(self) -> bool:
        """Whether the matrices have no jumps."""
        return not self.at_break.any()

    @property
    def halved(self) -> "Grid":
        """Grid with every step divided into two."""
        nodes = np.insert(self.nodes, np.arange(1, self.steps + 1), self.nodes[:-1] + self.h / 2)
        at_break = np.zeros(2 * self.steps, dtype=bool)
        at_break[::2] = self.at_break
        return Grid(nodes, at_break)

    def parts(self, steps: int) -> "list[Grid]":
        """Divide the grid into consecutive parts with at most `steps` steps each. If the matrices jump,
        return the whole grid as one part."""
        if not self.smooth:
            return [self]
        return [
            Grid(self.nodes[first : first + steps + 1], self.at_break[first : first + steps])
            for first in range(0, self.steps, steps)
        ]

    def stages(self, c: Array) -> Array:
        """Phases (m, s) of the stages at the fractions c (s,) of each step.

        A stage at a jump is moved slightly into its step, so that the matrices of that side of the jump
        apply."""
        if self.steps > _MAX_CACHED:
            return self._stages(c)
        key = c.tobytes()
        if key not in self._phases:
            self._phases[key] = self._stages(c)
            self._phases[key].flags.writeable = False
        return self._phases[key]

    @cached_property
    def _phases(self) -> dict[bytes, Array]:
        """Cached phases of the stages. The keys are the bytes of the fractions c."""
        return {}

    def _stages(self, c: Array) -> Array:
        phases = self.nodes[:-1, None] + self.h[:, None] * c
        if self.smooth:
            return phases
        inset = _INSIDE * self.period
        low = self.nodes[:-1] + inset * self.at_break
        high = self.nodes[1:] - inset * np.roll(self.at_break, -1)
        return np.clip(phases, low[:, None], high[:, None])


@lru_cache(maxsize=64)
def _cached(steps: int, period: float, breaks: tuple[float, ...]) -> Grid:
    """Grid from a cache; many solutions use the same grid."""
    return Grid._new(steps, period, breaks)


def pieces(period: float, breaks: tuple[float, ...]) -> tuple[Array, bool]:
    """Return the ends of the pieces between jumps, including 0 and the period, and whether the matrices jump
    at phase 0.

    Breaks that differ by round-off count as one."""
    same = 0.5 * _INSIDE * period
    ends, jump_at_zero = [0.0], False
    for phase in sorted(b % period for b in breaks):
        if min(phase, period - phase) <= same:
            jump_at_zero = True
        elif phase - ends[-1] > same:
            ends.append(phase)
    return np.array([*ends, period]), jump_at_zero


def steps_of(steps: int, lengths: Array) -> Array:
    """Distribute `steps` steps over pieces in proportion to their lengths (k,), given as fractions of the
    period.

    Every piece has at least half as many steps as it would have if all pieces had equal length."""
    k = len(lengths)
    least = steps // (2 * k) + 1
    short = steps * lengths < least
    left = steps - least * short.sum()
    shared = np.round(left * lengths / max(lengths[~short].sum(), np.finfo(float).tiny))
    return np.where(short, least, np.maximum(shared, least)).astype(int)
