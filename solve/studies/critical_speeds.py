"""Critical speeds by three criteria (sections 7.2.3 and 7.3 of the thesis).

The criteria are maxima of the response versus speed, maxima of the real part of the dominant Floquet
multiplier versus speed, and integer fractions of the cycle-mean natural frequencies.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from solve.arguments import checked_tolerance, require_integer, require_size
from solve.arrays import EPS, Array
from solve.batch.family import over_speed
from solve.batch.task import task_of
from solve.errors import require_name
from solve.labels import known_quantities
from solve.methods.choice import Rule
from solve.period.multipliers import UNSTABLE
from solve.results.critical_speeds import Critical, CriticalSpeeds
from solve.results.points import Kept, PointResults
from solve.results.sweep import Sweep
from solve.studies.constant_coefficients import constant_coefficients
from solve.studies.critical_search import CriticalSearch, radius, real_part
from solve.studies.mean_frequencies import MeanFrequencies, combinations, resonance_speeds, resonances
from solve.studies.resonances import assign
from solve.studies.speed_grids import ends_with_matrices, multiplier_rotation, no_rotation, without_result
from solve.system import PeriodicSystem, of_system, shown_in
from solve.terminal import progress
from solve.units import speeds_between

RESPONSES = ("max_abs", "rms", "max", "min", "mean")
"""Names of statistics of a quantity over the period. Each statistic, as a function of speed, can be searched
for maxima."""

_SPEEDS_PER_DIVISION = 24
"""Smallest number of speeds between two neighbouring integer divisions of the lowest frequency. Chosen by
judgement."""

_ROUNDOFF = 64 * EPS
"""Relative difference below which two speeds of the grid count as equal: each speed is computed by a few
operations with a round-off of eps."""


@dataclass(frozen=True)
class _Settings:
    """Settings of `critical_speeds` with their defaults."""

    quantity: str | None = None
    figure: str = "max_abs"
    orders: int = 20
    method: str | Rule = "auto"
    rtol: float = 1e-8
    tolerance: float = 1e-5
    engine: str = "auto"

    def __post_init__(self) -> None:
        require_name("figure", self.figure, RESPONSES)
        require_integer("orders", self.orders, hint=", such as 20")


@of_system
def critical_speeds(
    system: PeriodicSystem,
    speeds: str | Sequence[float | str] | Array,
    quantity: str | None = None,
    figure: str = "max_abs",
    orders: int = _Settings.orders,
    method: str | Rule = "auto",
    rtol: float = 1e-8,
    tolerance: float = _Settings.tolerance,
    engine: str = "auto",
) -> CriticalSpeeds:
    """Find the critical speeds within the range of the given speeds.

    Parameters
    ----------
    system : PeriodicSystem
        System to solve.
    speeds : str or sequence of float or str
        Speeds in rad/s, strings with a unit, or one string such as "100:900:81 rpm". Speeds are added where
        fewer than 24 lie between two integer divisions of the lowest frequency. The divisions of all
        frequencies, and the speeds halfway between neighbouring divisions, are added too.
    quantity : str, optional
        Coordinate or output whose maxima are searched for; by default the first coordinate.
    figure : str
        "max_abs", "rms", "max", "min" or "mean" of the quantity over the period.
    orders : int
        Highest order of integer divisions and combinations. Maxima are not searched for at speeds at which
        the ratio of the lowest frequency to the speed exceeds this order.
    method : str or Method
        Method, as in `periodic`.
    rtol : float
        Relative tolerance of orbits and multipliers.
    tolerance : float
        Relative tolerance of the speeds of maxima.
    engine : str
        "auto", "compiled" or "numpy".

    Returns
    -------
    CriticalSpeeds
        Critical speeds in descending order of the speed.

    Raises
    ------
    SolveError
        A subclass for bad input, or if no speed has a result.

    Notes
    -----
    Maxima are bracketed on the grid of speeds and narrowed by Chandrupatla's method. Integer divisions are
    speeds at which a cycle-mean frequency is an integer multiple of the speed (section 7.3 of the thesis).

    Examples
    --------
    >>> import numpy as np
    >>> def oscillator(phase, speed):
    ...     one = np.ones((len(phase), 1, 1))
    ...     return one, 0.1 * one, 4.0 * one, np.cos(phase)[:, None]
    >>> found = critical_speeds(PeriodicSystem(oscillator, ["q"]), np.linspace(1.5, 2.5, 11), orders=1)
    >>> round(found.rows[0].division, 3)
    2.0
    """
    settings = _Settings(quantity, figure, orders, method, rtol, tolerance, engine)
    return _critical_speeds(system, speeds_between(speeds, "critical speeds"), settings)


def critical_speeds_of(sweep: Sweep, method: str | Rule, rtol: float) -> CriticalSpeeds:
    """Find the critical speeds of the first coordinate in the range of a sweep. The orbits of the sweep are
    reused. `method` and `rtol` must be those of the sweep."""
    speeds = speeds_between(sweep.speeds.tolist(), "critical speeds")
    return _critical_speeds(sweep.system, speeds, _Settings(method=method, rtol=rtol), sweep)


def _critical_speeds(
    system: PeriodicSystem, speeds: Sequence[float], settings: _Settings, sweep: Sweep | None = None
) -> CriticalSpeeds:
    """Find the critical speeds in the range of ascending speeds (rad/s). The solutions of `sweep`, if given,
    are reused."""
    system, omegas, orders = shown_in(system, speeds[0]), np.array(speeds), settings.orders
    (name,) = known_quantities(system, settings.quantity or system.coordinates[0])
    require_size("orders", orders, len(omegas) * system.n**2)
    rest_frequencies = MeanFrequencies(system, np.array([0.0]))
    search, grid, notes = _prepare(rest_frequencies, omegas, name, settings, sweep)
    constant = search.constant is not None
    with progress.steps(4) as step:
        step("all speeds")
        results = search.solve(grid)
        results.require_any()
        step("mean natural frequencies")
        frequencies = MeanFrequencies(system, grid)
        with progress.task("speeds", len(grid)):
            resolved = _resolved(frequencies, orders)
        step("maxima of the dominant multiplier")
        values = np.where(resolved, np.maximum(real_part(results), 0.0), np.nan)
        of_real_part = search.multiplier_maxima(grid, values, results, real_part)
        step("maxima of the response")
        growing = np.array([maximum.speed for maximum in of_real_part if maximum.height > 1])
        # A resonance of a higher mode may be narrower than the distance between two speeds of the grid.
        rows = _divisions(frequencies, rest_frequencies, orders)
        resonant = np.unique([row.speed for row in rows])
        halfway = (resonant[:-1] + resonant[1:]) / 2
        further = np.concatenate((growing, resonant, halfway))
        grid, results = search.add_crossings(grid, results, further)
        frequencies = replace(frequencies, speeds=grid)
        resolved = _resolved(frequencies, orders)
        of_response = search.response_maxima(grid, results, resolved)
        values = np.where(resolved, radius(results), np.nan)
        of_radius = search.multiplier_maxima(grid, values, results, radius)
        rows = _divisions(frequencies, rest_frequencies, orders)
        rows = assign(rows, search.label_response_maxima(of_response), frequencies, "response")
        rows = assign(rows, search.label_real_part_maxima(of_real_part), frequencies, "multiplier")
        rows = assign(rows, search.label_radius_maxima(of_radius), frequencies, "radius")
        rows = [replace(row, ratios=(frequencies.at(row.speed) / row.speed).tolist()) for row in rows]
    notes += [*results.notes, *frequencies.shift_notes()]
    return CriticalSpeeds(
        system,
        speeds=grid,
        response=search.response(results),
        real_part=real_part(results),
        radius=results.spectral_radius,
        unstable=results.verdicts == UNSTABLE,
        imaginary=frequencies.imaginary & ~results.failed,
        frequencies=frequencies.values,
        quantity=name,
        figure=settings.figure,
        rows=sorted(rows, key=lambda row: -row.speed),
        combinations=[] if constant else combinations(frequencies, orders),
        orders=orders,
        notes=[*notes, *_omissions(frequencies, results, orders)],
        constant_matrices=constant,
    )


def _prepare(
    rest: MeanFrequencies, omegas: Array, name: str, settings: _Settings, sweep: Sweep | None
) -> tuple[CriticalSearch, Array, list[str]]:
    """Return the search object for a refined grid of speeds, the refined grid, and notes on the method and
    the engine."""
    system = rest.system
    ends = ends_with_matrices(system, omegas)
    selection = Kept((name,), warnings=False)
    task, notes = task_of(over_speed(system), settings.method, settings.rtol, settings.engine, selection)
    # Without matrices at rest, frequencies at the lowest speed are used instead.
    first = rest if np.isfinite(rest.values).all() else MeanFrequencies(system, np.array([ends[0]]))
    stability = replace(task, request=replace(task.request, orbit=False))
    constant = constant_coefficients(stability.batch(omegas[:, None]))
    grid = _refined_grid(omegas, first, settings.orders, combined=constant is None)
    search = CriticalSearch(
        task.batch(grid[:, None]),
        stability.batch(grid[:, None]),
        task.kept,
        settings.figure,
        settings.orders,
        checked_tolerance(settings.tolerance),
        no_rotation if constant else multiplier_rotation(system, ends),
        constant,
        sweep,
    )
    return search, grid, [*notes]


def _refined_grid(omegas: Array, frequencies: MeanFrequencies, orders: int, combined: bool) -> Array:
    """Return ascending speeds, with additional speeds that resolve the divisions of the lowest frequency up
    to `orders`.

    If `combined` is True, combination resonances and the speeds halfway between them are added, so that two
    unstable ranges are not merged.
    """
    low, high, lowest = omegas[0], omegas[-1], float(frequencies.lowest[0])
    between = np.empty(0)
    first, last = lowest / high, min(lowest / low, orders + 1.0)
    if last > first > 0:
        count = int(np.ceil((last - first) * _SPEEDS_PER_DIVISION)) + 1
        require_size("speeds between the divisions up to that order", count, orders)
        between = np.clip(lowest / np.linspace(first, last, count), low, high)
    resonant = np.unique(resonances(frequencies, low, high)) if combined else np.empty(0)
    halfway = (resonant[:-1] + resonant[1:]) / 2
    speeds = np.unique(np.concatenate((omegas, between, resonant, halfway)))
    # Speeds that differ by round-off would bracket a false maximum.
    return speeds[np.append(np.diff(speeds) > _ROUNDOFF * speeds[1:], True)]


def _resolved(frequencies: MeanFrequencies, orders: int) -> Array:
    """Return a mask (P,) of the speeds at which the ratio of the lowest frequency to the speed, rounded to an
    integer, is at most `orders`."""
    return frequencies.lowest <= (orders + 0.5) * frequencies.speeds


def _divisions(frequencies: MeanFrequencies, rest: MeanFrequencies, orders: int) -> list[Critical]:
    """Return the integer divisions of the mean frequencies. Each is paired with the same division of the
    frequency at rest."""
    return [
        Critical(None, None, speed, mode + 1, order, float(rest.values[0, mode] / order))
        for mode, weights in enumerate(np.eye(frequencies.values.shape[1]))
        for order, speed in resonance_speeds(frequencies, weights, orders)
    ]


def _omissions(frequencies: MeanFrequencies, results: PointResults, orders: int) -> Iterator[str]:
    """Yield notes on speeds at which maxima are not searched for, and on speeds without a result."""
    grid, unit = frequencies.speeds, frequencies.system.labels.speed_unit
    skipped = frequencies.lowest > (orders + 0.5) * grid
    if skipped.any():
        limit = unit.text(float(grid[skipped].max()), ".4g")
        yield f"below {limit} only orders above {orders} occur; maxima are not searched for at these speeds"
    if results.failures:
        yield without_result(grid, results.failed, unit, next(iter(results.failures.values())))
