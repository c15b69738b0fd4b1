"""`solve sensitivity`."""

import json

import pytest

import solve

CAM = ("sensitivity", "cam", "--speed", "600 rpm")


def test_json_matches_the_python_result(command):
    ran = command(*CAM, "--of", "q3.max_abs", "--of", "rho1", "--by", "k1", "--by", "speed", "--json")
    assert ran.status == 0
    record = json.loads(ran.out)
    sensitivities = solve.sensitivities(solve.load("cam"), "600 rpm", ["q3.max_abs", "rho1"], ["k1", "speed"])
    assert record["sensitivities"]["q3.max_abs"] == pytest.approx(sensitivities["q3.max_abs"])
    rho = sensitivities["rho1"]["speed"]
    assert record["sensitivities"]["rho1"]["speed"] == pytest.approx([rho.real, rho.imag])
    assert record["elasticities"]["q3.max_abs"]["k1"] == pytest.approx(
        sensitivities.elasticities("q3.max_abs")["k1"]
    )
    assert record["by"] == pytest.approx({"k1": 8e4, "speed": sensitivities.speed})
    assert 0 < record["errors"]["q3.max_abs"]["k1"] < 1e-8 * abs(sensitivities["q3.max_abs"]["k1"])
    assert record["warnings"] == []


def test_tables_and_figures_are_written(command, tmp_path):
    ran = command(*CAM, "--of", "spectral_radius", "--of", "rho1", "--plot", "bars.png", "--save", "all.csv")
    assert ran.status == 0
    assert "and 35 less influential parameters" in ran.out
    assert max(map(len, ran.out.splitlines())) <= 80
    assert (tmp_path / "bars.png").stat().st_size > 10_000
    assert len((tmp_path / "all.csv").read_text("utf-8").splitlines()) == 1 + 2 * (
        1 + len(solve.load("cam").parameters)
    )


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (("--of", "q3.maxabs"), "did you mean 'max_abs'?"),
        (("--of", "q3"), "such as q3.max_abs"),
        (("--of", "rho9"), "multipliers 1 to 6"),
        (("--of", "rho1.absolute"), "did you mean 'abs'?"),
        (("--by", "kk"), "did you mean 'k3'?"),
        (("--method", "newmark", "--steps", "4000"), "sensitivities support radau, gauss"),
    ],
)
def test_invalid_input_is_refused_in_one_line(command, flags, words):
    ran = command(*CAM, *flags)
    assert (ran.status, ran.out) == (2, "")
    assert words in ran.err
    assert len(ran.err.splitlines()) == 1


def test_derivatives_versus_speed_and_of_critical_speeds_are_printed(command, tmp_path):
    cam = ("--speeds", "300 400 rpm", "--of", "q3.max_abs", "--by", "k1", "--by", "k3")
    ran = command("sensitivity", "cam", *cam, "--json", "--plot", "over.png", "--save", "over.nc")
    assert ran.status == 0
    record = json.loads(ran.out)
    assert len(record["sensitivities"]["q3.max_abs"]["k1"]) == 2
    assert (tmp_path / "over.png").stat().st_size > 10_000
    again = solve.open(tmp_path / "over.nc")
    assert again["q3.max_abs"]["k1"].tolist() == record["sensitivities"]["q3.max_abs"]["k1"]
    ran = command("sensitivity", "cam", *cam)
    assert "Elasticities of q3.max_abs" in ran.out
    ran = command("sensitivity", "cam", *cam, "--speed", "300 rpm")
    assert (ran.status, ran.err.count("\n")) == (2, 1)
    mathieu = ("bands", "mathieu", "--speeds", "0.8:1.2:2 rad/s", "--set", "delta=1", "--set", "epsilon=0.3")
    ran = command(*mathieu, "--set", "zeta=0.02", "--by", "delta", "--json")
    assert json.loads(ran.out)["sensitivities"]["band1.to"]["delta"] > 0
    ran = command(*mathieu, "--by", "gamma")
    assert ran.status == 2


def test_quantities_without_any_derivative_are_refused(command):
    ran = command(*CAM, "--of", "q1.max_phase", "--by", "k1")
    assert (ran.status, ran.out, ran.err.count("\n")) == (2, "", 1)
    assert "derivatives of phases of extrema are not calculated" in ran.err
