"""Stability charts, compared with characteristic values and single solutions."""

import pickle

import numpy as np
import pytest
from scipy.special import mathieu_a, mathieu_b

import solve
from derive import Mechanism, cos, rate
from solve.batch.task import Task
from solve.errors import MissingValueError, NoResultError, UnknownNameError, ValueOutOfBoundsError
from solve.period.named import Named
from tests.solve import systems

X, Y = {"delta": np.linspace(-1, 10, 30)}, {"epsilon": np.linspace(0.05, 8, 30)}


@pytest.fixture(scope="module")
def undamped():
    return solve.chart(solve.load("mathieu", zeta=0.0), X, Y, 1.0)


def distances(points):
    """Distance along delta from each point (k, 2) to every characteristic curve a_0 … a_4 and b_1 … b_4."""
    delta, q = points[:, 0], points[:, 1] / 2
    curves = [mathieu_a(k, q) for k in range(5)] + [mathieu_b(k, q) for k in range(1, 5)]
    return np.abs(np.array(curves) - delta)


def test_boundaries_match_characteristic_values(undamped):
    for curve in undamped.boundaries:
        assert distances(curve.points).min(axis=0).max() < 1e-6


def test_every_characteristic_curve_is_found_with_its_kind(undamped):
    computed = {}
    for curve in undamped.boundaries:
        # Where kinds change along a chain, the pieces share a point: each counts from its second on.
        for place in distances(curve.points[1:]).argmin(axis=0):
            computed.setdefault(int(place), set()).add(curve.name)
    # a_0 a_1 a_2 a_3 … b_1 b_2 b_3: those of even order have period T, the odd ones 2T.
    even, odd = {"+1"}, {"-1"}
    assert computed == {0: even, 1: odd, 2: even, 3: odd, 5: odd, 6: even, 7: odd}


def test_tongues_thinner_than_a_cell_are_followed(undamped):
    lowest = min(curve.points[:, 1].min() for curve in undamped.boundaries if curve.points[0, 0] > 8.5)
    width = mathieu_a(3, 0.025) - mathieu_b(3, 0.025)
    assert abs(width) < 1e-5
    assert lowest == 0.05


@pytest.mark.slow
def test_thin_tongue_is_followed_from_its_first_point():
    """Of two Mathieu oscillators, the third tongue of the second one is thinner than a thirtieth of a
    cell."""
    squares, loads = np.array([1014.6, 16233.5]), np.array([1233.7, 4934.8])

    def build(load):
        def matrices(phase, speed):
            one = np.tile(np.eye(2), (len(phase), 1, 1))
            stiffness = squares * (1 - (100 + load * np.cos(2 * phase))[:, None] / loads)
            return one, 0 * one, stiffness[:, :, None] * np.eye(2), np.zeros((len(phase), 2))

        return solve.PeriodicSystem(matrices, ["q1", "q2"], period=np.pi)

    amplitudes = np.linspace(0, 800, 60)
    chart = solve.chart(build, {"speed": np.linspace(12, 150, 140)}, {"load": amplitudes})
    mean, swing = squares[1] * (1 - 100 / loads[1]), squares[1] * amplitudes[2:] / loads[1]
    for edge, characteristic in ((0, mathieu_a), (1, mathieu_b)):
        speeds = np.sqrt(mean) / 3 * np.ones_like(swing)
        for _ in range(60):
            speeds = np.sqrt(mean / characteristic(3, swing / (2 * speeds**2)))
        curves = np.concatenate([points for kind, points in chart.boundaries if kind == "-1"])
        for speed, load in zip(speeds, amplitudes[2:], strict=True):
            row = curves[np.isclose(curves[:, 1], load, rtol=1e-9)][:, 0]
            assert np.abs(row - speed).min() < 1e-6, (edge, load)


def test_points_equal_single_solutions(undamped):
    rng = np.random.default_rng(0)
    for j, i in zip(rng.integers(0, 30, 8), rng.integers(0, 30, 8), strict=True):
        alone = undamped.at(undamped.x[i], undamped.y[j])
        assert undamped.spectral_radius[j, i] == pytest.approx(alone.spectral_radius, rel=1e-10)
        assert undamped.verdicts[j, i] == alone.verdict
        assert undamped.stable[j, i] == alone.stable
        assert (undamped.kinds[j, i] == "") == alone.stable


def test_narrow_stable_range_has_both_edges():
    chart = solve.chart(
        solve.load("mathieu", zeta=0.0),
        {"delta": np.linspace(-6, -2, 9)},
        {"epsilon": np.linspace(4, 20, 9)},
        1.0,
    )
    assert {curve.name for curve in chart.boundaries} == {"+1", "-1"}
    for curve in chart.boundaries:
        assert distances(curve.points).min(axis=0).max() < 1e-6
    at = chart.cut(x=-4.0)
    assert [kind for _, kind in at.crossings] == ["+1", "-1"]
    low, high = (place for place, _ in at.crossings)
    assert high - low < 0.6


def test_no_narrow_stable_range_if_another_multiplier_is_outside():
    """In addition to Mathieu's coordinate, another coordinate grows everywhere, so that no point is
    stable."""

    def build(delta, epsilon):
        def matrices(phase, speed):
            m = len(phase)
            M, C = (np.tile(np.diag(part), (m, 1, 1)) for part in ([1.0, 1.0], [0.0, -0.2]))
            K = np.zeros((m, 2, 2))
            K[:, 0, 0], K[:, 1, 1] = delta + epsilon * np.cos(2 * phase), 2.0
            return M, C, K, np.zeros((m, 2))

        return systems.system(matrices, 2, period=np.pi)

    axes = {"delta": np.linspace(-6, -2, 5)}, {"epsilon": np.linspace(4, 20, 5)}
    chart = solve.chart(build, *axes, 1.0)
    assert chart.boundaries == []
    alone = solve.chart(solve.load("mathieu", zeta=0.0), *axes, 1.0)
    assert alone.boundaries != []


@pytest.mark.parametrize("deltas", [np.linspace(3.98, 5.98, 11), np.linspace(2.5, 4.08, 11)])
def test_cut_includes_a_tongue_in_an_interval_at_its_end(deltas):
    """The second tongue lies between b_2 and a_2."""
    chart = solve.chart(solve.load("mathieu", zeta=0.0), {"delta": deltas}, Y, 1.0)
    found = [at for at, _ in chart.cut(y=0.5).crossings]
    assert found == pytest.approx([mathieu_b(2, 0.25), mathieu_a(2, 0.25)], abs=1e-6)


@pytest.mark.parametrize("held", ["x", "y"])
def test_cuts_cross_the_boundaries_at_characteristic_values(undamped, held):
    cut = undamped.cut(x=4.3) if held == "x" else undamped.cut(y=1.0)
    points = [(4.3, at) if held == "x" else (at, 1.0) for at, _ in cut.crossings]
    assert len(points) >= 1
    assert distances(np.array(points)).min(axis=0).max() < 1e-7
    assert cut.along == ("epsilon" if held == "x" else "delta")


def test_damped_boundaries_lie_on_the_unit_circle():
    chart = solve.chart(solve.load("mathieu", zeta=0.05), X, Y, 1.0)
    assert chart.boundaries
    for curve in chart.boundaries:
        for x, y in curve.points[::9]:
            assert chart.at(x, y).spectral_radius == pytest.approx(1.0, abs=1e-5)


def test_chart_of_a_user_function():
    def build(delta, epsilon):
        def matrices(phase, speed):
            one = np.ones((len(phase), 1, 1))
            return one, 0 * one, (delta + epsilon * np.cos(2 * phase))[:, None, None], 0 * one[:, 0]

        return systems.system(matrices, 1, period=np.pi)

    chart = solve.chart(build, {"delta": [0.5, 1.0, 1.5]}, {"epsilon": [0.5, 1.0]}, 1.0, boundaries=False)
    model = solve.chart(
        solve.load("mathieu", zeta=0.0),
        {"delta": [0.5, 1.0, 1.5]},
        {"epsilon": [0.5, 1.0]},
        1.0,
        boundaries=False,
    )
    np.testing.assert_allclose(chart.spectral_radius, model.spectral_radius, rtol=1e-12)


@pytest.mark.parametrize(
    ("x", "y", "error", "text"),
    [
        ({"delt": [1, 2]}, Y, UnknownNameError, "did you mean 'delta'"),
        (X, X, ValueOutOfBoundsError, "both delta"),
        ({"delta": [2, 1]}, Y, ValueOutOfBoundsError, "in increasing order"),
        ({"delta": [1]}, Y, ValueOutOfBoundsError, "at least two"),
        ({}, Y, ValueOutOfBoundsError, "give one"),
        (X, {"zeta": [-1, 1]}, ValueOutOfBoundsError, "zeta"),
    ],
)
def test_invalid_input_is_refused(x, y, error, text):
    with pytest.raises(error, match=text):
        solve.chart("mathieu", x, y)


@pytest.mark.parametrize("tolerance", [0.0, -1e-6, float("nan"), 1.0])
def test_invalid_tolerance_is_refused(tolerance):
    with pytest.raises(ValueOutOfBoundsError, match="tolerance is"):
        solve.chart("mathieu", X, Y, tolerance=tolerance)


def test_case_is_refused_for_a_loaded_system():
    with pytest.raises(ValueOutOfBoundsError, match="case is 'stable', but a system already has values"):
        solve.chart(solve.load("mathieu"), X, Y, case="stable")


def test_chart_uses_the_case_speed_by_default():
    model = solve.load("mathieu")
    assert solve.load("mathieu").labels.case_speed == "1 rad/s"
    plain, named, given = (
        solve.chart(*of, {"delta": [1, 2]}, {"epsilon": [1, 2]}, *speed, boundaries=False).spectral_radius
        for of, speed in (((model,), ()), (("mathieu",), ()), ((model,), (2.0,)))
    )
    np.testing.assert_array_equal(plain, named)
    assert (plain != given).all()


def test_chart_requires_a_speed():
    with pytest.raises(MissingValueError, match="no speed given"):
        solve.chart(solve.load("cam"), {"k3": [1e8, 2e8]}, {"k2": [1e8, 2e8]})


def test_figure_labels_the_boundaries(undamped):
    figure = undamped.plot()
    assert figure.axes[0].get_xlabel().startswith("δ")
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    unstable = ["unstable, ρ = +1: period T", "unstable, ρ = −1: period 2T"]
    assert names == ["stable", *unstable, "boundary +1", "boundary −1"]
    assert len(figure.axes[0].get_lines()) == len(undamped.boundaries)


def test_axes_may_be_texts_as_on_the_command_line():
    model = solve.load("cam")
    texts = solve.chart(model, "k1=8e4:9e4:2", "speed=100:200:3rpm", boundaries=False)
    k1, speeds = np.array([8e4, 9e4]), np.pi / 30 * np.array([100.0, 150.0, 200.0])
    numbers = solve.chart(model, {"k1": k1}, {"speed": speeds}, boundaries=False)
    half = solve.chart(model, {"k1": "8e4:9e4:2"}, {"speed": "100 150 200 rpm"}, boundaries=False)
    for computed in (texts, half):
        np.testing.assert_array_equal(computed.x, numbers.x)
        np.testing.assert_allclose(computed.y, numbers.y, rtol=1e-15)
        np.testing.assert_allclose(computed.spectral_radius, numbers.spectral_radius, rtol=1e-10)


def test_chart_quantity_matches_single_solutions():
    cam, speeds, stiff = solve.load("cam"), np.array([50.0, 60.0]), np.array([7e4, 8e4])
    for of in (
        "q3.max_abs",
        "contact_force.min",
        "q1.harmonic4",
        "rho1.re",
        "exponent2.im",
        "spectral_radius",
    ):
        chart = solve.chart(cam, {"speed": speeds}, {"k1": stiff}, boundaries=False, of=of)
        orbit = solve.periodic(cam.varied({"k1": 7e4}), 60.0)
        assert chart.values[0, 1] == pytest.approx(Named.parse(cam, of).value(orbit), rel=1e-6), of
        assert chart.record()["of"] == of
        assert chart.to_xarray()[of].sel(k1=7e4, speed=60.0) == chart.values[0, 1]
    with pytest.raises(ValueOutOfBoundsError, match="one real value"):
        solve.chart(cam, {"speed": speeds}, {"k1": stiff}, of="rho1")
    with pytest.raises(UnknownNameError):
        solve.chart(cam, {"speed": speeds}, {"k1": stiff}, of="q3.maximal")


def test_orbit_chart_warns_where_the_linear_model_fails():
    """The warning is that of the orbit farthest beyond the bound. A chart of multipliers has no orbits."""
    cam, speeds, stiff = solve.load("cam"), {"speed": [50.0, 60.0]}, {"k1": [7e4, 8e4]}
    orbits = [solve.periodic(cam.varied({"k1": k1}), speed) for k1 in (7e4, 8e4) for speed in (50.0, 60.0)]
    largest = max(orbit.statistics("q1").max_abs for orbit in orbits)
    chart = solve.chart(cam, speeds, stiff, boundaries=False, of="q3.max_abs")
    text = f"at some points the linearisation may be invalid: max|q1| = {largest:.3g} rad, beyond 0.05"
    assert text in chart.warnings
    assert solve.chart(cam, speeds, stiff, boundaries=False, of="rho1.re").warnings == []


def test_violated_bounds_are_reported_despite_points_without_orbit():
    made = Mechanism("trusted", "An oscillator that is trusted to 1 m")
    q = made.coordinate("q", "m", "displacement")
    m, k, f = made.parameters(m=("kg", "mass"), k=("N/m", "spring"), f=("N", "load"))
    made.kinetic, made.potential = m * rate(q) ** 2 / 2, k * q**2 / 2
    made.force(f * cos(made.phase), along=q)
    made.trust(q=1.0)
    model = solve.load(made, m=1.0, k=1.0, f=1.0)
    chart = solve.chart(model, {"k": [1.0, 1.1]}, {"speed": [1.0, 2.0]}, boundaries=False, of="q.max_abs")
    without, beyond = chart.warnings
    assert without.startswith("1 of 4 points has no orbit")
    assert "max|q| = 10 m, beyond 1" in beyond


def test_orbit_chart_solves_once_and_keeps_stability_without_an_orbit(monkeypatch):
    """The undamped oscillator x″ + k x = cos φ has no orbit at k = 1 and speed 1."""
    solved, whole = [], Task.solved
    monkeypatch.setattr(Task, "solved", lambda *of: solved.append(len(of[2])) or whole(*of))

    def build(k, c):
        def matrices(phase, speed):
            one = np.ones((len(phase), 1, 1))
            return one, c * one, k * one, np.cos(phase)[:, None]

        return solve.PeriodicSystem(matrices, ["x"])

    axes = {"k": [0.5, 1.0, 2.0]}, {"c": [0.0, 0.1]}
    chart = solve.chart(build, *axes, 1.0, boundaries=False, of="x.max_abs")
    assert solved == [6]
    k, c = np.meshgrid(*(next(iter(axis.values())) for axis in axes))
    with np.errstate(divide="ignore"):
        size = 1 / np.hypot(1 - k, c)
    np.testing.assert_allclose(chart.values, np.where(np.isinf(size), np.nan, size), rtol=1e-7)
    plain = solve.chart(build, *axes, 1.0, boundaries=False)
    np.testing.assert_allclose(chart.spectral_radius, plain.spectral_radius, rtol=1e-7)
    np.testing.assert_array_equal(chart.verdicts, plain.verdicts)
    assert chart.failures == plain.failures == {}
    (warning,) = chart.warnings
    assert warning.startswith("1 of 6 points has no orbit: I - Φ is singular")
    with pytest.raises(NoResultError, match="4 points, none with a result: I - Φ is singular"):
        solve.chart(lambda a, b: build(1, 0), {"a": [1.0, 2.0]}, {"b": [1.0, 2.0]}, 1.0, of="x.max_abs")


def test_pickled_chart_can_solve_further_points():
    chart = solve.chart("mathieu", {"delta": [1.0, 2.0, 3.0]}, {"epsilon": [0.5, 1.0]})
    other = pickle.loads(pickle.dumps(chart))
    assert other.record() == chart.record()
    assert other.at(1.5, 0.7).record() == chart.at(1.5, 0.7).record()
    assert other.cut(y=0.7).crossings == chart.cut(y=0.7).crossings != []
