"""Machines sampled from a model with randomly deviating parameters: stability and quantities at several
speeds, with gradients."""

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.batch.store import made_folder
from solve.batch.task import Task
from solve.model.model import Model
from solve.model.spread import Spread
from solve.period.multipliers import UNDETERMINED, UNSTABLE
from solve.period.named import RADIUS, Named
from solve.results.points import FAILED
from solve.studies.design_points import Design
from solve.studies.point_values import errors_of, values_of
from solve.studies.probability import MAX_DISTANCE, Gradient
from solve.studies.requirements import Bound
from solve.studies.tracked import leading


class Quantity(NamedTuple):
    """Quantity with its limits. `limits` maps 1 to the tightest upper limit, and -1 to the tightest lower
    limit. A quantity without any limit has the limit 0 in the direction in which its values become worse."""

    named: Named
    limits: Mapping[float, float]

    @classmethod
    def with_bounds(cls, named: Named, bounds: Sequence[Bound]) -> "Quantity":
        """Quantity with the limits that `bounds` contains for `named`. If there are no limits, small values
        of a minimum count as worse, and so do large values of any other quantity."""
        limits: dict[float, float] = {}
        for bound in bounds:
            if bound.quantity.text == named.text:
                others = (limits.get(bound.sign, bound.value), bound.value)
                limits[bound.sign] = min(others) if bound.sign > 0 else max(others)
        return cls(named, limits or {-1.0 if named.figure == "min" else 1.0: 0.0})

    def excess(self, values: Array) -> Array:
        """Distance of values (…) beyond the nearest limit; negative between the limits."""
        return np.max([sign * (values - limit) for sign, limit in self.limits.items()], axis=0)


STABILITY = Bound(f"{RADIUS} < 1", Named(RADIUS, "1", RADIUS), 1.0, 1.0)
"""Bound on the spectral radius; a machine that violates it is unstable."""


class Event(NamedTuple):
    """Event, such as the violation of a limit, at P points and k speeds. `margins` (P, k) are positive where
    the event occurs, and NaN without a result. `occurs` (P,) is True if the event occurs at any of the
    speeds. Where `occurs` is False, `failed` (P,) is True if any of the speeds has no result. Where `failed`
    is also False, `undetermined` (P,) is True if the event is undetermined at any of the speeds."""

    margins: Array
    occurs: Array
    undetermined: Array
    failed: Array

    @classmethod
    def from_points(cls, margins: Array, occurs: Array, is_open: Array, failed: Array) -> "Event":
        """Event from arrays (P, k) for P points and k speeds: the margins, and masks that are True where the
        event occurs, where it is undetermined (`is_open`), and where there is no result."""
        any_occurs, any_open, any_failed = (
            np.asarray(each.any(axis=1)) for each in (occurs, is_open, failed)
        )
        undetermined = any_open & ~any_occurs & ~any_failed
        return cls(margins, any_occurs, undetermined, any_failed & ~any_occurs)


class Outcome(NamedTuple):
    """Results of P machines at k speeds. `unstable` is the event that a machine is unstable. For each bound,
    `beyond` contains the event that this bound is violated. `values` (q, P, k) are the values of q
    quantities."""

    unstable: Event
    beyond: Sequence[Event]
    values: Array


@dataclass(eq=False)
class Machines:
    """Machines whose parameters deviate from those of the model by their spreads, at speeds in rad/s.

    `solves` is the number of machines solved so far.
    """

    model: Model
    spreads: dict[str, Spread]
    speeds: list[float]
    quantities: Sequence[Quantity]
    bounds: Sequence[Bound]
    task: Task
    executor: Executor | None = None
    store: str | Path | None = None
    solves: int = 0

    @property
    def limits(self) -> list[Bound]:
        """List of all limits: the stability limit, and then those in `bounds`."""
        return [STABILITY, *self.bounds]

    @property
    def nominal(self) -> Array:
        """Nominal parameters (1, r), which are those of the model."""
        return np.array([[self.model.parameters[name] for name in self.spreads]])

    def parameters(self, z: Array) -> Array:
        """Parameters (P, r) that correspond to standard normal variables z (P, r)."""
        return np.stack(
            [spread.values(column) for spread, column in zip(self.spreads.values(), z.T, strict=True)], axis=1
        )

    def outcome(self, parameters: Array, folder: str) -> Outcome:
        """Solve machines with parameters (P, r). If results are stored, `folder` is the name of their folder
        in the store. Raises NoResultError."""
        count, speeds, period = len(self.speeds), np.tile(self.speeds, len(parameters)), self.model.period
        points = np.column_stack((np.repeat(parameters, count, axis=0), speeds))
        store = None if self.store is None else made_folder(self.store) / folder
        results = self.task.solved(self.task.batch(points), points, self.executor, store)
        results.require_any()
        self.solves += len(parameters)

        def by_speed(values: Array) -> Array:
            return values.reshape(-1, count)

        verdicts = by_speed(results.verdicts)
        unstable = Event.from_points(
            by_speed(results.spectral_radius - 1),
            verdicts == UNSTABLE,
            verdicts == UNDETERMINED,
            verdicts == FAILED,
        )
        beyond = []
        for bound in self.bounds:
            values = values_of(bound.quantity, results, speeds, period)
            errors = by_speed(errors_of(bound.quantity, values, results, speeds, period))
            margins = bound.sign * by_speed(values - bound.value)
            # An infinite error leaves the event undetermined.
            is_open = ~(np.abs(margins) > errors) & ~np.isnan(margins)
            beyond.append(Event.from_points(margins, (margins > 0) & ~is_open, is_open, np.isnan(margins)))
        every = [by_speed(values_of(each.named, results, speeds, period)) for each in self.quantities]
        return Outcome(unstable, beyond, np.array(every))

    def worst(self, values: Array) -> tuple[Array, Array]:
        """Worst values (P, q) over all speeds, and the indices (P, q) of the speeds of these worst values,
        from `values` (q, P, k). A worst value is NaN if the value at any speed is NaN."""
        excess = [each.excess(each_values) for each, each_values in zip(self.quantities, values, strict=True)]
        speed_indices = np.array(excess).argmax(axis=2)
        return np.take_along_axis(values, speed_indices[..., None], axis=2)[..., 0].T, speed_indices.T

    def design(self, speed: float) -> Design:
        """Design at one speed. The range 0 … 1 of its variables x covers all parameter values whose
        probability is not negligible."""
        low, high = np.array(
            [
                (each.first - MAX_DISTANCE * each.second, each.first + MAX_DISTANCE * each.second)
                if each.normal
                else (each.first, each.second)
                for each in self.spreads.values()
            ]
        ).T
        names, request = list(self.spreads), self.task.request
        rule, rtol = self.task.method, request.rtol
        return Design(self.model, names, low, high, [speed], rule, rtol, request.orbit)

    def gradient(self, limit: Bound, speed: float) -> Gradient:
        """Return a function of z (r,) for a limit at a speed. This function returns the margin of the limit,
        which is positive if the limit is violated, and the derivatives (r,) of the margin with respect to
        z."""
        design = self.design(speed)
        width = design.high - design.low

        def margin(z: Array) -> tuple[float, Array]:
            values = self.parameters(z[None])[0]
            by_z = np.array(
                [float(each.slopes(at)) for each, at in zip(self.spreads.values(), z, strict=True)]
            )
            value, slopes = leading(design, (values - design.low) / width, 0, limit.quantity, limit.sign)
            return value - limit.sign * limit.value, slopes * by_z / width

        return margin
