"""Statistics of coordinates and outputs over one period: extrema of the continuous curve, means and
harmonics."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from solve.arguments import SMALL, conforms, described, matches_annotations, require_integer, require_size
from solve.arrays import Array
from solve.contracts import Formulas, Statistics
from solve.equations import output_formulas, output_values
from solve.errors import ValueOutOfBoundsError
from solve.kernel import formulas as kernel
from solve.kernel.engines import COMPILED, NUMPY
from solve.period.curve import Curve, PeriodicCurve
from solve.system import PeriodicSystem

Signal = Callable[[Array], Array]
"""Function that returns values (k,) at phases (k,)."""

Outputs = Callable[[Array, Array, Array, Array], Array]
"""Function that returns outputs (P, o, k) at phases (P, k), for states q, q̇, q̈ (P, n, k). Derivatives are
with respect to time."""

FIGURES = Statistics._fields

LEAST_SAMPLES = 2048
_SAMPLES_PER_STEP = 4
_ZOOMS, _ROUGH = 6, 3
"""Numbers of refinements of an extremum and of another candidate. Each refinement reduces the interval to a
sixteenth. Chosen by judgement."""

_ZOOM = np.linspace(-1.0, 1.0, 33)

_SIGNS = np.array([1.0, -1.0])
"""Signs for maxima and minima; a minimum is computed as the maximum of the negative."""

_TOGETHER = 16
"""Number of candidates for an extremum that are refined at a time. Chosen by judgement."""

_TIE = 1e-10
"""Difference between two candidates, relative to the largest value, up to which they count as the same
extremum. Chosen by judgement."""


def samples_a_step(steps: int) -> int:
    """Number of samples per step for a grid of `steps` steps, sufficient to resolve the curve."""
    wanted = max(LEAST_SAMPLES, 2 ** math.ceil(math.log2(_SAMPLES_PER_STEP * steps)))
    return math.ceil(wanted / steps)


def figures(values: Array, at: Callable[[Array], Array], period: float) -> Array:
    """Statistics (…, 7) of quantities, from their values (…, k) at k uniform phases from 0. The last axis
    contains the fields of `Statistics`.

    at: function that returns the values (…, j) of each quantity at phases (…, j) of its own. It is used to
    find the extrema of the continuous curve between the samples. All statistics are NaN if a value is not
    finite.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        return _figures(_known(values), at, period)


def _figures(values: Array, at: Callable[[Array], Array], period: float) -> Array:
    width = period / values.shape[-1]
    (high_at, high), (low_at, low) = _extremes(values, at, width)
    statistics = {
        "max": high,
        "min": -low,
        "max_abs": np.maximum(high, low),
        "mean": values.mean(axis=-1),
        "max_phase": high_at % period,
        "min_phase": low_at % period,
        "rms": np.sqrt(np.mean(values**2, axis=-1)),
    }
    found = np.stack([statistics[name] for name in FIGURES], axis=-1)
    # Replaces −0.0, which output would show.
    return np.where(np.isnan(values[..., :1]), np.nan, found) + 0.0


def _known(values: Array) -> Array:
    """Values (…, k); all k values are NaN if one of them is not finite."""
    return np.where(np.isfinite(values).all(axis=-1, keepdims=True), values, np.nan)


def _extremes(values: Array, at: Callable[[Array], Array], width: float) -> list[tuple[Array, Array]]:
    """Return the phase (…) and the value of the maximum, then those of the minimum. The value of the minimum
    has the opposite sign.

    Each extremum is sought near the largest sample (the first of several equal ones), and near lower samples
    if the curve may be higher there."""
    reaches = [_reach(sign * values) for sign in _SIGNS.tolist()]
    firsts = [_first(sign * values, reach) for sign, reach in zip(_SIGNS, reaches, strict=True)]
    # One call for maximum and minimum, because twice the phases cost little more.
    centres, highest = _zoomed(np.stack(firsts, axis=-1) * width, at, width, _SIGNS, _ZOOMS)
    found = []
    for side, (sign, reach, first) in enumerate(zip(_SIGNS, reaches, firsts, strict=True)):
        np.put_along_axis(reach, first[..., None], -np.inf, axis=-1)
        size = np.abs(values).max(axis=-1)
        found.append(_above(centres[..., side], highest[..., side], reach, at, width, (sign, size)))
    return found


def _first(values: Array, reach: Array) -> Array:
    """Index (…) of the first local maximum of the samples (…, k) that is as high as the highest sample."""
    largest = values.max(axis=-1, keepdims=True)
    return (np.isfinite(reach) & (values >= largest - _TIE * np.abs(largest))).argmax(axis=-1)


def _above(
    centre: Array,
    highest: Array,
    reach: Array,
    at: Callable[[Array], Array],
    width: float,
    side: tuple[float, Array],
) -> tuple[Array, Array]:
    """Return the phase (…) and the value of the highest maximum.

    `centre` and `highest` are the maximum found so far. It is replaced if the curve is higher near other
    samples; these are searched if their upper bound `reach` (…, k) exceeds it. side: the sign, and the
    largest moduli (…)."""
    sign, size = side
    rivals = int((reach > highest[..., None]).sum(axis=-1).max())
    if not rivals:
        return centre, highest
    candidates = np.argpartition(-reach, rivals - 1, axis=-1)[..., :rivals]
    for some in np.array_split(candidates, math.ceil(rivals / _TOGETHER), axis=-1):
        phase, found = _highest(some * width, at, width, sign, _ROUGH)
        if (found > highest + _TIE * size).any():
            phase, found = _highest(phase[..., None], at, width, sign, _ZOOMS)
            better = found > highest + _TIE * size
            centre, highest = np.where(better, phase, centre), np.where(better, found, highest)
    return centre, highest


def _reach(values: Array) -> Array:
    """Upper bounds on the curve near samples (…, k) that are local maxima; -inf for other samples.

    The parabola through the sample and its neighbours has a maximum above the sample; the bound exceeds the
    sample by twice as much."""
    before, after = np.roll(values, 1, axis=-1), np.roll(values, -1, axis=-1)
    peak, bend = (values >= before) & (values >= after), 2 * values - before - after
    above = np.square(before - after) / (4 * np.where(bend > 0, bend, np.inf))
    return np.where(peak, values + above, -np.inf)


def _highest(
    centres: Array, at: Callable[[Array], Array], width: float, sign: float, zooms: int
) -> tuple[Array, Array]:
    """Return the phase (…) and the value of the highest maximum of sign · curve within `width` of one of the
    centres (…, r)."""
    centres, highest = _zoomed(centres, at, width, np.array(sign), zooms)
    best = highest.argmax(axis=-1)[..., None]
    centres, highest = (np.take_along_axis(part, best, axis=-1)[..., 0] for part in (centres, highest))
    return centres, highest


def _zoomed(
    centres: Array, at: Callable[[Array], Array], width: float, signs: Array, zooms: int
) -> tuple[Array, Array]:
    """Return the phases (…, r) and the values of the maxima of sign · curve within `width` of each centre (…,
    r). `signs` is (r,), or a single sign."""
    highest = np.full(centres.shape, -np.inf)
    for _ in range(zooms):
        phase = centres[..., None] + width * _ZOOM
        around = at(phase.reshape(*centres.shape[:-1], -1)).reshape(phase.shape)
        around = signs[..., None] * around
        best = around.argmax(axis=-1)[..., None]
        centres, highest = (np.take_along_axis(part, best, axis=-1)[..., 0] for part in (phase, around))
        width /= 16
    return centres, highest


@matches_annotations
def signal_statistics(signal: Signal, period: float, samples: int = LEAST_SAMPLES) -> Statistics:
    """Compute the statistics of a function of the phase.

    Parameters
    ----------
    signal : callable
        Function of phases (k,) in rad that returns values (k,), periodic.
    period : float
        Period in rad.
    samples : int
        Number of uniform samples from which extrema are refined.

    Returns
    -------
    Statistics
        Extrema of the continuous curve, mean and root mean square.

    Raises
    ------
    ValueOutOfBoundsError
        If `period` or `samples` is out of range, or `signal` does not return one real value per phase.

    Examples
    --------
    >>> import numpy as np
    >>> round(signal_statistics(lambda phase: 1 + np.cos(phase), 2 * np.pi).max, 9)
    2.0
    """
    require_integer("samples", samples, 4)
    require_size("samples", samples)
    if not 0 < period < math.inf:
        raise ValueOutOfBoundsError(f"period is {period}; allowed: finite and > 0, such as 2 * np.pi")
    values = signal(np.arange(samples) * (period / samples))
    if np.shape(values) != (samples,) or not conforms(values, Array):
        raise ValueOutOfBoundsError(
            f"'signal' returns {described(values)}; it must return a real value for each of its phases"
        )
    return Statistics(*figures(values, signal, period).tolist())


def spectrum(values: Array, count: int) -> tuple[Array, Array]:
    """Return amplitudes [A0, A1, …] and phase angles [0, ψ1, …], both (…, count + 1), of the series A0 + Σ
    A_k cos(kφ + ψ_k).

    `values` (…, m) are samples at m uniform phases from 0. A0 is the signed mean; the others are single-sided
    peak amplitudes."""
    series = np.fft.rfft(_known(values), axis=-1)[..., : count + 1] / values.shape[-1]
    amplitudes, angles = 2 * np.abs(series), np.angle(series)
    amplitudes[..., 0], angles[..., 0] = series[..., 0].real, 0.0
    return amplitudes, angles


def enough_samples(samples: int, count: int) -> int:
    """Number of samples per period, at least `samples`, that suffices for `count` harmonics. Raises
    ValueOutOfBoundsError for an invalid count."""
    if not (isinstance(count, int | np.integer) and count >= 0):
        raise ValueOutOfBoundsError(
            f"harmonics is {count!r}; allowed: whole numbers of at least 0, such as 60"
        )
    require_size("harmonics", 8 * int(count))
    return max(samples, 8 * int(count))


def harmonics(signal: Signal, period: float, count: int, samples: int = LEAST_SAMPLES) -> tuple[Array, Array]:
    """Return the amplitudes and phase angles of `count` harmonics of one quantity, as from `spectrum`.
    Harmonic k has k cycles per period. Raises ValueOutOfBoundsError for an invalid count."""
    enough = enough_samples(samples, count)
    return spectrum(signal(np.arange(enough) * (period / enough)), count)


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
        phase, even = np.arange(count) * (self.period / count), self._uniform
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
        found = kernel.figures(*turn, _ZOOM, (_ZOOMS, _ROUGH), _TIE, wanted, self.formulas)
        return found if found is not None and np.isfinite(found).all() else None

    @property
    def _uniform(self) -> bool:
        return bool(np.ptp(np.diff(self.curve.nodes)) <= 1e-12 * self.period)

    def amplitudes(self, quantities: list[int], count: int) -> Array:
        """Return the signed mean and the single-sided amplitudes of `count` harmonics, (P, k, count + 1), of
        k selected quantities."""
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
"""Relative tolerance, and number of phases, for comparing the periods of an orbit over several periods. If
all periods agree, the orbit has the period of the system. Chosen by judgement."""

_A_STEP = 4
"""Number of phases per step at which outputs of two curves are compared."""


def coordinate_figures(curve: PeriodicCurve, engine: str) -> Array:
    """Statistics (n, 7) of the coordinates of one curve, as from `figures`."""
    return Quantities(curve[None], np.ones(1), engine=engine).figures()[0]


def compiled_output_figures(
    system: PeriodicSystem, curve: PeriodicCurve, speed: float, engine: str
) -> Array | None:
    """Statistics (o, 7) of the outputs as from `figures`, but from compiled code; None if it is not
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
    """Statistics (o, 7) of the outputs as from `figures`, from compiled code if it is available."""
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
    """Statistics (n + o, 7) of the coordinates and outputs, in this order, as from `figures`."""
    of_coordinates = coordinate_figures(curve, engine)
    if not system.outputs:
        return of_coordinates
    return np.concatenate((of_coordinates, output_figures(system, curve, speed, engine)))


def output_changes(system: PeriodicSystem, speed: float, one: Curve, other: Curve, engine: str) -> Array:
    """Largest difference (o,) of each output between the curves `one` and `other` with the same nodes,
    relative to the largest modulus of the output for `other`."""
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
    """Whether a curve over several periods already repeats after the first one."""
    last = float(curve.nodes[-1])
    phase = np.arange(_SAMPLES) * (last / _SAMPLES)
    q, later = curve(phase), curve(phase + last / periods)
    return bool((np.abs(later - q).max(axis=1) <= _REPEATS * np.abs(q).max(axis=1)).all())
