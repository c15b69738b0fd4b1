"""JSON, table, figure and file of `solve compare`."""

import contextlib
import csv
import io
import json
import math

import numpy as np
import pytest

from solve.commands import deliver
from solve.commands.app import run
from solve.methods.choice import METHODS
from solve.results.comparison import Row
from solve.views.comparison import work_precision_figure

ARGUMENTS = (
    "manipulator", "--method", "newmark", "--method", "rk4", "--steps", "300", "--steps", "600",
    "--rtol", "1e-3",
)  # fmt: skip
ROW = {"method", "order", "steps", "orbit_error", "multiplier_error", "time", "verdict", "at", "warnings"}


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    """Return output, JSON and folder of a comparison with figure and file."""
    folder, output, figures = tmp_path_factory.mktemp("compared"), io.StringIO(), []
    keep = deliver.drawn
    with pytest.MonkeyPatch.context() as patch, contextlib.chdir(folder):
        patch.setattr(deliver, "drawn", lambda figure, file: figures.append(figure) or keep(figure, file))
        with contextlib.redirect_stdout(output):
            assert run(["compare", *ARGUMENTS, "--json", "--plot", "work.png", "--save", "rows.csv"]) == 0
    return output.getvalue(), figures, folder


def test_json_has_the_documented_keys(compared):
    record = json.loads(compared[0], parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))
    assert record["model"] == "manipulator"
    assert record["reference"]["error_estimate"]["orbit"] < 1e-10
    assert all(row.keys() >= ROW for row in record["rows"])
    kinds = [(row["method"], row["at"], row["target"]) for row in record["rows"]]
    assert kinds == [
        (method, at, target)
        for method in ("newmark", "rk4")
        for at, target in (("equal steps", None), ("equal steps", None), ("equal accuracy", 1e-3))
    ]
    coarse, fine = (row["orbit_error"] for row in record["rows"][:2])
    assert coarse / fine == pytest.approx(4.0, rel=0.1)


def test_missing_result_is_null_with_a_reason(command):
    ran = command("compare", "manipulator", "--method", "rk4", "--steps", "5", "--rtol", "0.01", "--json")
    row = json.loads(ran.out)["rows"][0]
    assert row["orbit_error"] is row["time"] is row["verdict"] is None
    assert "at least" in row["reason"]


def test_tables_fit_80_columns(command):
    arguments = ("--gamma", "0.5", "--beta", "0.16666", "--method", "modal")
    ran = command("compare", *ARGUMENTS, *arguments)
    assert ran.status == 0
    assert max(map(len, ran.out.splitlines())) <= 80
    assert "…" not in ran.out, "a cell is cut"
    rows = [line.split() for line in ran.out.splitlines()]
    assert sum(row[:3] == ["newmark", "β", "0.16666"] for row in rows) == 3
    assert "At equal steps: 300 steps per period" in ran.out
    assert "At equal accuracy: orbit accurate to 0.001" in ran.out
    assert "modal: out of reach" in " ".join(ran.out.split())


def test_figure_has_one_labelled_line_per_method(compared):
    _, (figure,), folder = compared
    assert (folder / "work.png").read_bytes().startswith(b"\x89PNG")
    orbit, multipliers = figure.axes
    assert [axes.get_title() for axes in figure.axes] == ["orbit", "multipliers"]
    for axes in figure.axes:
        assert [line.get_label() for line in axes.lines[:2]] == ["newmark", "rk4"]
        assert axes.get_xscale() == axes.get_yscale() == "log"
        assert axes.get_xlabel() == "processor time of a solution (ms)"
    assert [line.get_ydata()[0] for line in orbit.lines[2:]] == [1e-3]
    assert len(multipliers.lines) == 2, "targets are those of the orbit"
    for line in orbit.lines[:2]:
        errors = line.get_ydata()
        assert errors[-1] <= 1e-6 < errors[-2], "the trend is followed beyond the target"
    (key,) = figure.legends
    assert [text.get_text() for text in key.get_texts()] == ["newmark", "rk4"]


def points(*errors):
    """Return points of one method; time increases by one second and steps by one."""
    return [
        Row("rk4", 4, k, "equal steps", orbit_error=error, time=float(k)) for k, error in enumerate(errors, 1)
    ]


def test_infinite_reference_error_shades_the_whole_figure():
    made = work_precision_figure("one", {"rk4": points(0.1, 0.01)}, {"orbit": np.inf}, {})
    low, high = made.axes[0].get_ylim()
    shade = made.axes[0].patches[0].get_extents().transformed(made.axes[0].transData.inverted())
    assert 0 < low < high
    assert (shade.y0, shade.y1) == pytest.approx((low, high))


def test_figure_distinguishes_methods_and_omits_points_out_of_range():
    work = points(np.inf, 40.0, 0.5, 1e-4, 1e-9, 0.0)
    made = work_precision_figure("all", dict.fromkeys(METHODS, work), {"orbit": 1e-8}, {"orbit": [1e-3]})
    lines = made.axes[0].lines[: len(METHODS)]
    assert len({(line.get_color(), line.get_marker(), line.get_linestyle()) for line in lines}) == len(
        METHODS
    )
    assert (
        len({line.get_color() for line in lines})
        == len({line.get_marker() for line in lines})
        == len(METHODS)
    )
    for line in lines:
        np.testing.assert_array_equal(line.get_ydata(), [0.5, 1e-4, 1e-9])
        np.testing.assert_array_equal(line.get_xdata(), [3e3, 4e3, 5e3])


def test_methods_without_a_load_are_compared_by_multipliers(command):
    """The only orbit of Mathieu's equation is q = 0. The error of |ρ| decreases with the order of the
    method."""
    arguments = ("mathieu", "--method", "newmark", "--method", "rk4", "--steps", "40")
    ran = command("compare", *arguments, "--rtol", "1e-4", "--rtol", "1e-6", "--json")
    record = json.loads(ran.out)
    assert record["judged_by"] == "multipliers"
    assert all(row["orbit_error"] is None for row in record["rows"])
    newmark, rk4 = ([row for row in record["rows"] if row["method"] == name] for name in ("newmark", "rk4"))
    for rows, order in ((newmark, 2), (rk4, 4)):
        equal, coarse, fine = rows
        assert equal["steps"] == 40
        assert 0.8e-4 < coarse["multiplier_error"] <= 1e-4
        assert 0.8e-6 < fine["multiplier_error"] <= 1e-6
        ratio = math.log(coarse["multiplier_error"] / fine["multiplier_error"])
        assert ratio / math.log(fine["steps"] / coarse["steps"]) == pytest.approx(order, abs=0.15)
    ran = command("compare", *arguments, "--rtol", "1e-3")
    assert "At equal accuracy: multipliers accurate to 0.001" in ran.out
    assert not [line for line in ran.out.splitlines() if " 0.0e+00" in line]


def test_false_multipliers_and_verdicts_are_marked_in_the_table(command):
    """For the cam at 100 rpm, 100 steps resolve the fastest mode for no method. Only Radau damps it."""
    arguments = ("cam", "--case", "1", "--speed", "100 rpm", "--steps", "100", "--rtol", "0.9")
    methods = ("--method", "radau", "--method", "newmark", "--gamma", "0.4")
    ran = command("compare", *arguments, *methods)
    lines = [line for line in ran.out.split("At equal accuracy")[0].splitlines() if line.strip()]
    assert max(map(len, ran.out.splitlines())) <= 80
    marked = {line.split()[0]: line.rstrip() for line in lines if "  100  " in line}
    assert marked["radau"].endswith("  asympt. stable")
    assert marked["newmark"].split()[-1] == "*≠"
    assert "* ω_max h is beyond what the method resolves or damps: multipliers may be wrong" in lines
    assert "≠ verdict differs from the reference" in lines
    assert any(line.startswith("newmark gamma 0.4: with gamma = 0.4 < 1/2") for line in lines)
    rows = json.loads(command("compare", *arguments, *methods, "--json").out)["rows"]
    assert [row["followed"] for row in rows[::2]] == [True, False]


def test_table_rows_are_saved(compared):
    header, *rows = csv.reader((compared[2] / "rows.csv").read_text().splitlines())
    assert header[:6] == ["method", "order", "steps", "orbit_error (1)", "multiplier_error (1)", "time (s)"]
    assert len(rows) == 6
