"""Blocks: products of the maps of neighbouring steps. Maps are multiplied only as long as the product is
accurate."""

from dataclasses import dataclass

import numpy as np

from solve.arrays import EPS, Array, solved
from solve.period.eigenvalues import balance_matrices

LOSS = 1e-12
"""Largest accepted round-off error of a product of neighbouring maps, relative to the smallest singular value
of the product. Chosen by judgement."""


@dataclass(frozen=True)
class Blocks:
    """Factors (P, m, N, N) whose product is the map of the period, in scaled states.

    units (P, N): powers of 2. For a right vector x and a left vector y of the factors, the vectors of the
    steps are units · x and y / units. variance (P, m, N, N): squared errors of the entries of the factors.
    starts (m,): index of the first step of each block."""

    factors: Array
    variance: Array
    units: Array
    starts: Array

    def in_units(self, units: Array) -> "Blocks":
        """Convert the blocks to other units (P, N) of the state."""
        ratio = self.units / units
        change = (ratio[:, :, None] / ratio[:, None, :])[:, None]
        return Blocks(self.factors * change, self.variance * change**2, units, self.starts)

    @property
    def rounding(self) -> Array:
        """Frobenius norm (P, m) of the error of each factor."""
        return np.sqrt(self.variance.sum(axis=(-2, -1)))


def balanced_blocks(steps: Array, loss: float = LOSS) -> Blocks:
    """Multiply neighbouring one-step maps (P, m, N, N) into blocks, in units that balance the blocks.

    Maps are in order of application. Neighbours are multiplied as long as the product is accurate in every
    direction at every point; the entries of the maps are assumed to have round-off errors. loss: see
    `LOSS`."""
    blocks = Blocks(steps, (EPS / 2 * steps) ** 2, np.ones(steps.shape[::2]), np.arange(steps.shape[1]))
    blocks, offset, stalled = _balanced(blocks), 0, 0
    while len(blocks.starts) > 1 and stalled < 2:
        A, variance = blocks.factors, blocks.variance
        first = np.arange(offset, A.shape[1] - 1, 2)
        left, right = A[:, first + 1], A[:, first]
        product = left @ right
        # Round-off errors are independent: their squares add up.
        error = (left**2) @ (variance[:, first] + (EPS / 2 * right) ** 2) + variance[:, first + 1] @ right**2
        # Bounds on the singular values are cheaper than the singular values.
        with np.errstate(all="ignore"):
            least = 1 / np.linalg.norm(solved(product, np.eye(product.shape[-1])), axis=(-2, -1))
        joined = np.sqrt(error.sum(axis=(-2, -1))) <= loss * least
        joined = (joined & (least > 1e-60) & (np.abs(product).max(axis=(-2, -1)) < 1e60)).all(axis=0)
        kept, gone = first[joined], first[joined] + 1
        A[:, kept], variance[:, kept] = product[:, joined], error[:, joined]
        rest = np.delete(A, gone, 1), np.delete(variance, gone, 1), np.delete(blocks.starts, gone)
        offset, stalled = 1 - offset, 0 if joined.any() else stalled + 1
        # Balance again: states that are weakly coupled in one step may be strongly coupled over many.
        blocks = _balanced(Blocks(rest[0], rest[1], blocks.units, rest[2]))
    return blocks


def carried(steps: Array, starts: Array, vectors: Array) -> tuple[Array, Array]:
    """Propagate vectors through the steps of each block.

    `vectors` (b, N, …) apply at the starts (b,) of the blocks, `steps` (m, N, N) are the one-step maps.
    Return the vectors at the start of every step (m, N, …) and at the end of every block (b, N, …)."""
    lengths, reached = np.diff(np.append(starts, len(steps))), vectors.copy()
    every = np.empty((len(steps), *vectors.shape[1:]), dtype=vectors.dtype)
    for inner in range(int(lengths.max())):
        inside = np.flatnonzero(lengths > inner)
        every[starts[inside] + inner] = reached[inside]
        reached[inside] = steps[starts[inside] + inner] @ reached[inside]
    return every, reached


def _balanced(blocks: Blocks) -> Blocks:
    """Convert the blocks to units in which the mean of |A| is balanced."""
    A = blocks.factors
    size = np.abs(A) / np.maximum(np.abs(A).max(axis=(2, 3), keepdims=True), np.finfo(float).tiny)
    return blocks.in_units(blocks.units * balance_matrices(size.mean(axis=1))[1])
