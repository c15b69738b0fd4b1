"""Optima of parameters: closed forms, scans, kept quantities, stability, requests that are refused."""

import json

import numpy as np
import pytest

import solve
from derive import Mechanism, cos, rate
from solve.commands.app import run
from solve.errors import SolveError, UnitError, UnknownNameError, ValueOutOfBoundsError
from solve.period.named import Named
from solve.studies.design_points import Design
from solve.studies.tracked import tracked

MASS, DAMPING, STIFFNESS = 2.0, 0.3, 9.0


def oscillator():
    """m q̈ + c q̇ + k q = p1 cos φ + p2 cos 3φ, with the load as an output."""
    made = Mechanism("oscillator", "Oscillator with two harmonics of load")
    (q,) = made.coordinates(q=("m", "displacement"))
    m, c, k = made.parameters(
        m=("kg", "mass", "> 0"), c=("N s/m", "damping", ">= 0"), k=("N/m", "spring", "> 0")
    )
    p1, p2 = made.parameters(p1=("N", "first harmonic"), p2=("N", "third harmonic"))
    load = p1 * cos(made.phase) + p2 * cos(3 * made.phase)
    made.kinetic, made.potential, made.dissipation = m * rate(q) ** 2 / 2, k * q**2 / 2, c * rate(q) ** 2 / 2
    made.force(load, along=q)
    made.output("load", load, "N", "load")
    return made


def absorber():
    """Mass m1 on a spring k1 with a damped absorber m2, k2, c2, under a harmonic force."""
    made = Mechanism("absorber", "Tuned absorber")
    x1, x2 = made.coordinates(x1=("m", "main mass"), x2=("m", "absorber"))
    m1, m2, F = made.parameters(m1=("kg", "mass", "> 0"), m2=("kg", "absorber", "> 0"), F=("N", "force"))
    k1, k2, c2 = made.parameters(
        k1=("N/m", "support", "> 0"), k2=("N/m", "spring", "> 0"), c2=("N s/m", "damping", ">= 0")
    )
    made.kinetic = (m1 * rate(x1) ** 2 + m2 * rate(x2) ** 2) / 2
    made.potential = (k1 * x1**2 + k2 * (x2 - x1) ** 2) / 2
    made.dissipation = c2 * (rate(x2) - rate(x1)) ** 2 / 2
    made.force(F * cos(made.phase), along=x1)
    return made


@pytest.fixture(scope="module")
def model():
    return solve.load(oscillator(), m=MASS, c=DAMPING, k=STIFFNESS, p1=1.0, p2=0.0)


def response(speed, m=MASS, c=DAMPING, k=STIFFNESS):
    """Complex amplitude of q for a unit load."""
    return 1 / (k - m * speed**2 + 1j * c * speed)


def test_two_speeds_share_the_largest_amplitude(model):
    low, high = 1.5, 3.0
    found = solve.optimise(model, "q.max_abs", {"k": (5.0, 17.0)}, [low, high])
    # Equal moduli of k - m Ω² + i c Ω at both speeds.
    k = MASS * (low**2 + high**2) / 2 + DAMPING**2 / (2 * MASS)
    assert found.free["k"] == pytest.approx(k, rel=1e-6)
    assert found.objective == pytest.approx(abs(response(low, k=k)), rel=1e-6)
    assert found.values[0] == pytest.approx(found.values[1], rel=1e-6)
    assert found.before == pytest.approx(max(abs(response(low)), abs(response(high))), rel=1e-7)


def largest(p1, p2, speed):
    """Largest |q| over a fine grid of phases."""
    phase = np.linspace(0, 2 * np.pi, 20001)
    curve = p1 * response(speed) * np.exp(1j * phase) + p2 * response(3 * speed) * np.exp(3j * phase)
    return np.abs(curve.real).max()


@pytest.mark.parametrize("figure", ["load.max", "load.range"])
def test_kept_maximum_of_the_load_is_kept(model, figure):
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


def test_kept_curve_with_tolerance_stays_within_it(model):
    found = solve.optimise(
        model, "q.max_abs", {"p1": (0.5, 1.5), "p2": (-0.4, 0.4)}, 0.8, keep=["load@0:30 deg within 0.05 N"]
    )
    phase = np.radians(np.linspace(0, 30, 301))
    change = found.free["p1"] * np.cos(phase) + found.free["p2"] * np.cos(3 * phase) - np.cos(phase)
    assert np.abs(change).max() == pytest.approx(0.05, rel=1e-3)


def test_bound_on_another_quantity_is_active(model):
    found = solve.optimise(model, "q.max_abs", {"k": (4.0, 20.0)}, 0.5, subject=["q.max > 0.1"])
    assert found.objective == pytest.approx(0.1, rel=1e-5)
    assert found.constraints[1].value >= 0.1 * (1 - 1e-6)
    assert abs(response(0.5, k=found.free["k"])) == pytest.approx(0.1, rel=1e-5)


def test_requirements_that_no_design_fulfils_are_reported(model):
    found = solve.optimise(model, "q.max_abs", {"k": (8.0, 10.0)}, 0.5, subject=["q.max < 0.01"])
    assert any("no design that fulfils all requirements" in warning for warning in found.warnings)


def test_unstable_start_becomes_stable():
    unstable = solve.load("mathieu", delta=1.0, epsilon=0.5, zeta=0.01)
    assert solve.floquet(unstable, 1.0).verdict == "unstable"
    found = solve.optimise(unstable, "spectral_radius", {"delta": (0.9, 2.0)}, 1.0)
    assert solve.floquet(found.system, 1.0).verdict == "asymptotically stable"


def test_function_of_orbits_equals_the_named_quantity(model):
    free, speeds = {"k": (5.0, 17.0)}, [1.5, 3.0]
    named = solve.optimise(model, "q.rms", free, 3.0)
    given = solve.optimise(model, lambda orbits: orbits[0].statistics("q").rms, free, 3.0)
    assert given.objective == pytest.approx(named.objective, rel=1e-6)
    both = solve.optimise(model, lambda orbits: sum(o.statistics("q").rms for o in orbits), free, speeds)
    scan = [
        sum(abs(response(speed, k=k)) for speed in speeds) / np.sqrt(2) for k in np.linspace(5.0, 17.0, 2401)
    ]
    assert both.objective == pytest.approx(min(scan), rel=1e-5)


def test_random_starts_find_the_better_of_two_minima(model):
    # Amplitudes with stiffnesses above both resonances are lower than those between them.
    free = {"k": (7.0, 60.0)}
    one = solve.optimise(model, "q.max_abs", free, [1.5, 3.0])
    several = solve.optimise(model, "q.max_abs", free, [1.5, 3.0], starts=4)
    assert several.free["k"] == pytest.approx(60.0)
    assert several.objective < one.objective


def test_derivatives_of_extrema_equal_the_closed_form(model):
    low, high, speed = np.array([5.0, -0.5]), np.array([17.0, 0.5]), 1.1
    design = Design(model, ["k", "p2"], low, high, [speed], "auto", 1e-10, True)
    x = np.array([0.4, 0.7])
    extrema = tracked(design, x, 0, Named.of(model, "q.max_abs"))
    k, p2 = low + x * (high - low)
    first, third = response(speed, k=k), response(3 * speed, k=k)
    phase = np.linspace(0, 2 * np.pi, 200_001)
    curve = np.real(first * np.exp(1j * phase) + p2 * third * np.exp(3j * phase))
    top = phase[curve.argmax()] + np.array([0.0, np.pi])
    by_k = -np.real(first**2 * np.exp(1j * top) + p2 * third**2 * np.exp(3j * top))
    by_p2 = np.real(third * np.exp(3j * top))
    closed = np.array([1.0, -1.0])[:, None] * np.stack((by_k, by_p2), axis=1) * (high - low)
    np.testing.assert_allclose(extrema.slopes(x), closed, rtol=1e-4)
    np.testing.assert_allclose(extrema.values(x), curve.max(), rtol=1e-9)


@pytest.mark.slow
def test_absorber_equals_the_optimum_of_nishihara_and_asami():
    mu = 0.1
    system = solve.load(absorber(), m1=1.0, m2=mu, k1=1.0, k2=0.08, c2=0.02, F=1.0)
    free = {"k2": (0.04, 0.12), "c2": (0.005, 0.1)}
    found = solve.optimise(system, "x1.max_abs", free, "0.7:1.3:9 rad/s")
    # O. Nishihara, T. Asami, J. Vib. Acoust. 124 (2002) 576-582.
    root = np.sqrt(4 + 3 * mu)
    tuning = (
        2
        / (1 + mu)
        * np.sqrt(2 * (16 + 23 * mu + 9 * mu**2 + 2 * (2 + mu) * root) / (3 * (64 + 80 * mu + 27 * mu**2)))
    )
    ratio = np.sqrt((8 + 9 * mu - 4 * root) / (1 + mu)) / 4
    assert found.free["k2"] == pytest.approx(tuning**2 * mu, rel=1e-4)
    assert found.free["c2"] == pytest.approx(2 * ratio * mu * tuning, rel=1e-4)
    k2, c2, speed = tuning**2 * mu, 2 * ratio * mu * tuning, np.linspace(0.7, 1.3, 400_001)
    coupling = k2 + 1j * speed * c2
    size = np.abs(
        (coupling - mu * speed**2) / ((1 + coupling - speed**2) * (coupling - mu * speed**2) - coupling**2)
    )
    assert found.objective == pytest.approx(size.max(), rel=1e-6)


@pytest.mark.slow
def test_cam_vibrates_less_with_its_lift_kept():
    cam = solve.load("cam")
    names = [f"a{order}" for order in range(1, 13)]
    free = {name: (cam.parameters[name] - 0.02, cam.parameters[name] + 0.02) for name in names}
    found = solve.optimise(cam, "q3.max_abs", free, "100 rpm", keep=["lift.range"])
    assert found.objective < 0.8 * found.before
    lifts = [solve.periodic(each, "100 rpm").statistics("lift") for each in (cam, found.system)]
    before, after = (each.max - each.min for each in lifts)
    assert after == pytest.approx(before, abs=1e-9)
    assert found.confirmed["objective"] == pytest.approx(found.objective, rel=0.01)
    assert {*found.confirmed["verdicts"]} == {"asymptotically stable"}
    radii = [solve.floquet(found.system, speed).spectral_radius for speed in ("50 rpm", "300 rpm")]
    assert max(radii) < 1


@pytest.mark.parametrize(
    ("change", "error", "text"),
    [
        ({"minimise": "x.max"}, UnknownNameError, "x.max"),
        ({"minimise": "q"}, ValueOutOfBoundsError, "names no statistic"),
        ({"minimise": "rho1"}, ValueOutOfBoundsError, "is complex"),
        ({"free": {}}, ValueOutOfBoundsError, "no parameter is free"),
        ({"free": {"z": (1, 2)}}, UnknownNameError, "parameter of oscillator 'z'"),
        ({"free": {"k": (10, 20)}}, ValueOutOfBoundsError, "its initial value is 9"),
        ({"free": {"k": (0, 20)}}, ValueOutOfBoundsError, "allowed: > 0"),
        ({"free": {"k": ("5 kg", 20)}}, UnitError, "kg"),
        ({"keep": ["load"]}, ValueOutOfBoundsError, "names no statistic"),
        ({"keep": ["load@30:0 deg"]}, ValueOutOfBoundsError, "ends before it begins"),
        ({"keep": ["load@x deg"]}, ValueOutOfBoundsError, "has no valid interval"),
        ({"keep": ["load.max within 0 N"]}, ValueOutOfBoundsError, "numbers > 0"),
        ({"subject": ["q.max"]}, ValueOutOfBoundsError, "is not a bound"),
        ({"subject": ["q.max < 3 kg"]}, UnitError, "kg"),
        ({"subject": ["rho1 < 1"]}, ValueOutOfBoundsError, "is complex"),
        ({"starts": 0}, ValueOutOfBoundsError, "starts is 0"),
        ({"method": "newmark"}, ValueOutOfBoundsError, "takes radau, gauss, or auto"),
    ],
)
def test_bad_requests_are_refused(model, change, error, text):
    request = {"minimise": "q.max_abs", "free": {"k": (5.0, 20.0)}, "speeds": 1.0, **change}
    with pytest.raises(error, match=text) as caught:
        solve.optimise(model, **request)
    assert isinstance(caught.value, SolveError)
    assert "\n" not in str(caught.value)


def test_result_is_reopened_and_drawn(model, tmp_path):
    found = solve.optimise(model, "q.max_abs", {"k": (5.0, 17.0)}, [1.5, 3.0])
    found.save(tmp_path / "optimum.nc")
    again = solve.open(tmp_path / "optimum.nc")
    assert again.free == found.free
    assert again.record() == found.record()
    assert len(found.plot().axes) == 3
    assert "falls from" in repr(found)


def test_command_prints_the_promised_keys(capsys, tmp_path):
    case = tmp_path / "optimum.toml"
    line = "optimise mathieu --speed 1rad/s --minimise spectral_radius --free zeta --bounds zeta=0:0.1 --json"
    assert run([*line.split(), "--toml", str(case)]) == 0
    record = json.loads(capsys.readouterr().out)
    assert {"free", "objective", "before", "constraints", "confirmed", "warnings"} <= record.keys()
    assert record["constraints"][0].keys() == {"name", "value", "bound"}
    assert run(["floquet", "mathieu", "--cases", str(case), "--speed", "1rad/s", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["parameters"]["zeta"] == pytest.approx(0.1)


@pytest.mark.parametrize("missing", ["--minimise", "--free", "--bounds"])
def test_command_names_the_flag_that_is_missing(capsys, missing):
    flags = {"--minimise": "spectral_radius", "--free": "zeta", "--bounds": "zeta=0:0.1"}
    line = [part for flag, value in flags.items() if flag != missing for part in (flag, value)]
    assert run(["optimise", "mathieu", *line]) == 2
    assert missing in capsys.readouterr().err
