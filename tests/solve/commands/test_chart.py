"""JSON, tables, figures and errors of `solve chart` and `solve critical`."""

import json

import numpy as np
import pytest
import xarray
from scipy.special import mathieu_a, mathieu_b

CHART = ("chart", "mathieu", "--set", "zeta=0", "--x", "delta=0:6:13", "--y", "epsilon=0.1:3:7")
CRITICAL = ("critical", "manipulator", "--speeds", "250:400:6 rpm", "--orders", "3")


def test_chart_json_contains_verdicts(command):
    ran = command(*CHART, "--cut", "epsilon=1", "--json")
    assert ran.status == 0, ran.err
    record = json.loads(ran.out)
    assert (record["x"]["name"], record["y"]["name"]) == ("delta", "epsilon")
    assert len(record["spectral_radius"]) == 7
    assert all(len(row) == 13 for row in record["spectral_radius"])
    assert {curve["kind"] for curve in record["boundaries"]} == {"+1", "-1"}
    crossings = [crossing["at"] for crossing in record["cuts"][0]["crossings"]]
    edges = [mathieu_b(1, 0.5), mathieu_a(1, 0.5), mathieu_b(2, 0.5), mathieu_a(2, 0.5)]
    assert crossings == pytest.approx(edges, abs=1e-7)


@pytest.mark.parametrize("arguments", [CHART, CRITICAL], ids=["chart", "critical"])
def test_tables_fit_80_columns_and_figures_are_written(command, tmp_path, arguments):
    ran = command(*arguments, "--plot", "picture.png")
    assert ran.status == 0, ran.err
    assert max(map(len, ran.out.splitlines())) <= 80
    assert (tmp_path / "picture.png").read_bytes().startswith(b"\x89PNG")


def test_critical_speeds_json_has_the_documented_keys(command):
    ran = command(*CRITICAL, "--figure", "rms", "--json")
    assert ran.status == 0, ran.err
    record = json.loads(ran.out)
    assert record["figure"] == "rms"
    keys = {"response", "multiplier", "division", "division_at_rest", "mode", "order"}
    assert record["rows"]
    assert all(row.keys() >= keys for row in record["rows"])


def test_points_without_a_result_are_counted_and_saved(command, tmp_path):
    axes = ("--x", "speed=4000:5000:4 rpm", "--y", "l2=0.05:0.65:3")
    ran = command("chart", "coupler", *axes, "--plot", "chart.png", "--save", "chart.nc", "--json")
    assert ran.status == 0, ran.err
    assert "4 of 12 points have no result, and boundaries end near these points" in ran.err
    record = json.loads(ran.out)
    assert record["spectral_radius"][2] == [None] * 4
    assert record["verdicts"][2] == ["failed"] * 4
    assert [(one["row"], one["column"]) for one in record["failures"]] == [(2, k) for k in range(4)]
    saved = xarray.open_dataset(tmp_path / "chart.nc")
    assert np.isnan(saved["spectral_radius"].values).tolist() == [[False] * 4] * 2 + [[True] * 4]
    assert saved["spectral_radius"].dims == ("l2", "speed")
    assert all("cannot turn" in text for text in saved["error"].values[2].tolist())
    assert json.loads(saved.attrs["metadata"])["boundaries"] == record["boundaries"]


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("chart", "mathieu", "--x", "delta=0:6:13"), "no --y given"),
        ((*CHART[:-1], "epsilon=3"), "write --y epsilon=A:B:N"),
        ((*CHART[:-1], "epsilom=0:3:4"), "did you mean 'epsilon'"),
        ((*CHART, "--tolerance", "nan"), "tolerance is nan"),
        (
            ("chart", "four_bar", "--x", "speed=200:300:2 rpm", "--y", "L4=0.7:0.8:2"),
            "4 points, none with a result",
        ),
        ((*CHART, "--cut", "zeta=1"), "unknown quantity of the chart 'zeta'"),
        ((*CRITICAL, "--figure", "mean"), "unknown figure 'mean'"),
        ((*CRITICAL, "--of", "q7"), "unknown coordinate or output"),
        (("critical", "manipulator"), "no speeds given"),
    ],
)
def test_invalid_arguments_are_refused_in_one_line(command, arguments, text):
    ran = command(*arguments)
    assert ran.status == 2
    assert text in ran.err
    assert ran.err.count("\n") == 1
