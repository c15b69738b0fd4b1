"""`solve export`."""

import numpy as np
import pytest
from scipy.io import loadmat

import solve


def test_command_and_python_export_the_same_file(command, tmp_path):
    ran = command(
        "export", "cam", "--speed", "600 rpm", "--set", "k1=9e4", "--out", "mine.mat", "--samples", "6"
    )
    assert ran.status == 0
    assert "wrote mine.mat" in ran.err
    space = solve.state_space(solve.load("cam", k1=9e4), "600 rpm", samples=6)
    content = loadmat(tmp_path / "mine.mat")
    np.testing.assert_array_equal(np.moveaxis(content["A"], -1, 0), space.A)
    assert content["C"].shape == (3 + len(space.system.outputs), 6, 6)


def test_c_export_requires_no_speed_and_reports_both_files(command, tmp_path):
    ran = command("export", "coupler", "--option", "modes=2", "--out", "mine.c")
    assert ran.status == 0
    assert ran.err.splitlines() == ["wrote mine.c", "wrote mine.h"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine.c", "mine.h"]


@pytest.mark.parametrize("wrong", [("--speed", "90"), ("--speed", "-1 rpm"), ("--samples", "0")])
def test_c_export_validates_unused_arguments(command, tmp_path, wrong):
    ran = command("export", "mathieu", "--out", "mine.c", *wrong)
    assert ran.status == 2
    assert len(ran.err.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_export_prints_model_warnings(command, tmp_path):
    ran = command("export", "four_bar", "--speed", "30 rad/s", "--option", "terms=instantaneous", "--set",
                  "zeta=0", "--out", "mine.mat", "--samples", "4")  # fmt: skip
    assert ran.status == 0
    assert "warning: terms=instantaneous" in ran.err
    assert (tmp_path / "mine.mat").is_file()
