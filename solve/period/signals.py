"""Statistics of functions of the phase over one period: extrema of the continuous curve, means and
harmonics."""

import math
from collections.abc import Callable

import numpy as np

from solve.arguments import conforms, described, matches_annotations, require_integer, require_size
from solve.arrays import Array, uniform_phases
from solve.contracts import Statistics
from solve.errors import ValueOutOfBoundsError

Signal = Callable[[Array], Array]
"""Function that returns values (k,) at phases (k,)."""

FIGURES = Statistics._fields

LEAST_SAMPLES = 2048
_SAMPLES_PER_STEP = 4
ZOOMS, ROUGH = 6, 3
"""Numbers of refinements of an extremum, and of a sample that may be near a larger one. Each refinement
reduces the interval to a sixteenth. Chosen by judgement."""

ZOOM = np.linspace(-1.0, 1.0, 33)

_SIGNS = np.array([1.0, -1.0])
"""Signs for maxima and minima; a minimum is computed as the maximum of the negative."""

_TOGETHER = 16
"""Number of candidates for an extremum that are refined at a time. Chosen by judgement."""

TIE = 1e-10
"""Difference between two candidates, relative to the largest value, up to which they count as the same
extremum. Chosen by judgement."""


def samples_a_step(steps: int) -> int:
    """Number of samples per step for a grid of `steps` steps, sufficient to resolve the curve."""
    wanted = max(LEAST_SAMPLES, 2 ** math.ceil(math.log2(_SAMPLES_PER_STEP * steps)))
    return math.ceil(wanted / steps)


def figures(values: Array, at: Callable[[Array], Array], period: float) -> Array:
    """Statistics (…, 7) of quantities, from their values (…, k) at k uniform phases from 0. The last axis
    contains the fields of `Statistics`.

    at: function that returns values (…, j) of the quantities at phases (…, j), which may differ between
    quantities. It is used to find the extrema of the continuous curve between the samples. All statistics are
    NaN if a value is not finite.
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
    """Return `values` (…, k). If one of the k values is not finite, all k are replaced by NaN."""
    return np.where(np.isfinite(values).all(axis=-1, keepdims=True), values, np.nan)


def _extremes(values: Array, at: Callable[[Array], Array], width: float) -> list[tuple[Array, Array]]:
    """Return the phase (…) and the value of the maximum, and the phase and the value of the minimum. The
    value of the minimum has the opposite sign.

    Each extremum is sought near the largest sample (the first if several are equal), and near lower samples
    if the curve may be higher there."""
    reaches = [_reach(sign * values) for sign in _SIGNS.tolist()]
    firsts = [_first(sign * values, reach) for sign, reach in zip(_SIGNS, reaches, strict=True)]
    # One call for maximum and minimum, because twice the phases cost little more.
    centres, highest = _zoomed(np.stack(firsts, axis=-1) * width, at, width, _SIGNS, ZOOMS)
    found = []
    for side, (sign, reach, first) in enumerate(zip(_SIGNS, reaches, firsts, strict=True)):
        np.put_along_axis(reach, first[..., None], -np.inf, axis=-1)
        size = np.abs(values).max(axis=-1)
        found.append(_above(centres[..., side], highest[..., side], reach, at, width, (sign, size)))
    return found


def _first(values: Array, reach: Array) -> Array:
    """Index (…) of the first local maximum of the samples (…, k) that is as high as the highest sample."""
    largest = values.max(axis=-1, keepdims=True)
    return (np.isfinite(reach) & (values >= largest - TIE * np.abs(largest))).argmax(axis=-1)


def _above(
    centre: Array,
    highest: Array,
    reach: Array,
    at: Callable[[Array], Array],
    width: float,
    side: tuple[float, Array],
) -> tuple[Array, Array]:
    """Return the phase (…) and the value of the highest maximum.

    `centre` and `highest` are the phase and the value of the maximum found so far. Samples whose upper bound
    `reach` (…, k) exceeds `highest` are examined; a higher maximum near one of them replaces the maximum
    found so far. side: the sign by which the curve is multiplied, and the largest moduli (…) of the samples.
    """
    sign, size = side
    rivals = int((reach > highest[..., None]).sum(axis=-1).max())
    if not rivals:
        return centre, highest
    candidates = np.argpartition(-reach, rivals - 1, axis=-1)[..., :rivals]
    for some in np.array_split(candidates, math.ceil(rivals / _TOGETHER), axis=-1):
        phase, found = _highest(some * width, at, width, sign, ROUGH)
        if (found > highest + TIE * size).any():
            phase, found = _highest(phase[..., None], at, width, sign, ZOOMS)
            better = found > highest + TIE * size
            centre, highest = np.where(better, phase, centre), np.where(better, found, highest)
    return centre, highest


def _reach(values: Array) -> Array:
    """Upper bounds on the curve near samples (…, k) that are local maxima; -inf for other samples.

    The bound is twice as far above the sample as the maximum of the parabola through the sample and its
    neighbours."""
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
        phase = centres[..., None] + width * ZOOM
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
    values = signal(uniform_phases(samples, period))
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
    """Return the amplitudes and phase angles of `count` harmonics of one quantity, in the form that
    `spectrum` returns. Harmonic k has k cycles per period. Raises ValueOutOfBoundsError for an invalid
    count."""
    enough = enough_samples(samples, count)
    return spectrum(signal(uniform_phases(enough, period)), count)
