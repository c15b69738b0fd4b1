"""Motion of the mechanism, as points that the page draws and interpolates."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from solve.arrays import Array, Plane, uniform_phases
from solve.equations import sketched
from solve.results.formatting import prefixed, round_magnification
from solve.system import PeriodicSystem
from solve.views.animation import VISIBLE
from solve.views.live.picture import Solution
from solve.views.moving_picture import is_closed, is_still, meeting_ends

FRAMES = 36
"""Number of frames over a period, between which the page interpolates. The interpolated path of a rotating
point deviates from its circle by at most 0.4 %."""

COARSE = 0.25
"""Number of points on lines while sliders move, relative to the number of points in animations. Chosen by
judgement: the computing time is reduced to a quarter."""


def motion(
    solution: Solution, scale: float | None, fineness: float = COARSE
) -> tuple[dict[str, Any], bytes] | None:
    """Compute the lines of the mechanism over a period.

    Parameters
    ----------
    solution : Solution
        Present solution.
    scale : float, optional
        Magnification of the vibration; by default, one that makes it visible.
    fineness : float
        Number of points on lines, relative to their number in animations.

    Returns
    -------
    record : dict
        Names, sizes and kinds of the lines, the magnification, and the area that contains all frames.
    points : bytes
        Coordinates as little-endian 32-bit floats: for each line first the rigid motion, then the magnified
        motion, each in the order of frames, points, and x, y. For a model without a sketch, None is returned
        instead of both.
    """
    system, speed = solution.orbit.system, solution.orbit.speed
    if not _has_sketch(system):
        return None
    phase = uniform_phases(FRAMES, solution.span)
    vibration = solution.vibration(phase)
    rigid = _lines(system, phase, speed, 0.0 * vibration, fineness)
    if scale is None:
        scale = _visible_scale(solution, phase, vibration, rigid, fineness)
    moved = _lines(system, phase, speed, scale * vibration, fineness) if system.labels.vibrates else rigid
    return _record(system, rigid, moved, scale), _points(rigid, moved)


def _has_sketch(system: PeriodicSystem) -> bool:
    return bool(system.labels.links) or bool(getattr(getattr(system, "module", None), "SKETCH", ()))


def _lines(
    system: PeriodicSystem, phase: Array, speed: float, q: Array, fineness: float
) -> Mapping[str, Plane]:
    return sketched(system, phase, speed, q, fineness)


def _size(lines: Sequence[Plane]) -> float:
    low, high = _corners(lines)
    return max((high - low).real, (high - low).imag) or 1.0


def _corners(lines: Sequence[Plane]) -> tuple[complex, complex]:
    """Return the lower left and the upper right corner of the bounding box of lines."""
    x, y = (np.concatenate([component(line).ravel() for line in lines]) for component in (np.real, np.imag))
    return complex(x.min(), y.min()), complex(x.max(), y.max())


def _visible_scale(
    solution: Solution, phase: Array, q: Array, rigid: Mapping[str, Plane], fineness: float
) -> float:
    """Return the largest round magnification that does not visibly distort the mechanism, estimated from
    every third frame."""
    if not q.any():
        return 1.0
    some, system, speed = slice(None, None, 3), solution.orbit.system, solution.orbit.speed
    moved = _lines(system, phase[some], speed, q[:, some], fineness)
    largest = max(float(np.abs(moved[name] - points[:, some]).max()) for name, points in rigid.items())
    return float(round_magnification(VISIBLE * _size([*rigid.values()]) / largest)) if largest > 0 else 1.0


def _record(
    system: PeriodicSystem, rigid: Mapping[str, Plane], moved: Mapping[str, Plane], scale: float
) -> dict[str, Any]:
    low, high = _corners([*rigid.values(), *moved.values()])
    size = abs(high - low)
    lines = []
    for name, line in moved.items():
        fixed = is_still(line, size)
        ends = [line[0], line[-1]] if not fixed and not is_closed(line, size) else []
        held = [[end[0].real, end[0].imag] for end in ends if is_still(end[None], size)]
        lines.append({"name": name, "points": len(line), "fixed": fixed, "held": held})
    factor, unit = prefixed(system.labels.sketch_unit, abs(size))
    return {
        "frames": FRAMES,
        "lines": lines,
        "joints": meeting_ends(rigid, moved, size),
        "low": [low.real, low.imag],
        "high": [high.real, high.imag],
        "factor": factor,
        "unit": unit,
        "scale": scale,
    }


def _points(rigid: Mapping[str, Plane], moved: Mapping[str, Plane]) -> bytes:
    pieces = []
    for name, line in rigid.items():
        for points in (line, moved[name]):
            pieces.append(np.stack((np.real(points.T), np.imag(points.T)), axis=-1).ravel())
    return np.concatenate(pieces).astype("<f4").tobytes()
