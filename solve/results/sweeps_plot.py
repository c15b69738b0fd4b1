"""Picture of several systems' responses over speed."""

import math
from collections.abc import Mapping, Sequence

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from solve.arrays import Array
from solve.results.plot import labelled, title_of
from solve.results.quantities import prefixed
from solve.results.style import GREY, new_figure, styled
from solve.results.turn_plot import DASHES, LIGHTEST
from solve.system import PeriodicSystem

_RPM = 30 / math.pi


def sweeps_figure(
    system: PeriodicSystem,
    title: str,
    labels: Sequence[str],
    speeds: Array,
    responses: Mapping[str, Array],
    figure: str,
) -> Figure:
    """A row a quantity with responses (systems, speeds), a curve a system, the first darkest."""
    order = np.argsort(speeds)
    rpm = speeds[order] * _RPM
    colours = matplotlib.colormaps["viridis"](np.linspace(0.0, LIGHTEST, len(labels)))
    with styled():
        made = new_figure(1.1 + 1.9 * len(responses))
        made.suptitle(f"{title_of(system)}: response over speed", fontweight="bold")
        axes = made.subplots(len(responses), 1, sharex=True, squeeze=False)[:, 0]
        for place, (name, values) in zip(axes, responses.items(), strict=True):
            largest = float(np.nanmax(np.abs(values), initial=0.0))
            factor, unit = prefixed(system.units.get(name, ""), largest)
            for k, (label, row) in enumerate(zip(labels, values[:, order], strict=True)):
                dashes = DASHES[k % len(DASHES)]
                place.plot(rpm, row * factor, color=colours[k], dashes=dashes, label=label)
            place.set_ylabel(labelled(f"max|{name}|" if figure == "max_abs" else f"{figure} {name}", unit))
            place.set_title(system.meanings.get(name, ""), loc="left", color=GREY)
            if np.nanmin(values, initial=0.0) >= 0:
                place.set_ylim(bottom=0.0)
        axes[-1].set_xlim(rpm[0], rpm[-1])
        axes[-1].set_xlabel("speed (rpm)")
        axes[-1].ticklabel_format(axis="x", scilimits=(-3, 6))
        made.align_ylabels(axes)
        handles, names = axes[0].get_legend_handles_labels()
        made.legend(handles, names, title=title, loc="outside right center", handlelength=2.4)
    return made
