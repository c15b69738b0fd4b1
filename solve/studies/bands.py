"""Unstable bands: ranges of speed in which the motion is unstable, with refined edges.

Fast modes that are not damped out cannot be resolved at many speeds. The axial vibration of an undamped steel
link has a phase advance of thousands of radians per revolution of the crank. Over the range of speeds, the
angles of its multipliers change by a similar amount. For such systems, only the bands of slow modes are
searched for. Radau's method damps out unresolved modes and preserves slow modes. A multiplier on which two
grids agree belongs to a slow mode.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from solve.arguments import checked_tolerance
from solve.arrays import SPLIT, Array
from solve.batch.batch import POINTS, Batch
from solve.batch.family import over_speed
from solve.batch.gathering import gathered
from solve.batch.task import task_of
from solve.errors import NoResultError, counted
from solve.methods.choice import RESOLVABLE, Rule, auto
from solve.methods.free import free
from solve.methods.radau import Radau
from solve.period.frozen import frozen
from solve.period.multipliers import UNIT_CIRCLE
from solve.period.pencils import residual_amplitude
from solve.period.points import SinglePoint
from solve.results.bands import Band, Bands
from solve.results.points import KINDS, LEFT_OUT, Kept
from solve.studies.boundaries import BoundarySearch, Brackets
from solve.studies.constant_coefficients import constant_coefficients
from solve.studies.speed_grids import (
    DAMPED_OUT,
    INTERVALS,
    LIGHTLY_DAMPED,
    Rotation,
    by_speed,
    ends_with_matrices,
    multiplier_rotation,
    no_rotation,
    separate_crossings,
    without_result,
)
from solve.studies.stability_samples import Evaluate, StabilitySamples, evaluator
from solve.studies.tongues import find_narrow_tongues, near_ends
from solve.system import PeriodicSystem, of_system, shown_in
from solve.terminal import progress
from solve.units import ShownUnit, speeds_between

_MAX_INTERVALS = 2000
"""Maximum number of intervals into which the range of speeds is divided before the search for narrow bands.
Chosen by judgement."""

_FINER = 5
"""Number of parts into which each interval is divided if the matrices are constant. Stability then follows
from eigenvalues, which cost less than a solution. Chosen by judgement."""

_PREDICTED = 0.9
"""A minimum of the distance from instability is searched for only if a parabola predicts a value below this
fraction of the smallest computed distance. If the distance does not depend on the speed, its minima are
round-off. Chosen by judgement."""

_MAX_ANGLE = 0.25
"""Largest permitted rotation, in rad, of the fastest multiplier from one speed to the next. Chosen by
judgement."""

_HALVINGS = 3
"""Maximum number of times that an interval in which multipliers may coalesce is halved. Chosen by
judgement."""

_POINTS_INSIDE = 15
"""Number of additional speeds evaluated inside every band to find the largest multiplier and any stable
speeds. Chosen by judgement."""

_MAX_SPLITS = 8
"""Maximum number of rounds in which bands are split at stable speeds inside the bands. Chosen by
judgement."""

_UNKNOWN = -2
"""State assigned to speeds without a result."""

_MAX_PHASE_ADVANCE = 128.0
"""Phase advance per period in rad, at the lowest speed, up to which a mode counts as slow: half a radian per
step of the finer grid."""

_STEPS, _AGREEMENT = (192, 256), 1e-4
"""Numbers of steps of the two grids on which slow modes are solved; and the difference between the two grids'
values of a multiplier below which the multiplier counts as resolved. Chosen by judgement."""


@of_system
def bands(
    system: PeriodicSystem,
    speeds: str | Sequence[float | str] | Array,
    method: str | Rule = "auto",
    rtol: float = 1e-8,
    tolerance: float = 1e-7,
    engine: str = "auto",
) -> Bands:
    """Find the bands of speed in which the motion is unstable.

    Parameters
    ----------
    system : PeriodicSystem
        System to solve.
    speeds : str or sequence of float or str
        Speeds in rad/s, strings with a unit, or one string such as "100:900:81 rpm". Bands are searched
        between the lowest and the highest of them.
    method : str or Method
        Method, as in `periodic`.
    rtol : float
        Relative tolerance of the multipliers.
    tolerance : float
        Relative tolerance of the edges of the bands.
    engine : str
        "auto", "compiled" or "numpy".

    Returns
    -------
    Bands
        Unstable bands in ascending order.

    Raises
    ------
    ValueOutOfBoundsError
        For fewer than two speeds.
    SolveError
        A subclass for errors that affect all speeds.

    Notes
    -----
    Speeds are added, up to about 2000, until there are at least 40 intervals and no multiplier of modulus
    above 0.01 rotates by more than 0.25 rad from one speed to the next. Bands narrower than the intervals are
    searched for where two multipliers come closest to each other, and where a multiplier comes closest to +1
    or to -1. Narrow bands may still be missed, as may a stable range narrower than a sixteenth of the
    unstable range around it. Growth below 1e-6 per period does not count as instability. If M, C and K are
    constant over the period, stability is computed from eigenvalues on a grid of at least 200 intervals. If
    lightly damped modes are too fast to be resolved at many speeds, `auto` searches only for the bands of the
    slower modes, and adds a note to the result.

    Examples
    --------
    >>> import solve
    >>> found = bands(solve.load("mathieu", delta=1.0, epsilon=0.3), "0.8:1.2:5 rad/s")
    >>> [band.kind for band in found]
    ['-1']
    """
    given_speeds = speeds_between(speeds, "bands")
    system, omegas = shown_in(system, given_speeds[0]), np.array(given_speeds)
    ends = ends_with_matrices(system, omegas)
    task, notes = task_of(over_speed(system), method, rtol, engine, orbit=False)
    if free(SinglePoint(system, ends[0])) is not None:
        notes = [*notes, f"rigid-body modes: {LEFT_OUT}"]
    coarse = _subdivide(omegas, np.diff(omegas) / (omegas[-1] - omegas[0]) * INTERVALS)
    constant = constant_coefficients(task.batch(coarse[:, None]))
    fast = 0 if constant else _count_fast_modes(system, ends[0], task.method)
    if fast:
        left_out = (
            f"{counted(fast, f'of {system.n} modes has', f'of {system.n} modes have')} a phase advance of "
            f"more than {_MAX_PHASE_ADVANCE:g} rad per period without being damped out; their unstable "
            "bands, of high order, are not searched for, but a solution at one speed includes all modes"
        )
        task, notes = replace(task, method=Radau()), [*notes, left_out]
    if constant:
        rotation, points = no_rotation, _subdivide(coarse, np.full(len(coarse) - 1, _FINER))[:, None]
    else:
        rotation = multiplier_rotation(system, ends, _MAX_PHASE_ADVANCE if fast else np.inf)
        turned = -np.diff(1 / coarse) * rotation(coarse[1:])
        points = _subdivide(coarse, turned / max(_MAX_ANGLE, turned.sum() / _MAX_INTERVALS))[:, None]
    points = np.union1d(points, near_ends(points[:, 0]))[:, None]
    batch = task.batch(points)
    evaluate = constant.evaluate if constant else (_evaluator_of_slow_modes if fast else evaluator)(batch)
    with progress.steps(4) as step:
        step("all speeds")
        samples = evaluate(points)
        step("speeds where multipliers are near each other")
        samples = separate_crossings(
            evaluate, _refine_near_coalescence(evaluate, samples, rotation), rotation
        )
        middle = np.arange(1, len(samples.points) - 1)
        spacing = float(np.diff(samples.points[:, 0]).max())
        step("narrow bands")
        samples += find_narrow_tongues(evaluate, samples, middle, predicted=_PREDICTED if constant else 1.0)
        if samples.failed.any():
            notes = [*notes, _failed_speeds_text(batch, by_speed(samples), system.labels.speed_unit)]
        step("edges of bands")
        runs = _UnstableRuns(evaluate, checked_tolerance(tolerance), omegas[-1:])
        unstable_bands = runs.bands(by_speed(samples))
    samples = by_speed(sum(runs.inside, samples))
    radius = np.where(samples.failed, np.nan, np.abs(samples.multipliers[:, 0]))
    range_ = float(omegas[0]), float(omegas[-1])
    speeds = samples.points[:, 0]
    return Bands(unstable_bands, system, range_, spacing, notes, speeds, radius, constant is not None)


def _failed_speeds_text(batch: Batch, known: StabilitySamples, unit: ShownUnit) -> str:
    """Return a message that lists the speeds without a result, and states the reason for the first of these
    speeds. Raises NoResultError if no speed has a result."""
    failures = gathered(batch, known.points[known.failed][:1], Kept(warnings=False)).failures
    reason = "multipliers are within their error of the unit circle; give a smaller rtol"
    failed = without_result(known.points[:, 0], known.failed, unit, failures.get(0, reason))
    if known.failed.all():
        raise NoResultError(failed)
    return f"{failed}; the ends of bands next to these speeds are unknown"


def _subdivide(speeds: Array, parts: Array) -> Array:
    """Return ascending speeds that divide each interval between neighbouring `speeds` into at least `parts`
    parts."""
    counts = np.maximum(np.ceil(parts * (1 - 1e-9)), 1).astype(int)
    at = np.concatenate([[0], np.cumsum(counts)])
    return np.interp(np.arange(at[-1] + 1), at, speeds)


def _refine_near_coalescence(
    evaluate: Evaluate, known: StabilitySamples, rotation: Rotation
) -> StabilitySamples:
    """Add samples between speeds at which the angle between two multipliers is so small that they may
    coalesce before the next speed. The distance from instability then has a separate minimum for each of
    several successive coalescences."""
    for _ in range(_HALVINGS):
        speeds, distance = known.points[:, 0], _least_angle(known.multipliers)
        turned = -np.diff(1 / speeds) * rotation(speeds[1:])
        near = np.minimum(distance[:-1], distance[1:]) < 2 * turned
        if not near.any():
            break
        known = by_speed(known + evaluate(((speeds[:-1] + speeds[1:]) / 2)[near, None]))
    return known


def _least_angle(multipliers: Array) -> Array:
    """Return, for each point (k,), the smallest difference between the angles of two multipliers. Only
    lightly damped multipliers above the real axis are considered."""
    rotating = (np.imag(multipliers) > 0) & (np.abs(multipliers) > LIGHTLY_DAMPED)
    placeholders = 1e3 * (1 + np.arange(multipliers.shape[1]))
    angles = np.sort(np.where(rotating, np.angle(multipliers), placeholders), axis=1)
    return np.diff(angles, axis=1).min(axis=1)


@dataclass(frozen=True)
class _UnstableRuns:
    """Search for runs of consecutive unstable samples of one kind, at ascending speeds.

    `highest` (1,) is the highest speed. `inside` contains the additional samples evaluated inside the runs.
    Borders, and the largest |ρ| between two speeds, are cached because the search is repeated after each
    split."""

    evaluate: Evaluate
    tolerance: float
    highest: Array
    _between: "dict[tuple[float, float], tuple[float, bool]]" = field(default_factory=dict)
    _within: "dict[tuple[float, float], float]" = field(default_factory=dict)
    inside: "list[StabilitySamples]" = field(default_factory=list)

    def bands(self, known: StabilitySamples) -> list[Band]:
        """Return bands with refined edges. A run is split where a sample inside the run is stable or has
        another kind of instability."""
        unstable_bands: list[Band] = []
        for _ in range(_MAX_SPLITS):
            unstable_bands, inside = self._search_inside(known)
            if len(inside.points) == 0:
                break
            known = by_speed(known + inside)
        return unstable_bands

    def _search_inside(self, known: StabilitySamples) -> tuple[list[Band], StabilitySamples]:
        """Return the bands, and the new samples inside those runs that contain samples of several states.
        These runs must be split."""
        state = _state(known)
        changes = np.flatnonzero(np.diff(state))
        speeds = known.points[:, 0]
        between, unknown = self._cached_borders(known, changes, state)
        borders = np.concatenate((speeds[:1], between, speeds[-1:]))
        unknown = np.concatenate(([True], unknown, [True]))
        starts, ends = np.append(0, changes + 1), np.append(changes, len(state) - 1)
        runs = np.flatnonzero(state[starts] >= 0)
        low, high = borders[runs], borders[runs + 1]
        nothing = known[runs[:0]], np.zeros(0, dtype=bool)
        within = list(zip(low.tolist(), high.tolist(), strict=True))
        new = np.array([edges not in self._within for edges in within], dtype=bool)
        looked, mixed = self._inside(low[new], high[new], state[starts[runs[new]]]) if new.any() else nothing
        uniform, growing = [], np.zeros(len(runs), dtype=bool)
        for at, run in enumerate(runs):
            first, last = starts[run], ends[run]
            radius = max(self._within[within[at]], np.abs(known.multipliers[first : last + 1, 0]).max())
            growing[at] = radius > 1 + SPLIT
            if growing[at]:
                open_ends = bool(unknown[run]), bool(unknown[run + 1])
                uniform.append(Band(*within[at], KINDS[state[first]], float(radius), *open_ends))
        return uniform, looked[np.flatnonzero(np.repeat(mixed & growing[new], _POINTS_INSIDE))]

    def _inside(self, low: Array, high: Array, states: Array) -> tuple[StabilitySamples, Array]:
        """Evaluate additional samples inside k runs, which extend from the speeds `low` (k,) to `high` (k,)
        and have the states `states` (k,). Return the samples, and a mask (k,) of the runs in which a sample
        has another state than the run."""
        parts = (np.arange(_POINTS_INSIDE) + 1) / (_POINTS_INSIDE + 1)
        looked = self.evaluate((low[:, None] + parts * (high - low)[:, None]).reshape(-1, 1))
        self.inside.append(looked)
        radii = np.abs(looked.multipliers[:, 0]).reshape(-1, _POINTS_INSIDE).max(axis=1, initial=0.0)
        self._within.update(zip(zip(low.tolist(), high.tolist(), strict=True), radii.tolist(), strict=True))
        return looked, (_state(looked).reshape(-1, _POINTS_INSIDE) != states[:, None]).any(axis=1)

    def _cached_borders(self, known: StabilitySamples, changes: Array, state: Array) -> tuple[Array, Array]:
        """Result of `_borders`, from the cache where available."""
        speeds = known.points[:, 0].tolist()
        ends = [(speeds[at], speeds[at + 1]) for at in changes.tolist()]
        new = changes[np.array([pair not in self._between for pair in ends], dtype=bool)]
        borders = zip(*(array.tolist() for array in self._borders(known, new, state)), strict=True)
        self._between.update(zip(((speeds[at], speeds[at + 1]) for at in new), borders, strict=True))
        cached = np.array([self._between[pair] for pair in ends]).reshape(-1, 2)
        return cached[:, 0], cached[:, 1].astype(bool)

    def _borders(self, known: StabilitySamples, changes: Array, state: Array) -> tuple[Array, Array]:
        """Return the speeds (k,) at which the state changes, and a mask (k,) that is True if the speed on one
        side of a change has no result. In this case, the last unstable speed is returned for the change."""
        low, high = known[changes], known[changes + 1]
        borders = np.empty(len(changes))
        search = BoundarySearch(self.evaluate, self.highest, self.tolerance)
        loses, wins = state[changes] < 0, state[changes + 1] < 0
        kind_only = ~(loses | wins)
        stable, unstable = (known[changes + (loses != side)] for side in (True, False))
        unknown = (state[changes] == _UNKNOWN) | (state[changes + 1] == _UNKNOWN)
        borders[unknown] = unstable.points[unknown, 0]
        crossed = ~(kind_only | unknown)
        edges, _ = search.edges(stable[crossed], unstable[crossed])
        borders[crossed] = np.where(np.isnan(edges), unstable.points[crossed], edges)[:, 0]
        unknown[crossed] = np.isnan(edges[:, 0])
        if kind_only.any():
            kinds = state[changes][kind_only]

            def differs(found: StabilitySamples, lines: Array) -> Array:
                return ~found.unstable | (found.kinds != kinds[lines])

            ends = search.narrow(Brackets(low[kind_only], high[kind_only], low[kind_only]), differs)
            borders[kind_only] = (ends.low.points + ends.high.points)[:, 0] / 2
        return borders, unknown


def _state(known: StabilitySamples) -> Array:
    """Return the state (k,) of each sample: the index in KINDS if it is unstable, -1 if it is stable,
    `_UNKNOWN` if it has no result."""
    return np.where(known.unstable, known.kinds, np.where(known.failed, _UNKNOWN, -1))


def _count_fast_modes(system: PeriodicSystem, speed: float, method: Rule) -> int:
    """Return the number of modes that are too fast to be resolved at `speed` and above. It is 0 if all modes
    can be resolved, if the unresolved modes decay within a period, if the user chose a method, or if no mode
    would remain."""
    values = frozen(SinglePoint(system, speed)).eigenvalues()[0]
    reach = np.abs(values).max(axis=0) * system.period
    fast = int((np.sort(reach)[::2] > _MAX_PHASE_ADVANCE).sum())
    survives = float(residual_amplitude(values, system.period, RESOLVABLE)) > DAMPED_OUT
    needed = method is auto and reach.max() > RESOLVABLE and survives
    return fast if needed and fast < system.n else 0


def _evaluator_of_slow_modes(batch: Batch) -> Evaluate:
    """Return a function that evaluates stability from the slow modes only. The method of the batch is
    Radau's. A point is unstable if a multiplier on which both grids agree lies outside the unit circle by
    more than the difference between its values on the two grids."""

    def on_grid(points: Array, steps: int) -> Array:
        with progress.subtask(POINTS, len(points) / len(_STEPS)):
            return batch.multipliers(points, steps)

    def evaluate(points: Array) -> StabilitySamples:
        with progress.subtask(POINTS, len(points)), progress.task(POINTS, len(points)):
            coarse, fine = (on_grid(points, steps) for steps in _STEPS)
        error = np.abs(fine[:, :, None] - coarse[:, None, :]).min(axis=2)
        agreed = (error < _AGREEMENT) & (fine != 0)
        beyond = (agreed & (np.abs(fine) - 1 > np.maximum(error, UNIT_CIRCLE))).any(axis=1)
        is_resolved = agreed.any(axis=1)
        slow = np.where(agreed, fine, 0.0)
        order = np.argsort(-np.abs(slow), axis=1, kind="stable")
        return StabilitySamples.from_multipliers(
            points, is_resolved & ~beyond, is_resolved & beyond, np.take_along_axis(slow, order, axis=1)
        )

    return evaluate
