"""Unstable bands of the undamped four-bar linkage, whose axial modes are undamped and unresolved."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import expm

import solve

LOW, HIGH = 87.3, 88.6
STEPS = 6144


@pytest.fixture(scope="module")
def four_bar():
    return solve.load("four_bar", options={"terms": "full"}, zeta=0.0)


def magnus(system, speed):
    """Largest modulus of the multipliers of all modes, by Magnus's series of fourth order for (q, dq/dt)."""
    n, h = system.n, system.period / STEPS
    sampled = []
    for place in (0.5 - np.sqrt(3) / 6, 0.5 + np.sqrt(3) / 6):
        M, C, K, _ = system.at((np.arange(STEPS) + place) * h, speed)
        rate = np.zeros((STEPS, 2 * n, 2 * n))
        rate[:, :n, n:] = np.eye(n)
        rate[:, n:] = -np.linalg.solve(M, np.concatenate((K, C), axis=2))
        sampled.append(rate * (h / speed))
    first, second = sampled
    turn = np.eye(2 * n)
    for step in expm((first + second) / 2 + np.sqrt(3) / 12 * (second @ first - first @ second)):
        turn = step @ turn
    return float(np.abs(np.linalg.eigvals(turn)).max())


@pytest.mark.slow
def test_magnus_series_confirms_growth_only_inside_the_bands(four_bar):
    bands = solve.bands(four_bar, [LOW, HIGH], rtol=1e-6)
    wide = [band for band in bands if band.high - band.low > 0.01]
    assert [band.kind for band in wide] == ["+1", "-1"]
    assert "5 of 9 modes" in bands.notes[0]
    for band in wide:
        growth = magnus(four_bar, (band.low + band.high) / 2) - 1
        assert growth > 0.005
        assert growth < (band.spectral_radius - 1) * (1 + 1e-3)
        outside = (band.high - band.low) / 20
        assert magnus(four_bar, band.low - outside) < 1 + 1e-7
        assert magnus(four_bar, band.high + outside) < 1 + 1e-7
    for one, other in pairwise(bands):
        assert magnus(four_bar, (one.high + other.low) / 2) < 1 + 1e-7


def test_every_mode_of_damped_or_soft_systems_is_resolved(four_bar):
    for system in (solve.load("four_bar"), solve.load("mathieu")):
        assert not any(
            "modes have a phase advance of more" in note
            for note in solve.bands(system, [87.0, 87.1], rtol=1e-4).notes
        )
