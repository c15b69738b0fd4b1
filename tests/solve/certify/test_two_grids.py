"""Traps for two grids: multipliers equal by chance, unevenly divided intervals between jumps, and weak
damping."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

from solve import Gauss, PeriodicSystem, floquet
from solve.period.grid import Grid
from solve.period.points import SinglePoint
from tests.solve.references import Shooting, multiplier_error
from tests.solve.systems import constant


def hill(delta):
    """System q″ + (δ + 2 cos φ) q = 0."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, 0 * one, delta + 2 * np.cos(phase)[:, None, None], 0 * one[:, 0]

    return PeriodicSystem(matrices, ["q"])


@pytest.mark.parametrize("between", [(4.0, 4.3), (6.2, 6.5), (8.9, 9.2), (12.1, 12.4)])
def test_accidentally_equal_multipliers_are_detected(between):
    """Without damping, ρ depends on tr Φ only. For some δ, tr Φ is the same with 8 and with 12 steps."""

    def difference(delta):
        grids = (Grid.uniform(steps, 2 * np.pi) for steps in (8, 12))
        return np.subtract(
            *(
                np.trace(Gauss().solutions(SinglePoint(hill(delta), 1.0), grid, False).Phi[0])
                for grid in grids
            )
        )

    given = hill(brentq(difference, *between, xtol=1e-15))
    stability = floquet(given, 1.0, "gauss", rtol=1e-5)
    error = multiplier_error(stability.multipliers, Shooting(given, 1.0).multipliers)
    assert 1e-12 < error <= 10 * stability.error_estimate.multipliers <= 1e-4


def of_pieces(breaks, K, damping):
    """Return the system q″ + damping q′ + K q = 1 with another K in each interval, and its multipliers from
    matrix exponentials."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        piece = np.searchsorted(breaks, np.mod(phase, 2 * np.pi), side="right") - 1
        return one, damping * one, K[piece][:, None, None], one[:, 0]

    Phi, ends = np.eye(2), [0.0, *breaks, 2 * np.pi]
    for k, length in zip([K[-1], *K], np.diff(ends), strict=True):
        Phi = expm(length * np.array([[0.0, 1.0], [-k, -damping]])) @ Phi
    return PeriodicSystem(matrices, ["q"], breaks=breaks), np.linalg.eigvals(Phi)


@pytest.mark.parametrize("seed", range(60))
def test_error_covers_intervals_with_equal_steps_on_both_grids(seed):
    """The 8 steps in six intervals are 1 1 1 1 3 1, and the 12 steps are two in each."""
    rng = np.random.default_rng(seed)
    breaks = np.sort(rng.uniform(0, 2 * np.pi, 5))
    K = rng.uniform(-1, 1, 5) * 10 ** rng.uniform(-1, 2) + 10 ** rng.uniform(-1, 2)
    given, truth = of_pieces(breaks, K, 0.05)
    stability = floquet(given, 1.0, rtol=10.0 ** -(1 + seed % 6))
    error = multiplier_error(stability.multipliers, truth)
    assert error <= 10 * stability.error_estimate.multipliers + 1e-13


@pytest.mark.parametrize("seed", [35, 70, 231, 259])
@pytest.mark.parametrize("rtol", [1e-2, 1e-5, 1e-8])
def test_error_covers_a_stiff_piece_divided_alike_on_two_grids(seed, rtol):
    rng = np.random.default_rng((991, seed))
    count = int(rng.integers(1, 6))
    breaks = np.sort(rng.uniform(0, 2 * np.pi, count))
    K = 10 ** rng.uniform(-1, rng.uniform(0, 3), count) * np.where(rng.random(count) < 0.1, -0.05, 1)
    given, truth = of_pieces(breaks, K, rng.choice([0, 0.05, 0.3]))
    stability = floquet(given, 1.0, rtol=rtol)
    error = multiplier_error(stability.multipliers, truth)
    assert error <= 10 * stability.error_estimate.multipliers + 1e-12


@pytest.mark.parametrize("damping", [1e-5, 1e-7, -1e-7])
@pytest.mark.parametrize("rtol", [1e-2, 1e-6])
def test_weak_damping_determines_the_verdict_at_any_tolerance(damping, rtol):
    given = constant(np.eye(1), damping * np.eye(1), 5.3 * np.eye(1), lambda phase: np.zeros((len(phase), 1)))
    assert floquet(given, 1.0, rtol=rtol).verdict == ("asymptotically stable" if damping > 0 else "unstable")
