"""Picture of what each mode gives to an output over the turn."""

import math

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from solve.arrays import Array
from solve.beams.contributions import Contributions
from solve.beams.model import StructureModel
from solve.results.plot import title_of
from solve.results.quantities import prefixed
from solve.results.style import BLACK, GREY, VERMILION, new_figure, styled
from solve.results.turn_plot import DASHES, LIGHTEST


def contributions_figure(
    model: StructureModel, found: Contributions, speed: float, uncoupled: Array | None = None
) -> Figure:
    """An output over the turn, and each mode's part of it, at a speed in rad/s; uncoupled: values (k,) of
    the output if modes did not couple."""
    factor, unit = prefixed(model.units[found.output], float(np.abs(found.total).max()))
    colours = matplotlib.colormaps["viridis"](np.linspace(0.0, LIGHTEST, len(found.values)))
    degrees = np.degrees(found.phase)
    with styled():
        figure = new_figure(3.3)
        figure.suptitle(f"{title_of(model)}: modes at {speed:.6g} rad/s", fontweight="bold")
        axes = figure.subplots()
        axes.axhline(0.0, color=GREY, linewidth=0.7)
        axes.plot(degrees, found.total * factor, color=BLACK, linewidth=2.0, label="all modes")
        for number, values in enumerate(found.values):
            dashes = DASHES[number % len(DASHES)]
            style = {"color": colours[number], "dashes": dashes, "label": f"mode {number + 1}"}
            axes.plot(degrees, values * factor, **style)
        if uncoupled is not None:
            axes.plot(degrees, uncoupled * factor, color=VERMILION, label="uncoupled")
        axes.set_title(model.meanings[found.output], loc="left", color=GREY)
        axes.set_xlim(0.0, math.degrees(model.period))
        axes.xaxis.set_major_locator(MultipleLocator(math.degrees(model.period) / 12))
        axes.set_xlabel("phase (°)")
        axes.set_ylabel(f"{found.output.replace('_', ' ')} ({unit})")
        figure.legend(loc="outside right center", handlelength=2.4)
    return figure
