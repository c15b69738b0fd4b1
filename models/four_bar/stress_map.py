"""The largest stress of each link over a turn, for many speeds and ground links at once (thesis 7.3, 7.4).

At one L4 the matrices over the phase serve all speeds. Between the lengths that are solved the stress at
a place and a crank angle is the polynomial through Chebyshev points of L4: it depends on L4 smoothly,
though its maximum over a turn does not."""

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
"""L-stable: the axial modes are far too fast to be followed."""

_STEPS, _SAMPLES = 96, 4
"""Steps a turn, and crank angles a step at which the stress is looked at."""

_TOGETHER = 8
"""Speeds whose stresses are held in memory together."""

_BARLOW = (0.5 - math.sqrt(1 / 12), 0.5 + math.sqrt(1 / 12))
"""Places of an element where the curvature of a cubic is most accurate; at its ends it is not."""


@dataclass(frozen=True)
class Peaks:
    """Largest |stress| (Pa) over a turn, (P, lengths, links), and where: the place, a fraction of the
    link's length, and the crank angle (rad).

    error (P,): the greater of the relative differences that half the steps, and two Chebyshev points
    fewer, make to the largest stress. radius_bound (P, lengths solved): upper bound of the
    spectral radius.
    """

    stress: Array
    place: Array
    phase: Array
    error: Array
    radius_bound: Array


def places(beams: Beams) -> list[Array]:
    """For each link the fractions of its length where the stress is looked at: where the thesis does, at
    the clamped root or the middle, and at two places within each element."""
    by_link = []
    for member in beams.members:
        link = member.link
        root = [0.0] if link.start_rotation == "" else [1.0] if link.end_rotation == "" else [0.5]
        within = (np.arange(member.count)[:, None] + np.array(_BARLOW)).ravel() / member.count
        by_link.append(np.unique([*root, *within]))
    return by_link


def stress_rows(beams: Beams, angle: Array) -> Array:
    """Rows (k, 2, S, n) that give the axial stress and that of bending at the + surface, in Pa, at the
    places of all links, one after the other, for links at angles (k, links)."""
    rows = []
    for member, fractions in zip(beams.members, places(beams), strict=True):
        turned = member.rotations(angle)
        for fraction in fractions:
            first, xi = member.place(fraction)
            row = np.zeros((len(angle), 2, beams.freedoms.n + 1))
            row[:, :, member.indices[first]] = np.concatenate(member.stresses(np.array([xi]))) @ turned
            rows.append(row[:, :, :-1])
    return np.stack(rows, axis=2)


class StressMap:
    """Stresses of a four-bar over speeds (rad/s) and lengths L4 (m) from `low` to `high`.

    count: Chebyshev points of L4, or 1 where both ends are the same.
    """

    def __init__(self, model: StructureModel, low: float, high: float, count: int = 7):
        order = np.arange(count)
        self.nodes = (low + high) / 2 - (high - low) / 2 * np.cos(np.pi * (order + 0.5) / count)
        if high == low:
            self.nodes = np.array([low])
        self.links = [link.name for link in model.beams.freedoms.links]
        self.places = places(model.beams)
        self._ends = np.cumsum([0, *map(len, self.places)])
        self.lengths = [OneLength(model.varied({"L4": float(L4)})) for L4 in self.nodes]

    def weights(self, L4: Array) -> Array:
        """Values at lengths (g,) from those at the nodes: (g, nodes)."""
        if len(self.nodes) == 1:
            return np.ones((len(L4), 1))
        return BarycentricInterpolator(self.nodes, np.eye(len(self.nodes)), rng=0)(L4)

    def by_link(self, values: Array, function: Callable[[Array], float]) -> Array:
        """A function of the values (S,) at the places of each link: (links,)."""
        return np.array([function(own) for own in np.split(values, self._ends[1:-1])])

    def peaks(self, speeds: Array, L4: Array) -> Peaks:
        """At speeds (P,) and lengths (g,) between the ends."""
        parts = []
        with progress.task("speeds of the stress map", len(speeds)) as count:
            for start in range(0, len(speeds), _TOGETHER):
                some = speeds[start : start + _TOGETHER]
                parts.append(self._peaks(some, L4))
                count.add(len(some))
        return Peaks(*(np.concatenate([getattr(part, name) for part in parts]) for name in _FIELDS))

    def _peaks(self, speeds: Array, L4: Array) -> Peaks:
        solved = [each.stresses(speeds) for each in self.lengths]
        stresses = np.stack([each[0] for each in solved], axis=1)
        weights, shape = self.weights(L4), (len(speeds), len(L4), len(self.links))
        stress, place, phase = np.empty(shape), np.empty(shape), np.empty(shape)
        error = np.max([each[1] for each in solved], axis=0)
        for point, values in enumerate(stresses):
            histories = _surfaces(np.tensordot(weights, values, axes=1))
            for link, fractions in enumerate(self.places):
                own = histories[:, self._ends[link] : self._ends[link + 1]]
                stress[point, :, link], at, phase[point, :, link] = _highest(own)
                place[point, :, link] = fractions[at]
            error[point] = max(error[point], self._tail(values))
        return Peaks(stress, place, phase, error, np.stack([each[2] for each in solved], axis=1))

    def _tail(self, values: Array) -> float:
        """What the last two of the Chebyshev polynomials add at most, relative to the largest stress."""
        count = len(values)
        if count < 3:
            return 0.0
        places = -np.cos(np.pi * (np.arange(count) + 0.5) / count)
        last = np.linalg.inv(np.polynomial.chebyshev.chebvander(places, count - 1))[-2:]
        return float(np.abs(np.tensordot(last, values, axes=1)).sum(axis=0).max() / np.abs(values).max())


_FIELDS = tuple(Peaks.__dataclass_fields__)


class OneLength:
    """Stresses at many speeds of the mechanism with one length L4."""

    def __init__(self, model: StructureModel):
        self.model = model
        self._curves = PeriodicCurves(model, METHOD, _STEPS, _SAMPLES)

    def stresses(self, speeds: Array) -> tuple[Array, Array, Array]:
        """Axial and bending stresses (P, 2, S, k) in Pa, the relative difference (P,) that half the steps
        make, and a bound (P,) of the spectral radius. Infinite where there is no periodic solution."""
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
    """The greater |stress| of both surfaces from axial and bending stress (g, 2, S, k)."""
    return np.abs(stresses).sum(axis=1)


def _highest(histories: Array) -> tuple[Array, Array, Array]:
    """Largest value, row and phase of histories (g, S, k): the vertex of a parabola through three
    neighbours."""
    g, S, k = histories.shape
    at = histories.reshape(g, S * k).argmax(axis=1)
    row, column = np.divmod(at, k)
    every = np.arange(g)
    before, top, after = (histories[every, row, (column + shift) % k] for shift in (-1, 0, 1))
    bend = 2 * top - before - after
    with np.errstate(invalid="ignore", divide="ignore"):
        shift = np.where(bend > 0, (after - before) / (2 * bend), 0.0)
        value = top + np.where(bend > 0, (after - before) ** 2 / (8 * bend), 0.0)
    return np.nan_to_num(value, nan=np.inf), row, (column + shift) * (2 * math.pi / k) % (2 * math.pi)


def spaced(low: float, high: float, ratio: float) -> Sequence[float]:
    """Speeds from low to high, each at most `ratio` times the one before."""
    count = max(2, 1 + math.ceil(math.log(high / low) / math.log(ratio)))
    return [float(x) for x in np.geomspace(low, high, count)]
