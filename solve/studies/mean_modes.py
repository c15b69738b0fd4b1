"""Modes with the matrices frozen at phases of a period, followed from phase to phase, and their means."""

from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.period.multipliers import matched
from solve.period.points import rate_of
from solve.period.rigid_body import rigid_body_modes
from solve.system import PeriodicSystem

_PHASES, _FEWER = 64, 16

_ROUNDING, _COMPLEX = 1e-12, 1e-6
"""Negative squares of frequencies, and their imaginary parts, relative to the largest, that are rounding; of
double eigenvalues rounding takes half the digits."""

_LEAST = 1e-30
"""Part of a shape in another that counts as none."""

_NEAR = 0.5
"""Part of their largest difference in the period below which frequencies are near each other."""


class MeanModes(NamedTuple):
    """Means over the cycle of the frozen modes: frequencies in rad/s (n,), ascending, and decay rates in 1/s
    (n,) to first order in C. Frequencies count as 0 where K is not positive. imaginary: whether a frequency
    is imaginary or complex at some phase. rigid: number of rigid-body modes, with frequency 0."""

    frequencies: Array
    rates: Array
    imaginary: bool
    rigid: int = 0


def mean_modes(system: PeriodicSystem, speed: float) -> MeanModes:
    """Of the undamped modes with M and K frozen, at a speed (rad/s), 0 for the mechanism at rest. Raises
    SolveError subclasses and LinAlgError where there are no matrices.

    Modes are followed by their shapes where frequencies cross, see `_followed`; modes that change places
    within a period have one mean. Modes are those of the sorted frequencies instead where the small part of a
    vibration that keeps its rank decays so much more slowly that more of it is left after a period.
    """
    step = system.period / _PHASES
    M, C, K, _ = system.at((np.arange(_PHASES) + 0.5) * step, speed)
    if all((part == part[:1]).all() for part in (M, C, K)):
        M, C, K = M[:1], C[:1], K[:1]
    squares, shapes = np.linalg.eig(np.linalg.solve(M, K))
    rigid = int(rigid_body_modes(K[None], C[None], speed * M[None]).present.sum())
    np.put_along_axis(squares, np.argsort(np.abs(squares), axis=1)[:, :rigid], 0.0, axis=1)
    order = np.argsort(np.real(squares), axis=1)
    squares = np.take_along_axis(squares, order, axis=1)
    shapes = np.take_along_axis(shapes, order[:, None], axis=2)
    real, size = np.real(squares), np.abs(squares).max()
    imaginary = real.min() < -_ROUNDING * size or np.abs(np.imag(squares)).max() > _COMPLEX * size
    # Shapes that are one another's have no inverse.
    inverse = np.linalg.pinv(shapes)
    rates = np.real(np.einsum("kij,kji->ki", inverse @ np.linalg.solve(M, C), shapes)) / 2
    values = np.stack((np.sqrt(np.maximum(real, 0.0)), rates), axis=1)
    ranks, places, kept = _followed(values[:, 0], shapes, inverse, speed / step)
    means, moved = values.mean(axis=0), (ranks != np.arange(system.n)).any(axis=0)
    if moved.any():
        along = _over_turns(np.take_along_axis(values, ranks[:, None], axis=2).mean(axis=0), places)
        faster = along[1, moved].min() - means[1, moved].min()
        if speed == 0 or faster * system.period / speed <= -kept:
            means = along
    means = means[:, np.argsort(means[0], kind="stable")]
    return MeanModes(means[0], means[1], bool(imaginary), rigid)


def shift_by_rates(system: PeriodicSystem, speed: float) -> float:
    """By what part of itself a mean frequency differs at most, at a speed (rad/s), from that of moduli of
    eigenvalues with C, which `mean_modes` leaves out: gyroscopic forces make them differ, and damping that
    couples modes, not what damps each by itself. 0 where some are real."""
    parts = np.s_[: system.n], np.s_[system.n : 2 * system.n]
    rate = rate_of(*system.at((np.arange(_FEWER) + 0.5) * system.period / _FEWER, speed))[..., :-1]
    squares, values = np.linalg.eigvals(-rate[:, system.n :, : system.n]), np.linalg.eigvals(rate)
    rigid = int(rigid_body_modes(*(-rate[None, :, system.n :, part] for part in parts)).present.sum())
    squares, values = _without_least(squares, rigid), _without_least(values, 2 * rigid)
    if np.real(squares).min(initial=np.inf) <= 0 or not np.imag(values).all():
        return 0.0
    without = np.sort(np.sqrt(np.real(squares)), axis=1).mean(axis=0)
    return float(np.abs(np.sort(np.abs(values), axis=1)[:, ::2].mean(axis=0) / without - 1).max(initial=0.0))


def _without_least(values: Array, count: int) -> Array:
    """Values (k, n) without a given number of those of smallest modulus."""
    return np.take_along_axis(values, np.argsort(np.abs(values), axis=1)[:, count:], axis=1)


def _followed(frequencies: Array, shapes: Array, inverse: Array, rate: float) -> tuple[Array, Array, float]:
    """Ranks (k, n) of each mode at k phases, `rate` of them a second; the mode whose place each has taken
    after them (n,); and the logarithm of the part of a vibration that keeps its rank where its mode changes
    it.

    As long as the shapes of modes turn faster than their frequencies, near each other, differ, θ rate > Δω, a
    vibration keeps its shape: by the formula of Landau and Zener (C. Zener, Proceedings of the Royal Society
    A 137, 1932, 696) more than half of it then changes its rank in an avoided crossing.
    """
    count, n = frequencies.shape
    ahead, own = np.roll(np.arange(count), -1), np.arange(n)
    overlaps = _overlaps(inverse, shapes, inverse[ahead], shapes[ahead])
    apart = np.abs(frequencies[:, :, None] - frequencies[:, None])
    apart = np.where(apart < _NEAR * apart.max(axis=0), apart, np.inf)

    def slow(at: Array | int, now: Array, then: Array) -> Array:
        """Which of the modes (…, n) with these ranks at a phase and at the next have time to change shape."""
        turned, before, after = (
            part[np.asarray(at)[..., None, None], one[:, None], two]
            for part, one, two in ((overlaps, now, then), (apart, now, now), (apart[ahead], then, then))
        )
        enough = np.sqrt(turned) * rate <= np.minimum(before, after)
        return np.asarray((enough | np.eye(n, dtype=bool)).all(axis=-1))

    settled = slow(np.arange(count), own, own).all(axis=-1)
    if settled.all() and (np.einsum("kii->ki", overlaps) > 0.5).all():
        return np.tile(own, (count, 1)), own, 0.0
    # Where shapes are between two modes nothing would be known of either.
    first = int(settled.argmax())
    ranks, kept, now = np.empty((count, n), dtype=int), 0.0, own
    known, left, known_as = shapes[first], inverse[first], own
    for at in np.roll(np.arange(count), -first).tolist():
        ranks[at] = now
        there = ahead[at]
        alike = _overlaps(left, known, inverse[there], shapes[there])
        then = matched(-alike)[1]
        renewed = slow(at, now, then)
        passed = renewed & (then != known_as)
        kept += float(np.log(np.maximum(alike[passed, known_as[passed]], _LEAST)).sum()) / 4
        known, known_as = np.where(renewed, shapes[there][:, then], known), np.where(renewed, then, known_as)
        left, now = np.linalg.pinv(known), then
    return ranks, now, kept


def _overlaps(left: Array, shapes: Array, others_left: Array, others: Array) -> Array:
    """Parts (…, n, n) of shapes in others, squares of cosines where they are orthogonal: of shapes (…, n, n)
    in columns and their inverses."""
    return np.abs((left @ others) * np.swapaxes(others_left @ shapes, -1, -2))


def _over_turns(means: Array, places: Array) -> Array:
    """Means (2, n) over a period of modes that have taken the places (n,) of others after it, over as many
    periods as each needs to be back."""
    found = means.copy()
    for mode in range(len(places)):
        at = [mode]
        while places[at[-1]] != mode:
            at.append(int(places[at[-1]]))
        found[:, mode] = means[:, at].mean(axis=1)
    return found
