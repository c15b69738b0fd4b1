"""Identification of model parameters from measured vibration, by nonlinear least squares with exact
derivatives."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from solve.arguments import unique_names
from solve.arrays import Array
from solve.derivatives.point import OnGrid, dependence_of
from solve.errors import ValueOutOfBoundsError, require_name
from solve.methods.choice import Rule
from solve.methods.collocation import Collocated
from solve.model.bounds import clauses
from solve.model.bounds import measured as with_its_unit
from solve.model.model import Model, of_model
from solve.results.channels import Channel
from solve.results.fit import Fitted, Interval
from solve.single import periodic
from solve.studies.fit_frequencies import natural_frequencies, require_elastic_modes
from solve.studies.least_squares import Minimum, minimise
from solve.studies.measured import FREQUENCY, Measured, measured
from solve.studies.misfit import misfits
from solve.terminal import progress
from solve.units import speed_in_si

_CONFIDENCE = 0.95
_UNTOLD = 0.5
"""Standard deviation, relative, from which on the data do not tell a combination of parameters."""

_SHARE = 0.1
"""Part of the largest from which on a parameter is named in a combination."""

_REACH = 1e6
"""Times its start, or part of it, beyond which a positive parameter is not tried."""


Bounds = Mapping[str, tuple[float | str, float | str]]
"""Lower and upper bounds of parameters by name, as numbers in their own units or texts with unit."""


@of_model
def fit(
    model: Model,
    data: str | Path,
    free: Sequence[str],
    bounds: Bounds | None = None,
    speed: float | str | None = None,
    robust: bool = False,
    method: str | Rule = "auto",
    rtol: float = 1e-7,
) -> Fitted:
    """Values of the free parameters for which the linear orbit fits the measurement best, starting from those
    of the model. A trial that the model refuses shortens the step.

    data: a file, see `solve.studies.measured.measured`; each channel is normalised by its own size. bounds:
    lower and upper bound by name, in the model's units or with a unit. speed: required if the file has no
    column of speeds. robust: outliers are weighted by their moduli instead of their squares. Positive
    parameters are fitted by their logarithms. Raises SolveError subclasses for bad input, and if the model
    has no orbit at the start.
    """
    names = unique_names(free)
    if not names:
        raise ValueOutOfBoundsError("no parameter is free; give names, such as k1, k2")
    for name in names:
        require_name(f"parameter of {model.name}", name, model.parameters)
    model.derivatives.by(names)
    sets = measured(data, model, None if speed is None else speed_in_si(speed))
    require_elastic_modes(model, sets)
    model = model.shown_in(sets[0].speed)
    problem = Problem(model, sets, names, method, rtol)
    count = sum(len(each) for each in problem.measured)
    if count <= len(names):
        raise ValueOutOfBoundsError(
            f"values measured: {count}, parameters free: {len(names)}; free fewer, or measure more"
        )
    limits = _limits(problem, bounds or {})
    with progress.task("trials"):
        found = minimise(problem, limits, robust)
    return _fitted(problem, found, Path(data).name)


@dataclass(eq=False)
class Problem:
    """The differences to be made least. Their variables x (r,) are logarithms of parameters that are
    positive, and multiples of their sizes at the start of others."""

    model: Model
    sets: Sequence[Measured]
    names: Sequence[str]
    method: str | Rule
    rtol: float
    _last: tuple[bytes, Array, Array] | None = field(default=None)

    def __post_init__(self) -> None:
        bound = {name: clauses(text) for name, _, _, text in self.model.module.PARAMETERS}
        at = self.initial = np.array([self.model.parameters[name] for name in self.names])
        self.by_logarithm = (at > 0) & [bool({"> 0", ">= 0"} & {*bound[name]}) for name in self.names]
        self.unit = np.where(at != 0, np.abs(at), 1.0)
        self.scales = {
            name: float(np.sqrt(np.mean(np.abs(np.concatenate([s.channels[name] for s in self.sets])) ** 2)))
            or 1.0
            for name in self.sets[0].channels
        }

    @property
    def start(self) -> Array:
        return self.scaled(self.initial)

    def scaled(self, values: Array) -> Array:
        """x of parameters (r,)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.by_logarithm, np.log(values), values / self.unit)

    def values(self, x: Array) -> Array:
        """Parameters (r,) of x, no farther than they are tried."""
        return self.unscaled(self.within_reach(x))

    def within_reach(self, x: Array) -> Array:
        """x (r,), no farther than parameters are tried."""
        reach = np.log(_REACH)
        return np.where(self.by_logarithm, np.clip(x, self.start - reach, self.start + reach), x)

    def unscaled(self, x: Array) -> Array:
        """Parameters (r,) of x, however far."""
        return np.where(self.by_logarithm, np.exp(np.where(self.by_logarithm, x, 0.0)), x * self.unit)

    @property
    def measured(self) -> list[Array]:
        return [_flat(values) / self.scales[name] for s in self.sets for name, values in s.channels.items()]

    @property
    def ratios(self) -> dict[str, float]:
        """By name, how many times as large as it is computed at the start it was measured."""
        numbers = {name: [] for name in self.scales}
        measured, left = self.measured, self.residuals(self.start)
        names = [name for each in self.sets for name in each.channels]
        computed = np.split(left, np.cumsum([len(values) for values in measured])[:-1])
        for name, values, off in zip(names, measured, computed, strict=True):
            numbers[name] += (values + off).tolist()
        with np.errstate(divide="ignore"):
            return {name: float(np.sqrt(len(each)) / np.linalg.norm(each)) for name, each in numbers.items()}

    def residuals(self, x: Array) -> Array:
        return self._solved(x)[0]

    def jacobian(self, x: Array) -> Array:
        return self._solved(x)[1]

    def described(self, x: Array) -> str:
        """Text with the free parameters, their values and units."""
        values = zip(self.names, self.values(x).tolist(), strict=True)
        units = self.model.parameter_labels
        return ", ".join(f"{name} = {with_its_unit(value, units[name][0])}" for name, value in values)

    def varied(self, x: Array) -> Model:
        return self.model.varied(dict(zip(self.names, self.values(x).tolist(), strict=True)))

    def _solved(self, x: Array) -> tuple[Array, Array]:
        key = x.tobytes()
        if self._last is None or self._last[0] != key:
            with progress.subtask("trials"):
                model, rate = self.varied(x), np.where(self.by_logarithm, self.values(x), self.unit)
                found = [row for s in self.sets for row in self.computed(model, s)]
                values = np.concatenate([_flat(row) / self.scales[name] for name, row, _ in found])
                slopes = np.concatenate(
                    [
                        np.array([_flat(each) for each in rows]).T / self.scales[name]
                        for name, _, rows in found
                    ]
                )
            self._last = key, values - np.concatenate(self.measured), slopes * rate
        return self._last[1], self._last[2]

    def computed(self, model: Model, data: Measured) -> list[tuple[str, Array, Array]]:
        """Of every channel its name, values (k,) and their derivatives (r, k) by the parameters."""
        if data.position is not None:
            return [(FREQUENCY, *natural_frequencies(model, data, self.names))]
        orbit = periodic(model, data.speed, self.method, rtol=self.rtol)
        rule = orbit.certified.method
        if not isinstance(rule, Collocated):
            raise ValueOutOfBoundsError(f"method is {rule.name}; a fit takes radau, gauss, or auto")
        on = OnGrid(orbit, rule, orbit.steps, dependence_of(orbit, self.names), self.names)
        found = []
        for name, values in data.channels.items():
            if data.orders:
                found.append((name, *_of_orders(on, name, data.at, np.iscomplexobj(values))))
            else:
                found.append((name, on.orbit.signal(name)(data.at), on.forward.signal(name, data.at)))
        return found


def _of_orders(on: OnGrid, name: str, orders: Array, angles: bool) -> tuple[Array, Array]:
    """Complex amplitudes (k,) of orders and their derivatives (r, k), or moduli, but for the mean's sign."""
    pairs = [on.figures.harmonic(name, round(order)) for order in orders.tolist()]
    amplitudes = np.array([amplitude for amplitude, _ in pairs])
    moved = np.array(on.forward.of([sums for _, sums in pairs])).T
    if angles:
        return amplitudes, moved
    size = np.abs(amplitudes)
    along = np.where(orders == 0, 1.0, amplitudes / np.where(size > 0, size, 1.0))
    return np.real(amplitudes * np.conj(along)), np.real(moved * np.conj(along))


def _flat(values: Array) -> Array:
    return np.concatenate((np.real(values), np.imag(values))) if np.iscomplexobj(values) else values


def _limits(problem: Problem, bounds: Bounds) -> tuple[Array, Array]:
    """Bounds of x. Raises ValueOutOfBoundsError, UnitError."""
    low, high = np.full((2, len(problem.names)), np.inf) * np.array([[-1.0], [1.0]])
    for name, ends in bounds.items():
        if name not in problem.names:
            raise ValueOutOfBoundsError(
                f"bounds are given for {name}, which is not free; free it, or drop them"
            )
        least, most = (problem.model.in_own_unit(name, end) for end in ends)
        at = list(problem.names).index(name)
        value = float(problem.initial[at])
        if not least < most or not least <= value <= most:
            raise ValueOutOfBoundsError(
                f"bounds of {name} are {least:g} to {most:g}, and it starts from {value:g}; give a range "
                f"that holds it, or another start with --set {name}=NUMBER"
            )
        if problem.by_logarithm[at]:
            low[at], high[at] = np.log(least) if least > 0 else -np.inf, np.log(most)
        else:
            low[at], high[at] = least / problem.unit[at], most / problem.unit[at]
    return low, high


def _fitted(problem: Problem, found: Minimum, file: str) -> Fitted:
    from scipy.stats import t

    x, count = found.x, len(found.residuals)
    values, model = problem.values(x), problem.varied(x)
    covariance, lost, unidentifiable = _uncertainty(problem, values, found.jacobian, found.sigma, count)
    deviations = np.sqrt(np.diag(covariance))
    reach = np.where(
        lost | (not found.stationary), np.inf, t.ppf((1 + _CONFIDENCE) / 2, count - len(x)) * deviations
    )
    with np.errstate(over="ignore"):
        ends = [problem.unscaled(problem.within_reach(x) + way * reach) for way in (-1, 1)]
    intervals = {
        name: Interval(float(value), float(low), float(high))
        for name, value, low, high in zip(problem.names, values, *ends, strict=True)
    }
    channels = [
        Channel(s.speed, s.orders, name, s.at, s.channels[name], computed, s.position)
        for s in problem.sets
        for name, computed, _ in problem.computed(model, s)
    ]
    scale = np.where(deviations > 0, deviations, 1.0)
    residual = float(np.sqrt(np.mean(found.residuals**2)))
    correlations = covariance / scale / scale[:, None]
    doubts = [*found.warnings, *misfits(channels, model.period, problem.ratios)]
    return Fitted(model, file, intervals, correlations, residual, unidentifiable, channels, doubts)


def _uncertainty(
    problem: Problem, values: Array, jac: Array, sigma: float, count: int
) -> tuple[Array, Array, list[str]]:
    """Covariance (r, r) of x within what the data tell, which parameters (r,) they tell nothing of, and in
    words what they cannot tell."""
    _, sizes, axes = np.linalg.svd(jac, full_matrices=False)
    known = sizes > np.finfo(float).eps * count * sizes[0]
    spread = np.where(known, sigma / np.where(known, sizes, 1.0), np.inf)
    rate = np.where(problem.by_logarithm | (values == 0), 1.0, problem.unit / np.where(values, values, 1.0))
    unidentifiable = [
        _sentence(problem.names, axis * rate)
        for axis, each in zip(axes, spread, strict=True)
        if each > _UNTOLD
    ]
    lost = np.asarray((np.abs(axes[~known]) > _SHARE).any(axis=0))
    return (axes.T * np.where(known, spread, 0.0) ** 2) @ axes, lost, unidentifiable


def _sentence(names: Sequence[str], axis: Array) -> str:
    """What may change without the data telling it, in words."""
    lead = axis[np.abs(axis).argmax()]
    parts = [
        f"{name} by {100 * share:+.3g} %"
        for name, share in zip(names, (axis / lead).tolist(), strict=True)
        if abs(share) > _SHARE
    ]
    if len(parts) == 1:
        return f"the data do not tell {parts[0].split()[0]}"
    return f"the data do not tell a change of {' with '.join(parts)}: only what these do not change together"
