"""Determinant of the frame's dynamic stiffness versus frequency (Fig. 5.1 of the thesis).

At the fourth natural frequency, no joint moves. With one exact element per bar, this frequency is therefore a
pole of det D instead of a zero, and a search for zeros misses it. With two elements per bar, it is a zero.
The algorithm of Wittrick and Williams finds the frequency in both cases.
"""

from dataclasses import dataclass

import numpy as np

from solve import frequencies
from solve.arrays import Array
from solve.beams.structure import StructureModel
from solve.views.style import BLACK, BLUE, GREY, VERMILION, Figure, page

_POINTS = 2000
"""Number of frequencies in the figure."""

_ELEMENTS = 1, 2
"""Numbers of elements per bar for which the determinants are compared."""


@dataclass(frozen=True)
class Determinants:
    """Determinants at frequencies `omega` (k,) in rad/s.

    Row r of `logarithms` (rows, k) contains ln|det D(ω)/det D(0)| for `elements[r]` elements per bar. `found`
    (j,) are the natural frequencies up to the largest ω, in rad/s.
    """

    omega: Array
    elements: tuple[int, ...]
    logarithms: Array
    found: Array


def logarithm(model: StructureModel, omega: Array) -> Array:
    """Return ln|det D(ω)/det D(0)| (k,) of a structure of exact elements, at frequencies ω (k,) in rad/s."""
    place = model.at_positions(np.zeros(1))
    D = place.dynamic_stiffness(np.zeros(len(omega) + 1, dtype=int), np.append(0.0, omega))
    values = np.linalg.slogdet(D).logabsdet
    return values[1:] - values[0]


def determinants(model: StructureModel, most: float) -> Determinants:
    """Compute the determinants of a frame with one and with two exact elements per bar, for frequencies from
    0 to `most` rad/s."""
    omega = most * (np.arange(_POINTS) + 0.5) / _POINTS
    exact = [model.varied(options={"element": "dynamic", "elements": count}) for count in _ELEMENTS]
    logarithms = np.stack([logarithm(frame, omega) for frame in exact])
    count = 4
    while (found := frequencies(exact[0], count=count).values[0])[-1] < most:
        count *= 2
    return Determinants(omega, _ELEMENTS, logarithms, found[found < most])


def determinants_figure(result: Determinants) -> Figure:
    """Figure with one curve per number of elements, and the natural frequencies as vertical lines."""
    with page(3.4, "Portal frame: determinant of the dynamic stiffness") as figure:
        axes = figure.subplots()
        for value in result.found:
            axes.axvline(value, color=GREY, linewidth=0.7, linestyle=":")
        colours = (BLUE, VERMILION, BLACK)
        for count, line, colour in zip(result.elements, result.logarithms, colours, strict=False):
            label = f"{count} element per bar" if count == 1 else f"{count} elements per bar"
            axes.plot(result.omega, line, color=colour, label=label)
        axes.set_xlim(0, result.omega[-1])
        axes.set_xlabel("frequency (rad/s); dotted: the frame's natural frequencies")
        axes.set_ylabel("ln |det D(ω) / det D(0)|")
        axes.legend()
    return figure
