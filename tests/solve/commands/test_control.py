"""The command `control`."""

import json

import pytest

import solve
from solve.commands.app import run


def test_regulator_is_printed_with_the_vibration(capsys):
    assert run(["control", "manipulator", "--lqr", "q2=1e8, u=1e-2", "--vibration"]) == 0
    out, err = capsys.readouterr()
    assert "the closed loop is asymptotically stable" in out
    assert "u by q1_dot" in out
    assert "rms with" in out
    assert "warning" not in err


def test_json_has_gain_feedforward_and_observer(capsys):
    flags = ["--lqr", "q2=1e8, u=1e-2", "--kalman", "u=1, q1=1e-9", "--feedforward", "--vibration", "--json"]
    assert run(["control", "manipulator", "--speed", "70 rpm", *flags]) == 0
    record = json.loads(capsys.readouterr().out)
    found = solve.control(
        solve.load("manipulator"), "70 rpm", {"q2": 1e8, "u": 1e-2}, {"u": 1, "q1": 1e-9}, feedforward=True
    )
    assert record["kind"] == "lqg"
    assert record["spectral_radius"] == pytest.approx(found.stability.spectral_radius, rel=1e-9)
    assert record["gain"]["u_by_q1"]["harmonics"][0] == pytest.approx(abs(found.harmonics[0, 0, 0]), rel=1e-9)
    assert len(record["feedforward"]["u"]["harmonics"]) == 13
    assert record["observer"]["kind"] == "kalman"
    assert record["vibration"]["q2"]["controlled"] < record["vibration"]["q2"]["without"]


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        ([], "requires weights; add --lqr"),
        (["--lqr", "q2=1e8"], "contains no input (inputs of the system: u)"),
        (["--lqr", "u=1"], "contains no state"),
        (["--lqr", "q2=1e8, u"], "write each name once"),
        (["--lqr", "q2=1, q2=2, u=1"], "write each name once"),
        (["--lqr", "q9=1, u=1"], "q9"),
        (["--lqr", "q2=-1, u=1"], "at least 0"),
        (["--lqr", "q2=1, u=0"], "u is 0.0; allowed: real numbers > 0"),
        (["--kalman", "u=1, q1=1e-9", "--feedforward"], "--feedforward requires --lqr"),
        (["--kalman", "u=1, q1=1e-9", "--samples", "40"], "--samples 40 requires --lqr"),
    ],
)
def test_invalid_weights_are_refused_in_one_line(capsys, flags, words):
    assert run(["control", "manipulator", *flags]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert words in err
    assert err.count("\n") == 1


def test_model_without_inputs_is_refused(capsys):
    assert run(["control", "mathieu", "--lqr", "q=1, u=1"]) == 2
    assert "contains no input (inputs of the system: none)" in capsys.readouterr().err


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """Return a saved controller with an observer."""
    file = tmp_path_factory.mktemp("controller") / "k.npz"
    weights, noise = {"q2": 1e8, "u": 1e-3}, {"u": 1, "q1": 1e-9}
    solve.control(solve.load("manipulator"), "70 rpm", weights, noise).save(file)
    return file


def test_saved_controller_is_applied_to_a_changed_machine(capsys, stored):
    flags = ["--speed", "70 rpm", "--controller", str(stored), "--json"]
    assert run(["floquet", "manipulator", *flags, "--set", "k1=9e4"]) == 0
    record = json.loads(capsys.readouterr().out)
    noise = {"u": 1.0}, {"q1": 1e-9}
    found = solve.lqg(solve.load("manipulator"), "70 rpm", {"q2": 1e8}, {"u": 1e-3}, *noise)
    expected = solve.floquet(found.closed.varied({"k1": 9e4}), "70 rpm")
    # The observer keeps the stiffness of the design.
    assert record["spectral_radius"] == pytest.approx(expected.spectral_radius, rel=1e-7)
    assert record["spectral_radius"] > 100 * found.stability.spectral_radius
    assert record["parameters"]["k1"] == 9e4


def test_saved_controller_is_applied_in_sweeps_charts_and_transients(capsys, stored):
    given = ["manipulator", "--controller", str(stored), "--json"]
    for command in (
        ["sweep", *given, "--speeds", "69:71:2 rpm", "--rtol", "1e-4"],
        ["chart", *given, "--speed", "70 rpm", "--x", "k1=6e4:7e4:2", "--y", "k2=5e4:6e4:2"],
        ["transient", *given, "--speed", "70 rpm", "--turns", "1"],
    ):
        assert run(command) == 0
        record = json.loads(capsys.readouterr().out)
        assert record["model"] == "manipulator with feedback"


def test_incompatible_controllers_are_refused_in_one_line(capsys, stored, tmp_path):
    kalman = tmp_path / "filter.npz"
    solve.control(solve.load("manipulator"), kalman={"u": 1, "q1": 1e-9}, speed="70 rpm").save(kalman)
    for model, file, words in (
        ("cam", stored, "cam has the states q1, q2, q3"),
        ("mathieu", stored, "the inputs (none)"),
        ("manipulator", kalman, "holds no feedback"),
        ("manipulator", tmp_path / "none.npz", "there is no file"),
    ):
        assert run(["floquet", model, "--controller", str(file)]) == 2
        out, err = capsys.readouterr()
        assert out == ""
        assert words in err
        assert err.count("\n") == 1
