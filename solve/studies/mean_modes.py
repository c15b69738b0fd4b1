"""Modes of the matrices frozen at phases of a period, followed from phase to phase, and their means."""

from typing import NamedTuple

import numpy as np

from solve.arrays import EPS, ROUND_OFF, SPLIT, Array, midpoint_phases
from solve.period.multipliers import matched
from solve.period.points import rate_of
from solve.period.rigid_body import rigid_body_modes
from solve.system import PeriodicSystem

_PHASES, _FEW_PHASES = 64, 16
"""Number of phases for the means, and for the comparison of the means with and without C. Chosen by
judgement: means and comparison converge exponentially."""

_NEAR = 0.5
"""Two frequencies count as close at a phase if the difference between them is below this fraction of the
maximum difference over the period. Chosen by judgement."""


class MeanModes(NamedTuple):
    """Cycle means of the frozen modes: ascending `frequencies` (n,) in rad/s, and decay `rates` (n,) in 1/s
    to first order in C. Imaginary frequencies count as 0 in the means; `imaginary` is True if a frequency is
    imaginary or complex at some phase. `rigid` is the number of rigid-body modes, whose frequency is 0."""

    frequencies: Array
    rates: Array
    imaginary: bool
    rigid: int = 0


def mean_modes(system: PeriodicSystem, speed: float) -> MeanModes:
    """Return cycle means of the undamped modes of M and K frozen at phases of the period, at a speed (rad/s).
    Speed 0 is the mechanism at rest. Raises SolveError subclasses, and LinAlgError if there are no matrices.

    For systems with first-order coordinates, frequencies are moduli of the complex eigenvalues of the frozen
    system. Rates are the means of the decay rates of these eigenvalues, without approximation.

    Where frequencies cross, modes are followed by their shapes, see `_follow`. Modes that exchange their
    ranks within a period have a common mean. A small component of the vibration keeps its rank; if this
    component decays so slowly that it dominates after a period, the means are those of the sorted
    frequencies.
    """
    step = system.period / _PHASES
    M, C, K, d = system.at((np.arange(_PHASES) + 0.5) * step, speed)
    if len(system.states):
        return _of_states(rate_of(M, C, K, d, len(system.states))[..., :-1], system.n)
    if all((matrix == matrix[:1]).all() for matrix in (M, C, K)):
        M, C, K = M[:1], C[:1], K[:1]
    squares, shapes = np.linalg.eig(np.linalg.solve(M, K))
    rigid = int(rigid_body_modes(K[None], C[None], speed * M[None]).present.sum())
    np.put_along_axis(squares, np.argsort(np.abs(squares), axis=1)[:, :rigid], 0.0, axis=1)
    order = np.argsort(np.real(squares), axis=1)
    squares = np.take_along_axis(squares, order, axis=1)
    shapes = np.take_along_axis(shapes, order[:, None], axis=2)
    real, size = np.real(squares), np.abs(squares).max()
    imaginary = real.min() < -ROUND_OFF * size or np.abs(np.imag(squares)).max() > SPLIT * size
    # Linearly dependent mode shapes have no inverse.
    inverse = np.linalg.pinv(shapes)
    rates = np.real(np.einsum("kij,kji->ki", inverse @ np.linalg.solve(M, C), shapes)) / 2
    values = np.stack((np.sqrt(np.maximum(real, 0.0)), rates), axis=1)
    ranks, next_modes, log_unchanged = _follow(values[:, 0], shapes, inverse, speed / step)
    means, exchanged = values.mean(axis=0), (ranks != np.arange(system.n)).any(axis=0)
    if exchanged.any():
        followed = np.take_along_axis(values, ranks[:, None], axis=2).mean(axis=0)
        followed = _mean_over_cycles(followed, next_modes)
        faster = followed[1, exchanged].min() - means[1, exchanged].min()
        if speed == 0 or faster * system.period / speed <= -log_unchanged:
            means = followed
    means = means[:, np.argsort(means[0], kind="stable")]
    return MeanModes(means[0], means[1], bool(imaginary), rigid)


def shift_by_rates(system: PeriodicSystem, speed: float) -> float:
    """Return the largest relative difference between mean frequencies with and without C, at a speed (rad/s).

    With C, frequencies are moduli of complex eigenvalues. Gyroscopic forces, and damping that couples modes,
    change these moduli; modal damping does not. The result is 0 if an eigenvalue is real. It is also 0 for
    systems with first-order coordinates, whose mean frequencies always include C.
    """
    if len(system.states):
        return 0.0
    halves = np.s_[: system.n], np.s_[system.n : 2 * system.n]
    phases = midpoint_phases(_FEW_PHASES, system.period)
    rate = rate_of(*system.at(phases, speed))[..., :-1]
    squares, values = np.linalg.eigvals(-rate[:, system.n :, : system.n]), np.linalg.eigvals(rate)
    rigid = int(rigid_body_modes(*(-rate[None, :, system.n :, half] for half in halves)).present.sum())
    squares, values = _without_smallest(squares, rigid), _without_smallest(values, 2 * rigid)
    if np.real(squares).min(initial=np.inf) <= 0 or not np.imag(values).all():
        return 0.0
    undamped = np.sort(np.sqrt(np.real(squares)), axis=1).mean(axis=0)
    moduli = np.sort(np.abs(values), axis=1)[:, ::2].mean(axis=0)
    return float(np.abs(moduli / undamped - 1).max(initial=0.0))


def _of_states(rates: Array, n: int) -> MeanModes:
    """Return the mean moduli and the mean decay rates of the complex eigenvalues of n modes of x′ = A x.
    `rates` (k, N, N) contains A at k phases. If fewer than n modes oscillate, the first modes have frequency
    0."""
    values = np.linalg.eigvals(rates)
    values = np.where(np.imag(values) > ROUND_OFF * np.abs(values).max(), values, 0.0)
    order = np.argsort(np.abs(values), axis=1, kind="stable")[:, -n:]
    values = np.take_along_axis(values, order, axis=1)
    frequencies, decay = np.abs(values).mean(axis=0), -np.real(values).mean(axis=0)
    return MeanModes(frequencies, decay, imaginary=False, rigid=int((frequencies == 0).sum()))


def _without_smallest(values: Array, count: int) -> Array:
    """Return each row of `values` (k, n) without its `count` values of smallest modulus."""
    return np.take_along_axis(values, np.argsort(np.abs(values), axis=1)[:, count:], axis=1)


def _follow(frequencies: Array, shapes: Array, inverse: Array, rate: float) -> tuple[Array, Array, float]:
    """Follow n modes through k phases, of which `rate` pass per second. Return the rank (k, n) of each mode
    at each phase; for each mode, the index (n,) of the mode whose rank it takes after the period; and the
    logarithm of a component of the vibration. This component keeps its rank although its mode changes rank.

    While the mode shapes rotate faster than the frequencies differ, θ rate > Δω, the vibration cannot follow
    the mode shapes and keeps its own shape. By the Landau-Zener formula (C. Zener, Proceedings of the Royal
    Society A 137, 1932, 696), more than half of the vibration then changes rank in an avoided crossing.
    """
    count, n = frequencies.shape
    following, identity = np.roll(np.arange(count), -1), np.arange(n)
    overlaps = _overlaps(inverse, shapes, inverse[following], shapes[following])
    difference = np.abs(frequencies[:, :, None] - frequencies[:, None])
    difference = np.where(difference < _NEAR * difference.max(axis=0), difference, np.inf)

    def adapts(at: Array | int, now: Array, then: Array) -> Array:
        """Return whether modes (…, n) have enough time between two consecutive phases to change their shapes.
        `at` are the indices of the first phases; `now` and `then` are the ranks at the two phases."""
        rotated, before, after = (
            matrix[np.asarray(at)[..., None, None], first[:, None], second]
            for matrix, first, second in (
                (overlaps, now, then),
                (difference, now, now),
                (difference[following], then, then),
            )
        )
        slow = np.sqrt(rotated) * rate <= np.minimum(before, after)
        return np.asarray((slow | np.eye(n, dtype=bool)).all(axis=-1))

    all_adapt = adapts(np.arange(count), identity, identity).all(axis=-1)
    if all_adapt.all() and (np.einsum("kii->ki", overlaps) > 0.5).all():
        return np.tile(identity, (count, 1)), identity, 0.0
    # During an exchange, a mode shape identifies neither of the two modes. The first phase is therefore one
    # without an exchange.
    first = int(all_adapt.argmax())
    ranks, log_unchanged, now = np.empty((count, n), dtype=int), 0.0, identity
    reference, left, reference_rank = shapes[first], inverse[first], identity
    for at in np.roll(np.arange(count), -first).tolist():
        ranks[at] = now
        there = following[at]
        overlap = _overlaps(left, reference, inverse[there], shapes[there])
        then = matched(-overlap)[1]
        renewed = adapts(at, now, then)
        passed = renewed & (then != reference_rank)
        unchanged = np.maximum(overlap[passed, reference_rank[passed]], EPS)
        log_unchanged += float(np.log(unchanged).sum()) / 4
        reference = np.where(renewed, shapes[there][:, then], reference)
        reference_rank = np.where(renewed, then, reference_rank)
        left, now = np.linalg.pinv(reference), then
    return ranks, now, log_unchanged


def _overlaps(left: Array, shapes: Array, others_left: Array, others: Array) -> Array:
    """Return the overlaps (…, n, n) between two sets of mode shapes. The sets `shapes` and `others` (…, n, n)
    contain the shapes as columns; `left` and `others_left` are their inverses. For orthogonal shapes, the
    overlaps are squared cosines."""
    return np.abs((left @ others) * np.swapaxes(others_left @ shapes, -1, -2))


def _mean_over_cycles(means: Array, next_modes: Array) -> Array:
    """Return the means (2, n) of each mode over the number of periods after which the mode returns to its
    rank. `means` (2, n) are the means over one period. After a period, mode i takes the rank of the mode with
    the index `next_modes[i]`."""
    averaged = means.copy()
    for mode in range(len(next_modes)):
        cycle = [mode]
        while next_modes[cycle[-1]] != mode:
            cycle.append(int(next_modes[cycle[-1]]))
        averaged[:, mode] = means[:, cycle].mean(axis=1)
    return averaged
