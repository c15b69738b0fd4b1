"""Commands applied to matrix files instead of a model."""

import json

import numpy as np
import pytest

from tests.solve.readers.lin_files import SPEED, write_set


def test_pattern_selects_openfast_files(tmp_path, command):
    ran = command("floquet", write_set(tmp_path, 12), "--json")
    assert ran.status == 0, ran.err
    found = json.loads(ran.out)
    assert found["model"] == "run"
    assert found["speed"] == pytest.approx(SPEED)
    assert len(found["multipliers"]) == 6


def test_matrix_files_are_solved_and_modes_are_followed(tmp_path, command):
    phases = np.arange(12) * 2 * np.pi / 12
    K = (4 + 0.2 * np.cos(phases))[:, None, None]
    np.savez(tmp_path / "k.npz", M=np.eye(1), C=0.1 * np.eye(1), K=K, d=np.ones((1, 1)))
    ran = command("periodic", "k.npz", "--speed", "1 rad/s", "--json")
    assert ran.status == 0, ran.err
    assert json.loads(ran.out)["coordinates"]["q1"]["mean"] == pytest.approx(0.25, rel=0.01)
    ran = command("modes", "k.npz", "--speeds", "1:2:3 rad/s", "--json")
    assert ran.status == 0, ran.err
    frequencies = json.loads(ran.out)["frequencies"]
    np.testing.assert_allclose(frequencies, 2.0, rtol=0.01)


def test_live_window_refuses_matrix_files(tmp_path, command):
    pytest.importorskip("tornado")
    np.savez(tmp_path / "k.npz", M=np.eye(1), K=np.eye(1), speed=1.0)
    ran = command("explore", "k.npz", "--no-browser")
    assert ran.status == 2
    assert ran.err.strip().endswith("the live window requires a mechanism, such as cam")


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("none.*.lin",), "no file matches"),
        (("none.mat",), "there is no file"),
        (("k.npz",), "states no speed"),
        (("k.npz", "--set", "k=1"), "omit k"),
        (("k.npz", "--case", "1"), "no parameters, cases or options; omit case"),
        (("text.nc",), "cannot be read"),
    ],
)
def test_invalid_input_is_refused_in_one_line(tmp_path, command, arguments, text):
    np.savez(tmp_path / "k.npz", M=np.eye(1), K=np.eye(1))
    (tmp_path / "text.nc").write_text("text")
    ran = command("periodic", *arguments)
    assert ran.status == 2
    assert text in ran.err
    assert len(ran.err.strip().splitlines()) == 1
