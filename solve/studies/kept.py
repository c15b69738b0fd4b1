"""Quantities that an optimisation must keep unchanged: their initial values, their changes, and the
constraint equations."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from solve.arrays import Array
from solve.period.named import Named
from solve.studies.design_points import Design, DesignPoint
from solve.studies.minimax import Equations, Excess
from solve.studies.requirements import Kept
from solve.studies.tracked import Curve, Differences, Single, Tracked, equal_extrema


@dataclass(eq=False)
class KeptValues:
    """Quantities to be kept unchanged, with their initial values (k,) at each design speed.

    `before[i][j]` contains the initial values of quantity j at speed i.
    """

    design: Design
    kept: Sequence[Kept]
    before: list[list[Array]] = field(default_factory=list)

    def __post_init__(self) -> None:
        if self.kept:
            self.before = [self._values(point) for point in self.design.points(self.design.start)]

    def changes(self, points: Sequence[DesignPoint]) -> list[tuple[Kept, float, float]]:
        """For each quantity: the quantity, its largest change at any of the design speeds, and the allowed
        change."""
        return [
            (
                quantity,
                max(
                    float(np.abs(_values_of(point, quantity) - before[place]).max())
                    for point, before in zip(points, self.before, strict=True)
                ),
                min(quantity.allowed(before[place]) for before in self.before),
            )
            for place, quantity in enumerate(self.kept)
        ]

    def limits(self) -> list[Excess]:
        """Limits on the changes of the quantities that have a tolerance."""
        limits = []
        for at in range(len(self.before)):
            for place, quantity in enumerate(self.kept):
                if quantity.tolerance is not None:
                    smooth = self.smooth(at, place)
                    change = _Change(smooth, smooth.values(self.design.start))
                    limits.append(Excess(change, quantity.tolerance, quantity.tolerance))
        return limits

    def smooth(self, at: int, place: int) -> Tracked:
        """Smooth function for the quantity with index `place` at the speed with index `at`. The values of the
        function are the points of a curve or, for a statistic, all extrema that are equal to the statistic at
        the start."""
        each, design = self.kept[place], self.design
        if each.phases is not None:
            return Curve(design, at, each.name, each.phases)
        if not {*each.figures} <= {"max", "min"}:
            return Single(design, at, Named.parse(design.model, f"{each.name}.{each.figures[0]}"))
        sides = (1.0 if figure == "max" else -1.0 for figure in each.figures)
        return Differences([equal_extrema(design, design.start, at, each.name, side) for side in sides])

    def equations(self) -> Equations | None:
        """Constraint equations of the quantities without a tolerance.

        The equations are linear combinations of the changes, divided by the allowed changes. They follow from
        the singular value decomposition of the derivatives at the start. Combinations that stay within the
        allowed change for all parameters within the bounds are omitted. Such combinations arise if several
        speeds, or neighbouring phases, give the same equation.
        """
        chosen = [
            (at, place)
            for at in range(len(self.before))
            for place, each in enumerate(self.kept)
            if each.tolerance is None
        ]
        if not chosen:
            return None
        smooth = [self.smooth(*each) for each in chosen]
        start = [each.values(self.design.start) for each in smooth]
        allowed = [self.kept[place].allowed(self.before[at][place]) for at, place in chosen]
        scales = 1 / np.repeat(allowed, [len(values) for values in start])

        def slopes(x: Array) -> Array:
            return scales[:, None] * np.concatenate([each.slopes(x) for each in smooth])

        def residuals(x: Array) -> Array:
            changes = [each.values(x) - values for each, values in zip(smooth, start, strict=True)]
            return scales * np.concatenate(changes)

        directions, sizes, _ = np.linalg.svd(slopes(self.design.start), full_matrices=False)
        moved = sizes > 1.0
        # After division by the singular values, the derivatives of the equations have norm 1.
        weights = (directions[:, moved] / sizes[moved]).T
        return Equations(lambda x: weights @ residuals(x), lambda x: weights @ slopes(x))

    def _values(self, point: DesignPoint) -> list[Array]:
        return [_values_of(point, quantity) for quantity in self.kept]


@dataclass(frozen=True)
class _Change:
    """Changes (2 k,) of a quantity from its initial values (k,), followed by the changes with opposite
    sign."""

    smooth: Tracked
    before: Array

    def values(self, x: Array) -> Array:
        change = self.smooth.values(x) - self.before
        return np.concatenate((change, -change))

    def slopes(self, x: Array) -> Array:
        slopes = self.smooth.slopes(x)
        return np.concatenate((slopes, -slopes))


def _values_of(point: DesignPoint, each: Kept) -> Array:
    """Values (k,) of a quantity that is to be kept unchanged."""
    if each.phases is not None:
        return point.signal(each.name, each.phases)
    statistics = point.orbit.statistics(each.name)
    first, *others = (getattr(statistics, figure) for figure in each.figures)
    return np.array([first - sum(others)])
