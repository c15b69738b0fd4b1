"""Extrema, mean and root mean square of many points' coordinates and outputs over one turn."""

import math
from collections.abc import Callable

import numpy as np

from solve.arrays import Array
from solve.batch.curves import Curves
from solve.batch.family import Family
from solve.signal import Statistics

FIGURES = tuple(Statistics.__dataclass_fields__)

_LEAST_SAMPLES = 2048
_SAMPLES_PER_STEP = 4
_ZOOMS = 6
_ZOOM = np.linspace(-1.0, 1.0, 33)
"""As a single solve refines its extrema."""


def coordinate_figures(curves: Curves) -> Array:
    """(P, n, 7): the fields of `Statistics` of every coordinate."""
    return _figures(curves.sampled(_a_step(curves)), curves.at, curves.period)


def output_figures(family: Family, points: Array, speeds: Array, curves: Curves) -> Array:
    """(P, o, 7): the same of every output."""
    samples = _a_step(curves) * curves.steps
    phase = np.broadcast_to(np.arange(samples) * (curves.period / samples), (len(points), samples))
    by_time = [np.ones((len(points), 1, 1)), speeds[:, None, None], speeds[:, None, None] ** 2]
    states = (curves.sampled(_a_step(curves), order) * by_time[order] for order in range(3))
    values = family.outputs(phase, points, *states)
    n, o = curves.coefficients.shape[1], values.shape[1]

    def at(phase: Array) -> Array:
        """Each output at phases of its own (P, o, k): (P, o, k)."""
        P, _, k = phase.shape
        every = phase.reshape(P, 1, o * k)
        states = (curves.at(np.repeat(every, n, axis=1), order) * by_time[order] for order in range(3))
        found = family.outputs(every[:, 0], points, *states).reshape(P, o, o, k)
        return found[:, np.arange(o), np.arange(o)]

    return _figures(values, at, curves.period)


def _a_step(curves: Curves) -> int:
    """Samples a step that resolve the curve."""
    wanted = max(_LEAST_SAMPLES, 2 ** math.ceil(math.log2(_SAMPLES_PER_STEP * curves.steps)))
    return math.ceil(wanted / curves.steps)


def _figures(values: Array, at: Callable[[Array], Array], period: float) -> Array:
    width = period / values.shape[2]
    high_at, high = _refined(at, values.argmax(axis=2) * width, width)
    low_at, low = _refined(lambda phase: -at(phase), values.argmin(axis=2) * width, width)
    mean, rms = values.mean(axis=2), np.sqrt(np.mean(values**2, axis=2))
    found = {
        "max": high,
        "min": -low,
        "max_abs": np.maximum(high, low),
        "mean": mean,
        "max_phase": high_at % period,
        "min_phase": low_at % period,
        "rms": rms,
    }
    return np.stack([found[name] for name in FIGURES], axis=-1)


def _refined(at: Callable[[Array], Array], centre: Array, width: float) -> tuple[Array, Array]:
    """Phases and values (P, o) of the largest maxima within `width` of the centres (P, o)."""
    highest = np.full_like(centre, -np.inf)
    for _ in range(_ZOOMS):
        phase = centre[..., None] + width * _ZOOM
        values = at(phase)
        best = values.argmax(axis=2)[..., None]
        centre, highest = (np.take_along_axis(part, best, axis=2)[..., 0] for part in (phase, values))
        width /= 16
    return centre, highest
