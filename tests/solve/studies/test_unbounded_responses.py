"""Responses that are unbounded: at undamped resonances and at edges of unstable ranges."""

import numpy as np
import pytest

import solve
from tests.solve import systems


def pushed(damping):
    """q″ + 2 ζ 3 q′ + 9 q = cos Ωt + cos 2Ωt."""

    def push(phase):
        return (np.cos(phase) + np.cos(2 * phase))[:, None]

    return systems.constant(np.eye(1), np.eye(1) * 6 * damping, np.eye(1) * 9.0, push)


def test_undamped_resonance_is_unbounded():
    critical = solve.critical_speeds(pushed(0.0), "10:40:30 rpm", orders=4)
    rows = [row for row in critical.rows if row.response]
    assert [row.response.speed for row in rows] == pytest.approx([3.0, 1.5], rel=2e-5)
    assert all(row.unbounded and row.response.height == np.inf for row in rows)
    assert [row["response_height"] for row in critical.record()["rows"] if row["unbounded"]] == [None, None]
    (warning,) = [text for text in critical.warnings if "is unbounded at 14.324 rpm" in text]
    assert "a multiplier is +1 there" in warning
    assert "∞" in critical._repr_html_()
    assert "unbounded at 14.324 rpm, at 28.648 rpm" in critical.summary
    axes = critical.plot().axes[0]
    assert "unbounded" in [text.get_text() for text in axes.get_legend().get_texts()]
    lines = sorted(line.get_xdata()[0] for line in axes.get_lines() if line.get_marker() == "^")
    assert lines == pytest.approx([1.5 * 30 / np.pi, 3 * 30 / np.pi], rel=2e-5)


@pytest.mark.parametrize("count", [30, 60, 120])
def test_response_in_narrow_unstable_ranges_is_unbounded(count):
    """In q″ + 100 (1 + cos φ / 5) q = 1 + cos φ, a multiplier is +1 at both edges of each unstable range, at
    divisions of the mean frequency. Each range is narrower than the previous one by a power of ten."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        stiffness = 100 * (1 + 0.2 * np.cos(phase))[:, None, None]
        return one, 0 * one, stiffness, (1 + np.cos(phase))[:, None]

    critical = solve.critical_speeds(solve.PeriodicSystem(matrices, ["q"]), f"1.2:6:{count} rad/s")
    divisions = [row.response for row in critical.rows if row.response and row.response.height > 0.1]
    assert [round(9.97 / one.speed) for one in divisions] == [2, 3, 4, 5, 6, 7, 8]
    assert all(one.height == np.inf for one in divisions)


def test_resonance_with_slight_damping_has_a_finite_height():
    critical = solve.critical_speeds(pushed(1e-7), np.linspace(2.5, 3.5, 12), orders=1)
    (row,) = [row for row in critical.rows if row.response]
    assert not row.unbounded
    assert row.response.height == pytest.approx(1 / (2e-7 * 9), rel=1e-5)
    assert not any("unbounded" in text for text in critical.warnings)


def test_response_is_unbounded_at_edges_of_narrow_unstable_ranges():
    """The system is a pendulum whose pivot moves vertically. Among the given speeds, there is one maximum
    near both edges."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        shaken = speed**2 * (0.06 * np.cos(phase) + 0.08 * np.cos(2 * phase))
        load = 0.01 * speed**2 * np.sin(phase)[:, None]
        return one, 0.08 * one, one * 19.62 - shaken[:, None, None], load

    pendulum = solve.PeriodicSystem(matrices, ["q"])
    (band,) = solve.bands(pendulum, [4.0, 5.0])
    critical = solve.critical_speeds(pendulum, np.linspace(2.0, 20.0, 30))
    speeds = [row.response.speed for row in critical.rows if row.response and row.unbounded]
    assert band.kind == "+1"
    assert speeds == pytest.approx([band.high, band.low], rel=2e-5)


def test_response_is_unbounded_at_edges_between_given_speeds():
    """At both given speeds, det(I - Φ) is positive. Between them, the dominant multiplier rises beyond +1."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, 2.0 * one, 1e4 * one * (1 + 0.3 * np.cos(phase))[:, None, None], np.cos(phase)[:, None]

    system = solve.PeriodicSystem(matrices, ["q"])
    (band,) = solve.bands(system, np.linspace(98.0, 101.0, 31))
    critical = solve.critical_speeds(system, [30.0, 160.0])
    speeds = [row.response.speed for row in critical.rows if row.response and row.unbounded]
    assert speeds == pytest.approx([band.high, band.low], rel=2e-5)
    (unstable,) = critical.unstable_ranges
    assert unstable[:2] == pytest.approx((band.low, band.high), rel=2e-5)
