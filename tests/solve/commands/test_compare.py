"""`solve compare`: its JSON, table, picture and file."""

import csv
import json

import pytest

from solve.commands.app import run

ARGUMENTS = (
    "manipulator", "--method", "newmark", "--method", "rk4", "--steps", "300", "--steps", "600",
    "--rtol", "1e-3",
)  # fmt: skip
ROW = {"method", "order", "steps", "orbit_error", "multiplier_error", "time", "verdict", "at", "warnings"}


def test_json_has_the_promised_keys(command):
    ran = command("compare", *ARGUMENTS, "--json")
    assert (ran.status, ran.err) == (0, "")
    found = json.loads(ran.out, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))
    assert found["model"] == "manipulator"
    assert found["reference"]["error_estimate"]["orbit"] < 1e-10
    assert all(row.keys() >= ROW for row in found["rows"])
    kinds = [(row["method"], row["at"], row["target"]) for row in found["rows"]]
    assert kinds == [
        (method, at, target)
        for method in ("newmark", "rk4")
        for at, target in (("equal steps", None), ("equal steps", None), ("equal accuracy", 1e-3))
    ]
    coarse, fine = (row["orbit_error"] for row in found["rows"][:2])
    assert coarse / fine == pytest.approx(4.0, rel=0.1)


def test_no_result_is_null_with_its_reason(command):
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
    assert sum(row[:3] == ["newmark", "beta", "0.16666"] for row in rows) == 3
    assert "At equal steps: 300 steps a period" in ran.out
    assert "At equal accuracy: orbit right to 0.001" in ran.out
    assert "modal: out of reach" in " ".join(ran.out.split())


def test_the_picture_has_a_line_a_method_and_says_what_it_shows(command, monkeypatch, tmp_path):
    from solve.output import style

    figures = []
    keep = style.save_figure
    monkeypatch.setattr(
        style, "save_figure", lambda figure, file: (figures.append(figure), keep(figure, file))
    )
    assert command("compare", *ARGUMENTS, "--plot", "work.png").status == 0
    assert (tmp_path / "work.png").read_bytes().startswith(b"\x89PNG")
    (figure,) = figures
    by_steps, by_time, cost, key = figure.axes
    assert [axes.get_xlabel() for axes in (by_steps, by_time, cost)] == [
        "steps a period",
        "time (ms)",
        "steps a period",
    ]
    for axes in (by_steps, by_time, cost):
        assert [line.get_label() for line in axes.lines if not line.get_label().startswith("_")] == [
            "newmark",
            "rk4",
        ]
        assert axes.get_xscale() == axes.get_yscale() == "log"
    assert [line.get_ydata()[0] for line in by_steps.lines[2:]] == [1e-3]
    errors = by_steps.lines[0].get_ydata()
    assert errors[-1] <= 1e-3 < errors[-2], "steps are doubled until the target is reached"
    assert [text.get_text() for text in key.get_legend().get_texts()] == ["newmark", "rk4"]


def test_rows_are_saved(tmp_path):
    assert run(["compare", *ARGUMENTS, "--save", str(tmp_path / "rows.csv")]) == 0
    header, *rows = csv.reader((tmp_path / "rows.csv").read_text().splitlines())
    assert header[:6] == ["method", "order", "steps", "orbit_error (1)", "multiplier_error (1)", "time (s)"]
    assert len(rows) == 6
