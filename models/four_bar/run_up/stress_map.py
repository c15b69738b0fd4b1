"""The largest stress of each link over a turn, for many speeds and ground links at once (thesis 7.3, 7.4).

At one L4 the matrices over the phase serve all speeds. Between the lengths that are solved the stress at
a place and a crank angle is the polynomial through Chebyshev points of L4: it depends on L4 smoothly,
though its maximum over a turn does not.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import BarycentricInterpolator

from solve.arrays import Array
from solve.batch.engines import chosen_engine
from solve.batch.family import Speeds
from solve.batch.level import GridTables, Level
from solve.batch.tables import Chunk, Sampled, Separated, Separation
from solve.beams.assembly import rotations
from solve.beams.beams import Beams
from solve.beams.model import StructureModel
from solve.methods.radau import Radau
from solve.period.grid import Grid

METHOD = Radau(order=9)
"""L-stable: the axial modes are far too fast to be followed."""

_STEPS = 48
"""Steps a turn of the coarser of two grids; the finer one has twice as many and gives the result."""

_SAMPLES = 4
"""Crank angles a step of the finer grid at which the stress is looked at."""

_TOGETHER = 8
"""Speeds whose stresses are held in memory together."""

_BARLOW = (0.5 - math.sqrt(1 / 12), 0.5 + math.sqrt(1 / 12))
"""Places of an element where the curvature of a cubic is most accurate; at its ends it is not."""


@dataclass(frozen=True)
class Peaks:
    """Largest |stress| (Pa) over a turn, (P, lengths, links), and where: the place, a fraction of the
    link's length, and the crank angle (rad).

    error (P,): the greater of the relative differences that half the steps, and two Chebyshev points
    fewer, make to the largest stress. growth (P, lengths solved): a bound of the spectral radius.
    """

    stress: Array
    place: Array
    phase: Array
    error: Array
    growth: Array


def places(beams: Beams) -> list[Array]:
    """For each link the fractions of its length where the stress is looked at: where the thesis does, at
    the clamped root or the middle, and at two places within each element."""
    found = []
    for link, count in zip(beams.freedoms.links, beams.freedoms.counts, strict=True):
        root = [0.0] if link.start_rotation == "" else [1.0] if link.end_rotation == "" else [0.5]
        within = (np.arange(count)[:, None] + np.array(_BARLOW)).ravel() / count
        found.append(np.unique([*root, *within]))
    return found


def stress_rows(beams: Beams, angle: Array) -> Array:
    """Rows (k, 2, S, n) that give the axial stress and that of bending at the + surface, in Pa, at the
    places of all links, one after the other, for links at angles (k, links)."""
    freedoms, rows = beams.freedoms, []
    for number, fractions in enumerate(places(beams)):
        member, element = beams.members[number], freedoms.elements[number]
        turned = rotations(freedoms, number, angle[:, number])
        E, half = beams.properties.E[number], beams.properties.height[number] / 2
        for fraction in fractions:
            first = min(int(fraction * member.count), member.count - 1)
            elongation, curvature = element.strains(member.L, np.array([fraction * member.count - first]))
            local = np.concatenate((E * elongation, -E * half * curvature)) @ turned
            row = np.zeros((len(angle), 2, freedoms.n + 1))
            row[:, :, freedoms.indices[number][first]] = local
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
        self.lines = [Line(model.varied({"L4": float(L4)})) for L4 in self.nodes]

    def weights(self, L4: Array) -> Array:
        """Values at lengths (g,) from those at the nodes: (g, nodes)."""
        if len(self.nodes) == 1:
            return np.ones((len(L4), 1))
        return BarycentricInterpolator(self.nodes, np.eye(len(self.nodes)))(L4)

    def by_link(self, values: Array, function: Callable[[Array], float]) -> Array:
        """A function of the values (S,) at the places of each link: (links,)."""
        return np.array([function(own) for own in np.split(values, self._ends[1:-1])])

    def peaks(self, speeds: Array, L4: Array, progress: Callable[[int], None] | None = None) -> Peaks:
        """At every speed (P,) and every length (g,) between the ends; progress is told the speeds done."""
        parts = []
        for start in range(0, len(speeds), _TOGETHER):
            parts.append(self._peaks(speeds[start : start + _TOGETHER], L4))
            if progress:
                progress(min(start + _TOGETHER, len(speeds)))
        return Peaks(*(np.concatenate([getattr(part, name) for part in parts]) for name in _FIELDS))

    def _peaks(self, speeds: Array, L4: Array) -> Peaks:
        solved = [line.stresses(speeds) for line in self.lines]
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


class Line:
    """One length L4: stresses at many speeds."""

    def __init__(self, model: StructureModel):
        self.model = model
        self._engine, _ = chosen_engine("auto")

    def stresses(self, speeds: Array) -> tuple[Array, Array, Array]:
        """Axial and bending stresses (P, 2, S, k) in Pa at the crank angles `phase`, the relative
        difference (P,) that half the steps make, and a bound (P,) of the spectral radius. Infinite
        where there is no periodic solution."""
        coarse, fine = (self._level(steps, speeds) for steps in (_STEPS, 2 * _STEPS))
        q = [
            np.where(level.sound[:, None, None], _sampled(level, a_step), np.inf)
            for level, a_step in ((coarse, 2 * _SAMPLES), (fine, _SAMPLES))
        ]
        with np.errstate(invalid="ignore"):
            first, second = (np.einsum("kasn,pnk->pask", self._rows, each, optimize=True) for each in q)
            largest = np.abs(second).max(axis=(1, 2, 3))
            error = np.abs(second - first).max(axis=(1, 2, 3)) / largest
        return second, error, _growth(fine.Phi)

    @cached_property
    def phase(self) -> Array:
        """Crank angles (k,) of the stresses."""
        count = 2 * _STEPS * _SAMPLES
        return np.arange(count) * (self.model.period / count)

    @cached_property
    def _rows(self) -> Array:
        return stress_rows(self.model.beams, self.model.beams.angle(self.phase))

    @cached_property
    def _family(self) -> Speeds:
        return Speeds(self.model)

    @cached_property
    def _separation(self) -> Separation:
        speeds = np.array([1.0, 3.0, 9.0, 27.0, 81.0, 243.0])
        return Separation(self._family, speeds[:, None], self.model.period, self.model.n)

    def _level(self, steps: int, speeds: Array) -> Level:
        grid, collocation = Grid.uniform(steps, self.model.period), METHOD.collocation
        phase = grid.stages(np.array(collocation.c)).ravel()
        tables, coefficients = self._chunk(speeds).tables(steps, phase, np.arange(len(speeds)))
        return self._engine.level(
            GridTables(collocation, steps, self.model.period, tables, None), coefficients, True
        )

    def _chunk(self, speeds: Array) -> Chunk:
        points, separation = speeds[:, None], self._separation
        if separation.separable:
            coefficients, represented = separation.coefficients(points)
            if represented.all():
                return Separated(separation, points, coefficients)
        return Sampled(self._family, points, self.model.n, self.model.period)


def _sampled(level: Level, a_step: int) -> Array:
    assert level.curves is not None
    return level.curves.sampled(a_step)


def _growth(Phi: Array, doublings: int = 6) -> Array:
    """A bound of the spectral radius of matrices (P, N, N): the norm of a high power, its root."""
    power, scale = Phi, np.zeros(len(Phi))
    for _ in range(doublings):
        power = power @ power
        size = np.linalg.norm(power, axis=(1, 2))
        size = np.where(size > 0, size, 1.0)
        power, scale = power / size[:, None, None], 2 * scale + np.log(size)
    return np.exp(scale / 2**doublings)


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
