"""Derivatives of quantities with respect to parameters and speed, at one or several speeds."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from solve.arguments import matches_annotations, require_index
from solve.arrays import Array
from solve.equations import warnings_of
from solve.errors import counted, require_name
from solve.results.contents import MOST_SHOWN, Column, Columns, HeaderRows, speeds_of
from solve.results.result import Result
from solve.results.serialization import serializable, stored_property
from solve.system import PeriodicSystem

MOST_ROWS = 12
"""Maximum number of parameters for each quantity in figures and tables at one speed. Chosen by judgement."""

_UNCERTAIN = 0.01
"""Relative error of a derivative above which a warning is issued. Chosen by judgement."""

_MATTERS = 1e-3
"""Fraction of a quantity's largest elasticity below which the effect of a parameter is negligible, so that no
warning about its derivative is issued. Chosen by judgement."""

_INDEPENDENT = 1e-8
"""Elasticity plus its error below which a quantity counts as independent of a parameter: the default
tolerance of orbits and multipliers."""


@serializable
@dataclass(frozen=True)
class Sensitivity:
    """Derivatives of one quantity, with their errors.

    Attributes
    ----------
    value, unit : float or complex, str
        Value of the quantity, and its unit.
    derivatives, errors : (r,) array
        Derivatives with respect to the parameters, and their estimated absolute errors, in SI units; NaN if
        `reason` is not empty.
    reason : str
        Reason why there are no derivatives.
    """

    value: float | complex
    unit: str
    derivatives: Array
    errors: Array
    reason: str = ""


@dataclass(frozen=True)
class Sensitivities(Result):
    """Derivatives of quantities with respect to parameters and speed, from `solve.sensitivities`. Also
    derivatives of critical speeds and of edges of bands, from `solve.speed_sensitivities`.

    Attributes
    ----------
    speed : float or None
        Speed in rad/s; None for derivatives of speeds.
    by : mapping of str to float
        Parameters with their values.
    found : mapping of str to Sensitivity
        Sensitivities of each quantity.
    method, steps : str, int
        Method, and number of steps per period. Derivatives are exact except for the error of the method.
    notes : sequence of str
        Notes on the computation.
    """

    system: PeriodicSystem
    speed: float | None
    by: Mapping[str, float]
    found: Mapping[str, Sensitivity]
    method: str
    steps: int
    notes: Sequence[str] = ()

    def __getitem__(self, quantity: str) -> dict[str, float | complex]:
        """Mapping from parameters to the derivatives of a quantity."""
        return dict(zip(self.by, self.found[quantity].derivatives.tolist(), strict=True))

    @matches_annotations
    def elasticities(self, quantity: str) -> dict[str, float | complex]:
        """Mapping from parameters θ to the elasticities (θ/q) ∂q/∂θ of a quantity q; NaN if q is 0."""
        require_name("quantity", quantity, self.found)
        one = self.found[quantity]
        scale = 1 / one.value if one.value != 0 else math.nan
        return dict(zip(self.by, (one.derivatives * self._values * scale).tolist(), strict=True))

    @property
    def _values(self) -> Array:
        return np.array(list(self.by.values()))

    @stored_property
    def warnings(self) -> list[str]:
        """Warnings about quantities without derivatives, and about inaccurate derivatives, one sentence
        each."""
        sentences = [one.reason for one in self.found.values() if one.reason]
        for quantity, one in self.found.items():
            sizes = np.abs(one.derivatives * self._values)
            matters = sizes > _MATTERS * np.nanmax(sizes, initial=0.0)
            matters &= sizes + one.errors * np.abs(self._values) > _INDEPENDENT * abs(one.value)
            doubtful = matters & (one.errors > _UNCERTAIN * np.abs(one.derivatives))
            names = [name for name, doubt in zip(self.by, doubtful, strict=True) if doubt]
            if names:
                sentences.append(
                    f"errors of the derivatives of {quantity} with respect to {', '.join(names)} "
                    f"exceed {100 * _UNCERTAIN:g} %; give a smaller rtol or more steps"
                )
        return [*sentences, *([] if self.speed is None else warnings_of(self.system, self.speed))]

    @property
    def summary_values(self) -> dict[str, Any]:
        return {
            "speed": self.speed,
            "method": self.method,
            "steps": self.steps,
            "values": {quantity: one.value for quantity, one in self.found.items()},
            "units": {quantity: one.unit for quantity, one in self.found.items()},
            "by": dict(self.by),
            "sensitivities": {quantity: self[quantity] for quantity in self.found},
            "elasticities": {quantity: self.elasticities(quantity) for quantity in self.found},
            "errors": {
                quantity: dict(zip(self.by, one.errors, strict=True)) for quantity, one in self.found.items()
            },
        }

    @property
    def columns(self) -> Columns:
        """Columns of the table, with one row per quantity and parameter."""
        sensitivities = self.found.values()
        slopes = np.array([one.derivatives for one in sensitivities], dtype=complex).ravel()
        relative = [list(self.elasticities(quantity).values()) for quantity in self.found]
        elasticities = np.array(relative, dtype=complex).ravel()
        errors = np.concatenate([one.errors for one in sensitivities])
        return {
            "quantity": Column([name for name in self.found for _ in self.by], "", "quantity"),
            "by": Column([*self.by] * len(self.found), "", "parameter"),
            "derivative": Column(np.real(slopes), "", "in SI units, real part"),
            "derivative_im": Column(np.imag(slopes), "", "imaginary part, of complex quantities"),
            "error": Column(errors, "", "estimated error of the derivative"),
            "elasticity": Column(
                np.real(elasticities), "1", "elasticity (relative change per relative change), real part"
            ),
            "elasticity_im": Column(np.imag(elasticities), "1", "imaginary part, of complex quantities"),
        }

    def header_rows(self) -> HeaderRows:
        steps = counted(self.steps, "step")
        return [] if self.speed is None else [("method", f"{self.method}, {steps} per period")]

    @property
    def summary(self) -> str:
        """Sentence on the parameter with the largest elasticity of each quantity."""
        parts = []
        for quantity, one in itertools.islice(self.found.items(), MOST_SHOWN):
            certain = one.errors <= _UNCERTAIN * np.abs(one.derivatives)
            sizes = self.elasticities(quantity)
            accurate = {
                by for by, sure in zip(sizes, certain, strict=True) if sure and np.isfinite(sizes[by])
            }
            name = next((by for by in self.ranked(quantity) if by in accurate), None)
            if name is not None:
                parts.append(f"{quantity} by {name} ({number(sizes[name], 3)} % per 1 %)")
        return f"Largest elasticities: {', '.join(parts)}." if parts else ""

    @matches_annotations
    def ranked(self, quantity: str) -> list[str]:
        """Names of the parameters in order of decreasing elasticity of the quantity."""
        require_name("quantity", quantity, self.found)
        sizes = np.abs(self.found[quantity].derivatives * self._values)
        absolute = np.abs(self.found[quantity].derivatives)
        order = np.lexsort((-np.nan_to_num(absolute), -np.nan_to_num(sizes)))
        names = list(self.by)
        return [names[k] for k in order if absolute[k] != 0 or len(names) <= MOST_ROWS]


def number(value: Any, digits: int) -> str:
    """Format a real or complex number."""
    if np.iscomplexobj(value):
        return f"{value.real:.{digits - 2}g}{value.imag:+.{digits - 2}g}i"
    return f"{value:.{digits}g}" if math.isfinite(value) else "–"


_AXES = ("speed", "quantity", "by")


@dataclass(frozen=True)
class SensitivitiesOver(Result):
    """Derivatives of q quantities with respect to r parameters at P speeds, from `solve.sensitivities_over`.

    Attributes
    ----------
    speeds : (P,) array
        Speeds in rad/s.
    quantities, by : sequence of str
        Names of the quantities and of the parameters.
    at : (P, r) array
        Values of the parameters.
    values : (P, q) array
        Values of the quantities in SI units.
    derivatives, errors : (P, q, r) array
        Derivatives and their estimated absolute errors in SI units; NaN where `reasons` states why.
    reasons : mapping of int to sequence of str
        Mapping from indices of speeds to reasons why there are no derivatives at the speed, or no derivatives
        of a quantity.
    """

    system: PeriodicSystem
    speeds: Array
    quantities: Sequence[str]
    by: Sequence[str]
    at: Array
    values: Array
    derivatives: Array
    errors: Array
    reasons: Mapping[int, Sequence[str]]

    @property
    def elasticities(self) -> Array:
        """Elasticities (θ/q) ∂q/∂θ (P, q, r) of quantities q with respect to parameters θ; NaN if q is 0."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(
                self.values[..., None] != 0,
                self.derivatives * self.at[:, None] / self.values[..., None],
                np.nan,
            )

    def __getitem__(self, quantity: str) -> dict[str, Array]:
        """Mapping from parameters to the derivatives (P,) of a quantity."""
        place = list(self.quantities).index(quantity)
        return dict(zip(self.by, self.derivatives[:, place].T, strict=True))

    @stored_property
    def warnings(self) -> list[str]:
        """Warnings about speeds and quantities without derivatives, one sentence each."""
        return self._reduction + [
            f"{reason} (at {self.system.labels.speed_unit.text(self.speeds[index])})"
            for index, reasons in self.reasons.items()
            for reason in reasons
        ]

    @property
    def summary_values(self) -> dict[str, Any]:
        def by_name(values: Array) -> dict[str, Any]:
            return {
                quantity: dict(zip(self.by, rows.T, strict=True))
                for quantity, rows in zip(self.quantities, np.moveaxis(values, 1, 0), strict=True)
            }

        return {
            "speeds": self.speeds,
            "values": dict(zip(self.quantities, self.values.T, strict=True)),
            "sensitivities": by_name(self.derivatives),
            "elasticities": by_name(self.elasticities),
            "errors": by_name(self.errors),
        }

    @property
    def columns(self) -> Columns:
        """Columns of the table, with one row per speed, quantity and parameter."""
        return {
            "speed": speeds_of(self.system, self.speeds, axes=_AXES[:1]),
            "quantity": Column(np.array(self.quantities), "", "quantity", axes=_AXES[1:2]),
            "by": Column(np.array(self.by), "", "parameter", axes=_AXES[2:]),
            "derivative": Column(np.real(self.derivatives), "", "in SI units, real part", axes=_AXES),
            "derivative_im": Column(np.imag(self.derivatives), "", "imaginary part", axes=_AXES),
            "error": Column(self.errors, "", "estimated error of the derivative", axes=_AXES),
            "elasticity": Column(np.real(self.elasticities), "1", "relative, real part", axes=_AXES),
            "elasticity_im": Column(np.imag(self.elasticities), "1", "imaginary part", axes=_AXES),
        }

    @matches_annotations
    def ranked(self, place: int) -> list[int]:
        """Indices of the parameters with the largest elasticities of the quantity with index `place`, in
        descending order. The elasticity of a parameter is its maximum over the speeds."""
        require_index("place", place, len(self.quantities))
        sizes = np.nan_to_num(np.abs(self.elasticities[:, place])).max(axis=0)
        return np.argsort(-sizes, kind="stable")[:MOST_SHOWN].tolist()
