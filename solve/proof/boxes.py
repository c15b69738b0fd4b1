"""Boxes of two quantities on which the system is proved stable, proved unstable, or remains undecided.

A polynomial on a box is expanded anew on each half of the box, with the matrix that expresses T_k((x ± 1)/2)
by T_j(x). The range of the polynomial lies within c_00 ± Σ' |c_jk|, because |T_j T_k| ≤ 1. Ends of boxes are
doubles with errors below δ half widths. Because |T_j(1 + δ)| ≤ e^(j√(2δ)), these errors increase the sum by
at most the factor e^z, z = p√(2δ_x) + q√(2δ_y).

For one coordinate, let t and D be the trace and the determinant of Φ. Both multipliers lie inside the unit
circle if D < 1 and |t| < 1 + D. One lies outside if D > 1 or |t| > 1 + D (Jury's criterion). With more
coordinates, the verdict follows from the discs of `spectrum`."""

import math
import time
from collections import deque
from concurrent.futures import Executor
from fractions import Fraction
from functools import cache
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.period.multipliers import ASYMPTOTICALLY_STABLE, STABLE, UNDETERMINED, UNSTABLE
from solve.proof.balls import arb, arb_mat, precision
from solve.proof.enclosure import EXACT
from solve.proof.regions import Box, Plane, axis_to_halve, polynomials, require_degrees
from solve.proof.spectrum import multipliers, verdict
from solve.results.chart import ProvedBoxes
from solve.terminal import progress

_UNIT = 2.0**-52
"""Twice the unit round-off. The factor of two allows for rounding errors in the sums that bound rounding
errors."""

_ENDS = 2.0**-45
"""Bound on twice the error of an end of a box, relative to the larger end. The error is at most half of 2^-52
for each of up to 128 halvings."""

_OPEN = 0.001
"""Undecided fraction of the area at which bisection ends. Chosen by judgement."""

_MOST_BOXES = 200_000, 20_000
"""Largest numbers of boxes that are examined: with one coordinate, and with several. Chosen by judgement:
with several coordinates, a box takes a hundred times as long."""

_SMALLEST = 2.0**-8
"""Width of a box, as a fraction of the range, below which a box without polynomials is not bisected. Chosen
by judgement."""

_PRECISION = 53
"""Working precision in bits for the verdicts of boxes with several coordinates."""


class _Piece(NamedTuple):
    """Box with polynomials for k functions: coefficients (k, p+1, q+1) and error bounds (k,). conservative:
    whether det Φ = 1."""

    box: Box
    coefficients: Array
    errors: Array
    conservative: bool


def proved_boxes(plane: Plane, whole: Box, executor: Executor | None = None) -> ProvedBoxes:
    """Compute verdicts on boxes that cover the ranges `whole`. Boxes are bisected until the undecided
    fraction of the area is small, or the largest permitted number of boxes is reached."""
    begun = time.perf_counter()
    require_degrees(plane, _central(whole))
    pieces, ends = _pieces(plane, whole, executor)
    verdicts = [UNDETERMINED] * len(ends)
    queue, open_area = deque(pieces), sum(piece.box.area for piece in pieces)
    with progress.task("% of the area decided", 100) as count:
        for _ in range(_MOST_BOXES[plane.system.n > 1]):
            if not queue or open_area <= _OPEN * whole.area:
                break
            piece = queue.popleft()
            found = _verdict(piece, plane.system.n)
            if found == UNDETERMINED:
                queue.extend(_halves(piece))
                continue
            ends.append(piece.box)
            verdicts.append(found)
            open_area -= piece.box.area
            count.add(100 * piece.box.area / whole.area)
    ends += [piece.box for piece in queue]
    verdicts += [UNDETERMINED] * len(queue)
    return ProvedBoxes(
        np.array([[*box.x, *box.y] for box in ends]),
        np.array(verdicts),
        f"{EXACT}, apart from {' and '.join(plane.names)}, which are any real numbers in a box",
        time.perf_counter() - begun,
    )


def _central(whole: Box) -> Box:
    """Box in the middle of the ranges. It has the smallest size to which boxes without polynomials are
    bisected."""
    x, y = ((low + high) / 2 + np.array([-0.5, 0.5]) * _SMALLEST * (high - low) for low, high in whole)
    return Box((float(x[0]), float(x[1])), (float(y[0]), float(y[1])))


def _pieces(plane: Plane, whole: Box, executor: Executor | None) -> tuple[list[_Piece], list[Box]]:
    """Return boxes with polynomials, and undecided boxes without polynomials. Near an undecided box, the
    equations are not analytic."""
    found, without, pending = [], [], [whole]
    while pending:
        box = pending.pop()
        pieces = polynomials(plane, box, executor)
        if pieces is not None:
            found.append(_Piece(box, pieces.coefficients, pieces.errors, pieces.conservative))
            continue
        widths = [(side[1] - side[0]) / (all_[1] - all_[0]) for side, all_ in zip(box, whole, strict=True)]
        axis = axis_to_halve(plane, box, widths)
        if widths[axis] <= _SMALLEST:
            without.append(box)
        else:
            pending += box.halved(axis)
    return found, without


def _halves(piece: _Piece) -> list[_Piece]:
    """Bisect a piece in the direction in which its functions vary most."""
    size = np.abs(piece.coefficients)
    axis = int(
        (size[:, :, 1:].sum(axis=(1, 2)) / size.sum(axis=(1, 2))).max()
        > (size[:, 1:].sum(axis=(1, 2)) / size.sum(axis=(1, 2))).max()
    )
    halves = []
    for box, side in zip(piece.box.halved(axis), (-1, 1), strict=True):
        by = _halving(piece.coefficients.shape[1 + axis], side)
        if axis == 0:
            coefficients = by @ piece.coefficients
            bounds = np.abs(by) @ size
        else:
            coefficients = piece.coefficients @ by.T
            bounds = size @ np.abs(by).T
        rounding = (len(by) + 3) * _UNIT * bounds.sum(axis=(1, 2))
        halves.append(_Piece(box, coefficients, piece.errors + 2 * rounding, piece.conservative))
    return halves


@cache
def _halving(count: int, side: int) -> Array:
    """Matrix (count, count) that converts coefficients of Σ c_k T_k(x) to coefficients of the same function
    at (x ± 1)/2; the sign is the sign of `side`. The matrix is computed exactly and rounded once."""
    rows = [[Fraction(1)], [Fraction(side, 2), Fraction(1, 2)]]
    for _ in range(2, count):
        # T_k+1(z) = 2 z T_k(z) − T_k−1(z), 2z = x ± 1, and x T_j = (T_j+1 + T_|j−1|)/2.
        last, before = rows[-1], rows[-2]
        coefficients = [Fraction(0)] * (len(last) + 1)
        for j, c in enumerate(last):
            coefficients[j] += side * c
            coefficients[j + 1] += c / 2
            coefficients[abs(j - 1)] += c / 2
        for j, c in enumerate(before):
            coefficients[j] -= c
        rows.append(coefficients)
    matrix = np.zeros((count, count))
    for k, row in enumerate(rows[:count]):
        matrix[: len(row), k] = [float(c) for c in row]
    return matrix


def _verdict(piece: _Piece, n: int) -> int:
    """Index in VERDICTS of the verdict that is proved for the whole box."""
    c = piece.coefficients
    middle = c[:, 0, 0]
    z = sum(
        (count - 1) * math.sqrt(2 * _ENDS * max(map(abs, side)) / (side[1] - side[0]))
        for count, side in zip(c.shape[1:], piece.box, strict=True)
    )
    if not z < 1:
        return UNDETERMINED
    # e^z < 1 + 2z.
    radius = (np.abs(c).sum(axis=(1, 2)) - np.abs(middle)) * (1 + 2 * z)
    # All bounds on rounding errors (of the sums, of the difference and of the additions below) are doubled.
    radius = (
        radius * (1 + 8 * _UNIT) + (c[0].size + 8) * _UNIT * np.abs(c).sum(axis=(1, 2)) + 2 * piece.errors
    )
    if n == 1:
        return _of_one_coordinate(middle, radius, piece.conservative)
    with precision(_PRECISION):
        balls = [arb(value, by) for value, by in zip(middle.tolist(), radius.tolist(), strict=True)]
        Phi = arb_mat(2 * n, 2 * n, balls)
        return verdict(Phi, multipliers(Phi), conservative=False)


def _of_one_coordinate(middle: Array, radius: Array, conservative: bool) -> int:
    (t, D), (by, more) = middle.tolist(), radius.tolist()
    if conservative:
        D, more = 1.0, 0.0
    margin, spread = 1 + D - abs(t), (by + more) * (1 + 2 * _UNIT) + 8 * _UNIT * (1 + abs(D) + abs(t))
    if margin < -spread or D - more > 1 + 4 * _UNIT:
        return UNSTABLE
    if margin <= spread:
        return UNDETERMINED
    if conservative:
        return STABLE
    return ASYMPTOTICALLY_STABLE if D + more < 1 - 4 * _UNIT else UNDETERMINED
