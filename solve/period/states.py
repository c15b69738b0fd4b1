"""Motions known at states of each revolution: curves through the states, and their error between them."""

import numpy as np

from solve.arrays import Array
from solve.period.curve import Curve

_FEWEST = 256
"""Least number of states per revolution that curves go through."""


def curves_through(nodes: Array, motions: Array) -> Curve:
    """Curves, one a revolution, through motions (turns, 3, n, k) at nodes (k,): q and its first and second
    derivative."""
    q, v, a = np.moveaxis(motions, 1, 0).swapaxes(-1, -2)
    return Curve.quintic(nodes, q, v, a[:, :-1], a[:, 1:])


def interpolation_tolerance(rtol: float) -> float:
    """Error allowed between the states: a tenth of rtol, but at least 1e-9 and at most 1e-3."""
    return min(max(rtol / 10, 1e-9), 1e-3)


def interpolation_error(nodes: Array, motions: Array, jumps: bool) -> Array:
    """Error (turns,) between the states of the curves through motions (turns, 3, n, k), relative to the
    largest of each coordinate and its rates.

    It follows from the errors at every other state of curves through the rest. For q and its first and second
    derivative these fall with the sixth, fifth and fourth power of the steps; a tenth of that of the second
    derivative counts. Where the equations jump they fall with the second power, and second derivatives are
    left out.
    """
    coarse, off = curves_through(nodes[::2], motions[..., ::2]), np.zeros(len(motions))
    for order in range(2 if jumps else 3):
        size = np.abs(motions[:, order]).max(axis=(0, 2), initial=0.0)[:, None]
        missed = np.abs(coarse(nodes[1::2], order) - motions[:, order, :, 1::2])
        part = (missed / np.where(size > 0, size, 1.0)).max(axis=(1, 2)) / 2 ** (2 if jumps else 6 - order)
        off = np.maximum(off, part / 10 if order == 2 else part)
    return off


def sufficient_strides(nodes: Array, motions: Array, jumps: bool, allowed: float) -> Array:
    """Strides (turns,), powers of 2: curves through every so many states are within the allowed error."""
    strides, stride = np.ones(len(motions), dtype=int), 2
    while stride * _FEWEST <= len(nodes) - 1:
        error = interpolation_error(nodes[::stride], motions[..., ::stride], jumps)
        strides[(error <= allowed) & (strides == stride // 2)] = stride
        stride *= 2
    return strides
