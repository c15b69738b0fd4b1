"""Joint evaluation of all coordinates and outputs for the record of an orbit."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

import solve

_CALLS = 24
"""Joint evaluations of all outputs: samples, warnings, and refinements of the extrema. With 21 outputs,
separate evaluations need more than 200 calls."""


@pytest.fixture(scope="module")
def model():
    return solve.load("four_bar")


@pytest.fixture(scope="module")
def orbit(model):
    return solve.periodic(model, "30 rad/s", rtol=1e-6)


def test_outputs_are_evaluated_together(model, monkeypatch):
    counted = []
    evaluate = type(model).output_values

    def output_values(self, phase, *state, **options):
        counted.append(len(phase))
        return evaluate(self, phase, *state, **options)

    monkeypatch.setattr(type(model), "output_values", output_values)
    record = solve.periodic(model, "30 rad/s", rtol=1e-6).record(20)
    assert len(record["outputs"]) == len(model.outputs) > 20
    assert len(counted) <= _CALLS


def extremum(signal, period, sign):
    """Return the largest sign · value by SciPy, starting from the best of many samples."""
    width = period / 20000
    phases = np.arange(20000) * width
    best = phases[np.argmax(sign * signal(phases))]
    minimum = minimize_scalar(
        lambda phase: -sign * float(signal(np.array([phase]))[0]),
        bounds=(best - width, best + width),
        options={"xatol": 1e-12},
        method="bounded",
    )
    return -minimum.fun


@pytest.mark.parametrize("name", ["crank_tip_deflection", "O_moment", "B_force_x", "strain_energy", "B_x"])
def test_joint_statistics_match_those_of_single_quantities(orbit, name):
    signal, figures = orbit.signal(name), orbit.statistics(name)
    allowed = 1e-10 * figures.max_abs
    assert figures.max == pytest.approx(extremum(signal, orbit.system.period, 1.0), abs=allowed)
    assert -figures.min == pytest.approx(extremum(signal, orbit.system.period, -1.0), abs=allowed)


@pytest.mark.parametrize("name", ["crank_tip_deflection", "C_force_y"])
def test_joint_harmonics_match_those_of_single_quantities(orbit, name):
    """They are compared with trapezoidal sums on a grid with a different number of phases."""
    count, (amplitudes, angles) = 6001, orbit.harmonics(name, 5)
    phases = np.arange(count) * (2 * np.pi / count)
    values = orbit.signal(name)(phases)
    for k in range(1, 6):
        truth = 2 * np.mean(values * np.exp(-1j * k * phases))
        assert amplitudes[k] * np.exp(1j * angles[k]) == pytest.approx(truth, abs=1e-9 * amplitudes.max())


def test_unresolved_harmonics_are_computed_from_new_samples(orbit):
    """The shared samples have too few phases for these harmonics."""
    few, _ = orbit.harmonics("A_x", 60)
    many, _ = orbit.harmonics("A_x", orbit.samples // 4)
    assert len(many) == orbit.samples // 4 + 1
    np.testing.assert_allclose(many[:10], few[:10], atol=1e-10 * few.max())
