"""The four-bar over its speed: sweeps of a structure against single solves."""

import pytest

import solve


def test_doubtful_speed_is_resolved_on_a_finer_grid():
    """At 32.4 rad/s two grids agree while a hidden multiplier is still in doubt: no point is settled then."""
    model, speed = solve.load("four_bar"), 32.3728813559322
    swept = solve.sweep(model, [speed], rtol=1e-6, quantities=["A_x"]).points[0]
    alone = solve.periodic(model, speed, rtol=1e-6)
    assert swept.error is None
    assert swept.spectral_radius == pytest.approx(alone.spectral_radius, rel=1e-6)
    assert swept.statistics["A_x"].max_abs == pytest.approx(alone.statistics("A_x").max_abs, rel=1e-6)
