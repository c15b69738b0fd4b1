"""Quantities as smooth functions of the design, near a design. Each local extremum over the period that may
become the largest is followed separately.

The maximum over the period is not differentiable where two extrema are equally large, and minimisation leads
to such designs. The individual extrema are differentiable, and their derivatives are those at a fixed phase
(envelope theorem).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from solve.arguments import described, number_or_nan
from solve.arrays import Array, uniform_phases
from solve.derivatives.figures import DIFFERENCE_STEP, EQUAL, FIRST_DIFFERENCE, SECOND_DIFFERENCE
from solve.errors import ValueOutOfBoundsError
from solve.period.named import Named
from solve.period.signals import LEAST_SAMPLES
from solve.results.orbit import Orbit
from solve.studies.design_points import Design, DesignPoint

_LEADING = 0.5
"""An extremum is not followed if it is lower than the largest by more than this fraction of the range of the
values. The choice is repeated in each round."""

_WINDOW = np.linspace(-1.0, 1.0, 33)
"""Sampling points of the window in which an extremum is searched for again, relative to the half-width of the
window. The window ends halfway to the neighbouring extremum."""

_ZOOMS, _ZOOM = 2, 16
"""Number of searches for an extremum, and factor by which the width of the window is reduced from one search
to the next. Measured for an oscillator: derivatives of extrema are accurate to 2e-4 with one search, and to
1e-7 with two."""

_WINDOWS = 16
"""Number of windows, spread over the whole period, in which the maxima of a quantity that is constant over
the period are followed. The half-width of any window is at most the period divided by this number. Chosen by
judgement."""


class Tracked(Protocol):
    """Functions of x: `values` (k,), which must not exceed a limit, and `slopes` (k, r), their derivatives
    with respect to x."""

    def values(self, x: Array) -> Array: ...

    def slopes(self, x: Array) -> Array: ...


@dataclass(frozen=True)
class Single:
    """Quantity at one speed, multiplied by a sign and by `factor`, for example 1 + error."""

    design: Design
    at: int
    quantity: Named
    sign: float = 1.0
    factor: float = 1.0

    def values(self, x: Array) -> Array:
        return np.array([self.sign * self.factor * self.design.points(x)[self.at].value(self.quantity)])

    def slopes(self, x: Array) -> Array:
        slopes = self.design.points(x)[self.at].slopes(self.quantity)
        return self.sign * self.factor * self.design.slopes(slopes)[None]


@dataclass(frozen=True)
class Extrema:
    """Local maxima of `sides` (k,) times the signal `name`, in windows about `phases` (k,) with half-widths
    `widths` (k,). A side is 1 for maxima of the signal and -1 for minima."""

    design: Design
    at: int
    name: str
    sides: Array
    phases: Array
    widths: Array

    def values(self, x: Array) -> Array:
        return self._found(x)[1]

    def slopes(self, x: Array) -> Array:
        point, phases = self.design.points(x)[self.at], self._found(x)[0]
        return self.design.slopes(self.sides[:, None] * point.signal_slopes(self.name, phases))

    def _found(self, x: Array) -> tuple[Array, Array]:
        """Phases (k,) and values (k,) of the maxima in the windows. If a window contains no maximum, its
        phase is at an end of the window."""
        point, found, widths = self.design.points(x)[self.at], self.phases, self.widths
        for _ in range(_ZOOMS):
            phases = found[:, None] + widths[:, None] * _WINDOW
            values = point.signal(self.name, phases.ravel()).reshape(phases.shape) * self.sides[:, None]
            found, widths = _refined(values, values.argmax(axis=1), phases), widths / _ZOOM
        phases = found[:, None] + widths[:, None] * np.arange(-2, 3)
        around = point.signal(self.name, phases.ravel()).reshape(phases.shape) * self.sides[:, None]
        # A Newton step to the phase of the extremum: derivatives then agree with differences to 1e-6.
        first, second = around @ FIRST_DIFFERENCE, around @ SECOND_DIFFERENCE
        is_near = (second < 0) & (np.abs(first) < np.abs(second))
        found = found - np.where(is_near, first / np.where(is_near, second, 1.0), 0.0) * widths
        return found, self.sides * point.signal(self.name, found)


@dataclass(frozen=True)
class Curve:
    """A coordinate or output at fixed phases (k,)."""

    design: Design
    at: int
    name: str
    phases: Array

    def values(self, x: Array) -> Array:
        return self.design.points(x)[self.at].signal(self.name, self.phases)

    def slopes(self, x: Array) -> Array:
        return self.design.slopes(self.design.points(x)[self.at].signal_slopes(self.name, self.phases))


@dataclass(frozen=True)
class Differences:
    """Maxima (k,) of a curve if `extrema` contains only maxima. If `extrema` also contains minima (l,), the
    values are differences (k + l - 1,): each maximum minus the first minimum, followed by the first maximum
    minus each further minimum."""

    extrema: Sequence[Extrema]

    def values(self, x: Array) -> Array:
        return self._combined([extremum.sides * extremum.values(x) for extremum in self.extrema])

    def slopes(self, x: Array) -> Array:
        return self._combined([extremum.sides[:, None] * extremum.slopes(x) for extremum in self.extrema])

    @staticmethod
    def _combined(parts: Sequence[Array]) -> Array:
        if len(parts) == 1:
            return parts[0]
        maxima, minima = parts
        return np.concatenate((maxima - minima[0], maxima[0] - minima[1:]))


@dataclass(frozen=True)
class Function:
    """Function of the orbits at all speeds, with derivatives by central differences."""

    design: Design
    function: Callable[[Sequence[Orbit]], float]

    def values(self, x: Array) -> Array:
        return np.array([self.value(self.design.points(x))])

    def value(self, points: Sequence[DesignPoint]) -> float:
        """Value of the function. Raises ValueOutOfBoundsError if it is not a finite number."""
        given = self.function([point.orbit for point in points])
        value = number_or_nan(given)
        if not math.isfinite(value):
            raise ValueOutOfBoundsError(
                f"the minimised function returns {described(given)}; allowed: finite numbers"
            )
        return value

    def slopes(self, x: Array) -> Array:
        points, slopes = self.design.points(x), np.empty((1, len(x)))

        def value(place: int, end: float) -> float:
            return self.value(self.design.on_grids_of(points, np.r_[x[:place], end, x[place + 1 :]]))

        for place, at in enumerate(x.tolist()):
            # At a bound, the difference is one-sided and is corrected by the second difference.
            middle = min(max(at, DIFFERENCE_STEP), 1 - DIFFERENCE_STEP)
            below, above = value(place, middle - DIFFERENCE_STEP), value(place, middle + DIFFERENCE_STEP)
            bend = 0.0 if middle == at else below - 2 * value(place, middle) + above
            slope = (above - below) / 2 + (at - middle) * bend / DIFFERENCE_STEP
            slopes[0, place] = slope / DIFFERENCE_STEP
        return slopes


def tracked(design: Design, x: Array, at: int, quantity: Named, sign: float = 1.0) -> Single | Extrema:
    """Return smooth functions of x. The largest of them is `sign` times a quantity at one speed. If this
    product is a maximum of a signal, there is one function for each relevant local maximum; otherwise, there
    is a single function."""
    sides = {("max", 1.0): (1.0,), ("min", -1.0): (-1.0,), ("max_abs", 1.0): (1.0, -1.0)}.get(
        (quantity.figure, sign)
    )
    if sides is None:
        return Single(design, at, quantity, sign)
    period, phases, signs, widths = design.model.period, [], [], []
    samples = uniform_phases(LEAST_SAMPLES, period)
    values = design.points(x)[at].signal(quantity.subject, samples)
    largest = max(float((side * values).max()) for side in sides)
    for side in sides:
        phases_of_side = _maxima(side * values, largest - _LEADING * float(np.ptp(values)), period)
        phases.append(phases_of_side)
        signs.append(np.full(len(phases_of_side), side))
        widths.append(_half_widths(phases_of_side, period))
    return Extrema(design, at, quantity.subject, *map(np.concatenate, (signs, phases, widths)))


def leading(design: Design, x: Array, at: int, quantity: Named, sign: float = 1.0) -> tuple[float, Array]:
    """Return the value of a quantity at one speed, multiplied by `sign`, and the derivatives (r,) of this
    product with respect to x. If several extrema are followed, the largest one is used."""
    followed = tracked(design, x, at, quantity, sign)
    values = followed.values(x)
    lead = int(values.argmax())
    return float(values[lead]), followed.slopes(x)[lead]


def equal_extrema(design: Design, x: Array, at: int, name: str, side: float) -> Extrema:
    """Return the largest local maximum of `side` times the signal `name` at one speed, or several maxima if
    they are equally large."""
    extrema = tracked(design, x, at, Named("", "", name, "max" if side > 0 else "min"), side)
    assert isinstance(extrema, Extrema)
    values = extrema.values(x)
    largest = values >= values.max() - EQUAL * np.abs(values).max()
    return Extrema(design, at, name, extrema.sides[largest], extrema.phases[largest], extrema.widths[largest])


def _maxima(values: Array, least: float, period: float) -> Array:
    """Return the phases (k,) of the local maxima that are at least `least`, from `values` at samples over a
    period."""
    before, after = np.roll(values, 1), np.roll(values, -1)
    indices = np.flatnonzero((values >= before) & (values > after) & (values >= least))
    if not len(indices):
        # A signal that is constant for this design may have maxima at any phase for the next design.
        indices = np.arange(0, len(values), len(values) // _WINDOWS)
    neighbours = np.stack((before, values, after), axis=1)[indices]
    phases = (indices[:, None] + np.array([-1, 0, 1])) * (period / len(values))
    return _refined(neighbours, np.ones(len(indices), dtype=int), phases)


def _half_widths(phases: Array, period: float) -> Array:
    """Return the half-widths (k,) of windows about ascending phases (k,), chosen so that the windows do not
    overlap."""
    if len(phases) < 2:
        return np.full(len(phases), period / _WINDOWS)
    gaps = np.diff(np.append(phases, phases[0] + period))
    return np.minimum(np.minimum(gaps, np.roll(gaps, 1)) / 2, period / _WINDOWS)


def _refined(values: Array, indices: Array, phases: Array) -> Array:
    """Return the phases (k,) of the vertices of parabolas through three samples. `indices` (k,) are the
    indices of the middle samples among the `values` (k, j) at `phases` (k, j). If such an index is that of
    the first or last sample, the phase of this sample is returned."""
    rows, inner = np.arange(len(indices)), np.clip(indices, 1, values.shape[1] - 2)
    below, top, above = (values[rows, inner + shift] for shift in (-1, 0, 1))
    bend = 2 * top - below - above
    spacing = phases[rows, inner] - phases[rows, inner - 1]
    shift = np.where(bend > 0, (above - below) / (2 * np.where(bend > 0, bend, 1.0)), 0.0)
    return np.where(
        indices == inner, phases[rows, inner] + np.clip(shift, -1, 1) * spacing, phases[rows, indices]
    )
