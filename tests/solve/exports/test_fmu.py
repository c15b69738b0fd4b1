"""Functional mock-up units, simulated by FMPy and compared with nonlinear orbits and SciPy."""

import shutil
import sys
import zipfile

import casadi
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import solve
from derive import Mechanism, cos, rate
from solve.errors import LinearModelError, MissingLibraryError, NoMotionError, ValueOutOfBoundsError

fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed")
pytestmark = pytest.mark.skipif(
    not any(map(shutil.which, ("cc", "gcc", "clang"))) or not hasattr(casadi.DaeBuilder, "compile_fmu"),
    reason="there is no C compiler, or CasADi is older than 3.8",
)

SPEED = 30.0


@pytest.fixture(scope="module")
def cam(tmp_path_factory):
    file = tmp_path_factory.mktemp("fmu") / "cam.fmu"
    solve.export(solve.load("cam"), file, SPEED)
    return str(file)


def simulated(file, turns, speed, tolerance=1e-9, **settings):
    end = turns * 2 * np.pi / speed
    given = {"stop_time": end, "output_interval": end / (512 * turns), "relative_tolerance": tolerance}
    return fmpy.simulate_fmu(file, **given, **settings)


def shaker():
    """Return a mass on a cubic spring on a table that is driven by an eccentric."""
    made = Mechanism("shaker", "A mass on a table that an eccentric moves")
    q = made.coordinate("q", "m", "way against the table")
    m, k, c = made.parameters(m=("kg", "mass", "> 0"), k=("N/m", "spring", "> 0"), c=("N s/m", "damping"))
    cubic, e = made.parameters(cubic=("N/m^3", "cubic spring"), e=("m", "eccentricity"))
    made.kinetic = m * rate(q + e * cos(made.phase)) ** 2 / 2
    made.potential = k * q**2 / 2 + cubic * q**4 / 4
    made.dissipation = c * rate(q) ** 2 / 2
    return made


SHAKER = {"m": 2.0, "k": 1800.0, "c": 1.5, "cubic": 4e5, "e": 0.02}


def by_hand(end, start, u=0.0, acceleration=0.0, **numbers):
    """Return q of the shaker at the end, integrated by SciPy from equations written by hand."""
    m, k, c, cubic, e = {**SHAKER, **numbers}.values()

    def change(t, x):
        phase, speed = SPEED * t + acceleration * t**2 / 2, SPEED + acceleration * t
        table = -e * (np.cos(phase) * speed**2 + np.sin(phase) * acceleration)
        return x[1], (u - c * x[1] - k * x[0] - cubic * x[0] ** 3) / m - table

    return solve_ivp(change, (0, end), start, "DOP853", rtol=1e-11, atol=1e-13).y[0, -1]


@pytest.fixture(scope="module")
def shaken(tmp_path_factory):
    """Return the FMU of the shaker and its initial state."""
    file, model = tmp_path_factory.mktemp("fmu") / "shaker.fmu", solve.load(shaker, **SHAKER)
    solve.export(model, file, SPEED)
    q, qd, _ = solve.nonlinear(model, SPEED).state(np.zeros(1))
    return str(file), (q[0, 0], qd[0, 0])


def test_fmu_is_valid_with_units_and_descriptions(cam):
    from fmpy.validation import validate_fmu

    assert validate_fmu(cam) == []
    computed = {
        modelvariable.name: modelvariable for modelvariable in fmpy.read_model_description(cam).modelVariables
    }
    model = solve.load("cam")
    for name, (unit, meaning) in model.labels.parameter_labels.items():
        variable = computed[name]
        assert (variable.causality, variable.variability) == ("parameter", "tunable")
        assert (variable.unit, variable.description) == (unit.replace(" ", ".").replace("^", ""), meaning)
        assert float(variable.start) == model.parameters[name]
    assert {name for name, each in computed.items() if each.causality == "output"} == {
        *model.coordinates,
        *model.outputs,
    }
    inputs = {name for name, each in computed.items() if each.causality == "input"}
    assert inputs == {"acceleration", "force_q1", "force_q2", "force_q3"}
    assert computed["speed"].start == repr(SPEED)


@pytest.mark.parametrize(
    ("name", "tolerance"),
    [("coupler", 1e-9), ("gear_pair", 1e-10), pytest.param("cam", 1e-9, marks=pytest.mark.slow)],
)
def test_fmu_stays_on_the_nonlinear_orbit(tmp_path, name, tolerance):
    model, speed = solve.load(name), 40.0
    file = str(tmp_path / "made.fmu")
    solve.export(model, file, speed)
    computed, orbit = simulated(file, 4, speed, tolerance), solve.nonlinear(model, speed)
    for quantity in (*model.coordinates, *model.outputs[:1]):
        expected = orbit.signal(quantity)(speed * computed["time"])
        np.testing.assert_allclose(computed[quantity], expected, rtol=0, atol=1e-4 * np.abs(expected).max())


def test_changed_parameter_changes_the_motion(shaken):
    file, start = shaken
    for numbers in ({}, {"k": 2500.0}, {"m": 3.0, "e": 0.01}):
        computed = simulated(file, 3, SPEED, start_values=numbers)
        expected = by_hand(computed["time"][-1], start, **numbers)
        assert computed["q"][-1] == pytest.approx(expected, rel=1e-4)


def test_fmu_inputs_act_on_mass_and_drive(shaken):
    file, start = shaken
    end = 3 * 2 * np.pi / SPEED
    for u, acceleration in ((5.0, 0.0), (0.0, 8.0), (5.0, -8.0)):
        columns = [(each, float) for each in ("time", "force_q", "acceleration")]
        given = np.array([(0.0, u, acceleration), (end, u, acceleration)], dtype=columns)
        computed = simulated(file, 3, SPEED, input=given)
        assert computed["q"][-1] == pytest.approx(by_hand(end, start, u, acceleration), rel=1e-4)


def test_nominal_values_match_the_magnitude_of_the_states(tmp_path):
    """The motion is of the order of micrometres and the tolerance is 1e-6. Without nominal values, the error
    of 1e-6 m would be as large as the motion."""
    model = solve.load(shaker, **{**SHAKER, "e": 1e-6})
    solve.export(model, tmp_path / "small.fmu", SPEED)
    computed = simulated(str(tmp_path / "small.fmu"), 2, SPEED, 1e-6)
    expected = solve.nonlinear(model, SPEED).at(SPEED * computed["time"])[0]
    np.testing.assert_allclose(computed["q"], expected, rtol=0, atol=1e-3 * np.abs(expected).max())


def test_fmu_without_a_load_starts_at_rest(tmp_path):
    exported = solve.export(solve.load("mathieu"), tmp_path / "mathieu.fmu")
    assert exported.warnings[0].endswith("the FMU starts at rest")
    computed = fmpy.simulate_fmu(
        str(tmp_path / "mathieu.fmu"), stop_time=np.pi, relative_tolerance=1e-9, start_values={"q": 1.0}
    )
    expected = in_time_mathieu(solve.load("mathieu"), np.pi)
    assert computed["q"][-1] == pytest.approx(expected, rel=1e-5)


def in_time_mathieu(model, end):
    delta, epsilon, zeta = (model.parameters[name] for name in ("delta", "epsilon", "zeta"))

    def change(t, x):
        damping = 2 * zeta * np.sqrt(abs(delta))
        return x[1], -damping * x[1] - (delta + epsilon * np.cos(2 * t)) * x[0]

    return solve_ivp(change, (0, end), (1.0, 0.0), "DOP853", rtol=1e-10, atol=1e-12).y[0, -1]


def test_jumps_of_the_matrices_are_events(tmp_path):
    """Meissner's equation with q = 1 initially is compared with sines and cosines in each interval."""
    numbers = {"w1": 1.3, "w2": 2.9, "share": 0.4}
    solve.export(solve.load("meissner", **numbers), tmp_path / "meissner.fmu", 1.0)
    file, end = str(tmp_path / "meissner.fmu"), 9.0
    computed = fmpy.simulate_fmu(file, stop_time=end, relative_tolerance=1e-9, start_values={"q": 1.0})
    x, left = np.array([1.0, 0.0]), end
    for w, share in [(1.3, 0.4), (2.9, 0.6), (1.3, 0.4), (2.9, 0.6)]:
        h = min(left, 2 * np.pi * share)
        c, s = np.cos(w * h), np.sin(w * h)
        x, left = np.array([[c, s / w], [-w * s, c]]) @ x, left - h
    assert left < 1e-12
    assert computed["q"][-1] == pytest.approx(x[0], abs=1e-6)
    assert len(fmpy.read_model_description(file).eventIndicators) == 2


def test_fmu_contains_its_source_code(cam):
    with zipfile.ZipFile(cam) as archive:
        names = archive.namelist()
    assert "sources/cam.c" in names
    assert any(name.startswith("binaries/") for name in names)


def named_speed():
    made = Mechanism("clash", "A mass whose way is called acceleration")
    (q,) = made.coordinates(acceleration=("m", "way"))
    m, k = made.parameters(m=("kg", "mass", "> 0"), k=("N/m", "spring", "> 0"))
    made.kinetic = m * rate(q) ** 2 / 2
    made.potential = k * q**2 / 2
    return made


def test_refused_fmu_export_leaves_no_file(tmp_path, monkeypatch):
    file = tmp_path / "a.fmu"
    with pytest.raises(LinearModelError, match="four_bar has only numerical matrices"):
        solve.export(solve.load("four_bar"), file, SPEED)
    with pytest.raises(NoMotionError):
        solve.export(solve.load("portal_frame"), file)
    with pytest.raises(ValueOutOfBoundsError, match="'acceleration' would be the name of two"):
        solve.export(solve.load(named_speed, m=1.0, k=4.0), file, 1.0)
    monkeypatch.setenv("CC", "no-such-compiler")
    from solve.kernel.compiler import c_compiler

    c_compiler.cache_clear()
    with pytest.raises(MissingLibraryError, match=r"requires a C compiler.*no-such-compiler"):
        solve.export(solve.load("mathieu"), file)
    c_compiler.cache_clear()
    monkeypatch.setitem(sys.modules, "fmpy", None)
    with pytest.raises(MissingLibraryError, match=r'pip install "parametric-vibration\[fmu\]"'):
        solve.export(solve.load("mathieu"), file)
    assert list(tmp_path.iterdir()) == []
