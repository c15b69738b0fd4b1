"""How much quantities change with parameters and the speed, over speed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.results.contents import Column, Columns, speeds_of
from solve.results.result import Result
from solve.system import PeriodicSystem

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

    @cached_property
    def warnings(self) -> list[str]:
        """Why speeds, or quantities there, have no derivatives, a sentence each."""
        return self._reduction + [
            f"{reason} (at {self.system.speed_unit.text(self.speeds[at])})"
            for at, reasons in self.reasons.items()
            for reason in reasons
        ]

    @property
    def whole(self) -> dict[str, Any]:
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
