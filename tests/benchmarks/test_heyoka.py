"""heyoka solves the same problems to the accuracy of the timed runs."""

import numpy as np
import pytest

import solve
from tests.benchmarks.cam import ACCURACY, SPECTRAL_RADIUS, error

pytest.importorskip("heyoka")
from tests.benchmarks import heyoka_peers


def test_heyoka_solves_the_cam():
    result = heyoka_peers.cam_single()
    assert error(result) <= ACCURACY
    assert np.abs(result[2]).max() == pytest.approx(SPECTRAL_RADIUS, rel=ACCURACY)


@pytest.mark.slow
def test_heyoka_solves_the_cam_at_many_speeds():
    q, multipliers = heyoka_peers.cam_batch()
    for at in (0, 77, 199):
        orbit = solve.periodic(solve.load("cam", case="1"), heyoka_peers.SPEEDS[at], rtol=1e-9)
        assert abs(q[at, 2] - orbit.q[2, 0]) <= ACCURACY * orbit.statistics("q3").max_abs
        assert np.abs(multipliers[at]).max() == pytest.approx(orbit.spectral_radius, rel=ACCURACY)


@pytest.mark.slow
def test_heyoka_solves_mathieus_equation():
    computed = heyoka_peers.mathieu_batch()
    for column, row in ((0, 299), (150, 20), (299, 299)):
        given = {"delta": heyoka_peers.DELTA[column], "epsilon": heyoka_peers.EPSILON[row], "zeta": 0.0}
        truth = solve.floquet(solve.load("mathieu", **given), 1.0, rtol=1e-10)
        trace = computed[300 * row + column].sum()
        assert abs(trace - truth.multipliers.sum()) <= ACCURACY * truth.spectral_radius


def test_shooting_converges_to_the_nonlinear_orbit():
    from tests.benchmarks import heyoka_shooting

    x, multipliers, _ = heyoka_shooting.shooting()
    orbit = solve.nonlinear(solve.load("cam", case="1"), heyoka_shooting.SPEED, rtol=1e-9)
    assert (np.abs(x[:3] - orbit.q[:, 0]) <= ACCURACY * np.abs(orbit.q).max(axis=1)).all()
    assert np.abs(multipliers).max() == pytest.approx(orbit.spectral_radius, rel=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("state", "speed"),
    [
        ([-0.22995, -6.21e-5, 9.827e-4, 0.616, -2.711e-3, -0.15392], 428.839),
        ([-0.21841, -9.01e-5, -5.871e-4, 0.6631, -2.874e-3, -0.16176], 428.43),
    ],
)
def test_folds_of_the_cam_near_428_rpm_match(state, speed):
    """The tests of branches use these values."""
    from tests.benchmarks import heyoka_shooting
    from tests.solve.newton.test_cam import FOLDS

    found = heyoka_shooting.fold(np.array(state), speed * np.pi / 30) * 30 / np.pi
    assert np.abs(np.array(FOLDS) / found - 1).min() < 1e-8
