"""How much quantities of a solution change with parameters and the speed."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.results.contents import Column, Columns, Facts
from solve.results.lasting import lasting
from solve.results.result import Result
from solve.system import PeriodicSystem

MOST_ROWS, _MOST_NAMED = 12, 6
_UNCERTAIN = 0.01
"""Part of a derivative that its error may be before it deserves a warning."""

_MATTERS = 1e-3
"""Part of the largest elasticity from which on a parameter matters."""

_INDEPENDENT = 1e-8
"""Elasticity, with its error, below which a quantity counts as independent of a parameter: the default
tolerance of orbits and multipliers."""


@lasting
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

    @cached_property
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
    def whole(self) -> dict[str, Any]:
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

    def facts(self) -> Facts:
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
