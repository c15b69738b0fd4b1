"""Coupler curves of the flexible and the rigid linkage, and the commands `curve` and `modes`."""

import json

import numpy as np
import pytest

import solve
from models.four_bar.linkage import Linkage
from models.four_bar.studies.curve import coupler_curve

PHASE = np.linspace(0, 2 * np.pi, 25)


@pytest.fixture(scope="module")
def orbit():
    return solve.periodic(solve.load("four_bar"), 30.0, rtol=1e-6)


def test_coupler_curve_deviation_matches_the_joint_displacements(orbit):
    q = dict(zip(orbit.coordinates, orbit.at(PHASE), strict=True))
    for along, joint in ((0.0, "A"), (1.0, "B")):
        curve = coupler_curve(orbit.system, orbit, along, 0.0, PHASE)
        np.testing.assert_allclose(curve.deviation, q[f"{joint}_x"] + 1j * q[f"{joint}_y"], atol=1e-15)


def test_rigid_curve_agrees_with_the_linkage(orbit):
    p = orbit.system.labels.parameters
    linkage = Linkage(*(p[name] for name in ("L1", "L2", "L3", "L4")))
    curve = coupler_curve(orbit.system, orbit, 0.3, 0.08, PHASE)
    for phase, place in zip(PHASE, curve.rigid, strict=True):
        t2 = linkage.motion(phase, 0.0, 0.0).t[1]
        expected = p["L1"] * np.exp(1j * phase) + (0.3 * p["L2"] + 0.08j) * np.exp(1j * t2)
        assert place == pytest.approx(expected, abs=1e-12)


def test_off_axis_point_rotates_with_its_section(orbit):
    q = dict(zip(orbit.coordinates, orbit.at(PHASE), strict=True))
    for along, end in ((0.0, "A"), (1.0, "B")):
        on, beside = (coupler_curve(orbit.system, orbit, along, across, PHASE) for across in (0.0, 0.05))
        carried = 1j * q[f"coupler_{end}_turn"] * (beside.rigid - on.rigid)
        np.testing.assert_allclose(beside.deviation - on.deviation, carried, atol=1e-15)


def test_command_curve(answer, orbit, tmp_path):
    picture, data = tmp_path / "curve.png", tmp_path / "curve.csv"
    out, _ = answer("curve", "--along", "1", "--plot", str(picture), "--save", str(data), "--json")
    record = json.loads(out)
    q = dict(zip(orbit.coordinates, orbit.at(np.linspace(0, 2 * np.pi, 721)), strict=True))
    distance = np.hypot(q["B_x"], q["B_y"])
    assert record["max_deviation"] == pytest.approx(distance.max(), rel=1e-6)
    assert picture.stat().st_size > 10_000
    assert len(data.read_text().splitlines()) > 721
    out, _ = answer("curve")
    assert max(map(len, out.splitlines())) <= 80


def test_command_modes(answer, tmp_path):
    picture = tmp_path / "modes.png"
    out, _ = answer("modes", "--count", "3", "--json", "--plot", str(picture))
    record = json.loads(out)
    assert len(record["modes"]) == 3
    assert record["modes"][0]["max_abs"] == pytest.approx(max(map(abs, record["total"])), rel=0.05)
    assert picture.stat().st_size > 10_000
    assert "uncoupled" not in record
    out, _ = answer("modes", "--uncoupled")
    assert max(map(len, out.splitlines())) <= 80


def test_command_modes_prints_the_error_of_uncoupling(answer, tmp_path):
    picture, data = tmp_path / "modes.png", tmp_path / "modes.csv"
    given = ("--uncoupled", "--option", "elements=3", "--of", "coupler_midpoint_deflection")
    out, _ = answer("modes", *given, "--json", "--plot", str(picture), "--save", str(data))
    record = json.loads(out)
    assert record["uncoupled"]["error"] == pytest.approx(0.98, abs=0.01)
    assert len(record["uncoupled"]["values"]) == len(record["phase"])
    assert picture.stat().st_size > 10_000
    assert "uncoupled (m)" in data.read_text().splitlines()[0]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("curve", "--along", "1.5"), "allowed: 0 to 1"),
        (("curve", "--speed", "30"), "unit"),
        (("modes", "--of", "strain_energy"), "deflection or stress"),
        (("modes", "--count", "10"), "allowed: 1 to 9"),
    ],
)
def test_invalid_input_is_refused_in_one_line(arguments, message, refusal):
    assert message in refusal(*arguments)
