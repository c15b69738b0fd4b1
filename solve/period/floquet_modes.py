"""Floquet modes over the period, and their dominant harmonics.

A multiplier determines the frequency of its mode only modulo 2π/T. The mode is p(φ) exp(λt) with a periodic
p. If k is the harmonic of p with the largest participation, a measurement shows the frequency |Im λ + 2πk/T|.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.period.blocks import Blocks, carried
from solve.period.grid import Grid
from solve.period.product_eigenvalues import ProductEigenvalues

ALIASED = 0.1
"""The steps resolve the harmonics of a mode if a measure is at most this value. With a mass matrix, the
measure is the relative difference between the mean square of the rates and its value from the harmonics.
Without a mass matrix, it is the fraction of the mode in the upper third of the harmonics. Chosen by
judgement."""

_SAME = 1e-6
"""Relative difference below which the participations of two harmonics count as equal. Chosen by judgement."""


class FloquetMode(NamedTuple):
    """Frequency and dominant harmonic of a Floquet mode.

    Only `folded` is known if the method computes no maps of the steps, or if the steps are too few.

    Attributes
    ----------
    folded : float
        Im λ in rad/s, within ±π/T.
    unfolded : float or None
        |folded + 2π order/T| in rad/s.
    order : int or None
        Dominant harmonic.
    participation : float or None
        Fraction of the mode in this harmonic, in the norm of the mean mass matrix.
    mirror : int or None
        For a real multiplier, the other harmonic with the same participation and frequency.
    """

    folded: float
    unfolded: float | None = None
    order: int | None = None
    participation: float | None = None
    mirror: int | None = None


def floquet_modes(
    steps: Array,
    grid: Grid,
    mass: Array | None,
    blocks: Blocks,
    eigenvalues: ProductEigenvalues,
    rotation: float,
) -> Sequence[FloquetMode]:
    """Compute the N Floquet modes of a point, in the order of `eigenvalues`.

    Parameters
    ----------
    steps : (m, N, N)
        One-step maps of the states; the coordinates are the first states.
    grid : Grid
    mass : (n, n), optional
        Mean of M in any unit. None for systems with first-order states; participations then include all
        states, in units that balance the maps.
    blocks : Blocks
        Products of the one-step maps.
    eigenvalues : ProductEigenvalues
        Eigenvalues of the product of the blocks, with right eigenvectors.
    rotation : float
        2π/T in rad/s.
    """
    p = periodic_parts(steps, grid, blocks, eigenvalues)
    if not grid.smooth:
        p = _evenly(grid, p)
    spectrum = np.fft.fft(p, axis=0)
    orders = np.rint(np.fft.fftfreq(len(p), 1 / len(p))).astype(int)
    fundamental = 2 * math.pi / grid.period
    exponents = eigenvalues.logarithms[0] / grid.period + 1j * fundamental * orders[:, None]
    if mass is None:
        sizes = (np.abs(spectrum / blocks.units[0][:, None]) ** 2).sum(axis=1)
        # Strong harmonics near the highest one indicate a phase advance of the mode per step that is too
        # large.
        is_resolved = sizes[3 * np.abs(orders) > len(p)].sum(axis=0) <= ALIASED * sizes.sum(axis=0)
    else:
        sizes, of_rates = (
            (half.conj() * (mass @ half)).sum(axis=1).real for half in np.split(spectrum, 2, axis=1)
        )
        # A difference between the rates and those computed from the harmonics indicates the same.
        rates = (np.abs(exponents) ** 2 * sizes).sum(axis=0)
        is_resolved = np.abs(rates - of_rates.sum(axis=0)) <= ALIASED * of_rates.sum(axis=0)
    shares = sizes / sizes.sum(axis=0)
    folded = np.imag(eigenvalues.logarithms[0]) * rotation / (2 * math.pi)
    return [
        _mode(angle, rotation, orders, share) if resolved else FloquetMode(angle)
        for angle, share, resolved in zip(folded.tolist(), shares.T, is_resolved, strict=True)
    ]


def _mode(folded: float, rotation: float, orders: Array, shares: Array) -> FloquetMode:
    """Mode with the folded frequency `folded` and the participations `shares` of the harmonics `orders`.
    Among harmonics of equal participation, the one with the highest frequency is dominant."""
    frequencies = folded + orders * rotation
    largest = np.flatnonzero(shares >= (1 - _SAME) * shares.max())
    at = largest[np.argmax(frequencies[largest])]
    order, unfolded = int(orders[at]), abs(float(frequencies[at]))
    opposite = -order - round(2 * folded / rotation)
    real = folded == 0 or math.isclose(folded, rotation / 2)
    mirror = opposite if real and opposite != order else None
    return FloquetMode(folded, unfolded, order, float(shares[at]), mirror)


def periodic_parts(steps: Array, grid: Grid, blocks: Blocks, eigenvalues: ProductEigenvalues) -> Array:
    """Return the periodic part p (m, N, N) of each mode at the start of every step, in arbitrary norm. Each
    mode is a column."""
    assert eigenvalues.right is not None
    units, starts, logarithms = blocks.units[0][:, None], blocks.starts, eigenvalues.logarithms[0]
    lengths = np.diff(np.append(starts, len(steps)))
    vectors, reached = carried(steps, starts, units * eigenvalues.right[0])
    # The vectors at the start of a block have length 1. They are multiples of the vectors at the end of the
    # previous block.
    following = np.roll(eigenvalues.right[0], -1, axis=0)
    with np.errstate(divide="ignore"):
        gained = np.log((following.conj() * (reached / units)).sum(axis=1))
    exponents = np.repeat(np.cumsum(gained, axis=0) - gained, lengths, axis=0)
    exponents -= grid.nodes[:-1, None] / grid.period * logarithms
    exponents -= np.real(exponents).max(axis=0)
    return vectors * np.exp(exponents)[:, None, :]


def _evenly(grid: Grid, p: Array) -> Array:
    """Interpolate values (m, …) at the nodes of a nonuniform grid. Return values at uniform phases, twice as
    many as steps."""
    from scipy.interpolate import CubicSpline

    even = np.arange(2 * grid.steps) * (grid.period / (2 * grid.steps))
    return CubicSpline(grid.nodes, np.concatenate((p, p[:1])), bc_type="periodic")(even)
