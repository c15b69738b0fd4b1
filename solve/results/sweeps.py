"""Response over speed for several systems beside each other, such as one model with several lengths."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.results.plot import label_quantity, label_speeds, shades, title_of
from solve.results.quantities import RPM
from solve.results.style import Figure, page
from solve.results.sweep import Sweep

_PROMINENT = 1e-3
"""Part of its height by which an extreme must stand out from its surroundings."""

PEAK, QUIET = "peak", "quiet"


class Extreme(NamedTuple):
    """A speed (rad/s) where the first system's response is largest or least among its neighbours, which of
    the two, and the responses of all the systems there."""

    speed: float
    kind: str
    responses: tuple[float, ...]


@dataclass(frozen=True)
class Sweeps:
    """Sweeps over the same speeds (rad/s), by the label of their system. title: what the labels are
    values of."""

    title: str
    speeds: Array
    sweeps: Mapping[str, Sweep]

    def figures(self, quantity: str, figure: str = "max_abs") -> Array:
        """A figure of a coordinate or output (systems, speeds), as `Sweep.figures`; NaN where a point
        failed. Raises UnknownNameError."""
        return np.array([each.figures(quantity, figure) for each in self.sweeps.values()])

    def extremes(self, quantity: str, figure: str = "max_abs") -> list[Extreme]:
        """Peaks and quiet speeds of the first system among the given speeds, rising, with what the others
        do there. Raises UnknownNameError."""
        from scipy.signal import find_peaks

        responses = self.figures(quantity, figure)
        order = np.argsort(self.speeds)
        order = order[np.isfinite(responses[0, order])]
        speeds, responses = self.speeds[order], responses[:, order]
        first = responses[0]
        found = []
        for kind, sign in ((PEAK, 1.0), (QUIET, -1.0)):
            at, properties = find_peaks(sign * first, prominence=0.0)
            at = at[properties["prominences"] > _PROMINENT * np.abs(first[at])]
            found += [Extreme(float(speeds[k]), kind, tuple(responses[:, k].tolist())) for k in at]
        return sorted(found)

    def plot(self, quantities: Sequence[str], figure: str = "max_abs") -> Figure:
        """A row a quantity, a curve a system (matplotlib Figure). Raises UnknownNameError."""
        responses = {name: self.figures(name, figure) for name in quantities}
        system = next(iter(self.sweeps.values())).system
        order = np.argsort(self.speeds)
        rpm = self.speeds[order] * RPM
        with page(1.1 + 1.9 * len(responses), f"{title_of(system)}: response over speed") as made:
            axes = made.subplots(len(responses), 1, sharex=True, squeeze=False)[:, 0]
            for place, (name, values) in zip(axes, responses.items(), strict=True):
                factor = label_quantity(place, system, name, values, figure)
                for label, row, shade in zip(self.sweeps, values, shades(len(self.sweeps)), strict=True):
                    place.plot(rpm, row[order] * factor, label=label, **shade)
                if np.nanmin(values, initial=0.0) >= 0:
                    place.set_ylim(bottom=0.0)
            label_speeds(axes[-1], rpm)
            made.align_ylabels(axes)
            handles, names = axes[0].get_legend_handles_labels()
            made.legend(handles, names, title=self.title, loc="outside right center", handlelength=2.4)
        return made
