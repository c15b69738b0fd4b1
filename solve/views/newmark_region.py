"""A picture of where Newmark's method is stable (after thesis Fig. 6.1)."""

from typing import Any

import numpy as np

from solve.methods.newmark import stability_limit
from solve.views.style import BLACK, BLUE, GREY, LIGHT, ORANGE, VERMILION, Figure, new_figure, styled

_POINTS = {
    "average acceleration": (0.5, 1 / 4),
    "linear acceleration": (0.5, 1 / 6),
    "Fox–Goodwin": (0.5, 1 / 12),
    "central differences": (0.5, 0.0),
}
_GROWING = "γ = 1/4, β = 1/6"

_LEVELS = (1.5, 2.0, 2.5, 3.0, 4.0, 6.0)


def newmark_region_figure() -> Figure:
    """The (γ, β) plane: unstable for γ < 1/2, stable to a limit of ω h (contours), stable at any step."""
    with styled():
        figure = new_figure(4.3)
        axes = figure.add_subplot()
        gamma = np.linspace(0.5, 1.0, 201)
        axes.axvspan(0.18, 0.5, color=LIGHT, lw=0)
        axes.fill_between(gamma, gamma / 2, (gamma + 0.5) ** 2 / 4, color=ORANGE, alpha=0.35, lw=0)
        axes.fill_between(gamma, (gamma + 0.5) ** 2 / 4, 0.7, color=BLUE, alpha=0.22, lw=0)
        axes.plot(gamma, gamma / 2, color=BLACK)
        axes.plot(gamma, (gamma + 0.5) ** 2 / 4, color=BLACK, ls="--")
        axes.axvline(0.5, color=BLACK)
        coarse, beta = np.linspace(0.5, 1.0, 151), np.linspace(0.0, 0.5, 151)
        limit = np.array([[stability_limit(g, b) for g in coarse] for b in beta])
        lines = axes.contour(coarse, beta, limit, levels=_LEVELS, colors=GREY, linewidths=0.7)
        places = [(0.86, 0.86 / 2 - 1 / level**2) for level in _LEVELS]
        axes.clabel(lines, fmt="%g", fontsize=7.5, manual=places)
        apart: dict[str, Any] = {"textcoords": "offset fontsize"}
        for name, place in _POINTS.items():
            axes.plot(*place, "o", color=BLACK, clip_on=False, zorder=3)
            axes.annotate(name, place, (-0.7, 0.0), ha="right", va="center", **apart)
        axes.plot(0.25, 1 / 6, "o", color=VERMILION)
        axes.annotate(_GROWING, (0.25, 1 / 6), (0, 0.8), ha="center", color=VERMILION, **apart)
        axes.annotate("unstable at any step: energy grows", (0.34, 0.48), ha="center")
        axes.annotate("stable at any step", (0.62, 0.48), ha="center")
        white = {"boxstyle": "square,pad=0.15", "color": "white"}
        axes.annotate("stable up to the ω h on the line", (0.75, 0.015), ha="center", bbox=white)
        line = {"arrowstyle": "-", "color": GREY, "lw": 0.7}
        damped = "stable at any step;\nlong steps decay without oscillating"
        axes.annotate(damped, (0.93, 0.49), (0.8, 0.60), ha="center", va="center", arrowprops=line)
        axes.set(xlim=(0.18, 1.0), ylim=(-0.02, 0.65), xlabel="γ", ylabel="β")
        axes.grid(False)
        axes.set_title("Newmark's method on an undamped oscillator")
    return figure
