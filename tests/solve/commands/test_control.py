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
        ([], "requires weights"),
        (["--lqr", "q2=1e8"], "names no input (u)"),
        (["--lqr", "u=1"], "names no state"),
        (["--lqr", "q2=1e8, u"], "write each name once"),
        (["--lqr", "q2=1, q2=2, u=1"], "write each name once"),
        (["--lqr", "q9=1, u=1"], "q9"),
        (["--lqr", "q2=-1, u=1"], "at least 0"),
        (["--lqr", "q2=1, u=0"], "positive"),
    ],
)
def test_weights_that_do_not_fit_are_refused_in_one_line(capsys, flags, words):
    assert run(["control", "manipulator", *flags]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert words in err
    assert err.count("\n") == 1


def test_model_without_inputs_is_refused(capsys):
    assert run(["control", "mathieu", "--lqr", "q=1, u=1"]) == 2
    assert "names no input (there is none)" in capsys.readouterr().err
