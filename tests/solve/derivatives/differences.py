"""Central differences of the results of `solve.periodic` on one grid with Richardson extrapolation, as
reference values of derivatives."""

import numpy as np

import solve
from solve.period.named import Named

PARTS = 3e-2, 1e-3, 1e-4
"""Of a parameter, the first of four steps: large for those that hardly matter, small for the others."""

NOISE = 1e-13
"""Relative error of a value that two neighbours do not share, at least."""

NEIGHBOUR = 2e-15
"""Part of a parameter by which neighbours are apart whose values differ by rounding alone."""


def varied(model, speed, name, number):
    """Return the model and the speed with one quantity changed."""
    return (model, number) if name == "speed" else (model.varied({name: number}), speed)


def differences(model, speed, name, texts, solved=solve.periodic, parts=PARTS, **settings):
    """Return derivatives of the values of `solved` with respect to a parameter or "speed". The steps are
    those for which the difference of the last two extrapolations and the round-off of the values are
    smallest."""
    at = speed if name == "speed" else model.parameters[name]

    def values(number):
        orbit = solved(*varied(model, speed, name, number), **settings)
        return np.array([complex(Named.parse(model, text).value(orbit)) for text in texts])

    def extrapolated(part):
        steps = part * (abs(at) or 0.1) / 2 ** np.arange(4)
        table = np.array([(values(at + step) - values(at - step)) / (2 * step) for step in steps])
        for order in (4, 16, 64):
            before, table = table, (order * table[1:] - table[:-1]) / (order - 1)
        return table[0], np.abs(table[0] - before[1]) + noise / steps[-1]

    near = np.array([values(at * (1 + NEIGHBOUR * k)) for k in range(5)])
    noise = NOISE * np.abs(near[0]) + np.abs(near - near[0]).max(axis=0)
    computed, apart = (np.array(part) for part in zip(*map(extrapolated, parts), strict=True))
    return np.take_along_axis(computed, apart.argmin(axis=0)[None], axis=0)[0]
