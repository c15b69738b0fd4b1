"""`python -m models.four_bar study` and `corrected`: reports, JSON, figures, files and errors."""

import json

import numpy as np
import pytest

import solve
from solve.commands.app import run as solve_command

SPEEDS = ("--speeds", "24:34:6 rad/s")


def test_study_over_length_equals_single_solves(answer, tmp_path):
    picture, data = tmp_path / "study.png", tmp_path / "study.csv"
    of = "follower_midpoint_deflection"
    out, err = answer(
        "study", *SPEEDS, "--over", "L4=0.547,0.65", "--of", of, "--json",
        "--plot", str(picture), "--save", str(data),
    )  # fmt: skip
    record = json.loads(out)
    assert (record["over"], [each["value"] for each in record["systems"]]) == ("L4 (m)", ["0.547", "0.65"])
    assert err.count("wrote") == 2
    for each in record["systems"]:
        alone = solve.periodic(solve.load("four_bar", L4=float(each["value"])), 30.0, rtol=1e-6)
        assert each["responses"][of][3] == pytest.approx(alone.statistics(of).max_abs, rel=1e-5)
    assert picture.stat().st_size > 10_000
    assert len(data.read_text().strip().splitlines()) >= 7


def test_study_over_option_and_corrected_model(answer):
    out, _ = answer("study", *SPEEDS, "--over", "elements=1", "--corrected")
    assert "elements" in out
    assert "corrected" in out
    assert max(map(len, out.splitlines())) <= 80


@pytest.mark.slow
def test_equation_warnings_are_printed_for_every_system(answer):
    given = ("study", "--speeds", "30 90 rad/s", "--option", "stiffening=on", "--rtol", "1e-4")
    _, err = answer(*given, "--over", "zeta=0,0.02")
    assert "0: terms=instantaneous neglects M'q'" in err
    assert "0.02: stiffening: at 38 deg the compression of link follower" in err
    assert "(at 90 rad/s)" in err


def test_largest_stress_covers_both_surfaces(answer):
    """At L4 = 0.66 m and 30 rad/s, the stress is largest on the minus surface: 92.96 MPa at the root of the
    crank and 86.20 MPa at the follower's midpoint, according to an independent program."""
    names = {"crank_root_stress": 92.96, "follower_midpoint_stress": 86.20}
    of = [part for name in names for part in ("--of", name)]
    given = ("--speeds", "30 rad/s", "--option", "elements=3", "--over", "L4=0.66")
    out, _ = answer("study", *given, *of, "--json")
    (system,) = json.loads(out)["systems"]
    for name, stress in names.items():
        assert system["responses"][name][0] / 1e6 == pytest.approx(stress, abs=0.011)


def test_several_quantities_rms_and_damping(answer):
    out, _ = answer(
        "study", *SPEEDS, "--over", "zeta=0.02,0.06", "--figure", "rms", "--json",
        "--of", "crank_root_stress_plus", "--of", "strain_energy",
    )  # fmt: skip
    record = json.loads(out)
    assert record["figure"] == "rms"
    for each in record["systems"]:
        assert set(each["responses"]) == {"crank_root_stress_plus", "strain_energy"}
        assert np.isfinite(each["spectral_radius"]).all()


@pytest.mark.slow
def test_corrected_model_is_compared_with_others(answer, tmp_path):
    picture = tmp_path / "corrected.png"
    out, _ = answer("corrected", "--elements", "1", "--json", "--plot", str(picture))
    models = {load["name"]: load for load in json.loads(out)["models"]}
    assert set(models) == {"reference", "1", "corrected, consistent", "corrected, nodal"}
    assert models["corrected, nodal"]["excess"] > 0.15
    assert abs(models["corrected, consistent"]["excess"]) < 0.03
    assert picture.stat().st_size > 10_000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("study",), "--speeds"),
        (("study", *SPEEDS), "--over NAME=A,B,C"),
        (("study", *SPEEDS, "--over", "L4=0.5,,0.6"), "--over NAME=A,B,C"),
        (("study", *SPEEDS, "--over", "L5=0.5"), "L4"),
        (("study", *SPEEDS, "--over", "L4=0.1,0.5"), "L4 = 0.1"),
        (("study", *SPEEDS, "--over", "L4=0.5,0.6", "--figure", "mean"), "figure"),
        (("study", *SPEEDS, "--over", "L4=0.5,0.6", "--of", "stress"), "coordinate or output"),
        (("study", *SPEEDS, "--over", "L4=0.5:0.6:20"), "up to 12"),
        (("study", *SPEEDS, "--over", "L4=0.5,0.6", "--plot", "study.doc"), "ends in '.doc'"),
        (("corrected", "--elements", "one"), "--elements"),
        (("corrected", "--speed", "30"), "unit"),
        (("corrected", "--of", "stress"), "coordinate or output"),
        (("corrected", "--option", "terms=full"), "terms"),
        (("corrected", "--option", "elements=3"), "--option elements has no effect"),
        (("elements", "--option", "element=internal"), "--option element has no effect"),
        (("modes", "--option", "reduce=2"), "--option reduce has no effect"),
        (("curve", "--reduce", "2"), "No such option: --reduce"),
    ],
)
def test_error_messages_have_one_line(arguments, message, refusal):
    assert message in refusal(*arguments)


@pytest.mark.parametrize("command", [("bands",), ("critical", "--of", "A_x")])
def test_commands_over_speed_print_equation_warnings(command, capsys):
    """The damping ratio is far too large because it was given in percent."""
    name, *of = command
    given = ("--set", "zeta=2", "--speeds", "30:31:2 rad/s", "--rtol", "1e-3", "--json")
    assert solve_command([name, "four_bar", *given, *of]) == 0
    written = capsys.readouterr()
    assert "write 2 % as 0.02" in written.err
    assert "write 2 % as 0.02" in json.loads(written.out)["warnings"][0]
