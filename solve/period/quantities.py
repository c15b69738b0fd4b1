"""Coordinates and outputs of many points: samples over one period, statistics and amplitudes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from solve.arguments import SMALL
from solve.arrays import Array, uniform_phases
from solve.contracts import Formulas
from solve.equations import output_formulas, output_values
from solve.kernel import formulas as kernel
from solve.kernel.engines import COMPILED, NUMPY
from solve.period.curve import Curve, PeriodicCurve
from solve.period.signals import ROUGH, TIE, ZOOM, ZOOMS, enough_samples, figures, samples_a_step, spectrum
from solve.system import PeriodicSystem

Outputs = Callable[[Array, Array, Array, Array], Array]
"""Function that returns outputs (P, o, k) at phases (P, k), for states q, q̇, q̈ (P, n, k). Derivatives are
with respect to time."""


@dataclass(frozen=True)
class Quantities:
    """The q quantities of P points: the coordinates, followed by the outputs, if any.

    curve (P, n, …): curves of the points. speeds (P,): speeds in rad/s. formulas: formulas of the outputs,
    with parameters (P, p). positions: indices of the outputs among the formulas. outputs: function that
    computes the same outputs in NumPy."""

    curve: PeriodicCurve
    speeds: Array
    outputs: Outputs | None = None
    engine: str = NUMPY
    formulas: Formulas | None = None
    positions: Sequence[int] = ()

    @property
    def period(self) -> float:
        return float(self.curve.nodes[-1])

    @cached_property
    def values(self) -> Array:
        """Samples (P, q, k), uniform over the period and dense enough to resolve the curves."""
        return self.sampled(samples_a_step(len(self.curve.nodes) - 1))

    def sampled(self, a_step: int) -> Array:
        """Samples (P, q, k) at `a_step` phases per step. They are uniform over the period even on nonuniform
        grids."""
        count = a_step * (len(self.curve.nodes) - 1)
        phase, even = uniform_phases(count, self.period), self._uniform
        states = (
            (self.curve.sampled(a_step, order) if even else self.curve(phase, order)) for order in range(3)
        )
        q = next(states)
        if self.outputs is None:
            return q
        rates = (rate * part for rate, part in zip(self._rates[1:], states, strict=True))
        every = np.broadcast_to(phase, (len(q), count))
        return np.concatenate((q, self.outputs(every, q, *rates)), axis=1)

    def at(self, phase: Array) -> Array:
        """Values (P, q, k) at phases (P, q, k), which may differ between quantities."""
        n = self.curve.n
        values = self.curve.each(phase[:, :n])
        if self.outputs is None:
            return values
        P, o, k = len(phase), phase.shape[1] - n, phase.shape[2]
        every = phase[:, n:].reshape(P, 1, o * k)
        shared = np.repeat(every, n, axis=1)
        states = (rate * self.curve.each(shared, order) for order, rate in enumerate(self._rates))
        outputs = self.outputs(every[:, 0], *states).reshape(P, o, o, k)
        return np.concatenate((values, outputs[:, np.arange(o), np.arange(o)]), axis=1)

    def figures(self) -> Array:
        """Statistics (P, q, 7) of the quantities. The last axis contains the fields of `Statistics`."""
        found = self.compiled_figures()
        return figures(self.values, self.at, self.period) if found is None else found

    def compiled_figures(self) -> Array | None:
        """Result of `figures` from compiled code; None if compiled code is not available, or a quantity is
        not finite."""
        curve, known = self.curve, self.outputs is None or self.formulas is not None
        if not (self.engine == COMPILED and known and isinstance(curve, Curve) and self._uniform):
            return None
        if curve.drift is not None and (self.outputs is not None or self.formulas is not None):
            return None
        n, wanted = (
            curve.n,
            np.concatenate((np.arange(curve.n), curve.n + np.array(self.positions, dtype=int))),
        )
        if n > SMALL:
            return None
        samples = samples_a_step(len(curve.nodes) - 1)
        turn = curve.coefficients, self.period, self.speeds, samples
        found = kernel.figures(*turn, ZOOM, (ZOOMS, ROUGH), TIE, wanted, self.formulas)
        return found if found is not None and np.isfinite(found).all() else None

    @property
    def _uniform(self) -> bool:
        return bool(np.ptp(np.diff(self.curve.nodes)) <= 1e-12 * self.period)

    def amplitudes(self, quantities: list[int], count: int) -> Array:
        """For each of k selected quantities, return the signed mean, followed by the single-sided amplitudes
        of `count` harmonics. The result is an array (P, k, count + 1)."""
        steps, enough = len(self.curve.nodes) - 1, enough_samples(self.values.shape[-1], count)
        values = self.values if enough == self.values.shape[-1] else self.sampled(-(-enough // steps))
        return spectrum(values[:, quantities], count)[0]

    @property
    def _rates(self) -> list[Array]:
        return [
            np.ones((len(self.speeds), 1, 1)),
            self.speeds[:, None, None],
            self.speeds[:, None, None] ** 2,
        ]


_REPEATS, _SAMPLES = 1e-6, 512
"""Relative tolerance and number of phases for a comparison of the periods of one orbit. If all periods agree,
the orbit has the period of the system. Chosen by judgement."""

_A_STEP = 4
"""Number of phases per step at which outputs of two curves are compared."""


def coordinate_figures(curve: PeriodicCurve, engine: str) -> Array:
    """Statistics (n, 7) of the coordinates of one curve, in the order of `Statistics`."""
    return Quantities(curve[None], np.ones(1), engine=engine).figures()[0]


def compiled_output_figures(
    system: PeriodicSystem, curve: PeriodicCurve, speed: float, engine: str
) -> Array | None:
    """Statistics (o, 7) of the outputs, in the order of `Statistics`, from compiled code; None if it is not
    available. `speed` is in rad/s."""
    formulas = output_formulas(system) if engine == COMPILED else None
    if formulas is None:
        return None
    formulas = formulas._replace(values=formulas.values[None])
    positions = range(len(system.outputs))
    quantities = Quantities(curve[None], np.array([speed]), None, engine, formulas, positions)
    found = quantities.compiled_figures()
    return None if found is None else found[0, system.n :]


def output_figures(system: PeriodicSystem, curve: PeriodicCurve, speed: float, engine: str) -> Array:
    """Statistics (o, 7) of the outputs, in the order of `Statistics`, from compiled code if it is
    available."""
    compiled = compiled_output_figures(system, curve, speed, engine)
    if compiled is not None:
        return compiled

    def outputs(phase: Array, *state: Array) -> Array:
        values = output_values(system, phase[0], speed, *(part[0] for part in state))
        return np.array([[values[name] for name in system.outputs]])

    positions = range(len(system.outputs))
    quantities = Quantities(curve[None], np.array([speed]), outputs, engine, None, positions)
    return quantities.figures()[0, system.n :]


def orbit_figures(system: PeriodicSystem, curve: PeriodicCurve, speed: float, engine: str) -> Array:
    """Statistics (n + o, 7) of the coordinates and then of the outputs, in the order of `Statistics`."""
    of_coordinates = coordinate_figures(curve, engine)
    if not system.outputs:
        return of_coordinates
    return np.concatenate((of_coordinates, output_figures(system, curve, speed, engine)))


def output_changes(system: PeriodicSystem, speed: float, one: Curve, other: Curve, engine: str) -> Array:
    """For each output, the largest difference (o,) between the curves `one` and `other`, which have the same
    nodes. It is relative to the largest modulus of the output for `other`."""
    if not system.outputs:
        return np.zeros(0)
    phase = (other.nodes[:-1, None] + other.h[:, None] * (np.arange(_A_STEP) / _A_STEP)).ravel()
    before, after = (_outputs_at(system, phase, speed, curve, engine) for curve in (one, other))
    change, largest = np.abs(after - before).max(axis=1), np.abs(after).max(axis=1)
    return change / np.where(largest > 0, largest, 1.0)


def _outputs_at(system: PeriodicSystem, phase: Array, speed: float, curve: Curve, engine: str) -> Array:
    """Outputs (o, k) of a curve at phases (k,)."""
    q, v, a = (curve.sampled(_A_STEP, order) for order in range(3))
    state = q, speed * v, speed**2 * a
    formulas = output_formulas(system) if engine == COMPILED else None
    if formulas is not None:
        columns = kernel.columns(formulas, (phase[None], np.full((1, len(phase)), speed), *state))
        if columns is not None:
            return columns
    values = output_values(system, phase, speed, *state)
    return np.array([values[name] for name in system.outputs])


def repeats_early(curve: PeriodicCurve, periods: int) -> bool:
    """Whether a curve over several periods already repeats after the first period."""
    last = float(curve.nodes[-1])
    phase = uniform_phases(_SAMPLES, last)
    q, later = curve(phase), curve(phase + last / periods)
    return bool((np.abs(later - q).max(axis=1) <= _REPEATS * np.abs(q).max(axis=1)).all())
