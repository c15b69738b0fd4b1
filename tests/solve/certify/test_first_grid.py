"""The first grid: steps by what modes turn, and points that meet on finer grids."""

import numpy as np
import pytest

import solve
from solve import Gauss, Newmark, Radau, periodic, sweep
from solve.certify.first_grid import first_steps
from solve.period.frozen import frozen
from solve.period.points import AtSpeeds, OnePoint
from tests.solve.systems import constant


def modes(*omegas, damping=0.0):
    """Of uncoupled oscillators; the last one with a damping ratio."""
    C, K = np.zeros((2, len(omegas), len(omegas)))
    np.fill_diagonal(K, np.square(omegas))
    C[-1, -1] = 2 * damping * omegas[-1]
    given = constant(np.eye(len(omegas)), C, K, lambda phase: np.zeros((len(phase), len(omegas))))
    return frozen(OnePoint(given, 1.0))


def steps(method, given, orbit=True, rtol=1e-6):
    (found,) = first_steps(method, given, orbit, rtol).tolist()
    return found


@pytest.mark.parametrize("n", [1, 2])
def test_soft_systems_begin_with_few_steps(n):
    soft = modes(*([1.5] * n))
    assert steps(Gauss(), soft, orbit=False) == 8
    assert steps(Gauss(), soft) == 16
    assert steps(Radau(), soft) == 64


@pytest.mark.parametrize("method", [Gauss(), Radau(13)])
def test_steps_follow_the_fastest_mode_and_the_accuracy(method):
    slow, fast = (steps(method, modes(1.0, omega)) for omega in (40.0, 160.0))
    assert fast == 4 * slow > 64
    loose, tight = (steps(method, modes(1.0, 160.0), rtol=rtol) for rtol in (1e-3, 1e-12))
    assert loose <= fast < tight
    assert steps(method, modes(1.0, 1e6)) == 1024


def test_modes_that_die_out_need_not_be_followed_by_a_method_that_damps_them():
    """Those of which a period leaves exp(-2π 0.01 · 400) = 1e-11."""
    dying = modes(1.0, 400.0, damping=0.01)
    assert steps(Radau(13), dying) == 64
    assert steps(Radau(13), dying, rtol=1e-12) > 64
    assert steps(Gauss(), dying) > 64
    assert steps(Newmark(), dying) > 64


def test_points_from_different_grids_meet_on_finer_ones_and_are_as_alone():
    model = solve.load("cam", case="1")
    speeds = np.linspace(300, 900, 24) * np.pi / 30
    assert len(set(first_steps(Radau(13), frozen(AtSpeeds(model, speeds)), True, 1e-6).tolist())) > 2
    together = sweep(model, speeds, rtol=1e-6, quantities=model.coordinates)
    for at, speed in enumerate(speeds.tolist()):
        alone = periodic(model, speed, rtol=1e-6)
        assert together.results.steps[at] == alone.steps
        radius = alone.spectral_radius
        np.testing.assert_allclose(together.multipliers[at], alone.multipliers, atol=1e-11 * radius)
