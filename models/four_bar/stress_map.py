"""Largest stress of each link over a revolution, for many speeds and ground lengths L4 (sections 7.3 and 7.4
of the thesis).

For each L4, all speeds share the matrices as functions of the phase. The problem is solved for lengths L4 at
Chebyshev points. Between these points, the stress at each position and crank angle, which is a smooth
function of L4, is interpolated by a polynomial. The maximum over a revolution is not a smooth function of L4.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import BarycentricInterpolator

from solve import PeriodicCurves, Radau
from solve.arrays import Array
from solve.beams.assembly import Beams
from solve.beams.structure import StructureModel
from solve.terminal import progress

METHOD = Radau(order=9)
"""Method by which the map is computed. It must be L-stable, because the steps do not resolve the axial
modes."""

_STEPS, _SAMPLES = 96, 4
"""Number of steps per revolution, and number of crank angles per step at which the stress is evaluated.

Chosen by judgement; `Peaks.error` measures their effect.
"""

_TOGETHER = 8
"""Number of speeds whose stresses are in memory at the same time. Chosen by judgement."""

_BARLOW = (0.5 - math.sqrt(1 / 12), 0.5 + math.sqrt(1 / 12))
"""Barlow points of a cubic element, at which its curvature is most accurate. These are the Gauss points of
order 2."""


@dataclass(frozen=True)
class Peaks:
    """Largest |stress| (P, lengths, links), in Pa, over a revolution at P speeds.

    `place` is the position of the largest stress as a fraction of the link's length, and `phase` its crank
    angle (rad). `error` (P,) is the relative change of the largest stress: the larger of the changes with
    half as many steps and with two Chebyshev points fewer. `radius_bound` (P, solved lengths) is an upper
    bound on the spectral radius.
    """

    stress: Array
    place: Array
    phase: Array
    error: Array
    radius_bound: Array


def stress_positions(beams: Beams) -> list[Array]:
    """Return the positions on each link, as fractions of its length, at which stresses are evaluated.

    One position is that of the thesis: the root of a clamped link, otherwise the midpoint. There are two more
    positions within each element.
    """
    by_link = []
    for member in beams.members:
        link = member.link
        root = [0.0] if link.start_rotation == "" else [1.0] if link.end_rotation == "" else [0.5]
        within = (np.arange(member.count)[:, None] + np.array(_BARLOW)).ravel() / member.count
        by_link.append(np.unique([*root, *within]))
    return by_link


def stress_rows(beams: Beams, angle: Array) -> Array:
    """Return the axial stress, and the bending stress at the + surface, in Pa per unit of each coordinate, as
    an array (k, 2, S, n).

    S is the number of positions on all links, which are in sequence. `angle` (k, links) are the angles of the
    links.
    """
    rows = []
    for member, fractions in zip(beams.members, stress_positions(beams), strict=True):
        turned = member.rotations(angle)
        for fraction in fractions:
            first, xi = member.place(fraction)
            row = np.zeros((len(angle), 2, beams.freedoms.n + 1))
            row[:, :, member.indices[first]] = np.concatenate(member.stresses(np.array([xi]))) @ turned
            rows.append(row[:, :, :-1])
    return np.stack(rows, axis=2)


class StressMap:
    """Stresses of a four-bar linkage as functions of the speed (rad/s) and of the length L4 (m) from `low` to
    `high`.

    `count` is the number of Chebyshev points of L4, or 1 if both ends are equal.
    """

    def __init__(self, model: StructureModel, low: float, high: float, count: int = 7):
        order = np.arange(count)
        self.nodes = (low + high) / 2 - (high - low) / 2 * np.cos(np.pi * (order + 0.5) / count)
        if high == low:
            self.nodes = np.array([low])
        self.links = [link.name for link in model.beams.freedoms.links]
        self.positions = stress_positions(model.beams)
        self._ends = np.cumsum([0, *map(len, self.positions)])
        self.lengths = [StressesAtLength(model.varied({"L4": float(L4)})) for L4 in self.nodes]

    def weights(self, L4: Array) -> Array:
        """Return the weights (g, nodes) of the interpolation nodes for lengths L4 (g,)."""
        if len(self.nodes) == 1:
            return np.ones((len(L4), 1))
        return BarycentricInterpolator(self.nodes, np.eye(len(self.nodes)), rng=0)(L4)

    def by_link(self, values: Array, function: Callable[[Array], float]) -> Array:
        """Return values (links,) of a function that is applied to those of the values (S,) that belong to
        each link."""
        return np.array([function(of_link) for of_link in np.split(values, self._ends[1:-1])])

    def peaks(self, speeds: Array, L4: Array) -> Peaks:
        """Compute the largest stresses at speeds (P,), for lengths L4 (g,) between `low` and `high`."""
        batches = []
        with progress.task("speeds of the stress map", len(speeds)) as count:
            for start in range(0, len(speeds), _TOGETHER):
                batch = speeds[start : start + _TOGETHER]
                batches.append(self._peaks(batch, L4))
                count.add(len(batch))
        return Peaks(*(np.concatenate([getattr(batch, name) for batch in batches]) for name in _FIELDS))

    def _peaks(self, speeds: Array, L4: Array) -> Peaks:
        solved = [length.stresses(speeds) for length in self.lengths]
        stresses = np.stack([stress for stress, _, _ in solved], axis=1)
        weights, shape = self.weights(L4), (len(speeds), len(L4), len(self.links))
        stress, place, phase = np.empty(shape), np.empty(shape), np.empty(shape)
        error = np.max([error for _, error, _ in solved], axis=0)
        for point, values in enumerate(stresses):
            histories = _surfaces(np.tensordot(weights, values, axes=1))
            for link, fractions in enumerate(self.positions):
                of_link = histories[:, self._ends[link] : self._ends[link + 1]]
                stress[point, :, link], row, phase[point, :, link] = _highest(of_link)
                place[point, :, link] = fractions[row]
            error[point] = max(error[point], self._tail(values))
        return Peaks(stress, place, phase, error, np.stack([bound for _, _, bound in solved], axis=1))

    def _tail(self, values: Array) -> float:
        """Return the largest coefficient of the last two Chebyshev polynomials, relative to the largest
        stress."""
        count = len(values)
        if count < 3:
            return 0.0
        nodes = -np.cos(np.pi * (np.arange(count) + 0.5) / count)
        last = np.linalg.inv(np.polynomial.chebyshev.chebvander(nodes, count - 1))[-2:]
        return float(np.abs(np.tensordot(last, values, axes=1)).sum(axis=0).max() / np.abs(values).max())


_FIELDS = tuple(Peaks.__dataclass_fields__)


class StressesAtLength:
    """Stresses of the mechanism at many speeds, for a single value of L4."""

    def __init__(self, model: StructureModel):
        self.model = model
        self._curves = PeriodicCurves(model, METHOD, _STEPS, _SAMPLES)

    def stresses(self, speeds: Array) -> tuple[Array, Array, Array]:
        """Compute the axial and bending stresses (P, 2, S, k) in Pa, their relative error (P,), and an upper
        bound (P,) on the spectral radius.

        The error is the relative change with half as many steps. Values are infinite at speeds without a
        periodic solution.
        """
        curves = self._curves(speeds)
        with np.errstate(invalid="ignore"):
            coarse, fine = (
                np.einsum("kasn,pnk->pask", self._rows, q, optimize=True) for q in (curves.coarse, curves.q)
            )
            largest = np.abs(fine).max(axis=(1, 2, 3))
            error = np.abs(fine - coarse).max(axis=(1, 2, 3)) / largest
        return fine, error, curves.radius_bound

    @cached_property
    def _rows(self) -> Array:
        return stress_rows(self.model.beams, self.model.beams.angle(self._curves.phase))


def _surfaces(stresses: Array) -> Array:
    """Return the larger |stress| of the two surfaces, from axial and bending stresses (g, 2, S, k)."""
    return np.abs(stresses).sum(axis=1)


def _highest(histories: Array) -> tuple[Array, Array, Array]:
    """Return the largest value of `histories` (g, S, k), with its row and its phase, from a parabola through
    three neighbouring samples."""
    g, S, k = histories.shape
    at = histories.reshape(g, S * k).argmax(axis=1)
    row, column = np.divmod(at, k)
    before, top, after = (histories[np.arange(g), row, (column + shift) % k] for shift in (-1, 0, 1))
    bend = 2 * top - before - after
    with np.errstate(invalid="ignore", divide="ignore"):
        shift = np.where(bend > 0, (after - before) / (2 * bend), 0.0)
        value = top + np.where(bend > 0, (after - before) ** 2 / (8 * bend), 0.0)
    return np.nan_to_num(value, nan=np.inf), row, (column + shift) * (2 * math.pi / k) % (2 * math.pi)


def spaced(low: float, high: float, ratio: float) -> Sequence[float]:
    """Return speeds from `low` to `high` in geometric progression, with a ratio of at most `ratio`."""
    count = max(2, 1 + math.ceil(math.log(high / low) / math.log(ratio)))
    return [float(x) for x in np.geomspace(low, high, count)]
