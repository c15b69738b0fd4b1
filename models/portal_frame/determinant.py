"""The determinant of the frame's dynamic stiffness over the frequency (thesis Fig. 5.1).

With one exact element a bar the fourth frequency, at which no joint moves, is a pole of det D and not a
zero: whoever looks for zeros misses it. With two it is a zero. The count of Wittrick and Williams finds it
with both.
"""

from dataclasses import dataclass

import numpy as np

from solve import frequencies
from solve.arrays import Array
from solve.beams.structure import StructureModel
from solve.views.style import BLACK, BLUE, GREY, VERMILION, Figure, page

_POINTS = 2000
"""Frequencies that are drawn."""

_ELEMENTS = 1, 2
"""A bar, of the determinants that are compared."""


@dataclass(frozen=True)
class Determinants:
    """omega (k,) in rad/s; logarithms (rows, k): ln|det D(ω)/det D(0)| with as many elements a bar as
    `elements` (rows,) says; found (j,): the frequencies up to the largest ω, in rad/s."""

    omega: Array
    elements: tuple[int, ...]
    logarithms: Array
    found: Array


def logarithm(model: StructureModel, omega: Array) -> Array:
    """ln|det D(ω)/det D(0)| (k,) at frequencies (k,) in rad/s of a structure of exact elements."""
    place = model.at_positions(np.zeros(1))
    D = place.dynamic_stiffness(np.zeros(len(omega) + 1, dtype=int), np.append(0.0, omega))
    values = np.linalg.slogdet(D).logabsdet
    return values[1:] - values[0]


def determinants(model: StructureModel, most: float) -> Determinants:
    """Of a frame with one and with two exact elements a bar, from 0 to `most` rad/s."""
    omega = most * (np.arange(_POINTS) + 0.5) / _POINTS
    exact = [model.varied(options={"element": "dynamic", "elements": count}) for count in _ELEMENTS]
    logarithms = np.stack([logarithm(each, omega) for each in exact])
    count = 4
    while (found := frequencies(exact[0], count=count).values[0])[-1] < most:
        count *= 2
    return Determinants(omega, _ELEMENTS, logarithms, found[found < most])


def determinants_figure(made: Determinants, title: str) -> Figure:
    """A curve for each number of elements, and the frequencies as vertical lines (matplotlib Figure)."""
    with page(3.4, title) as figure:
        axes = figure.subplots()
        for value in made.found:
            axes.axvline(value, color=GREY, linewidth=0.7, linestyle=":")
        colours = (BLUE, VERMILION, BLACK)
        for count, line, colour in zip(made.elements, made.logarithms, colours, strict=False):
            label = f"{count} element a bar" if count == 1 else f"{count} elements a bar"
            axes.plot(made.omega, line, color=colour, label=label)
        axes.set_xlim(0, made.omega[-1])
        axes.set_xlabel("frequency (rad/s); dotted: the frame's natural frequencies")
        axes.set_ylabel("ln |det D(ω) / det D(0)|")
        axes.legend()
    return figure
