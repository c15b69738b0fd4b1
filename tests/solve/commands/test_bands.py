"""Output, files, figures and errors of `solve bands`."""

import csv
import json
import math

import numpy as np
import pytest

UNDAMPED = ("coupler", "--set", "alpha=0", "--set", "cx=0", "--set", "cy=0")
RPM = 30 / math.pi


def record(ran):
    assert ran.status == 0, ran.err
    return json.loads(ran.out, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))


def test_json_contains_the_bands_of_the_undamped_coupler(command):
    computed = record(command("bands", *UNDAMPED, "--speeds", "4000:6000:3 rpm", "--json"))
    assert computed["model"] == "coupler"
    assert computed["parameters"]["alpha"] == 0
    assert computed["range"] == pytest.approx([4000 / RPM, 6000 / RPM], rel=1e-14)
    assert 0 < computed["spacing"] <= 2000 / 40 / RPM * (1 + 1e-9)
    for band in computed["bands"]:
        assert band.keys() >= {"from", "to", "kind", "spectral_radius"}
        assert band["kind"] in ("+1", "-1", "complex")
    wide = [band for band in computed["bands"] if band["spectral_radius"] > 1.001]
    assert [band["kind"] for band in wide] == ["-1", "+1"]
    edges = np.array([wide[0]["from"], wide[0]["to"], wide[1]["from"]]) * RPM
    np.testing.assert_allclose(edges, [4294.86, 4347.96, 5643.97], rtol=0, atol=0.05)
    assert wide[1]["to"] * RPM == pytest.approx(6000, rel=1e-14)
    assert [band["open_high"] for band in wide] == [False, True]


def test_table_warns_that_narrower_bands_may_be_missed(command):
    ran = command("bands", *UNDAMPED, "--speeds", "5600:6000:3 rpm")
    assert ran.status == 0, ran.err
    (row,) = [line.split() for line in ran.out.splitlines() if line.startswith("+1")]
    assert row[:3] == ["+1", "period", "T"]
    assert float(row[3]) == pytest.approx(5643.97, abs=0.05)
    assert row[4:6] == ["<", "6000.000"]
    assert "rpm: narrower bands may be missed" in ran.out
    assert max(map(len, ran.out.splitlines())) <= 80


def test_search_without_bands_reports_none_found(command):
    ran = command("bands", "coupler", "--speeds", "600 1500 rpm")
    assert "no unstable band found from 600 to 1500 rpm" in ran.out
    assert "narrower bands may be missed" in ran.out
    assert record(command("bands", "coupler", "--speeds", "600 1500 rpm", "--json"))["bands"] == []


def test_figure_and_data_are_written(command, tmp_path):
    arguments = ("bands", *UNDAMPED, "--speeds", "5600:6000:5 rpm")
    computed = record(command(*arguments, "--plot", "b.svg", "--save", "b.csv", "--json"))
    assert "unstable bands" in (tmp_path / "b.svg").read_text()
    (row,) = csv.DictReader((tmp_path / "b.csv").read_text().splitlines())
    (band,) = computed["bands"]
    assert float(row["from (rad/s)"]) == pytest.approx(band["from"], rel=1e-12)
    assert float(row["to (rad/s)"]) == pytest.approx(band["to"], rel=1e-12)
    assert row["kind"] == band["kind"] == "+1"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), ("no speeds given", "--speeds")),
        (("--speeds", "600 rpm"), ("at least two speeds", "'100:900:81 rpm'")),
        (("--speeds", "600 600 rpm"), ("at least two speeds",)),
        (("--speeds", "600, 900 rpm"), ("'600, 900 rpm'", "'600 900 1200 rpm'")),
        (("--speeds", "600:900:3 kg"), ("'kg'", "allowed: rpm, rad/s or Hz")),
        (("--speeds", "600:900:3 rpm", "--method", "gaus"), ("'gaus'", "'gauss'")),
        (("--speeds", "600:900:3 rpm", "--rtol", "0"), ("rtol is 0",)),
        (("--speeds", "600:900:3 rpm", "--plot", "b.jpeg"), ("b.jpeg", ".png")),
    ],
)
def test_invalid_arguments_are_refused_in_one_line(command, arguments, words):
    ran = command("bands", "coupler", *arguments)
    assert (ran.status, ran.out, ran.err.count("\n")) == (2, "", 1), ran.err
    assert [word for word in words if word not in ran.err] == [], ran.err
    assert "Error)" not in ran.err
