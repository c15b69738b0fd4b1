"""Floquet modes followed as the speed or a parameter varies, so that each mode keeps its identity."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from solve.arguments import checked_rtol, require_steps
from solve.arrays import Array
from solve.equations import require_bounds
from solve.errors import NoResultError, SolveError, StepsError, ValueOutOfBoundsError, require_name
from solve.kernel.engines import chosen_engine
from solve.labels import SPEED, speed_or_usual, unit_of
from solve.methods.choice import Rule, chosen, damping
from solve.methods.method import Method
from solve.period.points import SinglePoint
from solve.results.followed_modes import FollowedModes
from solve.studies.mode_identity import Identities, identified
from solve.studies.mode_tracks import Sample, Tracks
from solve.studies.mode_vectors import ModeVectors, mode_vectors
from solve.studies.sweep import Over, varied_values
from solve.system import PeriodicSystem, check, of_system, shown_in
from solve.terminal import progress
from solve.threads import one_thread
from solve.units import speeds_between, speeds_given

_FEWEST_STEPS, _MOST_STEPS = 64, 512
"""Numbers of steps of the coarsest and of the finest grid. The phases at which eigenvectors are compared must
resolve the harmonics of the vectors. Chosen by judgement."""

_ALLOWED = 100.0
"""The number of steps is doubled if the relative error of a multiplier exceeds this multiple of `rtol`.
Chosen by judgement."""

_ADDED = 30
"""Maximum number of samples added per given value, on average. Chosen by judgement: a veering requires about
2 log₂(spacing/width) samples."""


@dataclass
class _Solver:
    """Solver for the modes at values of the varied quantity, on a common grid."""

    at: Callable[[float], tuple[PeriodicSystem, float]]
    method: Method
    rtol: float
    engine: str
    steps: int

    def solved(self, x: float) -> ModeVectors:
        """Modes at a value of the varied quantity. Raises SolveError subclasses."""
        system, speed = self.at(x)
        check(system, speed)
        with one_thread(system.n):
            return mode_vectors(SinglePoint(system, speed), self.method, self.steps, self.rtol, self.engine)

    def __call__(self, x: float) -> ModeVectors | None:
        """Modes at a value of the varied quantity; None if there is no solution."""
        try:
            return self.solved(x)
        except SolveError:
            return None

    def choose_steps(self, values: Sequence[float]) -> None:
        """Double the number of steps until all multipliers at these values are accurate enough and the last
        doubling has resolved no further multiplier, or until two doublings bring no improvement."""
        history: list[tuple[int, float]] = []
        while True:
            count, error = self._quality(values)
            history.append((count, error))
            is_accurate = error <= _ALLOWED * self.rtol
            if len(history) > 1 and is_accurate and count == history[-2][0]:
                return
            if 2 * self.steps > _MOST_STEPS or (len(history) > 2 and not _better(history)):
                return
            self.steps *= 2

    def _quality(self, values: Sequence[float]) -> tuple[int, float]:
        """Number of resolved modes, and largest relative error of their multipliers; the error is infinite if
        the nodes resolve the harmonics at none of the values."""
        solved = [self(x) for x in values]
        resolved = [modes for modes in solved if modes is not None and modes.resolved]
        errors = [2 * math.pi * modes.errors.max(initial=0.0) / modes.rotation for modes in resolved]
        return sum(len(modes.exponents) for modes in resolved), float(max(errors, default=math.inf))


def _better(history: Sequence[tuple[int, float]]) -> bool:
    """Whether the last two doublings resolved more modes or reduced the error at least tenfold."""
    (count, error), (latest_count, latest_error) = history[-3], history[-1]
    return latest_count > count or latest_error < 0.1 * error


@of_system
def follow_modes(
    system: PeriodicSystem,
    speeds: float | str | Sequence[float | str] | Array | None = None,
    method: str | Rule = "auto",
    steps: int | None = None,
    rtol: float = 1e-8,
    engine: str = "auto",
    over: Over | None = None,
) -> FollowedModes:
    """Follow each Floquet mode as the speed, or a parameter, varies.

    Parameters
    ----------
    system : PeriodicSystem
        System of second or first order.
    speeds : float, str or sequence of float or str, optional
        Two or more speeds in rad/s, strings with a unit, or one string such as "100:900:81 rpm"; if `over` is
        given, one speed, by default the speed of the case.
    method : str or Method
        Method with step maps, radau or gauss; by default radau.
    steps : int, optional
        Number of steps per period; by default the number that `rtol` requires at the ends of the range.
    rtol : float
        Relative tolerance of the multipliers. Modes whose exponents differ by less than about 40 `rtol`/T
        are not distinguished.
    engine : str
        "auto", "compiled" or "numpy".
    over : str, sequence of str or mapping of str to values, optional
        Name and values of one parameter, in the model's units or with a unit, for example "k1=1e4:9e4:50".

    Returns
    -------
    FollowedModes
        Frequencies, damping ratios and labels of the modes, their crossings and veerings.

    Raises
    ------
    SolveError
        A subclass for bad input, or if no value has a result.

    Notes
    -----
    A mode p(φ) exp(λt) at one speed is identified with a mode at a neighbouring speed if its vector overlaps
    with the vector of no other mode at that speed. The overlap of p_a and p_b is |y_aᴴp_b| |y_bᴴp_a|, where y
    are left vectors and the products are averaged over the period. Harmonics are shifted so that the overlap
    is largest. Where two modes come close, their equations are reduced to a matrix of order 2, whose
    exceptional points (T. Kato, Perturbation Theory for Linear Operators, II.1.1) show whether the modes
    cross or veer. Speeds are added until the identity of all modes is unambiguous. Pairs for which this fails
    are listed as ambiguous.

    Examples
    --------
    >>> import numpy as np
    >>> def oscillator(phase, speed):
    ...     one = np.ones((len(phase), 1, 1))
    ...     return one, 0.1 * one, 4.0 * one, np.zeros((len(phase), 1))
    >>> followed = follow_modes(PeriodicSystem(oscillator, ["q"]), [1.0, 1.5])
    >>> followed.frequencies.round(6).tolist(), followed.damping.round(6).tolist()
    ([[1.999375], [1.999375]], [[0.025], [0.025]])
    """
    points = _Points.from_arguments(system, speeds, over)
    engine_used, notes = chosen_engine(engine)
    solver = _Solver(points.at, _method(method, system.n), checked_rtol(rtol), engine_used, _FEWEST_STEPS)
    if steps is not None:
        require_steps(steps)
        solver.steps = steps
    if steps is None:
        solver.choose_steps([float(points.values[0]), float(points.values[-1])])
    with progress.task("values", len(points.values)) as count:
        samples, failures = _solved(solver, points.values, count)
    branches = _followed(solver, samples)
    found = identified(branches, [sample.x for sample in samples])
    doubts = [*_unresolved(points, solver, samples), *_exhausted(points, branches)]
    return _result(points, solver, found, failures, [*notes, *doubts])


def _method(method: str | Rule, coordinates: int) -> Method:
    """Return the method. It must compute step maps, because eigenvectors with error estimates require step
    maps. Raises StepsError for other methods."""
    rule = chosen(method)
    used = rule if isinstance(rule, Method) else damping(coordinates)
    if used.with_another_stage is None:
        raise StepsError(f"{used.name} provides no eigenvectors with error estimates; use radau or gauss")
    return used


@dataclass(frozen=True)
class _Points:
    """Ascending values (P,) of the varied quantity, which is the speed or a parameter, and the speed (P,) at
    each value."""

    system: PeriodicSystem
    name: str
    values: Array
    speeds: Array

    @classmethod
    def from_arguments(cls, system: PeriodicSystem, speeds: Any, over: Over | None) -> Self:
        """Points from the arguments of `follow_modes`. Raises SolveError subclasses."""
        if over is None:
            omegas = speeds_between([] if speeds is None else speeds, "followed modes")
            return cls(shown_in(system, omegas[0]), SPEED, np.array(omegas), np.array(omegas))
        ranges = varied_values(over, system)
        if len(ranges) != 1:
            raise ValueOutOfBoundsError(
                f"'over' gives {len(ranges)} parameters; modes are followed versus one parameter; give one"
            )
        ((name, numbers),) = ranges.items()
        numbers = np.unique(numbers)
        if len(numbers) < 2:
            raise ValueOutOfBoundsError(f"'over' gives one value of {name}; give two or more: {name}=A:B:N")
        given_speeds = speeds_given(speed_or_usual(system, None) if speeds is None else speeds)
        if len(given_speeds) != 1:
            raise ValueOutOfBoundsError(
                f"{len(given_speeds)} speeds are given, and 'over' varies {name}; give one speed together "
                "with 'over'"
            )
        require_name(f"parameter of {system.labels.name}", name, system.labels.parameters)
        for extreme in (numbers[0], numbers[-1]):
            require_bounds(system, {name: float(extreme)})
        return cls(
            shown_in(system, given_speeds[0]), name, numbers, np.full(len(numbers), float(given_speeds[0]))
        )

    def text(self, x: float) -> str:
        """Text of a value, with its unit."""
        return unit_of(self.system, self.name).text(x, ".6g")

    def at(self, x: float) -> tuple[PeriodicSystem, float]:
        """System and speed at a value of the varied quantity."""
        if self.name == SPEED:
            return self.system, x
        return self.system.varied({self.name: x}), float(self.speeds[0])


def _solved(solver: _Solver, values: Array, count: progress.Task) -> tuple[list[Sample], dict[int, str]]:
    """Return the samples at `values`, and a mapping from the index of each failed value to the reason. Raises
    NoResultError if every value failed."""
    samples, failures = [], {}
    for position, x in enumerate(values.tolist()):
        try:
            samples.append(Sample(x, solver.solved(x)))
        except SolveError as error:
            failures[position] = str(error)
        count.add(1)
    if not samples:
        raise NoResultError(f"no value has a result: {failures[0]}")
    if not len(samples[0].modes.exponents):
        raise NoResultError("no multiplier is accurate to even one digit: there are no modes to follow")
    return samples, failures


def _followed(solver: _Solver, samples: Sequence[Sample]) -> tuple[Tracks, Tracks]:
    """Follow the modes towards lower and towards higher values, from the sample with the fewest coincident
    modes. Return both sets of tracks."""
    start = min(range(len(samples)), key=lambda k: (samples[k].modes.coincident.sum(), k))
    branches = []
    for following in (samples[:start][::-1], samples[start + 1 :]):
        tracks = Tracks(solver, _ADDED * len(samples))
        tracks.start(samples[start])
        with progress.task("followed values", len(following)) as count:
            for sample in following:
                tracks.extend(sample)
                count.add(1)
        branches.append(tracks)
    return branches[0], branches[1]


def _unresolved(points: _Points, solver: _Solver, samples: Sequence[Sample]) -> list[str]:
    """Return a list with a sentence on the values where the steps do not resolve the harmonics of all modes.
    The list is empty if there are no such values."""
    values = [sample.x for sample in samples if not sample.modes.resolved]
    if not values:
        return []
    where = points.text(values[0]) + (f" and {len(values) - 1} more values" if len(values) > 1 else "")
    return [
        f"{solver.steps} steps do not resolve the harmonics of all modes at {where}: their frequencies and "
        "identities are unreliable; give more steps"
    ]


def _exhausted(points: _Points, branches: Sequence[Tracks]) -> list[str]:
    """Return sentences on the ranges that were not refined further because the maximum number of added values
    was reached."""
    ranges = [(tracks.exhausted, tracks.samples[-1].x) for tracks in branches if tracks.exhausted is not None]
    return [
        f"modes are not identified from {points.text(start)} to {points.text(end)}: too many values would "
        "have to be added; give closer values or a smaller range"
        for start, end in ranges
    ]


def _result(
    points: _Points,
    solver: _Solver,
    found: Identities,
    failures: dict[int, str],
    notes: Sequence[str],
) -> FollowedModes:
    """Return the result, with NaN at the values that failed."""
    rows = np.setdiff1d(np.arange(len(points.values)), list(failures))

    def spread(values: Array) -> Array:
        missing = complex(np.nan, np.nan) if np.iscomplexobj(values) else np.nan
        spread_values = np.full((len(points.values), *values.shape[1:]), missing)
        spread_values[rows] = values
        return spread_values

    return FollowedModes(
        points.system,
        points.speeds,
        spread(found.exponents),
        spread(found.errors),
        found.labels,
        found.harmonics,
        spread(found.participation),
        found.meetings,
        found.ambiguous,
        found.path,
        found.path_exponents,
        found.resolution,
        solver.rtol,
        solver.steps,
        failures,
        {} if points.name == SPEED else {points.name: points.values},
        notes,
    )
