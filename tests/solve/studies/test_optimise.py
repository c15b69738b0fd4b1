"""Optima of parameters: closed forms, scans, constraints, stability, and invalid requests."""

import json
from dataclasses import replace

import numpy as np
import pytest

import solve
from derive import Mechanism, cos, rate, sin
from models.manipulator.mechanism import mechanism as manipulator
from solve.commands.app import run
from solve.errors import SolveError, UnitError, UnknownNameError, ValueOutOfBoundsError
from solve.methods.choice import chosen
from solve.period.named import Named
from solve.studies.design_points import Design
from solve.studies.optimum_search import Search
from solve.studies.over_speed import Peak
from solve.studies.tracked import tracked
from tests.solve.studies.driven_oscillator import DAMPING, MASS, STIFFNESS, loaded, response
from tests.solve.studies.test_tracked import differences


@pytest.fixture(scope="module")
def model():
    return loaded()


def test_optimum_has_equal_peaks_at_two_speeds(model):
    low, high = 1.5, 3.0
    found = solve.optimise(model, "q.max_abs", {"k": (5.0, 17.0)}, [low, high])
    # Equal moduli of k - m Ω² + i c Ω at both speeds.
    k = MASS * (low**2 + high**2) / 2 + DAMPING**2 / (2 * MASS)
    assert found.free["k"] == pytest.approx(k, rel=1e-6)
    assert found.objective == pytest.approx(abs(response(low, k=k)), rel=1e-6)
    assert found.values[0] == pytest.approx(found.values[1], rel=1e-6)
    assert found.before == pytest.approx(max(abs(response(low)), abs(response(high))), rel=1e-7)


def largest(p1, p2, speed):
    """Return the largest |q| on a fine grid of phases."""
    phase = np.linspace(0, 2 * np.pi, 20001)
    curve = p1 * response(speed) * np.exp(1j * phase) + p2 * response(3 * speed) * np.exp(3j * phase)
    return np.abs(curve.real).max()


@pytest.mark.parametrize("figure", ["load.max", "load.range"])
def test_equality_constraint_on_the_largest_load_is_met(model, figure):
    speed = 0.8
    free = {"p1": (0.5, 1.5), "p2": (-0.4, 0.4)}
    found = solve.optimise(model, "q.max_abs", free, speed, keep=[figure])
    load = solve.periodic(found.system, speed).statistics("load")
    kept = load.max if figure == "load.max" else load.max - load.min
    assert kept == pytest.approx(1.0 if figure == "load.max" else 2.0, abs=1e-9)
    # Where p2 > -p1 / 9 the load is largest at phase 0, p1 + p2 = 1.
    scan = [largest(p1, 1 - p1, speed) for p1 in np.linspace(0.6, 1.1, 501)]
    assert found.objective == pytest.approx(min(scan), rel=1e-4)
    assert found.objective < 0.9 * found.before


def test_curve_constraint_is_met_within_its_tolerance(model):
    found = solve.optimise(
        model, "q.max_abs", {"p1": (0.5, 1.5), "p2": (-0.4, 0.4)}, 0.8, keep=["load@0:30 deg within 0.05 N"]
    )
    phase = np.radians(np.linspace(0, 30, 301))
    change = found.free["p1"] * np.cos(phase) + found.free["p2"] * np.cos(3 * phase) - np.cos(phase)
    assert np.abs(change).max() == pytest.approx(0.05, rel=1e-3)


def test_bound_on_another_quantity_is_active_at_the_optimum(model):
    found = solve.optimise(model, "q.max_abs", {"k": (4.0, 20.0)}, 0.5, subject=["q.max > 0.1"])
    assert found.objective == pytest.approx(0.1, rel=1e-5)
    assert found.constraints[1].value >= 0.1 * (1 - 1e-6)
    assert abs(response(0.5, k=found.free["k"])) == pytest.approx(0.1, rel=1e-5)


@pytest.fixture
def solutions(monkeypatch):
    """Return the speeds of all solutions that are computed at designs."""
    speeds, at = [], Design.at
    monkeypatch.setattr(Design, "at", lambda design, x, given: speeds.extend(given) or at(design, x, given))
    return speeds


def test_infeasible_requirement_is_reported_with_its_best_value(model):
    found = solve.optimise(model, "q.max_abs", {"k": (8.0, 10.0)}, 0.5, subject=["q.max < 10 mm"])
    least = abs(response(0.5, k=10.0))
    assert found.objective == pytest.approx(least, rel=1e-6)
    text = f"fulfils q.max < 10 mm; the closest reaches {1e3 * least:.3g} mm"
    assert any(text in warning for warning in found.warnings)


def test_conflicting_requirements_are_both_reported(model, solutions):
    bounds = ["q.max < 0.1", "q.max > 0.11"]
    found = solve.optimise(model, "q.max_abs", {"k": (8.0, 12.0)}, 0.5, subject=bounds)
    # Equal violations, relative to the bounds.
    assert found.objective == pytest.approx(2 / (1 / 0.1 + 1 / 0.11), rel=1e-5)
    assert any("fulfils q.max < 0.1 and q.max > 0.11; the" in warning for warning in found.warnings)
    assert len(solutions) < 100


def test_unavoidable_unstable_band_ends_the_search_over_its_range(solutions):
    pendulum = solve.load("mathieu", delta=2.0, epsilon=1.0, zeta=0.02)
    found = solve.optimise(pendulum, "spectral_radius", {"zeta": (0.0, 0.1)}, "1:2:3 rad/s", rtol=1e-6)
    damped = pendulum.varied({"zeta": 0.1})
    worst = max(solve.floquet(damped, speed).spectral_radius for speed in np.linspace(1.38, 1.42, 41))
    assert found.objective == pytest.approx(worst, rel=1e-4)
    assert any(f"spectral_radius < 1; the closest reaches {worst:.3g}" in text for text in found.warnings)
    assert len(solutions) < 500


def test_unstable_initial_design_becomes_stable():
    unstable = solve.load("mathieu", delta=1.0, epsilon=0.5, zeta=0.01)
    assert solve.floquet(unstable, 1.0).verdict == "unstable"
    found = solve.optimise(unstable, "spectral_radius", {"delta": (0.9, 2.0)}, 1.0)
    assert solve.floquet(found.system, 1.0).verdict == "asymptotically stable"


def test_unavoidable_narrow_unstable_band_is_reported():
    # Mathieu's first tongue, about the speed of the natural frequency, has a width of 2 %.
    pendulum = solve.load("mathieu", delta=1.0, epsilon=0.05, zeta=0.005)
    found = solve.optimise(pendulum, "spectral_radius", {"delta": (0.99, 1.01)}, "0.7:1.7:2 rad/s", rtol=1e-4)
    assert any("unstable from 0.9" in text and "no design" in text for text in found.warnings)


@pytest.mark.slow
def test_narrow_unstable_band_is_moved_out_of_the_range():
    # The tongue is about the speed √delta, and closed by damping only for delta > ε / (4 ζ) = 12.5.
    pendulum = solve.load("mathieu", delta=1.0, epsilon=0.05, zeta=0.001)
    speeds, free = "0.7:1.7:2 rad/s", {"delta": (0.99, 4.5)}
    assert len(solve.bands(pendulum, speeds, rtol=1e-4))
    found = solve.optimise(pendulum, "spectral_radius", free, speeds, rtol=1e-4)
    assert not found.warnings
    assert not len(solve.bands(found.system, speeds, rtol=1e-4))
    assert found.free["delta"] > 1.7**2


def test_maximum_over_speed_and_its_derivatives_match_closed_forms(model):
    """The height of the resonance is F / (c ω √(1 - D²)), where D is the damping ratio, at every design."""
    speed = np.sqrt(STIFFNESS / MASS)
    speeds = [0.995 * speed, speed, 1.005 * speed]
    design = Design(
        model, ["k", "c"], np.array([8.9, 0.25]), np.array([9.1, 0.35]), speeds, "auto", 1e-10, True
    )
    x = np.array([0.45, 0.55])
    extrema = tracked(design, x, 1, Named.parse(model, "q.max_abs"))
    peak = Peak([replace(extrema, at=at) for at in range(3)])
    k, c = design.low + x * (design.high - design.low)
    ratio = c / (2 * np.sqrt(k * MASS))
    height = np.sqrt(MASS / k) / (c * np.sqrt(1 - ratio**2))
    np.testing.assert_allclose(peak.values(x), height, rtol=1e-4)
    np.testing.assert_allclose(peak.slopes(x), differences(peak.values, x), rtol=1e-5)


def test_objective_function_of_orbits_equals_the_named_quantity(model):
    free, speeds = {"k": (5.0, 17.0)}, [1.5, 3.0]
    named = solve.optimise(model, "q.rms", free, 3.0)
    given = solve.optimise(model, lambda orbits: orbits[0].statistics("q").rms, free, 3.0)
    assert given.objective == pytest.approx(named.objective, rel=1e-6)
    both = solve.optimise(model, lambda orbits: sum(o.statistics("q").rms for o in orbits), free, speeds)
    scan = [
        sum(abs(response(speed, k=k)) for speed in speeds) / np.sqrt(2) for k in np.linspace(5.0, 17.0, 2401)
    ]
    assert both.objective == pytest.approx(min(scan), rel=1e-5)


def test_random_initial_designs_find_the_better_of_two_minima(model):
    # Amplitudes with stiffnesses above both resonances are lower than those between them.
    free = {"k": (7.0, 60.0)}
    one = solve.optimise(model, "q.max_abs", free, [1.5, 3.0])
    several = solve.optimise(model, "q.max_abs", free, [1.5, 3.0], starts=4)
    assert several.free["k"] == pytest.approx(60.0)
    assert several.objective < one.objective


def dwell_law(cosines):
    """Return a symmetric lift at phases from 0 to 180°."""
    phase, order = np.linspace(0.0, np.pi, 50_001), np.arange(1, 13)
    return phase, np.cos(np.outer(phase, order)) @ cosines


@pytest.mark.slow
def test_cam_with_unchanged_dwell_vibrates_a_third_less():
    cam, names = solve.load("cam", case="dwell"), [f"b{order}" for order in range(1, 13)]
    keep = ["lift.range", "lift@150:210 deg"]
    free = dict.fromkeys(names, (-0.06, 0.08))
    found = solve.optimise(cam, "q3.max_abs", free, "100 rpm", keep=keep, rtol=1e-6)
    assert found.objective < 0.6 * found.before
    laws = []
    for numbers in (cam.parameters, found.free):
        phase, law = dwell_law([-numbers[name] / order for order, name in enumerate(names, 1)])
        laws.append(law)
    dwell, (before, after) = phase >= np.radians(150), laws
    # The law starts as rise, dwell and return of 0.1 m; the fit to twelve harmonics overshoots by 2 %.
    assert np.ptp(before[dwell]) < 1e-9
    assert np.ptp(before) == pytest.approx(0.1, rel=0.02)
    assert np.abs(after - before)[dwell].max() < 1e-9
    assert np.ptp(after) == pytest.approx(np.ptp(before), abs=1e-9)
    assert found.confirmed["objective"] == pytest.approx(found.objective, rel=0.01)
    assert {*found.confirmed["verdicts"]} == {"asymptotically stable"}
    assert not len(solve.bands(found.system, "50:300:11 rpm", rtol=1e-6))


def test_bound_on_an_initially_zero_quantity_is_met(model):
    # A counteracting third harmonic, absent at the start.
    free = {"p1": (0.5, 1.5), "p2": (-0.4, 0.4)}
    start = model.varied({"p1": 1.0, "p2": 0.0, "k": 12.0})
    still = start.varied({"p1": 0.0})
    found = solve.optimise(still, "q.max_abs", {"p1": (0.0, 1.0)}, 0.8, subject=["load.max_abs < 0.5"])
    assert found.objective == 0.0
    assert solve.optimise(start, "q.max_abs", free, 0.8, subject=["load.max > 0.9"]).objective > 0


def manipulator_with_a_torque():
    """Return the manipulator with a periodic torque on its cam and an output; the harmonics of the torque
    have no values."""
    made = manipulator()
    torque = made.series("T", harmonics=6, unit="N m", meaning="torque on the cam")(made.phase)
    made.force(torque, along=made.phase + made.declared_coordinates[0].symbol)
    made.output("torque", torque, "N m", "torque on the cam")
    return made


@pytest.mark.parametrize(
    ("cubic", "bound", "warned"),
    [
        (2.0, "q.max < 2 m", ["q.max_abs of the nonlinear orbits is 1 m instead of 1.4"]),
        (-0.5, "q.max < 0.93 m", ["is 1 m instead of 900 mm", "violate q.max < 0.93 m; they reach 1 m"]),
        (0.02, "q.max < 2 m", []),
    ],
)
def test_optimum_contradicted_by_nonlinear_orbits_has_a_warning(cubic, bound, warned):
    # With k = 4 N/m, q = cos(φ) solves m q̈ + c q̇ + k q + k3 q³ = p1 cos(φ) + p2 cos(3φ) + s sin(φ).
    made = Mechanism("cubic", "Oscillator with a cubic spring")
    (q,) = made.coordinates(q=("m", "displacement"))
    m, c, k = made.parameters(m=("kg", "mass"), c=("N s/m", "damping"), k=("N/m", "spring"))
    k3, p1, p2, s = made.parameters(k3=("N/m^3", "cubic"), **dict.fromkeys(["p1", "p2", "s"], ("N", "load")))
    made.kinetic, made.dissipation = m * rate(q) ** 2 / 2, c * rate(q) ** 2 / 2
    made.potential = k * q**2 / 2 + k3 * q**4 / 4
    made.force(p1 * cos(made.phase) + p2 * cos(3 * made.phase) + s * sin(made.phase), along=q)
    loads = {"p1": 3 + 0.75 * cubic, "p2": 0.25 * cubic, "s": -0.1}
    start = solve.load(made, m=1, c=0.1, k=3.0, k3=cubic, **loads)
    found = solve.optimise(start, "q.max_abs", {"k": (2.5, 4.0)}, 1.0, subject=[bound])
    assert found.free["k"] == pytest.approx(4.0)
    assert found.confirmed["objective"] == pytest.approx(1.0, rel=1e-6)
    about = [text for text in found.warnings if "nonlinear orbits" in text]
    assert len(about) == len(warned)
    assert all(part in text for part, text in zip(warned, about, strict=True))


@pytest.mark.slow
def test_torque_of_150_nm_reduces_the_peak_by_three_quarters():
    names = [f"T{kind}{order}" for order in range(1, 7) for kind in "ab"]
    numbers = {**solve.case_numbers("manipulator").parameters, **dict.fromkeys(["T", *names], 0.0)}
    press = solve.load(manipulator_with_a_torque(), **numbers)
    free = dict.fromkeys(names, (-200.0, 200.0))
    found = solve.optimise(press, "q1.max_abs", free, "50 rpm", subject=["torque.max_abs < 150 N m"])
    assert found.objective < 0.25 * found.before
    assert found.confirmed["objective"] == pytest.approx(found.objective, rel=0.01)
    assert {*found.confirmed["verdicts"]} == {"asymptotically stable"}
    phase = np.linspace(0, 2 * np.pi, 2001)
    waves = [np.cos(k * phase) for k in range(1, 7)], [np.sin(k * phase) for k in range(1, 7)]
    torque = sum(found.free[f"T{kind}{k}"] * waves[kind == "b"][k - 1] for k in range(1, 7) for kind in "ab")
    assert np.abs(torque).max() == pytest.approx(150.0, rel=1e-3)


@pytest.mark.slow
def test_four_bar_optimum_matches_a_fine_scan():
    bar = solve.load("four_bar", elements=1)
    quantity, speed = "crank_root_stress_minus", 17.0
    found = solve.optimise(bar, f"{quantity}.max_abs", {"L4": (0.54, 0.67)}, speed, rtol=1e-7)

    def peaks(lengths):
        orbits = [solve.periodic(bar.varied({"L4": L4}), speed, rtol=1e-6) for L4 in lengths]
        return np.array([orbit.statistics(quantity).max_abs for orbit in orbits])

    middle = 0.605
    for half, count in ((6.5e-2, 14), (1e-2, 21), (1e-3, 21), (2e-4, 41)):
        lengths = middle + np.linspace(-half, half, count)
        values = peaks(lengths)
        at = int(values.argmin())
        middle = lengths[at]
    assert found.free["L4"] == pytest.approx(middle, abs=1e-5)
    # At a kink, where two peaks meet, the value rises linearly on both sides. At a smooth minimum, twice the
    # distance gives four times the rise.
    for side in (-1, 1):
        near, far = values[at + 5 * side] - values[at], values[at + 10 * side] - values[at]
        assert far == pytest.approx(2 * near, rel=0.2)


@pytest.mark.parametrize(
    ("change", "error", "text"),
    [
        ({"minimise": "x.max"}, UnknownNameError, "x.max"),
        ({"minimise": 3}, ValueOutOfBoundsError, "minimise is 3; allowed"),
        ({"minimise": lambda orbits: float("nan")}, ValueOutOfBoundsError, "returns nan; allowed: finite"),
        ({"minimise": lambda orbits: "x"}, ValueOutOfBoundsError, "returns 'x'"),
        ({"free": {"k": 3}}, ValueOutOfBoundsError, r"free is {'k': 3}; allowed: mapping of str to"),
        ({"free": {"k": "5:20"}}, ValueOutOfBoundsError, "free is {'k': '5:20'}"),
        ({"vary": {"k": 3}, "robust": 3}, ValueOutOfBoundsError, "vary is {'k': 3}; allowed: mapping of str"),
        ({"minimise": "q"}, ValueOutOfBoundsError, "contains no statistic"),
        ({"minimise": "rho1"}, ValueOutOfBoundsError, "is complex"),
        ({"free": {}}, ValueOutOfBoundsError, "'free' is empty"),
        ({"free": {"z": (1, 2)}}, UnknownNameError, "parameter of oscillator 'z'"),
        ({"free": {"k": (10, 20)}}, ValueOutOfBoundsError, "its initial value is 9"),
        ({"free": {"k": (0, 20)}}, ValueOutOfBoundsError, "allowed: > 0"),
        ({"free": {"k": ("5 kg", 20)}}, UnitError, "kg"),
        ({"keep": ["load"]}, ValueOutOfBoundsError, "contains no statistic"),
        ({"keep": ["load@30:0 deg"]}, ValueOutOfBoundsError, "ends before it begins"),
        ({"keep": ["load@x deg"]}, ValueOutOfBoundsError, "has no valid interval"),
        ({"keep": ["load.max within 0 N"]}, ValueOutOfBoundsError, "numbers > 0"),
        ({"subject": ["q.max"]}, ValueOutOfBoundsError, "is not a bound"),
        ({"subject": ["q.max < 3 kg"]}, UnitError, "kg"),
        ({"subject": ["q.max < nan m"]}, ValueOutOfBoundsError, "'nan m' in .* is not a finite number"),
        ({"minimise": "q.max_phase"}, ValueOutOfBoundsError, "has no derivatives"),
        ({"subject": ["rho1 < 1"]}, ValueOutOfBoundsError, "is complex"),
        ({"starts": 0}, ValueOutOfBoundsError, "starts is 0"),
        ({"method": "newmark"}, ValueOutOfBoundsError, "allowed for an optimum: radau, gauss, auto"),
    ],
)
def test_invalid_requests_are_refused(model, change, error, text):
    request = {"minimise": "q.max_abs", "free": {"k": (5.0, 20.0)}, "speeds": 1.0, **change}
    with pytest.raises(error, match=text) as caught:
        solve.optimise(model, **request)
    assert isinstance(caught.value, SolveError)
    assert "\n" not in str(caught.value)


def test_saved_result_is_reopened_and_drawn(model, tmp_path):
    found = solve.optimise(model, "q.max_abs", {"k": (5.0, 17.0)}, [1.5, 3.0])
    found.save(tmp_path / "optimum.nc")
    again = solve.open(tmp_path / "optimum.nc")
    assert again.free == found.free
    assert again.record() == found.record()
    assert len(found.plot().axes) == 3
    assert "falls from" in repr(found)


def test_command_prints_the_documented_keys(capsys, tmp_path):
    case = tmp_path / "optimum.toml"
    line = "optimise mathieu --speed 1rad/s --minimise spectral_radius --free zeta --bounds zeta=0:0.1 --json"
    assert run([*line.split(), "--toml", str(case)]) == 0
    record = json.loads(capsys.readouterr().out)
    assert {"free", "objective", "before", "constraints", "confirmed", "warnings"} <= record.keys()
    assert record["constraints"][0].keys() == {"name", "value", "bound"}
    assert run(["floquet", "mathieu", "--cases", str(case), "--speed", "1rad/s", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["parameters"]["zeta"] == pytest.approx(0.1)


def test_verdict_of_the_optimum_is_proved_on_request():
    pytest.importorskip("flint")
    pendulum = solve.load("mathieu", delta=1.0, epsilon=0.05, zeta=0.05)
    found = solve.optimise(pendulum, "spectral_radius", {"zeta": (0.0, 0.1)}, 1.0, prove=True)
    assert found.confirmed["proved"] == ["asymptotically stable"]


@pytest.mark.parametrize("missing", ["--minimise", "--free", "--bounds"])
def test_command_reports_the_missing_flag(capsys, missing):
    flags = {"--minimise": "spectral_radius", "--free": "zeta", "--bounds": "zeta=0:0.1"}
    line = [part for flag, value in flags.items() if flag != missing for part in (flag, value)]
    assert run(["optimise", "mathieu", *line]) == 2
    assert missing in capsys.readouterr().err


def test_every_search_for_a_feasible_design_has_another_start(monkeypatch):
    """A search over a range repeats the search for a feasible design in every round."""
    begun = []

    def begin(search, state):
        begun.append((search, state))
        return state

    monkeypatch.setattr(Search, "_least_violation", begin)
    pendulum = solve.load("mathieu", delta=1.3, epsilon=0.2, zeta=0.05)
    unattainable = ["spectral_radius < 1e-3"]
    for _ in range(2):
        found = solve.optimise(
            pendulum, "spectral_radius", {"zeta": (0.0, 0.1)}, 1.0, subject=unattainable, rtol=1e-3
        )
        assert found.warnings
    search, state = begun[-1]
    first, second = ([x.x.tolist() for each, x in begun if each is one] for one in (begun[0][0], search))
    assert first == second
    search._feasible_near(state)
    later = [each.x.tolist() for one, each in begun if one is search][len(second) :]
    assert len(later) > 1
    assert not [x for x in later[1:] if x in second]


def test_optimum_at_a_bound_equals_the_bound():
    cam, low, high = solve.load("cam"), np.array([0.0, 7e4]), np.array([0.3, 9.1e4])
    design = Design(cam, ["Fa1", "k1"], low, high, [60.0], chosen("auto"), 1e-6, True)
    near = np.array([[2e-16, 1 - 1.1e-16], [-1e-17, 1 + 2.2e-16], [1e-13, 1.0]])
    assert [list(design.parameters(x).values()) for x in near] == 3 * [[0.0, 9.1e4]]
    inside = list(design.parameters(np.array([1e-6, 0.5])).values())
    assert inside == pytest.approx([3e-7, 8.05e4], rel=1e-9)
