"""Bands of speed in which the motion is unstable, with refined edges.

Where fast modes are neither damped out nor can be followed at many speeds, bands of the slow modes alone are
looked for: the axial vibration of an undamped steel link turns by thousands of radians while the crank turns
once, and so do its multipliers over speed. Radau damps out what its steps do not follow and leaves the slow
modes: a multiplier belongs to these where two grids agree on it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from solve.arrays import Array
from solve.batch.batch import POINTS, Batch
from solve.batch.family import over_speed
from solve.batch.gathering import gathered
from solve.batch.task import task_of
from solve.errors import NoResultError
from solve.methods.choice import RESOLVABLE, Rule, auto
from solve.methods.free import free
from solve.methods.radau import Radau
from solve.period.frozen import frozen, residual_amplitude
from solve.period.multipliers import UNIT_CIRCLE
from solve.period.points import OnePoint
from solve.results.bands import Band, Bands
from solve.results.points import KINDS, LEFT_OUT, Kept
from solve.studies.boundaries import Search
from solve.studies.constant import constant, still
from solve.studies.judged import Judge, Judged, judge
from solve.studies.known_speeds import ends_with_matrices, without_result
from solve.studies.tongues import LIGHTLY_DAMPED, Turning, fastest_turning, hidden, parted, rising
from solve.system import PeriodicSystem, of_system
from solve.terminal import progress
from solve.units import ShownUnit, checked_tolerance, speeds_between

GROWTH = 1e-6
"""Growth a turn that makes a band: less is within what two multipliers that meet lose to rounding."""

_FEWEST, _MOST = 40, 2000
"""Parts of the range of speeds before the search for narrow bands."""

_FINER = 5
"""Subdivision of each interval if the matrices are constant: an eigenvalue costs less than a solution."""

_PREDICTED = 0.9
"""Fraction of a gap to which a parabola must predict its minimum; gaps that do not depend on the speed have
minima of round-off."""

_TURN = 0.25
"""Angle in rad by which the fastest multiplier may turn between two speeds."""

_HALVINGS = 3
"""Of the distance of two speeds between which multipliers may meet."""

_POINTS_INSIDE = 15
"""Further points of every band, to find its largest multiplier and stable speeds inside it."""

_SPLITS = 8
_UNKNOWN = -2
"""State of speeds without a result."""

_FOLLOWED = 128.0
"""Angle in rad by which a mode that is followed turns at most in one period, at the lowest speed."""

_STEPS = 192, 256
_AGREEMENT = 1e-4
_SURVIVES = 1e-2
"""Part of a fast mode that is left after a period, above which it counts as not damped out."""


@of_system
def bands(
    system: PeriodicSystem,
    speeds: str | Sequence[float | str] | Array,
    method: str | Rule = "auto",
    rtol: float = 1e-8,
    tolerance: float = 1e-7,
    engine: str = "auto",
) -> Bands:
    """Unstable bands between the lowest and the highest of the speeds (rad/s, texts with unit, or one text
    such as "100:900:81 rpm").

    Speeds are added until there are at least 40 intervals and no multiplier above 0.01 rotates by more than
    0.25 rad from one speed to the next, with a limit of about 2000. Bands narrower than the result's
    `spacing` are searched where multipliers come closest to each other, to +1 and to -1. They may still be
    missed, as may a stable range narrower than a sixteenth of the unstable range around it. Growth below 1e-6
    per period does not make a band. If M, C and K are constant over the period, eigenvalues decide on a grid
    of at least five times 40 intervals. If lightly damped modes rotate too far within a period to be tracked
    at many speeds, `auto` searches only the bands of the slower ones, with a note. Edges are found to the
    relative `tolerance`. engine: as in `sweep`. Raises ValueOutOfBoundsError for fewer than two speeds, and
    SolveError subclasses for errors that affect all speeds.
    """
    given = speeds_between(speeds, "bands")
    system, omegas = system.shown_in(given[0]), np.array(given)
    ends = ends_with_matrices(system, omegas)
    task, notes = task_of(over_speed(system), method, rtol, engine, orbit=False)
    if free(OnePoint(system, ends[0])) is not None:
        notes = [*notes, f"rigid-body modes: {LEFT_OUT}"]
    coarse = _divided(omegas, np.diff(omegas) / (omegas[-1] - omegas[0]) * _FEWEST)
    steady = constant(task.batch(coarse[:, None]))
    fast = 0 if steady else _unfollowed(system, ends[0], task.method)
    if fast:
        left_out = (
            f"{fast} of {system.n} modes turn by more than {_FOLLOWED:g} rad a turn and are not damped out: "
            "their bands, of high order, are not looked for; a single solution follows all modes"
        )
        task, notes = replace(task, method=Radau()), [*notes, left_out]
    if steady:
        turning, points = still, _divided(coarse, np.full(len(coarse) - 1, _FINER))[:, None]
    else:
        turning = fastest_turning(system, ends, _FOLLOWED if fast else np.inf)
        turned = -np.diff(1 / coarse) * turning(coarse[1:])
        points = _divided(coarse, turned / max(_TURN, turned.sum() / _MOST))[:, None]
    batch = task.batch(points)
    asked = steady.judge if steady else (_judge_of_followed if fast else judge)(batch)
    with progress.steps(4) as step:
        step("all speeds")
        known = asked(points)
        step("speeds where multipliers are near each other")
        known = parted(asked, _closer(asked, known, turning), turning)
        middle = np.arange(1, len(known.points) - 1)
        spacing = float(np.diff(known.points[:, 0]).max())
        step("narrow bands")
        known += hidden(asked, known, middle, predicted=_PREDICTED if steady else 1.0)
        if known.failed.any():
            notes = [*notes, _left_out(batch, rising(known), system.speed_unit)]
        step("edges of bands")
        runs = _Runs(asked, checked_tolerance(tolerance), omegas[-1:])
        found = runs.bands(rising(known))
    known = rising(sum(runs.looked, known))
    radius = np.where(known.failed, np.nan, np.abs(known.multipliers[:, 0]))
    range_ = float(omegas[0]), float(omegas[-1])
    speeds = known.points[:, 0]
    return Bands(found, system, range_, spacing, notes, speeds, radius, steady is not None)


def _left_out(batch: Batch, known: Judged, unit: ShownUnit) -> str:
    """Which of rising speeds have no result, and why the first has none. Raises NoResultError where none has
    one."""
    failures = gathered(batch, known.points[known.failed][:1], Kept(warnings=False)).failures
    reason = "multipliers are within their error of the unit circle; ask for a smaller rtol"
    failed = without_result(known.points[:, 0], known.failed, unit, failures.get(0, reason))
    if known.failed.all():
        raise NoResultError(failed)
    return f"{failed}; bands end open beside them"


def _divided(speeds: Array, parts: Array) -> Array:
    """Rising speeds with each of their intervals divided into this many parts, or one more."""
    counts = np.maximum(np.ceil(parts * (1 - 1e-9)), 1).astype(int)
    at = np.concatenate([[0], np.cumsum(counts)])
    return np.interp(np.arange(at[-1] + 1), at, speeds)


def _closer(asked: Judge, known: Judged, turning: Turning) -> Judged:
    """Speeds added where two multipliers are nearer to each other than they turn from one to the next:
    several that meet one soon after another then have a minimum of distance each."""
    for _ in range(_HALVINGS):
        speeds, distance = known.points[:, 0], _distance(known.multipliers)
        turned = -np.diff(1 / speeds) * turning(speeds[1:])
        near = np.minimum(distance[:-1], distance[1:]) < 2 * turned
        if not near.any():
            break
        known = rising(known + asked(((speeds[:-1] + speeds[1:]) / 2)[near, None]))
    return known


def _distance(multipliers: Array) -> Array:
    """Least difference of angle (k,) among multipliers (k, N) above the real axis."""
    rotating = (np.imag(multipliers) > 0) & (np.abs(multipliers) > LIGHTLY_DAMPED)
    apart = 1e3 * (1 + np.arange(multipliers.shape[1]))
    angles = np.sort(np.where(rotating, np.angle(multipliers), apart), axis=1)
    return np.diff(angles, axis=1).min(axis=1)


@dataclass(frozen=True)
class _Runs:
    """Runs of unstable speeds of one kind among known ones, rising. highest (1,): of the speeds; what is
    found between two speeds is kept for when other runs are split; looked: the points inside."""

    judge: Judge
    tolerance: float
    highest: Array
    _between: "dict[tuple[float, float], tuple[float, bool]]" = field(default_factory=dict)
    _within: "dict[tuple[float, float], float]" = field(default_factory=dict)
    looked: "list[Judged]" = field(default_factory=list)

    def bands(self, known: Judged) -> list[Band]:
        """The runs with their edges, split where points inside are stable or of another kind."""
        found: list[Band] = []
        for _ in range(_SPLITS):
            found, inside = self._looked_into(known)
            if len(inside.points) == 0:
                break
            known = rising(known + inside)
        return found

    def _looked_into(self, known: Judged) -> tuple[list[Band], Judged]:
        """The bands, and all further points of those that are not of one kind throughout."""
        state = _state(known)
        changes = np.flatnonzero(np.diff(state))
        speeds = known.points[:, 0]
        between, unknown = self._kept_borders(known, changes, state)
        borders = np.concatenate((speeds[:1], between, speeds[-1:]))
        unknown = np.concatenate(([True], unknown, [True]))
        starts, ends = np.append(0, changes + 1), np.append(changes, len(state) - 1)
        runs = np.flatnonzero(state[starts] >= 0)
        low, high = borders[runs], borders[runs + 1]
        nothing = known[runs[:0]], np.zeros(0, dtype=bool)
        within = list(zip(low.tolist(), high.tolist(), strict=True))
        new = np.array([edges not in self._within for edges in within], dtype=bool)
        looked, mixed = self._inside(low[new], high[new], state[starts[runs[new]]]) if new.any() else nothing
        found, growing = [], np.zeros(len(runs), dtype=bool)
        for at, run in enumerate(runs):
            first, last = starts[run], ends[run]
            radius = max(self._within[within[at]], np.abs(known.multipliers[first : last + 1, 0]).max())
            growing[at] = radius > 1 + GROWTH
            if growing[at]:
                open_ends = bool(unknown[run]), bool(unknown[run + 1])
                found.append(Band(*within[at], KINDS[state[first]], float(radius), *open_ends))
        return found, looked[np.flatnonzero(np.repeat(mixed & growing[new], _POINTS_INSIDE))]

    def _inside(self, low: Array, high: Array, states: Array) -> tuple[Judged, Array]:
        """Further points of runs of these states between their ends (k,), and which of the runs are mixed."""
        parts = (np.arange(_POINTS_INSIDE) + 1) / (_POINTS_INSIDE + 1)
        looked = self.judge((low[:, None] + parts * (high - low)[:, None]).reshape(-1, 1))
        self.looked.append(looked)
        radii = np.abs(looked.multipliers[:, 0]).reshape(-1, _POINTS_INSIDE).max(axis=1, initial=0.0)
        self._within.update(zip(zip(low.tolist(), high.tolist(), strict=True), radii.tolist(), strict=True))
        return looked, (_state(looked).reshape(-1, _POINTS_INSIDE) != states[:, None]).any(axis=1)

    def _kept_borders(self, known: Judged, changes: Array, state: Array) -> tuple[Array, Array]:
        """`_borders`, solving those that were not met before."""
        speeds = known.points[:, 0].tolist()
        ends = [(speeds[at], speeds[at + 1]) for at in changes.tolist()]
        new = changes[np.array([pair not in self._between for pair in ends], dtype=bool)]
        borders = zip(*(part.tolist() for part in self._borders(known, new, state)), strict=True)
        self._between.update(zip(((speeds[at], speeds[at + 1]) for at in new), borders, strict=True))
        kept = np.array([self._between[pair] for pair in ends]).reshape(-1, 2)
        return kept[:, 0], kept[:, 1].astype(bool)

    def _borders(self, known: Judged, changes: Array, state: Array) -> tuple[Array, Array]:
        """Speeds between known ones at which the state changes (k,), and whether there a speed without a
        result stands in the way (k,): the border is then the last that is known to be unstable."""
        low, high = known[changes], known[changes + 1]
        borders = np.empty(len(changes))
        search = Search(self.judge, self.highest, self.tolerance)
        loses, wins = state[changes] < 0, state[changes + 1] < 0
        kind_only = ~(loses | wins)
        stable, unstable = (known[changes + (loses != side)] for side in (True, False))
        unknown = (state[changes] == _UNKNOWN) | (state[changes + 1] == _UNKNOWN)
        borders[unknown] = unstable.points[unknown, 0]
        crossed = ~(kind_only | unknown)
        places, _ = search.edges(stable[crossed], unstable[crossed])
        borders[crossed] = np.where(np.isnan(places), unstable.points[crossed], places)[:, 0]
        unknown[crossed] = np.isnan(places[:, 0])
        if kind_only.any():
            kinds = state[changes][kind_only]

            def differs(found: Judged, lines: Array) -> Array:
                return ~found.unstable | (found.kinds != kinds[lines])

            ends = search.sectioned(differs, low[kind_only], high[kind_only])[:2]
            borders[kind_only] = (ends[0].points + ends[1].points)[:, 0] / 2
        return borders, unknown


def _state(known: Judged) -> Array:
    """Positions in KINDS (k,), -1 where stable, _UNKNOWN where nothing is known."""
    return np.where(known.unstable, known.kinds, np.where(known.failed, _UNKNOWN, -1))


def _unfollowed(system: PeriodicSystem, speed: float, method: Rule) -> int:
    """How many modes are too fast to be followed from this speed on: 0 where all can be followed, where the
    fast ones are damped out within a turn, where a method is named, and where no mode would be left."""
    values = frozen(OnePoint(system, speed)).eigenvalues()[0]
    reach = np.abs(values).max(axis=0) * system.period
    fast = int((np.sort(reach)[::2] > _FOLLOWED).sum())
    survives = float(residual_amplitude(values, system.period, RESOLVABLE)) > _SURVIVES
    needed = method is auto and reach.max() > RESOLVABLE and survives
    return fast if needed and fast < system.n else 0


def _judge_of_followed(batch: Batch) -> Judge:
    """The judge of the modes that are followed, by the batch's method, Radau. Unstable: a multiplier on which
    both grids agree is outside the unit circle by more than their difference."""

    def on_grid(points: Array, steps: int) -> Array:
        with progress.subtask(POINTS, len(points) / len(_STEPS)):
            return batch.multipliers(points, steps)

    def judged(points: Array) -> Judged:
        with progress.subtask(POINTS, len(points)), progress.task(POINTS, len(points)):
            coarse, fine = (on_grid(points, steps) for steps in _STEPS)
        error = np.abs(fine[:, :, None] - coarse[:, None, :]).min(axis=2)
        agreed = (error < _AGREEMENT) & (fine != 0)
        beyond = (agreed & (np.abs(fine) - 1 > np.maximum(error, UNIT_CIRCLE))).any(axis=1)
        known = agreed.any(axis=1)
        kept = np.where(agreed, fine, 0.0)
        order = np.argsort(-np.abs(kept), axis=1, kind="stable")
        return Judged(points, known & ~beyond, known & beyond, np.take_along_axis(kept, order, axis=1))

    return judged
