"""Points without a result are reported as unknown: neither stable nor unstable."""

import numpy as np
import pytest
from scipy.special import mathieu_a, mathieu_b

import solve
from solve.errors import MatricesError, NoResultError, ValueOutOfBoundsError
from tests.solve import systems

LOW, HIGH = 1.3, 2.6
"""Range of delta within which the equation below has no matrices."""


def holed(delta, epsilon):
    """Return the undamped Mathieu equation with NaN matrices between LOW and HIGH."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        stiffness = (delta + epsilon * np.cos(2 * phase))[:, None, None]
        return one, 0 * one, stiffness if not LOW < delta < HIGH else np.nan * one, 0 * one[:, 0]

    return systems.system(matrices, 1, period=np.pi)


@pytest.fixture(scope="module")
def gapped_chart():
    x, y = {"delta": np.linspace(0.2, 4.7, 31)}, {"epsilon": np.linspace(0.5, 2.5, 5)}
    return solve.chart(holed, x, y, 1.0)


def test_chart_marks_failed_points(gapped_chart):
    hole = np.broadcast_to((gapped_chart.x > LOW) & (gapped_chart.x < HIGH), gapped_chart.shape)
    np.testing.assert_array_equal(np.isnan(gapped_chart.stable), hole)
    np.testing.assert_array_equal(np.isnan(gapped_chart.spectral_radius), hole)
    np.testing.assert_array_equal(gapped_chart.verdicts == "failed", hole)
    assert not gapped_chart.kinds[hole].any()
    assert len(gapped_chart.failures) == hole.sum()
    assert "NaN or infinite" in gapped_chart.failures[0, int(np.flatnonzero(hole[0])[0])]


def test_no_boundary_is_drawn_at_failed_points(gapped_chart):
    """For large epsilon, the right edge of the first tongue lies in the range without matrices."""
    for curve in gapped_chart.boundaries:
        delta, q = curve.points[:, 0], curve.points[:, 1] / 2
        assert not ((delta > LOW) & (delta < HIGH)).any()
        truth = [mathieu_a(0, q), mathieu_a(1, q), mathieu_b(1, q), mathieu_a(2, q), mathieu_b(2, q)]
        assert np.abs(np.array(truth) - delta).min(axis=0).max() < 1e-6
    assert {curve.name for curve in gapped_chart.boundaries} == {"+1", "-1"}


def test_band_edge_at_failed_points_is_omitted_from_a_cut(gapped_chart):
    cut = gapped_chart.cut(y=1.0)
    hole = (cut.values > LOW) & (cut.values < HIGH)
    np.testing.assert_array_equal(np.isnan(cut.stable), hole)
    np.testing.assert_array_equal(np.isnan(cut.spectral_radius), hole)
    # Of the edges b_1, a_1, b_2, a_2 the hole swallows a_1 (1.467).
    edges = [mathieu_b(1, 0.5), mathieu_b(2, 0.5), mathieu_a(2, 0.5)]
    assert [at for at, _ in cut.crossings] == pytest.approx(edges, abs=1e-7)


def test_figure_marks_failed_points_of_a_chart(gapped_chart):
    assert gapped_chart.plot().axes


def test_chart_without_any_result_is_refused():
    with pytest.raises(NoResultError, match=r"4 points, none with a result: .* NaN"):
        solve.chart(holed, {"delta": [1.5, 2.0]}, {"epsilon": [0.5, 1.0]}, 1.0)


@pytest.fixture(scope="module")
def rotating_linkage():
    model = solve.load("coupler", alpha=0, cx=0, cy=0)
    speeds = np.linspace(400.0, 560.0, 6)
    return solve.chart(model, {"speed": speeds}, {"l2": [0.05, 0.2, 0.45, 0.59, 0.61, 0.75]})


def test_impossible_linkages_fail_point_by_point(rotating_linkage):
    # l1 + l2 < l3 + l4 = 1.6 with l1 = 1.
    np.testing.assert_array_equal(np.isnan(rotating_linkage.stable).all(axis=1), rotating_linkage.y > 0.6)
    assert not np.isnan(rotating_linkage.stable[rotating_linkage.y < 0.6]).any()
    assert "the crank cannot turn fully" in rotating_linkage.failures[4, 0]
    for curve in rotating_linkage.boundaries:
        assert curve.points[:, 1].max() < 0.6


def test_parameters_out_of_bounds_are_refused_before_solving():
    with pytest.raises(ValueOutOfBoundsError, match=r"l2 .* is -0.1 m; allowed: > 0"):
        solve.chart(solve.load("coupler"), {"l2": [-0.1, 0.1]}, {"speed": [400.0, 500.0]})


def broken(delta, low, high):
    """Return the undamped Mathieu equation with epsilon = 2. It has no matrices between two speeds."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        stiffness = (delta + 2 * np.cos(2 * phase))[:, None, None]
        return one, 0 * one, stiffness if not low < speed < high else np.nan * one, 0 * one[:, 0]

    return systems.system(matrices, 1, period=np.pi)


def test_bands_have_open_edges_at_failed_speeds():
    whole = solve.bands(broken(4.0, 9, 9), np.linspace(1.2, 3.0, 20))
    (band,) = whole
    assert whole.notes == []
    low, high = 1.9, 2.1
    assert band.low < low < high < band.high
    bands = solve.bands(broken(4.0, low, high), np.linspace(1.2, 3.0, 20))
    left, right = bands
    assert (left.open_low, left.open_high, right.open_low, right.open_high) == (False, True, True, False)
    assert left.low == pytest.approx(band.low, rel=1e-6)
    assert right.high == pytest.approx(band.high, rel=1e-6)
    assert low - bands.spacing <= left.high <= low
    assert high <= right.low <= high + bands.spacing
    assert "have no result" in bands.notes[0]
    assert "NaN" in bands.notes[0]


def test_band_edge_between_failed_speeds_is_open():
    (band,) = solve.bands(broken(4.0, 9, 9), np.linspace(1.2, 3.0, 20))
    system = broken(4.0, band.low - 0.1, band.low + 0.1)
    (cut,) = solve.bands(system, np.linspace(1.2, 3.0, 20))
    assert (cut.open_low, cut.open_high) == (True, False)
    assert cut.low >= band.low + 0.1


def test_unstable_ranges_of_a_sweep_end_at_failed_points():
    speeds = np.linspace(1.2, 3.0, 37)
    sweep = solve.sweep(broken(4.0, 1.9, 2.1), speeds)
    (_, first, _), (second, _, _) = sweep.unstable
    known = speeds[~np.isnan(sweep.spectral_radius)]
    assert first == known[known <= 1.9].max()
    assert second == known[known >= 2.1].min()


def test_critical_speeds_report_failed_speeds():
    model = solve.load("mathieu")
    good = solve.critical_speeds(model, "0.5:3:20 rad/s")
    assert not good.notes
    critical = solve.critical_speeds(broken(4.0, 1.9, 2.1), np.linspace(1.2, 3.0, 20))
    assert any("speeds have no result" in note for note in critical.notes)


def faulty(fault):
    """Return a damped oscillator that raises an error at the speed 2 rad/s."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 2, 2))
        mass = np.diag([1.0, 0.0 if fault == "singular" and speed == 2.0 else 1.0]) * one
        drift = phase if fault == "not periodic" and speed == 2.0 else 0 * phase
        stiffness = (9.0 + np.cos(phase) + drift)[:, None, None] * np.eye(2)
        return mass, 0.3 * np.eye(2) * one, stiffness, np.cos(phase)[:, None] * np.ones(2)

    return systems.system(matrices, 2)


@pytest.mark.parametrize("fault", ["singular", "not periodic"])
def test_sweep_and_single_solution_report_the_same_error(fault):
    system = faulty(fault)
    with pytest.raises(MatricesError) as refused:
        solve.periodic(system, 2.0)
    sweep = solve.sweep(system, [1.0, 1.5, 2.0, 2.5, 3.0])
    assert {point.speed: point.error for point in sweep.points if point.error} == {2.0: str(refused.value)}


def test_chart_and_single_solution_report_the_same_failure():
    def built(mass, stiffness):
        def matrices(phase, speed):
            one = np.ones((len(phase), 1, 1))
            return mass * one, 0.3 * one, (stiffness + np.cos(phase))[:, None, None], 0 * one[:, 0]

        return systems.system(matrices, 1)

    with pytest.raises(MatricesError) as refused:
        solve.floquet(built(0.0, 9.0), 1.0)
    chart = solve.chart(built, {"mass": [0.0, 0.5, 1.0]}, {"stiffness": [4.0, 9.0]}, 1.0)
    assert chart.failures == {(row, 0): str(refused.value) for row in (0, 1)}


def known_between(low, high):
    """Return a damped oscillator with a varying stiffness. It has matrices only at speeds between `low` and
    `high`."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        inertia = one if low < speed < high else np.nan * one
        return inertia, 0.02 * one, (4 + 0.9 * np.cos(phase))[:, None, None], np.cos(phase)[:, None]

    return systems.system(matrices, 1)


@pytest.mark.parametrize("speeds", [np.linspace(1.0, 6.0, 11), np.array([1.0, 6.0])])
def test_failed_speeds_at_the_range_ends_are_omitted(speeds):
    """The unstable band and the maximum of the response lie at speeds with matrices. A note states the speeds
    without matrices."""
    system, whole = known_between(1.55, 5.1), known_between(-1.0, 9.0)
    gapped_chart, every = solve.bands(system, speeds), solve.bands(whole, speeds)
    assert [band.kind for band in gapped_chart] == [band.kind for band in every] == ["+1", "-1"]
    for band, other in zip(gapped_chart, every, strict=True):
        assert (band.low, band.high) == pytest.approx((other.low, other.high), rel=1e-6)
    (note,) = gapped_chart.notes
    critical = solve.critical_speeds(system, speeds, orders=4)
    peaks = [row.radius.speed for row in critical.rows if row.radius]
    reference = [
        row.radius.speed for row in solve.critical_speeds(whole, speeds, orders=4).rows if row.radius
    ]
    assert len(peaks) == 2
    assert peaks == pytest.approx(reference, rel=1e-4)
    for text in (note, critical.notes[-1]):
        assert "have no result, from 9.5493 to 14." in text
        assert "to 57.296 rpm: M has NaN" in text


@pytest.mark.parametrize("study", [solve.bands, solve.critical_speeds])
def test_speed_range_without_any_matrices_is_refused(study):
    with pytest.raises(MatricesError, match="M has NaN"):
        study(known_between(7.0, 8.0), [1.0, 6.0])
