"""Sweeps of the four-bar linkage compared with single solutions."""

import pytest

import solve


def test_doubtful_speed_is_resolved_on_a_finer_grid():
    """At 32.4 rad/s, two grids agree although a multiplier is not yet resolved. No point is accepted then."""
    model, speed = solve.load("four_bar"), 32.3728813559322
    swept = solve.sweep(model, [speed], rtol=1e-6, quantities=["A_x"]).points[0]
    alone = solve.periodic(model, speed, rtol=1e-6)
    assert swept.error is None
    assert swept.spectral_radius == pytest.approx(alone.spectral_radius, rel=1e-6)
    assert swept.statistics["A_x"].max_abs == pytest.approx(alone.statistics("A_x").max_abs, rel=1e-6)
