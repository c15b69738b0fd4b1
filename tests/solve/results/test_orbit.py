"""Interface of an orbit: nodes, the continuous curve, states, outputs, names."""

import numpy as np
import pytest

from solve import Orbit, PeriodicSystem, periodic
from solve.capabilities import Outputs
from solve.errors import UnknownNameError
from tests.solve.systems import cam, random_system, system

PHASES = np.linspace(-7.0, 14.0, 211)


@pytest.fixture(scope="module")
def orbit():
    return periodic(random_system(2, 3), 1.7, rtol=1e-10)


def test_nodes_include_both_ends_of_the_period(orbit):
    m = orbit.steps
    assert orbit.phase.shape == orbit.time.shape == (m + 1,)
    assert (orbit.phase[0], orbit.phase[-1]) == (0.0, 2 * np.pi)
    assert orbit.time[-1] == pytest.approx(orbit.period) == pytest.approx(2 * np.pi / 1.7)
    for part in (orbit.q, orbit.qd, orbit.qdd):
        assert part.shape == (3, m + 1)


def test_nodes_lie_on_the_curve(orbit):
    scale = np.abs(orbit.q).max()
    np.testing.assert_allclose(orbit.at(orbit.phase), orbit.q, rtol=0, atol=1e-13 * scale)
    q, qd, qdd = orbit.state(orbit.phase)
    for nodal, curve in ((orbit.q, q), (orbit.qd, qd), (orbit.qdd, qdd)):
        np.testing.assert_allclose(nodal, curve, rtol=0, atol=1e-12 * np.abs(nodal).max())


def test_velocities_and_accelerations_are_time_derivatives(orbit):
    step = 1e-4
    before, here, after = (orbit.at(PHASES + 1.7 * k * step) for k in (-1, 0, 1))
    _, qd, qdd = orbit.state(PHASES)
    np.testing.assert_allclose((after - before) / (2 * step), qd, rtol=0, atol=1e-6 * np.abs(qd).max())
    np.testing.assert_allclose(
        (after - 2 * here + before) / step**2, qdd, rtol=0, atol=1e-5 * np.abs(qdd).max()
    )


@pytest.mark.parametrize("method", ["radau", "gauss", "rk4", "newmark"])
def test_nodes_satisfy_the_equation_of_motion(method):
    given = random_system(6, 2)
    orbit = periodic(given, 1.0, method, steps=60, rtol=0.5)
    M, C, K, d = given.at(orbit.phase, 1.0)
    for k in range(61):
        left = M[k] @ orbit.qdd[:, k] + C[k] @ orbit.qd[:, k] + K[k] @ orbit.q[:, k]
        np.testing.assert_allclose(left, d[k], rtol=0, atol=1e-9)


def test_orbit_is_evaluated_at_scalar_phases_of_any_period(orbit):
    assert orbit.at(0.3).shape == (3, 1)
    np.testing.assert_allclose(orbit.at(0.3 + 40 * np.pi), orbit.at(0.3), rtol=1e-11)


def test_statistics_match_the_continuous_curve(orbit):
    dense = orbit.at(np.linspace(0.0, 2 * np.pi, 400_001))
    for row, name in enumerate(orbit.coordinates):
        statistics = orbit.statistics(name)
        scale = np.abs(dense[row]).max()
        assert statistics.max == pytest.approx(dense[row].max(), abs=1e-9 * scale)
        assert statistics.min == pytest.approx(dense[row].min(), abs=1e-9 * scale)
        assert statistics.max_abs == pytest.approx(scale, rel=1e-9)
        assert statistics.mean == pytest.approx(dense[row, :-1].mean(), abs=1e-12 * scale)
        assert orbit.at(statistics.max_phase)[row, 0] == pytest.approx(statistics.max, abs=1e-13 * scale)
        assert orbit.at(statistics.min_phase)[row, 0] == pytest.approx(statistics.min, abs=1e-13 * scale)


def test_coarse_grid_does_not_change_the_extrema():
    """The nodes of 256 steps miss the peaks of the fast cam. The curve between the nodes does not."""
    fine, coarse = (periodic(cam(), "600 rpm", steps=m, rtol=0.5) for m in (2048, 256))
    truth = fine.statistics("q3").max
    assert coarse.statistics("q3").max == pytest.approx(truth, rel=1e-4)
    assert coarse.q[2].max() < (1 - 1e-4) * truth


def test_high_harmonic_is_not_aliased_to_a_mean():
    """With 2048 samples, harmonic 2048 of the load would appear as a constant."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, one, 2048.0**2 * one, np.cos(2048 * phase)[:, None]

    orbit = periodic(system(matrices, 1), 1.0, rtol=1e-6)
    assert orbit.statistics("q1").max == pytest.approx(1 / 2048, rel=1e-5)
    assert orbit.statistics("q1").mean == pytest.approx(0.0, abs=1e-12)
    assert orbit.harmonics("q1", 3)[0] == pytest.approx(np.zeros(4), abs=1e-12)


def test_harmonics_sum_to_the_curve(orbit):
    for row, name in enumerate(orbit.coordinates):
        amplitudes, angles = orbit.harmonics(name)
        assert len(amplitudes) == len(angles) == 61
        waves = np.cos(np.outer(np.arange(61), PHASES) + angles[:, None])
        np.testing.assert_allclose(amplitudes @ waves, orbit.at(PHASES)[row], rtol=0, atol=1e-10)


def test_harmonics_are_counted_per_period():
    """The period is π. Harmonic 1 therefore has twice the frequency of the phase."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, one, one, np.cos(2 * phase + 0.4)[:, None]

    amplitudes, angles = periodic(system(matrices, 1, period=np.pi), 1.0).harmonics("q1", 3)
    response = np.exp(0.4j) / (1 - 4 + 2j)
    assert amplitudes[1] == pytest.approx(abs(response))
    assert angles[1] == pytest.approx(np.angle(response))
    np.testing.assert_allclose(amplitudes[[0, 2, 3]], 0.0, atol=1e-12)


class WithForce(PeriodicSystem, Outputs):
    outputs = ("force",)

    @property
    def capabilities(self):
        return super().capabilities._replace(outputs=self)

    def output_values(self, phase, speed, q, qd, qdd, acceleration=0.0):
        return {"force": 3.0 * q[0] - 0.5 * qd[1] + np.cos(phase) + speed * qdd[2]}


@pytest.fixture(scope="module")
def with_force():
    given = random_system(2, 3)
    return periodic(WithForce(given.at, given.coordinates), 1.7, rtol=1e-10)


def test_outputs_follow_from_phase_and_state(with_force):
    expected = (
        3 * with_force.q[0] - 0.5 * with_force.qd[1] + np.cos(with_force.phase) + 1.7 * with_force.qdd[2]
    )
    np.testing.assert_allclose(with_force.outputs["force"], expected, rtol=1e-13)
    computed, dense = (
        with_force.statistics("force"),
        with_force.signal("force")(np.linspace(0, 2 * np.pi, 100_001)),
    )
    assert (computed.max, computed.min) == pytest.approx((dense.max(), dense.min()), rel=1e-7)
    assert with_force.harmonics("force", 3)[0][0] == pytest.approx(dense[:-1].mean(), rel=1e-9)


@pytest.mark.parametrize(("given", "near"), [("q4", "q1"), ("forse", "force"), ("Q1", "q1")])
def test_unknown_names_are_refused_with_a_suggestion(with_force, given, near):
    for method in (with_force.statistics, with_force.harmonics, with_force.quasi_static.signal):
        with pytest.raises(UnknownNameError, match=rf"unknown coordinate or output '{given}'; did you mean"):
            method(given)


def test_orbit_contains_its_method_steps_and_speed():
    orbit = periodic(random_system(2, 2), "3 Hz", "rk4", steps=200, rtol=0.1)
    assert isinstance(orbit, Orbit)
    assert (orbit.method, orbit.steps, orbit.coordinates) == ("rk4", 200, ("q1", "q2"))
    assert orbit.speed == pytest.approx(6 * np.pi)


def test_orbit_without_a_load_is_zero():
    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, 0.1 * one, (4 + np.cos(phase))[:, None, None], 0 * one[:, 0]

    orbit = periodic(system(matrices, 1), 1.0)
    assert not orbit.q.any()
    assert orbit.residual == 0.0
    assert orbit.statistics("q1").max_abs == 0.0
    assert orbit.warnings == []


@pytest.mark.parametrize(("angle", "warned"), [(1.0, True), (0.0, False)])
def test_output_that_grows_every_period_gives_a_warning(angle, warned):
    class Shaft(PeriodicSystem, Outputs):
        outputs = ("swing",)

        @property
        def capabilities(self):
            return super().capabilities._replace(outputs=self)

        def output_values(self, phase, speed, q, qd, qdd, acceleration=0.0):
            return {"swing": angle * phase + q[0]}

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, 0.4 * one, 4.0 * one, np.cos(phase)[:, None]

    orbit = periodic(Shaft(matrices, ["q"]), 3.0)
    message = "swing is not periodic: it changes by 6.28 per period"
    assert any(text.startswith(message) for text in orbit.warnings) == warned
