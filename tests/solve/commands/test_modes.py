"""Output, files, figures and errors of `solve modes`."""

import json
import math

import numpy as np
import pytest

import solve


def test_json_has_frequencies_damping_labels_and_ambiguous_pairs(command):
    ran = command("modes", "manipulator", "--speeds", "30:40:3 rpm", "--json")
    assert ran.status == 0, ran.err
    found = json.loads(ran.out)
    assert found["labels"] == ["1", "2"]
    assert found["ambiguous"] == []
    assert np.shape(found["frequencies"]) == np.shape(found["damping"]) == (3, 2)
    # Both modes are in solve.floquet, whatever the order of their multipliers.
    modes = solve.floquet(solve.load("manipulator"), "35 rpm").modes
    frequencies = {round(mode.folded % (35 * math.pi / 30), 4) for mode in modes}
    rotation = 35 * math.pi / 30
    for omega in found["frequencies"][1]:
        assert round(omega % rotation, 4) in frequencies or round(-omega % rotation, 4) in frequencies


def test_tables_fit_80_columns_and_figure_is_drawn(command, tmp_path):
    picture = tmp_path / "modes.png"
    ran = command("modes", "coupler", "--speeds", "300:330:3 rpm", "--plot", str(picture))
    assert ran.status == 0, ran.err
    assert max(map(len, ran.out.splitlines())) <= 80
    assert "Frequency in Hz and damping ratio in %" in ran.out
    assert picture.stat().st_size > 10_000


def test_modes_versus_a_parameter_are_followed(command):
    ran = command("modes", "manipulator", "--speed", "40 rpm", "--over", "k1=6e3:8e3:3", "--json")
    assert ran.status == 0, ran.err
    found = json.loads(ran.out)
    assert found["k1"] == [6e3, 7e3, 8e3]
    assert np.all(np.diff(np.array(found["frequencies"])[:, 0]) > 0)


@pytest.mark.parametrize(
    ("flags", "text"),
    [
        ([], "no speeds given"),
        (["--speeds", "1 rad/s"], "at least two"),
        (["--speeds", "1:2:3 rad/s", "--method", "newmark"], "radau or gauss"),
        (["--speeds", "1:2:3 rad/s", "--over", "k1=1:2:3"], "one speed"),
    ],
)
def test_invalid_input_is_refused_in_one_line(command, flags, text):
    ran = command("modes", "manipulator", *flags)
    assert ran.status == 2
    assert text in ran.err
    assert len(ran.err.strip().splitlines()) == 1
