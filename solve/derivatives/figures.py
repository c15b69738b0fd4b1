"""Derivatives of figures of coordinates and outputs: extrema, means, root mean squares, harmonics.

An extremum changes as the quantity does at its phase, which may be held: the derivative by the phase is zero
there (envelope theorem).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from solve.arrays import Array
from solve.derivatives.turn import TurnOnGrid
from solve.errors import NoDerivativeError
from solve.period.curve import Curve
from solve.period.named import HARMONIC, PHASE, Named
from solve.period.quantities import enough_samples, samples_a_step
from solve.results.orbit import Turn
from solve.system import Dependence, PeriodicSystem

_SAME, _ALIKE = 1e-9, 1e-6
"""Relative difference of two extrema up to which either may be the largest, and of their derivatives up to
which it does not matter which of them is."""

_PROMISING = 1e-3
"""Part of the range of a quantity by which other maxima of samples may be lower and be the largest."""

_NEWTON, _MOST = 3, 64
"""Steps by which an extremum's phase is brought to where the derivative is zero; most extrema looked at."""

_NEAR = 0.03
"""Part of the distance of two samples by which values about an extremum are apart."""

_FIRST, _SECOND = np.array([1, -8, 0, 8, -1]) / 12, np.array([-1, 16, -30, 16, -1]) / 12
"""Weights of five values whose sums are their first and second derivative, by their distance."""


@dataclass(frozen=True)
class OrbitOnGrid(Turn):
    """The orbit of a system on a grid."""

    system: PeriodicSystem
    speed: float
    turn: TurnOnGrid

    @cached_property
    def curve(self) -> Curve:
        return self.turn.curves(self.turn.orbit)[0]

    def state(self, phase: Array) -> tuple[Array, Array, Array]:
        q, v, a = (self.curve(phase, order) for order in range(3))
        return q, self.speed * v, self.speed**2 * a

    @property
    def samples(self) -> int:
        return self.turn.grid.steps * samples_a_step(self.turn.grid.steps)


class FigureSlopes:
    """Derivatives by θ (r,) of figures of an orbit, from the curves (r, n, …) of its derivatives."""

    def __init__(self, orbit: OrbitOnGrid, curves: Curve, dependence: Dependence):
        self.orbit, self._curves, self._dependence = orbit, curves, dependence

    def signal(self, name: str, phase: Array) -> Array:
        """Of a coordinate or output (r, k) at phases (k,)."""
        system = self.orbit.system
        if name in system.coordinates:
            row = system.coordinates.index(name)
            return self._curves[:, row : row + 1](phase)[:, 0]
        states = np.array([self.orbit.curve(phase, order) for order in range(3)])
        moved = np.stack([self._curves(phase, order) for order in range(3)], axis=1)
        return self._dependence.output(name, phase, self.orbit.speed, states, moved)

    def __call__(self, asked: Named) -> Array:
        """Derivatives (r,) of a figure. Raises NoDerivativeError."""
        name, figure, orbit = asked.subject, asked.figure, self.orbit
        if figure in ("max", "min", "max_abs"):
            return self._of_extremum(name, figure)
        if figure.endswith("_phase"):
            raise NoDerivativeError(f"{asked.text}: derivatives of phases of extrema are not calculated")
        if figure in (HARMONIC, PHASE):
            return _of_harmonic(asked, *self.harmonic(name, asked.number))
        phases = np.arange(orbit.samples) * (orbit.system.period / orbit.samples)
        slopes = self.signal(name, phases)
        if figure == "mean":
            return slopes.mean(axis=1)
        values = orbit.signal(name)(phases)
        return _over(slopes @ values / len(phases), np.sqrt(np.mean(values**2)), asked)

    def harmonic(self, name: str, number: int) -> tuple[complex, Array]:
        """Complex amplitude A exp(iψ) of an order of a coordinate or output, the mean for order 0, and its
        derivatives (r,)."""
        period, count = self.orbit.system.period, enough_samples(self.orbit.samples, number)
        phases = np.arange(count) * (period / count)
        wave = np.exp(-2j * np.pi / period * number * phases) * ((2 if number else 1) / count)
        return complex(wave @ self.orbit.signal(name)(phases)), self.signal(name, phases) @ wave

    def _of_extremum(self, name: str, figure: str) -> Array:
        """Derivatives (r,); NaN where equally large extrema change differently."""
        ways = {"max": (1.0,), "min": (-1.0,), "max_abs": (1.0, -1.0)}[figure]
        found = [self._highest(name, way) for way in ways]
        most = max(value for _, value in found)
        slopes = [
            way * self.signal(name, phases)
            for way, (phases, value) in zip(ways, found, strict=True)
            if value >= most - _SAME * abs(most)
        ]
        every = np.concatenate(slopes, axis=1)
        alike = np.ptp(every, axis=1) <= _ALIKE * np.abs(every).max(axis=1)
        return np.where(alike, -every[:, 0] if figure == "min" else every[:, 0], np.nan)

    def _highest(self, name: str, way: float) -> tuple[Array, float]:
        """Phases (k,) at which way · quantity is largest, and that value. Its derivative is brought to zero
        there: of values that hardly differ, the largest tells its phase to half of their digits only."""
        signal, width = self.orbit.signal(name), self.orbit.system.period / self.orbit.samples
        values = way * signal(np.arange(self.orbit.samples) * width)
        level = values.max() - _PROMISING * np.ptp(values)
        tops = (values >= level) & (values >= np.roll(values, 1)) & (values > np.roll(values, -1))
        phases = np.flatnonzero(tops if tops.any() else values == values.max())[:_MOST] * width
        for _ in range(_NEWTON):
            around = signal((phases[:, None] + _NEAR * width * np.arange(-2, 3)).ravel()).reshape(-1, 5)
            first, second = around @ _FIRST, around @ _SECOND
            with np.errstate(divide="ignore", invalid="ignore"):
                moved = -_NEAR * first / second
            phases = phases + np.where(np.abs(moved) < 1, moved, 0.0) * width
        values = way * signal(phases)
        return phases[values >= values.max() - _SAME * np.abs(values).max()], float(values.max())


def _of_harmonic(asked: Named, value: complex, slopes: Array) -> Array:
    """Of amplitude or phase angle of an order, whose complex amplitude is `value` and has these derivatives
    (r,)."""
    if asked.number == 0:
        return np.real(slopes) if asked.figure == HARMONIC else np.zeros(len(slopes))
    turned = _over(slopes * np.conj(value), abs(value), asked)
    assert asked.figure in (HARMONIC, PHASE)
    return np.real(turned) if asked.figure == HARMONIC else np.imag(turned) / abs(value)


def _over(slopes: Array, size: float, asked: Named) -> Array:
    if size == 0:
        raise NoDerivativeError(f"{asked.text} is 0, where a modulus has a kink; ask for other quantities")
    return slopes / size
