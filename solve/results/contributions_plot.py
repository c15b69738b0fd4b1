"""Picture of what each mode gives to an output over the turn."""

import numpy as np

from solve.arrays import Array
from solve.beams.observations import Contributions
from solve.results.plot import label_phases, shades, title_of
from solve.results.quantities import prefixed
from solve.results.style import BLACK, GREY, VERMILION, Figure, page
from solve.system import PeriodicSystem


def contributions_figure(
    model: PeriodicSystem, found: Contributions, speed: float, uncoupled: Array | None = None
) -> Figure:
    """An output over the turn, and each mode's part of it, at a speed in rad/s; uncoupled: values (k,) of
    the output if modes did not couple."""
    factor, unit = prefixed(model.units[found.output], float(np.abs(found.total).max()))
    degrees = np.degrees(found.phase)
    with page(3.3, f"{title_of(model)}: modes at {speed:.6g} rad/s") as figure:
        axes = figure.subplots()
        axes.axhline(0.0, color=GREY, linewidth=0.7)
        axes.plot(degrees, found.total * factor, color=BLACK, linewidth=2.0, label="all modes")
        for number, (values, shade) in enumerate(zip(found.values, shades(len(found.values)), strict=True)):
            axes.plot(degrees, values * factor, label=f"mode {number + 1}", **shade)
        if uncoupled is not None:
            axes.plot(degrees, uncoupled * factor, color=VERMILION, label="uncoupled")
        axes.set_title(model.meanings[found.output], loc="left", color=GREY)
        label_phases(axes, model.period)
        axes.set_ylabel(f"{found.output.replace('_', ' ')} ({unit})")
        figure.legend(loc="outside right center", handlelength=2.4)
    return figure
