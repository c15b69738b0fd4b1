"""Parameters from measurement: known ones found again, what the data cannot tell, outliers, bad files."""

import json

import numpy as np
import pytest

import solve
from solve.errors import CaseFileError, MissingValueError, UnitError, UnknownNameError, ValueOutOfBoundsError
from tests.solve.derivatives.test_sensitivities import SPEED, amplitude, model

ANGLES = np.linspace(0.0, 2 * np.pi, 100, endpoint=False)
TRUE = {"m": 2.2, "c": 0.6, "k": 10.0}


def curve(noise=0.0, seed=0, speeds=(SPEED, 2.0), outlier=False, **numbers):
    """Rows phase, speed, q of the first oscillator, in closed form."""
    rng, rows = np.random.default_rng(seed), []
    for speed in speeds:
        size = amplitude(**{**TRUE, **numbers}, speed=speed)
        q = np.real(size * np.exp(2j * ANGLES)) + noise * abs(size) * rng.standard_normal(len(ANGLES))
        if outlier:
            q[17] += 20 * abs(size)
        rows += [(phase, speed, value) for phase, value in zip(ANGLES, q, strict=True)]
    return rows


def written(path, header, rows):
    path.write_text("\n".join([header, *(",".join(map(repr, map(float, row))) for row in rows)]), "utf-8")
    return path


@pytest.fixture
def file(tmp_path):
    return lambda rows, header="phase (rad),speed (rad/s),q (1)": written(tmp_path / "q.csv", header, rows)


def test_exact_curves_give_the_parameters_back(file):
    found = solve.fit(model(), file(curve()), list(TRUE))
    for name, value in TRUE.items():
        assert found.parameters[name].value == pytest.approx(value, rel=1e-6)
        assert found.system.parameters[name] == found.parameters[name].value
    assert found.residual < 1e-6
    assert found.unidentifiable == []


@pytest.mark.parametrize("phases", [True, False])
def test_amplitudes_of_orders_give_them_back(file, phases):
    rows = []
    for speed in (1.5, 2.0, SPEED):
        size = amplitude(**TRUE, speed=speed)
        rows.append((2.0, speed, abs(size), np.degrees(np.angle(size)))[: 4 if phases else 3])
    header = "order (1),speed (rad/s),q (1)" + (",q_phase (deg)" if phases else "")
    found = solve.fit(model(), file([*rows, *rows], header), list(TRUE))
    for name, value in TRUE.items():
        assert found.parameters[name].value == pytest.approx(value, rel=1e-5)


@pytest.mark.slow
def test_intervals_hold_the_truth_about_as_often_as_they_say(file):
    trials, held = 40, dict.fromkeys(TRUE, 0)
    for seed in range(trials):
        found = solve.fit(model(), file(curve(0.01, seed)), list(TRUE), rtol=1e-5)
        for name, value in TRUE.items():
            held[name] += found.parameters[name].low <= value <= found.parameters[name].high
    # Of 40 trials at 95 %, fewer than 33 are one case in ten thousand.
    assert min(held.values()) >= 33
    assert sum(held.values()) < 3 * trials


def test_what_the_data_cannot_tell_is_named(file):
    found = solve.fit(model(), file(curve(1e-3)), ["m", "c", "k", "f"])
    (text,) = found.unidentifiable
    # All four times a number give the same motion.
    for name in ("m", "c", "k", "f"):
        assert f"{name} by +1" in text
    assert found.warnings == [text]
    assert all(np.isinf(each.high) or each.high > 2 * each.value for each in found.parameters.values())
    assert "the data do not tell c2" in solve.fit(model(), file(curve()), ["k", "c2"]).unidentifiable


def test_an_outlier_moves_a_robust_fit_by_no_more_than_its_interval(file):
    clean = solve.fit(model(), file(curve(0.01)), list(TRUE), robust=True)
    disturbed = solve.fit(model(), file(curve(0.01, outlier=True)), list(TRUE), robust=True)
    plain = solve.fit(model(), file(curve(0.01, outlier=True)), list(TRUE))
    for name, (value, low, high) in clean.parameters.items():
        assert low <= disturbed.parameters[name].value <= high
        assert abs(plain.parameters[name].value - value) > abs(disturbed.parameters[name].value - value)


def test_bounds_hold(file):
    found = solve.fit(model(), file(curve()), ["k"], {"k": (10.5, 20.0)})
    assert found.parameters["k"].value >= 10.5
    assert found.parameters["k"].value == pytest.approx(10.5, rel=1e-3)


def test_a_file_of_an_orbit_is_read_as_it_is(tmp_path):
    cam = solve.load("cam")
    solve.periodic(cam.varied({"k1": 8.2e4}), "400 rpm").save(tmp_path / "cam.csv")
    found = solve.fit(cam, tmp_path / "cam.csv", "k1", speed="400 rpm")
    assert found.parameters["k1"].value == pytest.approx(8.2e4, rel=1e-6)


@pytest.mark.parametrize(
    ("header", "free", "bounds", "error", "words"),
    [
        ("phase (rad),q (1)", ["k"], None, MissingValueError, "no column 'speed (rpm)'"),
        ("phase (rad),speed (rad/s),r (1)", ["k"], None, UnknownNameError, "unknown coordinate or output"),
        ("phase,speed (rad/s),q (1)", ["k"], None, CaseFileError, "has no unit"),
        ("angle (rad),speed (rad/s),q (1)", ["k"], None, UnknownNameError, "first column"),
        ("phase (rad),speed (rad/s),q (kg)", ["k"], None, UnitError, "does not convert"),
        ("phase (rad),q (1),q (1)", ["k"], None, CaseFileError, "two columns of one name"),
        ("phase (rad),speed (rad/s),q (1)", ["kk"], None, UnknownNameError, "quantity of oscillators"),
        ("phase (rad),speed (rad/s),q (1)", [], None, ValueOutOfBoundsError, "no parameter is free"),
        (
            "phase (rad),speed (rad/s),q (1)",
            ["k"],
            {"k": (1.0, 2.0)},
            ValueOutOfBoundsError,
            "starts from 11",
        ),
        ("phase (rad),speed (rad/s),q (1)", ["k"], {"c": (1.0, 2.0)}, ValueOutOfBoundsError, "not free"),
    ],
)
def test_bad_input_is_said_in_a_line(file, header, free, bounds, error, words):
    with pytest.raises(error, match=words.replace("(", r"\(").replace(")", r"\)")):
        solve.fit(model(), file(curve()[:50], header), free, bounds)


def test_the_command_gives_record_picture_and_case(tmp_path, monkeypatch, capsys):
    from solve.commands.app import run

    monkeypatch.chdir(tmp_path)
    solve.periodic(solve.load("manipulator", k1=2e4), "50 rpm").save("m.csv")
    line = [
        "fit",
        "manipulator",
        "--data",
        "m.csv",
        "--free",
        "k1",
        "--speed",
        "50 rpm",
        "--bounds",
        "k1=1e3:1e6",
    ]
    assert run([*line, "--json", "--plot", "m.png", "--toml", "m.toml"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["parameters"]["k1"]["value"] == pytest.approx(2e4, rel=1e-6)
    assert record["unidentifiable"] == []
    assert (tmp_path / "m.png").stat().st_size > 10_000
    assert run(["floquet", "manipulator", "--cases", "m.toml", "--speed", "50 rpm", "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert again["parameters"] == record["fitted"]
    assert run(["fit", "manipulator"]) == 2
    assert "add --data FILE" in capsys.readouterr().err
