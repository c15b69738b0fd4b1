"""Errors estimated by two orders on one grid, compared with independent references."""

import numpy as np
import pytest

import solve
from solve import Gauss, Radau, floquet, periodic, sweep
from solve.certify.coefficients import ResampledPoints
from solve.period.grid import Grid
from solve.period.points import DerivedPoints, Points, SinglePoint
from tests.solve.certificates.population import HALF, member
from tests.solve.certificates.test_narrow import DAMPING, struck
from tests.solve.certificates.trials import TRIALS, outcomes, rates

SYSTEMS = [3, 46, 89, 132, 304, 347, *range(HALF + 8, HALF + 14)]
"""Members of the population of every kind, other than those of the quick test of the present certificate."""


def test_estimates_of_auto_are_sharp_bounds():
    trials = [trial for trial in TRIALS if trial.name == "auto"]
    computed = [outcome for index in SYSTEMS for outcome in outcomes(member(index), trials)]
    row = rates("auto", computed)
    print(row)
    assert row.refused == 0
    assert row.honest == 1.0, str(row)
    assert row.sharp >= 0.9, str(row)
    assert row.contradicted == 0


@pytest.mark.parametrize("part", [100, 1000, 5000])
def test_bump_between_the_stages_is_detected(part):
    """The bump, at random phases, changes the spectral radius by 6 %."""
    free = np.exp(-DAMPING / 2 * 2 * np.pi)
    places = np.random.default_rng((39, part)).uniform(0.0, 2 * np.pi, 25)
    computed = [floquet(struck(place, 2 * np.pi / part), 1.0, rtol=1e-6) for place in places]
    missed = [each for each in computed if each.spectral_radius < 1.01 * free and not each.warnings]
    assert missed == []


@pytest.fixture(scope="module")
def slow_cam():
    """Cam at 100 rpm. The phase of its fastest mode advances by 16 000 rad per revolution."""
    return floquet(solve.load("cam"), "100 rpm", Radau(13), rtol=1e-10)


@pytest.mark.parametrize("method", [Radau(9), Radau(13), Gauss(10), Gauss(12)])
@pytest.mark.parametrize("steps", [33, 100, 400])
def test_error_includes_modes_unresolved_by_given_steps(method, steps, slow_cam):
    stability = floquet(slow_cam.system, slow_cam.speed, method, steps=steps, rtol=0.9)
    error = abs(stability.spectral_radius / slow_cam.spectral_radius - 1)
    assert error <= 10 * stability.error_estimate.multipliers


def test_sweep_is_as_accurate_as_single_solutions():
    """Single solutions compute multipliers below the round-off of Φ with more steps."""
    cam, speeds = solve.load("cam"), np.linspace(300, 900, 12) * np.pi / 30
    together = sweep(cam, speeds, rtol=1e-6, quantities=cam.coordinates)
    for at, speed in enumerate(speeds.tolist()):
        alone = periodic(cam, speed, rtol=1e-6)
        assert together.results.steps[at] == alone.steps
        large = np.abs(alone.multipliers) > 1e-5 * alone.spectral_radius
        assert large[:2].all()
        np.testing.assert_allclose(
            together.multipliers[at][large], alone.multipliers[large], atol=1e-11 * alone.spectral_radius
        )


def test_nonlinear_orbit_has_the_same_kind_of_estimate():
    """Each iterate is computed with both orders. The reference is a method of another family."""
    orbit = solve.nonlinear(solve.load("cam"), "100 rpm", rtol=1e-7)
    reference = solve.nonlinear(solve.load("cam"), "100 rpm", method="gauss", rtol=1e-9)
    phase = np.linspace(0, 2 * np.pi, 500)
    q, truth = orbit.at(phase), reference.at(phase)
    error = (np.abs(q - truth).max(axis=1) / np.abs(truth).max(axis=1)).max()
    assert error <= 10 * orbit.error_estimate.orbit
    assert orbit.error_estimate.orbit <= 1e-7


class Counted(DerivedPoints):
    """Points that count the phases at which their coefficients are evaluated."""

    def __init__(self, points: Points):
        super().__init__(points)
        self.phases = 0

    def __getitem__(self, positions):
        return self

    def tables(self, phase):
        self.phases += len(phase)
        return self.points.tables(phase)


def test_averages_need_no_phases_beyond_those_of_the_differences():
    """Along an orbit, evaluations are a third of the time."""
    cam = solve.load("cam")
    orbit = solve.nonlinear(cam, "300 rpm", rtol=1e-4)
    points, lower = Counted(SinglePoint(orbit.system, orbit.speed)), Radau(13)
    resampled = ResampledPoints(points, 64, (lower.stages, lower.with_another_stage.stages))
    assert resampled.relative_difference > 0
    first = points.phases
    stages = Grid.uniform(64, points.period).stages(np.array(lower.stages.c)).ravel()
    assert not np.array_equal(resampled.tables(stages).table, points.points.tables(stages).table)
    assert points.phases == first
