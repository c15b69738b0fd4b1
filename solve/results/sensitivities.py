"""How much quantities of a solution change with parameters and the speed."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.results.contents import Column, Columns, HeaderRows, speeds_of
from solve.results.result import Result
from solve.results.serialization import serializable, stored_property
from solve.system import PeriodicSystem

MOST_ROWS, _MOST_NAMED = 12, 6
_UNCERTAIN = 0.01
"""Part of a derivative that its error may be before it deserves a warning."""

_MATTERS = 1e-3
"""Part of the largest elasticity from which on a parameter matters."""

_INDEPENDENT = 1e-8
"""Elasticity, with its error, below which a quantity counts as independent of a parameter: the default
tolerance of orbits and multipliers."""


@serializable
@dataclass(frozen=True)
class Sensitivity:
    """Of one quantity: its value, and by each of the quantities θ (r,) derivatives and their estimated
    absolute errors, in SI units; complex where the quantity is, NaN with the reason where it has none."""

    value: float | complex
    unit: str
    derivatives: Array
    errors: Array
    reason: str = ""


@dataclass(frozen=True)
class Sensitivities(Result):
    """Derivatives of quantities at a speed (rad/s) by parameters and the speed, or of speeds themselves.

    by: the values of the parameters by name; found: by quantity. method, steps: on which grid they are exact
    but for the method's own error.
    """

    system: PeriodicSystem
    speed: float | None
    by: Mapping[str, float]
    found: Mapping[str, Sensitivity]
    method: str
    steps: int
    notes: Sequence[str] = ()

    def __getitem__(self, quantity: str) -> dict[str, float | complex]:
        """Derivatives of a quantity by name of the parameter."""
        return dict(zip(self.by, self.found[quantity].derivatives.tolist(), strict=True))

    def elasticities(self, quantity: str) -> dict[str, float | complex]:
        """(θ/q) ∂q/∂θ by name: relative change of the quantity by that of the parameter; NaN where q is 0."""
        found = self.found[quantity]
        scale = 1 / found.value if found.value != 0 else math.nan
        return dict(zip(self.by, (found.derivatives * self._values * scale).tolist(), strict=True))

    @property
    def _values(self) -> Array:
        return np.array(list(self.by.values()))

    @stored_property
    def warnings(self) -> list[str]:
        """Quantities without a derivative, and derivatives that are not well known, a sentence each."""
        found = [each.reason for each in self.found.values() if each.reason]
        for quantity, each in self.found.items():
            sizes = np.abs(each.derivatives * self._values)
            matters = sizes > _MATTERS * np.nanmax(sizes, initial=0.0)
            matters &= sizes + each.errors * np.abs(self._values) > _INDEPENDENT * abs(each.value)
            doubtful = matters & (each.errors > _UNCERTAIN * np.abs(each.derivatives))
            names = [name for name, doubt in zip(self.by, doubtful, strict=True) if doubt]
            if names:
                found.append(
                    f"derivatives of {quantity} by {', '.join(names)} are known to worse than "
                    f"{100 * _UNCERTAIN:g} %; give a smaller rtol or more steps"
                )
        return [*found, *([] if self.speed is None else self.system.warnings(self.speed))]

    @property
    def summary_values(self) -> dict[str, Any]:
        return {
            "speed": self.speed,
            "method": self.method,
            "steps": self.steps,
            "values": {quantity: each.value for quantity, each in self.found.items()},
            "units": {quantity: each.unit for quantity, each in self.found.items()},
            "by": dict(self.by),
            "sensitivities": {quantity: self[quantity] for quantity in self.found},
            "elasticities": {quantity: self.elasticities(quantity) for quantity in self.found},
            "errors": {
                quantity: dict(zip(self.by, each.errors, strict=True))
                for quantity, each in self.found.items()
            },
        }

    @property
    def columns(self) -> Columns:
        """A row a quantity and parameter."""
        every = self.found.items()
        slopes = np.array([each.derivatives for _, each in every], dtype=complex).ravel()
        relative = [list(self.elasticities(quantity).values()) for quantity in self.found]
        elasticities = np.array(relative, dtype=complex).ravel()
        return {
            "quantity": Column([name for name in self.found for _ in self.by], "", "what changes"),
            "by": Column([*self.by] * len(self.found), "", "with which parameter"),
            "derivative": Column(np.real(slopes), "", "in SI units, real part"),
            "derivative_im": Column(np.imag(slopes), "", "imaginary part, of complex quantities"),
            "error": Column(
                np.concatenate([each.errors for _, each in every]), "", "estimated error of the derivative"
            ),
            "elasticity": Column(np.real(elasticities), "1", "relative change by relative change, real part"),
            "elasticity_im": Column(np.imag(elasticities), "1", "imaginary part, of complex quantities"),
        }

    def header_rows(self) -> HeaderRows:
        return [] if self.speed is None else [("method", f"{self.method}, {self.steps} steps a period")]

    @property
    def summary(self) -> str:
        """By what each quantity changes most."""
        parts = []
        for quantity, each in itertools.islice(self.found.items(), _MOST_NAMED):
            certain = each.errors <= _UNCERTAIN * np.abs(each.derivatives)
            sizes = self.elasticities(quantity)
            known = {by for by, sure in zip(sizes, certain, strict=True) if sure and np.isfinite(sizes[by])}
            name = next((by for by in self.ranked(quantity) if by in known), None)
            if name is not None:
                parts.append(f"{quantity} with {name} ({number(sizes[name], 3)} % per 1 % of it)")
        return f"What changes most by a parameter: {', '.join(parts)}." if parts else ""

    def ranked(self, quantity: str) -> list[str]:
        """Names of what the quantity depends on, the largest elasticity first."""
        sizes = np.abs(self.found[quantity].derivatives * self._values)
        absolute = np.abs(self.found[quantity].derivatives)
        order = np.lexsort((-np.nan_to_num(absolute), -np.nan_to_num(sizes)))
        names = list(self.by)
        return [names[at] for at in order if absolute[at] != 0 or len(names) <= MOST_ROWS]


def number(value: Any, digits: int) -> str:
    """A real or a complex number in few characters."""
    if np.iscomplexobj(value):
        return f"{value.real:.{digits - 2}g}{value.imag:+.{digits - 2}g}i"
    return f"{value:.{digits}g}" if math.isfinite(value) else "–"


_MOST = 6
"""Parameters of a quantity that are drawn, and columns of its table."""

_AXES = ("speed", "quantity", "by")


@dataclass(frozen=True)
class SensitivitiesOver(Result):
    """At speeds (P,) in rad/s, of quantities the values (P, q), and by each of the names derivatives and
    their estimated errors (P, q, r), in SI units; NaN where there are none. by: names, at: their values
    (P, r); reasons: why a speed, or a quantity at a speed, has none, by the position of the speed."""

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
        """(θ/q) ∂q/∂θ, (P, q, r); NaN where q is 0."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(
                self.values[..., None] != 0,
                self.derivatives * self.at[:, None] / self.values[..., None],
                np.nan,
            )

    def __getitem__(self, quantity: str) -> dict[str, Array]:
        """Derivatives (P,) of a quantity by name of the parameter."""
        place = list(self.quantities).index(quantity)
        return dict(zip(self.by, self.derivatives[:, place].T, strict=True))

    @stored_property
    def warnings(self) -> list[str]:
        """Why speeds, or quantities there, have no derivatives, a sentence each."""
        return self._reduction + [
            f"{reason} (at {self.system.speed_unit.text(self.speeds[at])})"
            for at, reasons in self.reasons.items()
            for reason in reasons
        ]

    @property
    def summary_values(self) -> dict[str, Any]:
        def by_name(found: Array) -> dict[str, Any]:
            return {
                quantity: dict(zip(self.by, rows.T, strict=True))
                for quantity, rows in zip(self.quantities, np.moveaxis(found, 1, 0), strict=True)
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
        """A row a speed, quantity and parameter."""
        return {
            "speed": speeds_of(self.system, self.speeds, axes=_AXES[:1]),
            "quantity": Column(np.array(self.quantities), "", "what changes", axes=_AXES[1:2]),
            "by": Column(np.array(self.by), "", "with which parameter", axes=_AXES[2:]),
            "derivative": Column(np.real(self.derivatives), "", "in SI units, real part", axes=_AXES),
            "derivative_im": Column(np.imag(self.derivatives), "", "imaginary part", axes=_AXES),
            "error": Column(self.errors, "", "estimated error of the derivative", axes=_AXES),
            "elasticity": Column(np.real(self.elasticities), "1", "relative, real part", axes=_AXES),
            "elasticity_im": Column(np.imag(self.elasticities), "1", "imaginary part", axes=_AXES),
        }

    def ranked(self, place: int) -> list[int]:
        """Positions of the parameters that matter most for a quantity at any of the speeds, most first."""
        sizes = np.nan_to_num(np.abs(self.elasticities[:, place])).max(axis=0)
        return np.argsort(-sizes, kind="stable")[:_MOST].tolist()
