"""Floquet modes along the turn: which order of the rotation a mode mostly vibrates with.

A multiplier tells the frequency of its mode only modulo 2π/T. The mode is p(φ) exp(λt) with a periodic p, and
the order k with the largest part of p tells the frequency that is measured, |Im λ + 2πk/T|."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.period.blocks import Blocks, carried
from solve.period.grid import Grid
from solve.period.product_eigenvalues import ProductEigenvalues

_ALIASED = 0.1
"""Part by which the mean square of the rates may differ from that of the orders that the steps see."""

_SAME = 1e-6
"""Relative difference between the parts of two orders that counts as none."""


class FloquetMode(NamedTuple):
    """folded: Im λ in rad/s, within ±π/T; unfolded: |folded + 2π order/T|; participation: part of the mode
    that has this order, of 1, in the norm of the mean mass matrix. mirror: the other order of a real
    multiplier, which has as large a part and the same frequency; else None.

    None where the method has no maps of steps that could tell, or they are too few.
    """

    folded: float
    unfolded: float | None = None
    order: int | None = None
    participation: float | None = None
    mirror: int | None = None


def floquet_modes(
    steps: Array, grid: Grid, mass: Array, blocks: Blocks, found: ProductEigenvalues, rotation: float
) -> Sequence[FloquetMode]:
    """The modes (N,) of a point, in the order of its eigenvalues `found` with their right vectors.

    steps (m, N, N): maps of the state, coordinates first; mass (n, n): mean of M, in any unit; blocks: of
    these maps; rotation: 2π/T in rad/s.
    """
    p = _periodic_parts(steps, grid, blocks, found)
    if not grid.smooth:
        p = _evenly(grid, p)
    parts = np.fft.fft(p, axis=0)
    of_coordinates, of_rates = (
        (part.conj() * (mass @ part)).sum(axis=1).real for part in np.split(parts, 2, axis=1)
    )
    orders = np.rint(np.fft.fftfreq(len(p), 1 / len(p))).astype(int)
    turn = 2 * math.pi / grid.period
    exponents = found.logarithms[0] / grid.period + 1j * turn * orders[:, None]
    # Rates that are not those of the orders seen belong to a mode that turns too far in a step.
    rates = (np.abs(exponents) ** 2 * of_coordinates).sum(axis=0)
    seen = np.abs(rates - of_rates.sum(axis=0)) <= _ALIASED * of_rates.sum(axis=0)
    shares = of_coordinates / of_coordinates.sum(axis=0)
    folded = np.imag(found.logarithms[0]) * rotation / (2 * math.pi)
    return [
        _mode(angle, rotation, orders, share) if known else FloquetMode(angle)
        for angle, share, known in zip(folded.tolist(), shares.T, seen, strict=True)
    ]


def _mode(folded: float, rotation: float, orders: Array, shares: Array) -> FloquetMode:
    frequencies = folded + orders * rotation
    largest = np.flatnonzero(shares >= (1 - _SAME) * shares.max())
    at = largest[np.argmax(frequencies[largest])]
    order, unfolded = int(orders[at]), abs(float(frequencies[at]))
    opposite = -order - round(2 * folded / rotation)
    real = folded == 0 or math.isclose(folded, rotation / 2)
    mirror = opposite if real and opposite != order else None
    return FloquetMode(folded, unfolded, order, float(shares[at]), mirror)


def _periodic_parts(steps: Array, grid: Grid, blocks: Blocks, found: ProductEigenvalues) -> Array:
    """p (m, N, N) at the beginning of every step, a column a mode, each of any length."""
    assert found.right is not None
    units, starts, logarithms = blocks.units[0][:, None], blocks.starts, found.logarithms[0]
    lengths = np.diff(np.append(starts, len(steps)))
    vectors, reached = carried(steps, starts, units * found.right[0])
    # Each block begins anew with vectors of length 1: what the one before leaves, but for a factor.
    following = np.roll(found.right[0], -1, axis=0)
    with np.errstate(divide="ignore"):
        gained = np.log((following.conj() * (reached / units)).sum(axis=1))
    exponents = np.repeat(np.cumsum(gained, axis=0) - gained, lengths, axis=0)
    exponents -= grid.nodes[:-1, None] / grid.period * logarithms
    exponents -= np.real(exponents).max(axis=0)
    return vectors * np.exp(exponents)[:, None, :]


def _evenly(grid: Grid, p: Array) -> Array:
    """Values (m, …) at the nodes of an uneven grid, as many as two a step at even phases."""
    from scipy.interpolate import CubicSpline

    even = np.arange(2 * grid.steps) * (grid.period / (2 * grid.steps))
    return CubicSpline(grid.nodes, np.concatenate((p, p[:1])), bc_type="periodic")(even)
