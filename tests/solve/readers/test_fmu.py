"""Functional mock-up units: multipliers match those of the equations, and unsuitable units are refused."""

import sys

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import solve
from solve.errors import FileError, MissingLibraryError, UnknownNameError, ValueOutOfBoundsError
from tests.solve.readers import fmi2_unit
from tests.solve.readers.fmi2_unit import NUMBERS, require_fmu_tools, write_unit

DRIVE = "phase", "speed"


@pytest.fixture(autouse=True)
def _tools():
    require_fmu_tools(exported=False)


def by_hand(c, d, e, f):
    """Return the monodromy matrix and the periodic motion at four times, integrated by SciPy."""

    def rates(t, x, load):
        return [x[1], load * np.cos(t) - c * x[1] - (d + e * np.cos(t)) * x[0]]

    def ends(start, load, times):
        return solve_ivp(
            rates, (0, 2 * np.pi), start, "DOP853", times, args=(load,), rtol=1e-12, atol=1e-13
        ).y

    Phi = np.stack([ends(column, 0.0, [2 * np.pi])[:, -1] for column in np.eye(2)], axis=1)
    start = np.linalg.solve(np.eye(2) - Phi, ends([0.0, 0.0], f, [2 * np.pi])[:, -1])
    return Phi, ends(start, f, np.arange(4) * np.pi / 2)


def test_fmi_2_unit_has_the_multipliers_of_its_equation(tmp_path):
    Phi, motion = by_hand(**NUMBERS)
    read = solve.read_fmu(write_unit(tmp_path), 1.0)
    found = solve.floquet(read, 1.0, rtol=1e-10).multipliers
    np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(np.linalg.eigvals(Phi)), atol=1e-9)
    assert (read.states, read.inputs, read.outputs) == (("x", "v"), ("u",), ("y",))
    points = read.source.operating_points
    count = len(points["x"])
    np.testing.assert_allclose([points["x"][:: count // 4], points["v"][:: count // 4]], motion, atol=1e-9)
    _, _, B, C, D = read.equations_at(np.zeros(1), 1.0)
    assert (B[0].tolist(), C[0].tolist(), D[0].tolist()) == ([[0.0], [1.0]], [[2.0, 0.0]], [[0.0]])
    assert (read.labels.units["x"], read.labels.meanings["x"], read.labels.title) == ("m", "the x", "Hill")


@pytest.mark.parametrize("unit", ["rpm", "Hz"])
def test_drive_with_another_unit_of_speed_is_refused(tmp_path, monkeypatch, unit):
    text = fmi2_unit.description().replace('<Real unit="m" start="1.6"', f'<Real unit="{unit}" start="1.6"')
    text = text.replace('<Unit name="m"/>', f'<Unit name="m"/><Unit name="{unit}"/>')
    monkeypatch.setattr(fmi2_unit, "description", lambda kind: text.replace("KIND", kind))
    with pytest.raises(FileError, match=f"the drive d has the unit {unit}; give a variable in rad/s"):
        solve.read_fmu(write_unit(tmp_path), 1.0, drive="d")


def test_given_values_and_motion_are_used(tmp_path):
    Phi, _ = by_hand(**{**NUMBERS, "d": 2.3})
    unit = write_unit(tmp_path)
    motion = {"x": np.zeros(64), "v": np.zeros(64)}
    for options in ({}, {"motion": motion}):
        read = solve.read_fmu(unit, "1 rad/s", values={"d": 2.3}, **options)
        found = solve.floquet(read, 1.0).multipliers
        np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(np.linalg.eigvals(Phi)), atol=1e-7)
    assert not read.source.operating_points["x"].any()


@pytest.mark.parametrize(
    ("name", "speed"),
    [
        ("manipulator", 5.0),
        pytest.param("gear_pair", 40.0, marks=pytest.mark.slow),
        pytest.param("cam", 40.0, marks=pytest.mark.slow),
    ],
)
def test_exported_models_are_read_back_with_their_multipliers(tmp_path, name, speed):
    """The unit is linearised about the orbit of the nonlinear equations."""
    require_fmu_tools()
    model, file = solve.load(name), tmp_path / "made.fmu"
    solve.export(model, file, speed)
    read = solve.read_fmu(file, speed, exclude=DRIVE)
    assert read.states == (*model.coordinates, *(f"{each}_dot" for each in model.coordinates))
    found = solve.floquet(read, speed).multipliers
    expected = solve.nonlinear(model, speed, rtol=1e-10).multipliers
    distance = np.abs(found[:, None] - expected)
    np.testing.assert_allclose(distance.min(axis=1), 0.0, atol=1e-8)
    np.testing.assert_allclose(distance.min(axis=0), 0.0, atol=1e-8)


BAD_UNITS = {
    "an event in time": ({"next_event": "0.5"}, "events within the period"),
    "a switch": ({"indicator": "cos(t)"}, "events within the period"),
    "no derivatives": ({"status": "3"}, "no directional derivatives"),
    "co-simulation": ({"kind": "CoSimulation"}, "without model exchange"),
    "missing functions": ({"stubs": ["Terminate"]}, "cannot be run"),
}


@pytest.mark.parametrize(("changes", "expected"), BAD_UNITS.values(), ids=BAD_UNITS)
def test_units_that_cannot_be_linearised_are_refused_in_one_line(tmp_path, changes, expected):
    with pytest.raises(FileError, match=r"mathieu\.fmu") as refused:
        solve.read_fmu(write_unit(tmp_path, **changes), 1.0)
    assert expected in str(refused.value)
    assert "\n" not in str(refused.value)


def test_unsuitable_arguments_are_refused(tmp_path):
    unit = write_unit(tmp_path)
    with pytest.raises(UnknownNameError, match="nope"):
        solve.read_fmu(unit, 1.0, exclude=["nope"])
    with pytest.raises(UnknownNameError, match="nope"):
        solve.read_fmu(unit, 1.0, values={"nope": 1.0})
    with pytest.raises(ValueOutOfBoundsError, match="rate depends on v"):
        solve.read_fmu(unit, 1.0, exclude=["x"])
    with pytest.raises(ValueOutOfBoundsError, match="all states"):
        solve.read_fmu(unit, 1.0, exclude=["x", "v"])
    with pytest.raises(ValueOutOfBoundsError, match="v has none"):
        solve.read_fmu(unit, 1.0, motion={"x": np.zeros(8)})
    with pytest.raises(FileError, match=r"\+1|no periodic motion"):
        solve.read_fmu(unit, 1.0, values={"c": 0.0, "d": 1.0, "e": 0.0})
    (tmp_path / "text.fmu").write_text("no archive")
    with pytest.raises(FileError, match=r"text\.fmu' cannot be run"):
        solve.read_fmu(tmp_path / "text.fmu", 1.0)


def test_missing_fmpy_is_reported_with_its_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "fmpy", None)
    with pytest.raises(MissingLibraryError, match=r'pip install "parametric-vibration\[fmu\]"'):
        solve.read_fmu(write_unit(tmp_path), 1.0)
