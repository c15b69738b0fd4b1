"""`python -m models.four_bar linkage`: report, JSON, figures and errors."""

import json
import math
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import models.four_bar
from models.four_bar.forces import bodies, joint_forces
from models.four_bar.linkage import Linkage
from solve import case_numbers

CASES = Path(models.four_bar.__path__[0]) / "cases.toml"
ROCKER = ("--set", "L1=0.4")
KEYS = {
    "model", "case", "parameters", "branch", "mobility", "class", "grashof", "solution_space", "turns_fully",
    "crank_range", "speed", "transmission_angle", "follower", "mechanical_advantage", "ratios",
    "coupler_curves", "joint_forces", "drive_torque", "energy_residual", "energy_swing",
    "preliminary_stress", "position",
    "warnings",
}  # fmt: skip


@pytest.fixture
def answer(answer):
    """Function that runs the command `linkage`."""
    return partial(answer, "linkage")


def work_of_the_drive():
    """Largest difference of the drive's work between two crank angles at 300 rpm, by the trapezoidal rule."""
    linkage, links = Linkage(0.170, 0.328, 0.525, 0.547), bodies(case_numbers("four_bar").parameters)
    angles = np.linspace(0.0, 2 * math.pi, 7201)
    torque = joint_forces(linkage.motion(angles, 10 * math.pi), links).torque
    return np.ptp(np.cumsum(torque[:-1] + torque[1:]) * (angles[1] / 2))


def test_json_has_the_promised_keys(answer):
    out, err = answer("--json", "--speed", "300 rpm", "--position", "70 deg")
    record = json.loads(out)
    assert set(record) >= KEYS
    assert err == ""
    assert (record["class"]["symbol"], record["grashof"], record["mobility"]) == ("GCRR", True, 1)
    assert record["speed"] == pytest.approx(10 * math.pi)
    gamma = record["transmission_angle"]
    # Thesis (3.10) at the lengths of Table 3.2.
    square = 0.328**2 + 0.525**2 - 0.170**2 - 0.547**2
    for computed, sign in ((gamma["min"], 1), (gamma["max"], -1)):
        cosine = (square + sign * 2 * 0.170 * 0.547) / (2 * 0.328 * 0.525)
        assert computed == pytest.approx(math.acos(cosine))
    assert gamma["within_advised"]
    slowest = np.abs(Linkage(0.170, 0.328, 0.525, 0.547).mechanical_advantage(np.linspace(0, 6.3, 20_000)))
    assert record["mechanical_advantage"]["least"] == pytest.approx(slowest.min(), rel=1e-6)
    assert record["energy_residual"] < 1e-12
    assert record["energy_swing"] == pytest.approx(work_of_the_drive(), rel=1e-4)
    assert abs(record["drive_torque"]["mean"]) < 1e-12 * record["drive_torque"]["max"]
    assert set(record["joint_forces"]) == {"O", "A", "B", "C"}
    assert record["position"]["t"][0] == pytest.approx(math.radians(70))
    assert len(record["coupler_curves"][0]["x"]) == 360
    assert record["coupler_curves"][0]["point"] == [0.164, 0.0]


def test_poor_transmission_angle_at_a_position_gives_a_warning(answer):
    """The crank lies on the ground link: cos γ = (L2² + L3² - (L4 - L1)²) / (2 L2 L3)."""
    given = [part for text in ("L1=0.15", "L2=0.5", "L3=0.4", "L4=0.4") for part in ("--set", text)]
    gamma = math.degrees(math.acos((0.5**2 + 0.4**2 - 0.25**2) / (2 * 0.5 * 0.4)))
    err = answer(*given, "--position", "0 deg")[1]
    assert f"at 0° the transmission angle is {gamma:.4g}°, outside 40°–140°" in err
    assert "at 90°" not in answer(*given, "--position", "90 deg")[1]


def test_json_agrees_with_the_linkage(answer):
    record = json.loads(
        answer("--json", "--branch", "crossed", "--position", "1 rad", "--coupler-point", "0.1,0.2")[0]
    )
    motion = Linkage(0.170, 0.328, 0.525, 0.547, "crossed").motion(1.0)
    position = record["position"]
    assert position["t"] == pytest.approx(list(motion.t))
    assert complex(*position["B"]) == pytest.approx(complex(motion.position(2, 0.328)))
    assert complex(*position["coupler_points"][0]["position"]) == pytest.approx(
        complex(motion.position(2, 0.1 + 0.2j))
    )
    assert position["ratios"]["alpha3"] == pytest.approx(motion.alpha[2])
    assert record["speed"] is None
    assert "drive_torque" not in record
    assert "joint_forces" not in position
    swing = record["follower"]["swing"]
    dead = Linkage(0.170, 0.328, 0.525, 0.547, "crossed").motion(record["follower"]["dead_points"])
    assert swing == pytest.approx(abs(dead.t[2, 0] - dead.t[2, 1]))


def test_mechanical_advantage_at_a_dead_point_is_null_or_huge(answer):
    angle = json.loads(answer("--json")[0])["follower"]["dead_points"][0]
    computed = json.loads(answer("--json", "--position", f"{angle!r} rad")[0])["position"]
    assert computed["mechanical_advantage"] is None or abs(computed["mechanical_advantage"]) > 1e9


def degrees(angle: float, decimals: int) -> str:
    return f"{math.degrees(angle):.{decimals}f}".rstrip("0").rstrip(".")


def test_terminal_output_contains_the_numbers_of_the_json(answer):
    """Every number of the JSON record occurs in the report."""
    requested = ("--speed", "300 rpm", "--position", "70 deg", "--coupler-point", "0.1,0.15")
    out, err = answer(*requested)
    record = json.loads(answer(*requested, "--json")[0])
    gamma, advantage = record["transmission_angle"], record["mechanical_advantage"]
    stretched, folded = record["follower"]["dead_points"]
    assert max(len(line) for line in out.splitlines()) <= 80
    assert "energy stored and released by a flywheel per revolution: 11.013 J" in out
    for text in (
        "GCRR (2 of 14)",
        "s + l < p + q; mobility 1",
        "300 rpm = 31.41593 rad/s",
        degrees(gamma["max"], 4),
        degrees(gamma["min"], 4),
        f"|T3/T1| at least {advantage['least']:.5g}",
        f"t1 = {degrees(stretched, 2)}°",
        f"{degrees(folded, 2)}° (folded)",
        f"swings through {degrees(record['follower']['swing'], 2)}°",
        f"{record['drive_torque']['max']:.3f}",
        *(f"{force['peak']:.5g}" for force in record["joint_forces"].values()),
        "energy balance",
        "coupler point (0.1, 0.15) m",
        "At t1 = 70°",
        f"drive torque {record['position']['drive_torque']:.6g} N m",
    ):
        assert text in out
    assert err == ""


def test_report_without_speed_states_how_to_compute_forces(answer):
    out, _ = answer()
    assert '--speed "300 rpm"' in out
    assert "Joint forces" not in out


def test_case_file_may_state_speed(answer, tmp_path):
    file = tmp_path / "mine.toml"
    text = CASES.read_text(encoding="utf-8")
    text = text.replace("[case.table41]", '[case.table41]\nspeed = "30 rad/s"')
    file.write_text(text, encoding="utf-8")
    assert json.loads(answer("--json", "--cases", str(file))[0])["speed"] == 30.0
    assert json.loads(answer("--json", "--cases", str(file), "--speed", "1 Hz")[0])["speed"] == 2 * math.pi


def test_drag_link_has_no_dead_points_but_a_warning(answer):
    lengths = ("L1=0.5", "L2=0.6", "L3=0.55", "L4=0.2")
    least = math.acos((0.6**2 + 0.55**2 - (0.5 - 0.2) ** 2) / (2 * 0.6 * 0.55))
    out, err = answer(*(part for text in lengths for part in ("--set", text)))
    assert "GCCC (1 of 14)" in out
    assert "no dead points" in out
    assert err.startswith(f"warning: the transmission angle goes from {degrees(least, 2)}°")
    record = json.loads(answer("--json", *(part for text in lengths for part in ("--set", text)))[0])
    assert record["transmission_angle"]["within_advised"] is False
    assert record["follower"] == {"dead_points": [], "swing": None}
    assert record["warnings"] == [err.removeprefix("warning: ").strip()]


def test_limited_crank_is_reported_at_one_position(answer):
    out, err = answer(*ROCKER, "--position", "70 deg")
    ends = (math.acos((0.4**2 + 0.547**2 - d**2) / (2 * 0.4 * 0.547)) for d in (0.525 - 0.328, 0.525 + 0.328))
    reach = "cannot turn fully; reachable: {}° <= |t1| <= {}°"
    assert reach.format(*(degrees(end, 2) for end in ends)) in out
    assert "Over one revolution" not in out
    assert "At t1 = 70°" in out
    assert "cannot turn fully" in err


def test_pictures_are_written(answer, tmp_path):
    linkage, planes = tmp_path / "linkage.png", tmp_path / "planes.svg"
    _, err = answer("--speed", "30 rad/s", "--plot", str(linkage), "--base-planes", str(planes))
    assert linkage.read_bytes().startswith(b"\x89PNG")
    assert b"<svg" in planes.read_bytes()
    assert f"wrote {linkage}" in err
    assert f"wrote {planes}" in err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--set", "L1=0"), "L1 (length of the crank) is 0 m; allowed: > 0"),
        (("--set", "L9=2"), "unknown parameter of four_bar 'L9'; did you mean"),
        (("--set", "L1=abc"), "'abc' is not a number"),
        (("--set", "L4=nan"), "L4 (length of the ground link) is nan m; allowed: > 0"),
        (("--set", "L4=5"), "the longest link is 5 m, the others together 1.023 m"),
        (ROCKER, "the crank cannot turn fully: with L1, L2, L3, L4 = 0.4, 0.328, 0.525, 0.547 m"),
        ((*ROCKER, "--position", "0 deg"), "does not close at t1 = 0°; allowed: 16."),
        ((*ROCKER, "--position", "70 deg", "--plot", "never.png"), "the crank cannot turn fully"),
        (("--speed", "300"), "'300' has no unit"),
        (("--speed", ""), "'' is not a number with a unit"),
        (("--speed", "0 rpm"), "speed is 0 rpm; allowed: finite and > 0"),
        (("--speed", "300 kg"), "unit 'kg' does not convert"),
        (("--position", "70"), "'70' has no unit; write it like '70 deg'"),
        (("--position", "nan deg"), "does not close at t1 = nan°"),
        (("--branch", "opened"), "unknown branch 'opened'; did you mean 'open'?"),
        (("--case", "table14"), "unknown case of four_bar 'table14'; did you mean 'table41'?"),
        (("--cases", "absent.toml"), "case file 'absent.toml' cannot be read"),
        (("--coupler-point", "1"), "--coupler-point is '1'; write two numbers X,Y in metres"),
        (("--coupler-point", "1,inf"), "--coupler-point is '1,inf'"),
        (("--plot", "linkage.bmp"), "picture file 'linkage.bmp' ends in '.bmp'; allowed: .png"),
        (("--base-planes", "absent/planes.png"), "there is no folder 'absent'"),
        (("--bogus",), "No such option: --bogus. See: python -m models.four_bar linkage --help"),
        (("more",), "unexpected extra argument"),
    ],
)
def test_invalid_input_gives_one_line_and_status_2(arguments, message, refusal, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert message in refusal("linkage", *arguments)
    assert list(tmp_path.iterdir()) == []


def test_program_runs_from_a_shell(answer):
    assert "--coupler-point" in answer("linkage", "--help")[0]
    command = [sys.executable, "-m", "models.four_bar", "linkages"]
    refused = subprocess.run(command, capture_output=True, text=True, check=False)
    assert refused.returncode == 2
    assert "No such command 'linkages'" in refused.stderr
    assert refused.stderr.count("\n") == 1
