"""Sweeps and charts of a structure of beams, whose matrices are assembled numerically."""

import numpy as np
import pytest

import solve
from solve.batch.family import SystemFamily
from solve.equations import output_values
from solve.system import in_phase

SAME = 1e-8
"""Relative difference that the condition of a stiff structure leaves to rounding (1e-9 seen)."""


@pytest.fixture(scope="module")
def four_bar():
    return solve.load("four_bar")


def test_sweep_equals_single_solutions(four_bar):
    speeds = np.linspace(20.0, 40.0, 5)
    sweep = solve.sweep(four_bar, speeds, rtol=1e-6)
    for at in (1, 4):
        orbit = solve.periodic(four_bar, speeds[at], rtol=1e-6)
        point = sweep.points[at]
        assert (point.method, point.steps, point.verdict) == (orbit.method, orbit.steps, orbit.verdict)
        assert point.spectral_radius == pytest.approx(orbit.spectral_radius, rel=SAME)
        assert list(point.warnings) == orbit.warnings
        # Rounding differs, of which the estimate tells the size: some coordinates are small beside others.
        allowed = max(SAME, orbit.error_estimate.orbit)
        for name in (*four_bar.coordinates, *four_bar.outputs):
            alone, ours = orbit.statistics(name), point.statistics[name]
            for figure in ("max", "min", "mean", "rms"):
                difference = abs(getattr(alone, figure) - getattr(ours, figure))
                assert difference <= allowed * alone.max_abs, f"{figure} of {name}"


@pytest.mark.parametrize("options", [{}, {"terms": "full", "stiffening": "on"}, {"damping": "rayleigh"}])
def test_matrices_at_all_speeds_follow_from_three_speeds(options):
    model = solve.load("four_bar", options=options)
    family, phase = SystemFamily(model, ["speed", "L4"]), np.linspace(0.0, 6.0, 7)
    points = np.array([[w, L4] for L4 in (0.53, 0.547) for w in (20.0, 23.0, 31.0, 38.0, 40.0)])
    computed = family.entries(phase, points)
    for (speed, L4), entries in zip(points, computed, strict=True):
        system = solve.load("four_bar", options=options, L4=L4)
        parts = [part.reshape(7, -1) for part in in_phase(system, phase, speed)]
        start = 0
        for part in parts:
            ours = entries[:, start : start + part.shape[1]]
            np.testing.assert_allclose(ours, part, rtol=0, atol=1e-13 * np.abs(part).max())
            start += part.shape[1]


def test_chart_over_speed_and_length_equals_single_solutions(four_bar):
    chart = solve.chart(
        four_bar,
        {"speed": [25.0, 27.0, 29.0, 31.0, 33.0]},
        {"L4": [0.53, 0.547, 0.75]},
        rtol=1e-6,
        boundaries=False,
    )
    assert np.isnan(chart.stable[2]).all()
    assert "cannot turn" in chart.failures[2, 0]
    for row, L4 in enumerate(chart.y[:2]):
        alone = solve.floquet(solve.load("four_bar", L4=L4), 29.0, rtol=1e-6)
        assert chart.spectral_radius[row, 2] == pytest.approx(alone.spectral_radius, rel=SAME)
        assert chart.verdicts[row, 2] == alone.verdict


def test_only_requested_outputs_are_calculated(four_bar, monkeypatch):
    from solve.beams import structure

    calls = set()

    def recorded(state, kind, *place):
        calls.add(kind)
        return quantity(state, kind, *place)

    quantity = structure.quantity
    monkeypatch.setattr(structure, "quantity", recorded)
    kept = ["follower_midpoint_deflection", "strain_energy"]
    sweep = solve.sweep(four_bar, [20.0], rtol=1e-3, quantities=kept)
    assert calls == {"deflection", "strain_energy"}
    assert list(sweep.points[0].statistics) == kept
    orbit = solve.periodic(four_bar, 20.0, rtol=1e-3)
    calls.clear()
    assert orbit.statistics("strain_energy").max > 0
    assert calls == {"strain_energy"}
    with pytest.raises(KeyError):
        output_values(four_bar, orbit.phase, 20.0, orbit.q, orbit.qd, orbit.qdd)["energy"]
