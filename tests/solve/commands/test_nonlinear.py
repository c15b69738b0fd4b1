"""`solve periodic --nonlinear`, `solve validity` and `solve transient`."""

import json

import numpy as np
import pytest
from scipy.special import mathieu_a, mathieu_b

import solve
from solve.results import serialization

CAM = ("periodic", "cam", "--speed", "300 rpm", "--rtol", "1e-6", "--nonlinear")


def test_json_contains_the_orbit_and_its_search(command):
    ran = command(*CAM, "--json", "--harmonics", "5")
    assert ran.status == 0
    record = json.loads(ran.out)
    orbit = solve.nonlinear(solve.load("cam"), "300 rpm", rtol=1e-6)
    assert record["found_by"] == orbit.found_by == "linear orbit"
    assert record["iterations"] == orbit.iterations > 1
    assert record["coordinates"]["q3"]["max_abs"] == pytest.approx(orbit.statistics("q3").max_abs, rel=1e-9)
    assert len(record["coordinates"]["q1"]["harmonics"]) == 6
    assert "linearisation_error" not in record
    assert not any("linearisation" in text for text in record["warnings"])


def test_orbit_may_span_several_periods(command):
    ran = command(*CAM, "--periods", "2", "--json", "--harmonics", "2")
    record = json.loads(ran.out)
    assert record["period"] == pytest.approx(2 * 60 / 300)
    assert record["coordinates"]["q1"]["harmonics"][2] > 100 * record["coordinates"]["q1"]["harmonics"][1]


def test_nonlinear_orbit_is_printed_plotted_and_saved(command, tmp_path):
    ran = command(*CAM, "--plot", "cam.png", "--save", "cam.npz")
    assert ran.status == 0
    assert "linear orbit" in ran.out
    assert max(map(len, ran.out.splitlines())) <= 80
    assert (tmp_path / "cam.png").stat().st_size > 10_000
    assert np.load(tmp_path / "cam.npz")["q"].shape[0] == 3


def test_linear_orbit_reports_the_linearisation_error_per_coordinate(command):
    record = json.loads(command("periodic", "cam", "--speed", "100 rpm", "--json").out)
    assert record["linearisation_error"].keys() == record["coordinates"].keys()


def test_validity_reports_the_highest_valid_speed_of_the_linear_model(command, tmp_path):
    speeds = ("--speeds", "50:150:3 rpm")
    ran = command("validity", "cam", *speeds, "--at", "2%", "--json", "--plot", "v.png", "--save", "v.csv")
    record = json.loads(ran.out)
    assert record["trusted_to"] == pytest.approx(100 * np.pi / 30)
    assert [point["speed"] for point in record["points"]] == pytest.approx(
        np.pi / 30 * np.array([50, 100, 150])
    )
    assert record["points"][2]["linearisation_error"]["q3"] > 0.02
    assert (tmp_path / "v.png").is_file()
    assert (tmp_path / "v.csv").is_file()
    assert "up to 100 rpm" in command("validity", "cam", *speeds, "--at", "0.02").out


def test_start_file_of_another_kind_is_refused(command, tmp_path, monkeypatch):
    """The error is the same if the results of that kind have not been loaded."""
    assert command("sweep", "cam", "--speeds", "300:301:2 rpm", "--save", "s.npz").status == 0
    monkeypatch.delitem(serialization.CLASSES, "Sweep")
    ran = command("periodic", "cam", "--speed", "300 rpm", "--nonlinear", "--start", "s.npz")
    assert (ran.status, ran.err) == (
        2,
        "solve: start 's.npz' is a Sweep; give a file of an orbit or of a transient\n",
    )


def test_branch_is_printed_plotted_and_saved(command, tmp_path):
    line = "branch", "cam", "--speeds", "300:302 rpm", "--rtol", "1e-2"
    record = json.loads(command(*line, "--json").out)
    assert record["points"][0]["speed"] == pytest.approx(10 * np.pi)
    assert record["points"][-1]["speed"] == pytest.approx(302 * np.pi / 30)
    assert record["points"][0]["verdict"] == "asymptotically stable"
    assert record["turning"] == []
    (warning,) = record["warnings"]
    assert warning.startswith("the follower lifts off the cam: contact_force reaches -")
    ran = command(*line, "--plot", "b.png", "--save", "b.npz")
    assert "The branch goes from 300 to 302 rpm." in ran.out
    assert max(map(len, ran.out.splitlines())) <= 80
    assert (tmp_path / "b.png").is_file()
    assert solve.open(tmp_path / "b.npz").record() == record


def test_run_down_to_rest_prints_and_plots_its_outputs(command, tmp_path):
    line = "transient", "manipulator", "--speeds", "300:0 rpm", "--turns", "2"
    record = json.loads(command(*line, "--json").out)
    assert record["speeds"] == pytest.approx([10 * np.pi, 0.0])
    assert record["outputs"]["drive_torque"]["max"] > 0
    ran = command(*line, "--show", "drive_torque", "--plot", "down.png", "--save", "down.csv")
    assert ran.status == 0
    assert "Outputs over all turns" in ran.out
    assert (tmp_path / "down.png").is_file()
    assert "drive_torque (N m)" in (tmp_path / "down.csv").read_text().splitlines()[0]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((*CAM, "--quasi-static"), ("--quasi-static", "--nonlinear")),
        ((*CAM, "--periods", "0"), ("periods is 0", "at least 1")),
        ((*CAM, "--method", "newmark"), ("newmark", "radau")),
        ((*CAM[:-1], "--periods", "2"), ("--periods 2", "--nonlinear")),
        (
            ("periodic", "four_bar", "--speed", "30 rad/s", "--nonlinear"),
            ("four_bar", "linear by construction"),
        ),
        (("validity", "cam", "--speeds", "100 rpm", "--at", "five"), ("five", "5%")),
        (("transient", "cam", "--speeds", "0:9 rpm", "--show", "q9"), ("q9", "coordinate or output")),
        (("branch", "cam"), ("no speeds", "--speeds")),
        (("branch", "cam", "--speeds", "300 rpm"), ("300 rpm", "give two")),
        (("branch", "cam", "--speeds", "300:310 rpm", "--over", "k1=1:2"), ("--over and --speeds",)),
        (("branch", "cam", "--speed", "300 rpm"), ("no speeds", "--over NAME=A:B")),
        (("branch", "cam", "--over", "k1=1e4", "--speed", "300 rpm"), ("write NAME=A:B",)),
        (("branch", "cam", "--over", "k1=1e4:2e4", "--over", "k2=1:2"), ("--over is given twice",)),
        (
            ("branch", "cam", "--follow", "fold", "--switch"),
            ("--follow excludes --switch, --unforced, --speeds, --begin and --store",),
        ),
        (
            ("branch", "cam", "--scatter", "3", "--switch"),
            ("--scatter excludes --switch, --follow, --start and --unforced",),
        ),
        (("branch", "cam", "--scatter", "3", "--begin", "1 Hz"), ("--begin requires a range",)),
        (("branch", "cam", "--speeds", "3:4 Hz", "--begin", "9 Hz"), ("9 Hz", "between 3 Hz and 4 Hz")),
        (
            ("branch", "cam", "--over", "k1=1:2", "--begin", "soft", "--speed", "1 Hz"),
            ("k1 is 'soft'; give a number",),
        ),
        (("sweep", "cam", "--speeds", "300:310:2 rpm", "--nonlinear", "--turn", "q1"), ("--turn",)),
        (("branch", "four_bar", "--speeds", "10:20 rad/s"), ("linear by construction",)),
        (("validity", "cam"), ("no speeds", "--speeds")),
    ],
)
def test_invalid_input_is_refused_in_one_line(command, arguments, words):
    ran = command(*arguments)
    assert ran.status == 2
    assert ran.out == ""
    assert len(ran.err.splitlines()) == 1
    assert all(word in ran.err for word in words)


def test_transient_reports_the_periods_needed_to_reach_the_orbit(command, tmp_path):
    cam = ("transient", "cam", "--speed", "300 rpm", "--turns", "4")
    ran = command(*cam, "--json", "--plot", "t.png", "--save", "t.npz")
    record = json.loads(ran.out)
    assert record["turns"] == 4
    assert record["reached"] == solve.transient(solve.load("cam"), "300 rpm", 4).reached
    assert len(record["coordinates"]["q1"]["peaks"]) == 4
    assert (tmp_path / "t.png").is_file()
    again = command(*cam, "--start", "t.npz")
    assert "is at most 0.001 after 0 of 4 turns" in again.out
    assert max(map(len, again.out.splitlines())) <= 80
    assert command(*cam, "--start", "tset").status == 2


def test_run_up_shows_speeds_and_outputs_versus_time(command, tmp_path):
    up = ("transient", "cam", "--speeds", "0:300 rpm", "--turns", "3", "--rtol", "1e-2")
    record = json.loads(command(*up, "--json", "--plot", "up.svg", "--save", "up.npz").out)
    assert record["speeds"] == [0.0, pytest.approx(10 * np.pi)]
    assert record["time"] == pytest.approx(3 * 2 * 60 / 300)
    assert (record["turns"], record["reached"], record["speed"]) == (3, None, None)
    assert "speed (rpm)" in (tmp_path / "up.svg").read_text("utf-8")
    ran = command(*up)
    assert "0 to 300 rpm, 3 turns in 1.2 s" in ran.out
    for flags, words in (
        (("--speed", "9 rpm", "--speeds", "0:9 rpm"), "give one of them"),
        (("--speeds", "0:9"), "speeds are '0:9'"),
    ):
        ran = command("transient", "cam", *flags)
        assert (ran.status, ran.out) == (2, "")
        assert words in ran.err


def test_branch_versus_a_parameter_has_special_points(command):
    """The system is Mathieu's equation with q = 0. Period doublings occur at the edges of the first unstable
    region."""
    line = "branch", "mathieu", "--over", "delta=0.8:1.2", "--set", "epsilon=0.2", "--speed", "1 rad/s"
    record = json.loads(command(*line, "--set", "zeta=0", "--rtol", "1e-6", "--json").out)
    edges = [mathieu_b(1, 0.1), mathieu_a(1, 0.1)]
    assert [point["delta"] for point in record["doublings"]] == pytest.approx(edges, rel=1e-6)
    assert (record["folds"], record["tori"], record["jumps"]) == ([], [], [])
    kinds = [point["kind"] for point in record["points"]]
    assert kinds.count("doubling") == 2
    assert {"turns", "spectral_radius", "delta"} <= record["points"][0].keys()
