"""Residuals of a model against measured vibration, and their derivatives with respect to the free
parameters."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from solve.approximation import slope
from solve.arrays import Array
from solve.derivatives.grid_derivatives import GridDerivatives, dependence_of
from solve.errors import ValueOutOfBoundsError, counted
from solve.methods.choice import Rule
from solve.methods.collocated import Collocated
from solve.model.bounds import clauses
from solve.model.bounds import measured as with_its_unit
from solve.model.model import Model
from solve.period.natural import slopes
from solve.single import periodic
from solve.studies.frequencies import at_speed_zero, natural
from solve.studies.measured import FREQUENCY, Measured
from solve.terminal import progress

_MAX_RATIO = 1e6
"""Largest factor by which a positive parameter may rise or fall from its initial value. It keeps the
logarithm finite if the data do not determine the parameter."""

_STEP = 1e-3
"""Largest step of the finite differences of matrices, relative to the parameter. For entries that are
polynomials of degree 8 or less, the extrapolation is exact to round-off."""


@dataclass(eq=False)
class Problem:
    """Least-squares problem in the variables x (r,): logarithms of positive parameters, and all other
    parameters, each divided by the modulus of its initial value."""

    model: Model
    sets: Sequence[Measured]
    names: Sequence[str]
    method: str | Rule
    rtol: float
    _last: tuple[bytes, Array, Array] | None = field(default=None)

    def __post_init__(self) -> None:
        bounds = {name: clauses(text) for name, _, _, text in self.model.module.PARAMETERS}
        self.initial = np.array([self.model.parameters[name] for name in self.names])
        non_negative = [bool({"> 0", ">= 0"} & {*bounds[name]}) for name in self.names]
        self.by_logarithm = (self.initial > 0) & non_negative
        self.unit = np.where(self.initial != 0, np.abs(self.initial), 1.0)
        self.scales = {name: self._root_mean_square(name) or 1.0 for name in self.sets[0].channels}

    def _root_mean_square(self, channel: str) -> float:
        values = np.concatenate([data.channels[channel] for data in self.sets])
        return float(np.sqrt(np.mean(np.abs(values) ** 2)))

    @property
    def start(self) -> Array:
        """Variables x (r,) that correspond to the parameters of the model."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.by_logarithm, np.log(self.initial), self.initial / self.unit)

    def values(self, x: Array) -> Array:
        """Parameters (r,) that correspond to x, clipped to the permitted range."""
        return self.unscaled(self.clipped(x))

    def clipped(self, x: Array) -> Array:
        """Variables x (r,), clipped to the permitted range."""
        limit = np.log(_MAX_RATIO)
        return np.where(self.by_logarithm, np.clip(x, self.start - limit, self.start + limit), x)

    def unscaled(self, x: Array) -> Array:
        """Parameters (r,) that correspond to x, without clipping."""
        return np.where(self.by_logarithm, np.exp(np.where(self.by_logarithm, x, 0.0)), x * self.unit)

    @property
    def measured(self) -> list[Array]:
        """Measured values of every channel at every speed, divided by the scale of the channel."""
        return [
            _real_values(values) / self.scales[name]
            for data in self.sets
            for name, values in data.channels.items()
        ]

    @property
    def ratios(self) -> dict[str, float]:
        """Mapping from each channel to the ratio of the measured to the initially computed values."""
        names = [name for data in self.sets for name in data.channels]
        measured = self.measured
        ends = np.cumsum([len(values) for values in measured])[:-1]
        totals: dict[str, list[float]] = {name: [] for name in self.scales}
        for name, values, residuals in zip(
            names, measured, np.split(self.residuals(self.start), ends), strict=True
        ):
            totals[name] += (values + residuals).tolist()
        with np.errstate(divide="ignore"):
            return {name: float(np.sqrt(len(row)) / np.linalg.norm(row)) for name, row in totals.items()}

    def residuals(self, x: Array) -> Array:
        """Computed minus measured values (k,), divided by the scales of the channels."""
        return self._solve(x)[0]

    def jacobian(self, x: Array) -> Array:
        """Derivatives (k, r) of the residuals with respect to x."""
        return self._solve(x)[1]

    def described(self, x: Array) -> str:
        """Text that lists the free parameters, with values and units."""
        values = zip(self.names, self.values(x).tolist(), strict=True)
        units = self.model.labels.parameter_labels
        return ", ".join(f"{name} = {with_its_unit(value, units[name][0])}" for name, value in values)

    def varied(self, x: Array) -> Model:
        """Model whose free parameters correspond to x."""
        return self.model.varied(dict(zip(self.names, self.values(x).tolist(), strict=True)))

    def _solve(self, x: Array) -> tuple[Array, Array]:
        key = x.tobytes()
        if self._last is None or self._last[0] != key:
            with progress.subtask("trials"):
                model, rate = self.varied(x), np.where(self.by_logarithm, self.values(x), self.unit)
                channels = [row for data in self.sets for row in self.computed(model, data)]
            values = [_real_values(row) / self.scales[name] for name, row, _ in channels]
            derivatives = [
                np.array([_real_values(row) for row in rows]).T / self.scales[name]
                for name, _, rows in channels
            ]
            residuals = np.concatenate(values) - np.concatenate(self.measured)
            self._last = key, residuals, np.concatenate(derivatives) * rate
        return self._last[1], self._last[2]

    def computed(self, model: Model, data: Measured) -> list[tuple[str, Array, Array]]:
        """For every channel of `data`: the name, the computed values (k,), and the derivatives (r, k) of
        these values with respect to the free parameters."""
        if data.position is not None:
            return [(FREQUENCY, *_natural_frequencies(model, data, self.names))]
        orbit = periodic(model, data.speed, self.method, rtol=self.rtol)
        rule = orbit.certified.method
        if not isinstance(rule, Collocated):
            raise ValueOutOfBoundsError(f"method is {rule.name}; allowed for a fit: radau, gauss, auto")
        grid = GridDerivatives(orbit, rule, orbit.steps, dependence_of(orbit, self.names), self.names)
        if data.orders:
            return [
                (name, *_amplitudes(grid, name, data.at, np.iscomplexobj(values)))
                for name, values in data.channels.items()
            ]
        return [
            (name, grid.orbit.signal(name)(data.at), grid.forward.signal(name, data.at))
            for name in data.channels
        ]


def _amplitudes(grid: GridDerivatives, name: str, orders: Array, with_angles: bool) -> tuple[Array, Array]:
    """Return the complex amplitudes (k,) of orders, and their derivatives (r, k). If `with_angles` is False,
    the moduli are returned instead, except that the mean keeps its sign."""
    pairs = [grid.figures.harmonic(name, round(order)) for order in orders.tolist()]
    amplitudes = np.array([amplitude for amplitude, _ in pairs])
    derivatives = np.array(grid.forward.derivatives_of([sums for _, sums in pairs])).T
    if with_angles:
        return amplitudes, derivatives
    size = np.abs(amplitudes)
    direction = np.where(orders == 0, 1.0, amplitudes / np.where(size > 0, size, 1.0))
    return np.real(amplitudes * np.conj(direction)), np.real(derivatives * np.conj(direction))


def _real_values(values: Array) -> Array:
    """Return real values unchanged, and complex values as their real parts followed by their imaginary
    parts."""
    return np.concatenate((np.real(values), np.imag(values))) if np.iscomplexobj(values) else values


def _natural_frequencies(model: Model, data: Measured, names: Sequence[str]) -> tuple[Array, Array]:
    """Return natural frequencies (k,) at rest in rad/s, and their derivatives (r, k). A growth rate is
    returned as a negative frequency, so that a trial with negative stiffness has a large residual."""
    modes, position = _modes(data), np.array([data.position])
    count = int(modes.max()) + 1
    values = natural(model, position, count).signed[0, modes]
    if model.capabilities.structure is None:
        derivatives = _eigenvalue_derivatives(model, position, names)[:, modes]
        elastic = values != 0
        factor = np.where(elastic, 2 * np.abs(values), 1.0)
        return values, np.where(elastic, derivatives / factor, 0.0)

    def of_elements(varied: Model) -> Array:
        return natural(varied, position, count).signed[0, modes]

    return values, np.array([_slope(of_elements, model, name) for name in names])


def require_elastic_modes(model: Model, sets: Sequence[Measured]) -> None:
    """Raise ValueOutOfBoundsError if a measured frequency is assigned to a rigid-body mode."""
    for data in sets:
        if data.position is None:
            continue
        modes, (measured,) = _modes(data), data.channels.values()
        computed = natural(model, np.array([data.position]), int(modes.max()) + 1).signed[0]
        rigid = np.flatnonzero((computed[modes] == 0) & (measured != 0))
        if len(rigid):
            first, count = int(rigid[0]), np.count_nonzero(computed == 0)
            number = counted(count, "rigid-body mode")
            raise ValueOutOfBoundsError(
                f"mode {modes[first] + 1} was measured at {measured[first] / (2 * math.pi):.6g} Hz, but is "
                f"a rigid-body mode of frequency 0: {model.labels.name} has {number}, counted first; number "
                f"the elastic modes in the file from {count + 1} on"
            )


def _modes(data: Measured) -> Array:
    """Indices (k,) of the measured modes, from 0."""
    return np.round(data.at).astype(int) - 1


def _eigenvalue_derivatives(model: Model, position: Array, names: Sequence[str]) -> Array:
    """Return the derivatives (r, n) of the eigenvalues λ of K v = λ M v, computed from the derivatives of M
    and K. The eigenvalues are in the order of the modes of `model`."""

    def matrices(varied: Model) -> Array:
        M, _, K, _ = at_speed_zero(varied, position)
        return np.stack((M[0], K[0]))

    derivatives = np.array([_slope(matrices, model, name) for name in names])
    M, K = matrices(model)
    return slopes(M, K, derivatives[:, 0], derivatives[:, 1])


def _slope(values: Callable[[Model], Array], model: Model, name: str) -> Array:
    """Return the derivative of an array with respect to the parameter `name`. The function `values` returns
    the array for a model."""
    at = model.parameters[name]
    return slope(lambda number: values(model.varied({name: number})), at, _STEP * (abs(at) or 1.0))
