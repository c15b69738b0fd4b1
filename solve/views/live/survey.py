"""Sweeps and charts of the live window. The page requests a sweep or chart, and the background process
computes it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from solve.arrays import Array
from solve.errors import ValueOutOfBoundsError, require_name
from solve.labels import SPEED, known_quantities
from solve.model.model import Model
from solve.period.named import HARMONIC, RADIUS, Named
from solve.period.signals import FIGURES
from solve.results.formatting import greek, headed, named, prefixed
from solve.studies.chart import chart
from solve.studies.sweep import sweep
from solve.units import ShownUnit, raised
from solve.views.live.controls import typed
from solve.views.live.picture import shortened

MOST_POINTS, MOST_ACROSS = 2000, 120
"""Maximum number of points of a sweep, and maximum number of values along each side of a chart. Chosen by
judgement."""


@dataclass(frozen=True)
class Axis:
    """Varied quantity with `count` values from `low` to `high`, in the unit of its slider."""

    name: str
    low: float
    high: float
    count: int
    logarithmic: bool = False

    @classmethod
    def from_request(cls, model: Model, unit: ShownUnit, values: Mapping[str, Any], most: int) -> Self:
        """Axis from the request of a page, with limits in any unit. `unit` applies to speeds without a unit.
        Raises SolveError subclasses."""
        name, count = str(values.get("name")), str(values.get("count"))
        low, high = (typed(model, name, str(values.get(end)), unit) for end in ("low", "high"))
        if low >= high:
            raise ValueOutOfBoundsError(
                f"{name} ranges from {low:g} to {high:g}; give two different values, the smaller first"
            )
        if not (count.isdecimal() and 2 <= int(count) <= most):
            raise ValueOutOfBoundsError(
                f"number of points of {name} is {count}; allowed: whole numbers 2 … {most}"
            )
        return cls(name, low, high, int(count), bool(values.get("logarithmic")) and low > 0)

    @property
    def values(self) -> Array:
        """Values in the unit of the slider."""
        if self.logarithmic:
            return np.geomspace(self.low, self.high, self.count)
        return np.linspace(self.low, self.high, self.count)

    def in_model_unit(self, unit: ShownUnit) -> Array:
        """Values in the unit of the model, and speeds in rad/s. `unit` is the unit in which speeds are
        shown."""
        return self.values * unit.size if self.name == SPEED else self.values

    def record(self, model: Model, unit: ShownUnit) -> dict[str, Any]:
        """Data of the axis for the page, as a JSON object."""
        model_unit, meaning = model.labels.parameter_labels.get(self.name, ("rad/s", "speed of the drive"))
        shown = unit.name if self.name == SPEED else raised(model_unit)
        label = "Ω" if self.name == SPEED else greek(self.name)
        return {
            "name": self.name,
            "label": headed(label, shown),
            "meaning": meaning,
            "values": self.values.tolist(),
            "logarithmic": self.logarithmic,
        }


@dataclass(frozen=True)
class Survey:
    """Request for a chart of a model or, if `y` is None, for a sweep.

    `speed` is the speed in rad/s if neither axis is the speed. `unit` is the unit of the slider of the speed.
    `of` is the name of the quantity.
    """

    model: Model
    speed: float
    unit: ShownUnit
    x: Axis
    y: Axis | None
    of: str

    @classmethod
    def of_page(cls, model: Model, speed: float, unit: ShownUnit, request: Mapping[str, Any]) -> Self:
        """Survey from the request of a page. Raises SolveError subclasses."""
        quantity = Named.parse(model, str(request.get("of", RADIUS)))
        most = MOST_ACROSS if request.get("y") else MOST_POINTS
        x = Axis.from_request(model, unit, request.get("x") or {}, most)
        y = Axis.from_request(model, unit, request["y"], most) if request.get("y") else None
        if y is not None and x.name == y.name:
            raise ValueOutOfBoundsError(f"x and y are both {x.name}; vary two different quantities")
        return cls(model, speed, unit, x, y, quantity.text)

    def run(self) -> dict[str, Any]:
        """Compute the sweep or chart and convert it to a JSON object for the page. Raises SolveError
        subclasses."""
        return self._sweep() if self.y is None else self._chart(self.y)

    def _sweep(self) -> dict[str, Any]:
        model, x, quantity = self.model, self.x, Named.parse(self.model, self.of)
        varies_speed = x.name == SPEED
        speeds = x.in_model_unit(self.unit) if varies_speed else [self.speed]
        over = None if varies_speed else {x.name: x.values}
        shown = [quantity.subject] if quantity.of_orbit else []
        spectra = shown if quantity.figure == HARMONIC else []
        result = sweep(
            model, speeds, quantities=shown, spectra=spectra, harmonics=quantity.number or 1, over=over
        )
        if quantity.figure == HARMONIC:
            values = result.spectrum(quantity.subject)[:, quantity.number]
        elif quantity.of_orbit:
            require_name(f"figure of {quantity.subject} in a sweep", quantity.figure, FIGURES)
            values = result.figures(quantity.subject, quantity.figure)
        elif quantity.subject == RADIUS:
            values = result.spectral_radius
        else:
            raise ValueOutOfBoundsError(f"a sweep cannot show {quantity.text}; choose another quantity")
        points = result.points
        failures = [point.error for point in points]
        if all(failures):
            raise ValueOutOfBoundsError(f"no point has a result: {failures[0]}")
        return {
            "x": x.record(model, self.unit),
            **self._values(quantity, values),
            "verdicts": [point.verdict for point in points],
            "failures": failures,
            "warnings": result.warnings,
        }

    def _chart(self, y: Axis) -> dict[str, Any]:
        quantity = Named.parse(self.model, self.of)
        axes = [{axis.name: axis.in_model_unit(self.unit)} for axis in (self.x, y)]
        speed = None if SPEED in (self.x.name, y.name) else self.speed
        result = chart(
            self.model, *axes, speed=speed, of=None if quantity.subject == RADIUS else quantity.text
        )
        values = result.spectral_radius if result.values is None else result.values
        curves = []
        for curve in result.boundaries:
            points = np.array(curve.points)
            sizes = [self.unit.size if axis.name == SPEED else 1.0 for axis in (self.x, y)]
            curves.append({"name": curve.name, "points": (points / sizes).tolist()})
        return {
            "x": self.x.record(self.model, self.unit),
            "y": y.record(self.model, self.unit),
            **self._values(quantity, np.asarray(values).ravel()),
            "verdicts": [str(verdict) for verdict in np.ravel(result.verdicts)],
            "boundaries": curves,
            "failures": [],
            "warnings": result.warnings,
        }

    def _values(self, quantity: Named, values: Array) -> dict[str, Any]:
        """Return the values of the quantity, in a unit with a prefix, and their label."""
        finite = values[np.isfinite(values)]
        factor, unit = prefixed(quantity.unit, float(np.abs(finite).max()) if len(finite) else 0.0)
        label = (
            named("max_abs", quantity.subject)
            if quantity.figure == "max_abs"
            else quantity.text.replace("_", " ")
        )
        return {"of": quantity.text, "label": headed(label, unit), "values": shortened(factor * values)}


def choices(model: Model) -> list[str]:
    """Return the names of the quantities that the page offers for sweeps and charts."""
    names = [f"{name}.max_abs" for name in known_quantities(model)]
    return [*names, RADIUS] if model.labels.vibrates else names
