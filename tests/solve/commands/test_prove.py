"""Output and errors of `--prove` of `solve floquet` and `periodic`."""

import dataclasses
import json
import sys

import pytest

pytest.importorskip("flint")

import solve
from solve.proof import prove as proving

MATHIEU = "floquet", "mathieu", "--speed", "1 rad/s"


def test_json_contains_the_proof_and_the_result(command):
    ran = command("periodic", *MATHIEU[1:], "--prove", "--digits", "30", "--json")
    assert ran.status == 0, ran.err
    record = json.loads(ran.out)
    proof = record["proof"]
    assert proof.keys() == {
        *("proved", "verdict", "multipliers", "isolated", "spectral_radius", "assumed", "max_abs"),
        *("true_error", "seconds"),
    }
    assert proof["proved"] is True
    assert proof["verdict"] == record["verdict"] == "asymptotically stable"
    assert proof["isolated"] == [True, True]
    low, high = map(float, proof["spectral_radius"])
    error = record["error_estimate"]["multipliers"] * record["spectral_radius"]
    assert low - error <= record["spectral_radius"] <= high + error
    for (real, imaginary, radius), ordinary in zip(proof["multipliers"], record["multipliers"], strict=True):
        assert abs(complex(real, imaginary) - complex(*ordinary)) <= radius + error
    assert proof["true_error"]["multipliers"] <= record["error_estimate"]["multipliers"]


def test_error_of_a_missing_orbit_is_null(command):
    ran = command(*MATHIEU, "--prove", "--json")
    proof = json.loads(ran.out)["proof"]
    assert proof["true_error"]["orbit"] is None
    assert proof["max_abs"] == {}


def test_terminal_output_shows_verdict_bounds_and_assumption(command):
    ran = command(*MATHIEU, "--prove")
    assert ran.status == 0, ran.err
    assert "\nproved: asymptotically stable\nspectral radius ≥ 0.91497580309320" in ran.out
    assert "Assumed: parameters, speed and constants are exactly their double-precision" in ran.out
    assert all(len(line) <= 80 for line in ran.out.splitlines())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((*MATHIEU, "--digits", "3"), "solve: --digits 3 requires --prove; add it\n"),
        ((*MATHIEU, "--rounded"), "solve: --rounded requires --prove; add it\n"),
        ((*MATHIEU, "--workers", "2"), "solve: --workers 2 requires --prove; add it\n"),
        (
            (*MATHIEU, "--prove", "--rounded", "--digits", "9"),
            "solve: --rounded limits the precision to that of the given numbers; omit --digits\n",
        ),
        ((*MATHIEU, "--prove", "--digits", "0"), "solve: digits is 0; allowed: 1 to 1000\n"),
    ],
)
def test_invalid_combinations_are_refused_in_one_line(command, arguments, message):
    assert command(*arguments) == (2, "", message)


def test_model_without_generated_matrices_is_refused_before_solving(command):
    ran = command("floquet", "four_bar", "--speed", "30 rad/s", "--prove")
    assert (ran.status, ran.out) == (2, "")
    assert "a proof requires matrices that are symbolic functions of the phase" in ran.err


def test_missing_python_flint_is_reported_with_its_extra(command, monkeypatch):
    monkeypatch.setitem(sys.modules, "flint", None)
    for name in [
        name for name in sys.modules if name.startswith("solve.proof.") and name != proving.__name__
    ]:
        monkeypatch.delitem(sys.modules, name)
    ran = command(*MATHIEU, "--prove")
    assert (ran.status, ran.out) == (2, "")
    message = (
        "solve: a proof requires python-flint; install python-flint with: "
        'pip install "parametric-vibration[prove]"\n'
    )
    assert ran.err == message


def test_contradiction_is_printed_and_saved_with_exit_status_70(command, monkeypatch, tmp_path):
    usual = proving.prove

    def contradicting(*given, **options):
        return dataclasses.replace(usual(*given, **options), verdict="unstable")

    monkeypatch.setattr(proving, "prove", contradicting)
    file = tmp_path / "both.npz"
    ran = command(*MATHIEU, "--prove", "--json", "--save", str(file))
    assert ran.status == 70
    opened = solve.open(file)
    assert (opened.verdict, opened.result.verdict) == ("unstable", "asymptotically stable")
    assert json.loads(ran.out)["proof"]["verdict"] == "unstable"
    assert json.loads(ran.out)["verdict"] == "asymptotically stable"
    *_, line = ran.err.splitlines()
    assert 'verdict is "unstable", but the numerical verdict is "asymptotically stable"' in line


def test_saved_file_contains_the_proof(command, tmp_path):
    file = tmp_path / "proof.npz"
    ran = command(*MATHIEU, "--prove", "--json", "--save", str(file))
    assert ran.status == 0, ran.err
    opened = solve.open(file)
    assert opened.record == json.loads(ran.out)["proof"] | {"true_error": opened.record["true_error"]}
    assert opened.result.verdict == "asymptotically stable"


@pytest.mark.slow
def test_command_accepts_a_number_of_processes(command):
    ran = command("floquet", "mathieu", "--speed", "1 rad/s", "--prove", "--workers", "2")
    assert ran.status == 0, ran.err
    assert "proved: asymptotically stable" in ran.out
