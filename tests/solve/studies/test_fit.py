"""Parameters fitted to measurements: known values, unidentifiable parameters, outliers and invalid files."""

import json
import re
import sys

import numpy as np
import pytest

import solve
from solve.errors import (
    CaseFileError,
    MissingLibraryError,
    MissingValueError,
    UnitError,
    UnknownNameError,
    ValueOutOfBoundsError,
)
from solve.units import RPM
from tests.solve.derivatives.test_sensitivities import SPEED, M, amplitude, model

ANGLES = np.linspace(0.0, 2 * np.pi, 100, endpoint=False)
K2 = 5.0
TRUE = {"m": 2.2, "c": 0.6, "k": 10.0}


def curve(noise=0.0, seed=0, speeds=(SPEED, 2.0), outlier=False, **numbers):
    """Return rows of phase, speed and q of the first oscillator, from its closed form."""
    rng, rows = np.random.default_rng(seed), []
    for speed in speeds:
        size = amplitude(**{**TRUE, **numbers}, speed=speed)
        q = np.real(size * np.exp(2j * ANGLES)) + noise * abs(size) * rng.standard_normal(len(ANGLES))
        if outlier:
            q[17] += 20 * abs(size)
        rows += [(phase, speed, value) for phase, value in zip(ANGLES, q, strict=True)]
    return rows


def table_file(path, header, rows):
    path.write_text("\n".join([header, *(",".join(map(repr, map(float, row))) for row in rows)]), "utf-8")
    return path


@pytest.fixture
def file(tmp_path):
    return lambda rows, header="phase (rad),speed (rad/s),q (1)": table_file(tmp_path / "q.csv", header, rows)


def test_exact_curves_give_the_true_parameters(file):
    fitted = solve.fit(model(), file(curve()), list(TRUE))
    for name, value in TRUE.items():
        assert fitted.parameters[name].value == pytest.approx(value, rel=1e-6)
        assert fitted.system.labels.parameters[name] == fitted.parameters[name].value
    assert fitted.residual < 1e-6
    assert fitted.unidentifiable == []


@pytest.mark.parametrize("phases", [True, False])
def test_harmonic_amplitudes_give_the_true_parameters(file, phases):
    rows = []
    for speed in (1.5, 2.0, SPEED):
        size = amplitude(**TRUE, speed=speed)
        rows.append((2.0, speed, abs(size), np.degrees(np.angle(size)))[: 4 if phases else 3])
    header = "order (1),speed (rad/s),q (1)" + (",q_phase (deg)" if phases else "")
    fitted = solve.fit(model(), file([*rows, *rows], header), list(TRUE))
    for name, value in TRUE.items():
        assert fitted.parameters[name].value == pytest.approx(value, rel=1e-5)


def test_natural_frequencies_give_the_ratio_of_stiffness_to_mass(tmp_path):
    rows = [(1, np.sqrt(K2) / 2 / np.pi), (2, np.sqrt(TRUE["k"] / M) / 2 / np.pi)]
    rows = [
        (mode, value * (1 + off)) for mode, value in sorted(rows, key=lambda row: row[1]) for off in (0, 1e-9)
    ]
    rows = [(1 + at // 2, value) for at, (_, value) in enumerate(sorted(rows, key=lambda row: row[1]))]
    made = table_file(tmp_path / "f.csv", "mode (1),frequency (Hz)", rows)
    fitted = solve.fit(model(k2=6.0), made, ["k", "k2"])
    assert fitted.parameters["k"].value == pytest.approx(TRUE["k"], rel=1e-6)
    assert fitted.parameters["k2"].value == pytest.approx(K2, rel=1e-6)
    assert [channel.where(RPM) for channel in fitted.channels] == ["at 0°"]
    assert (
        "the data do not determine m, k separately"
        in solve.fit(model(k2=6.0), made, ["m", "k"]).unidentifiable[0]
    )
    for rows, words in (
        ([(3, 1.0), (1, 2.0)], "has the modes 1 to 2"),
        ([(0.5, 1.0)], "has the modes 1 to 2"),
    ):
        made = table_file(tmp_path / "f.csv", "mode (1),frequency (Hz)", rows)
        with pytest.raises(ValueOutOfBoundsError, match=words):
            solve.fit(model(), made, ["k"])


def write_matlab_file(path):
    from scipy.io import savemat

    speed, size = SPEED, amplitude(**TRUE)
    q = np.real(size * np.exp(2j * ANGLES))
    units = {"phase": "deg", "q": "1", "speed": "rad/s"}
    savemat(path, {"phase": np.degrees(ANGLES), "q": q, "speed": speed, "units": units})
    return path


def write_universal_file(path, complex_=False):
    pyuff = pytest.importorskip("pyuff")
    size = amplitude(**TRUE)
    x = np.array([1.0, 2.0, 3.0]) if complex_ else ANGLES / SPEED
    data = np.array([0.0, size, 0.0]) if complex_ else np.real(size * np.exp(2j * ANGLES))
    labels = {"abscissa_axis_units_lab": "order" if complex_ else "s", "ordinate_axis_units_lab": "1"}
    made = pyuff.prepare_58(
        **labels, binary=0, id1="q", func_type=0 if complex_ else 1, ord_data_type=6 if complex_ else 4,
        num_pts=len(x), abscissa_spacing=1, abscissa_min=x[0], abscissa_inc=x[1] - x[0], z_axis_value=0.0,
        rsp_node=1, rsp_dir=1, ref_node=1, ref_dir=1, data=data, x=x, return_full_dict=True,
    )  # fmt: skip
    texts = re.compile(r"id\d|.*(lab|ent_name)")
    made = {
        name: ("NONE" if texts.fullmatch(name) else 0) if value is None else value
        for name, value in made.items()
    }
    pyuff.UFF(str(path)).write_sets(made, mode="overwrite")
    return path


def test_matlab_and_universal_files_are_read(tmp_path):
    files = [
        write_matlab_file(tmp_path / "q.mat"),
        write_universal_file(tmp_path / "q.uff"),
        write_universal_file(tmp_path / "o.unv", True),
    ]
    for file in files:
        fitted = solve.fit(model(), file, ["k", "c"], speed=SPEED)
        expected = solve.fit(model(), write_matlab_file(tmp_path / "again.mat"), ["k", "c"])
        for name in ("k", "c"):
            # Universal files hold the abscissa with six digits.
            assert fitted.parameters[name].value == pytest.approx(expected.parameters[name].value, rel=1e-3)


def test_unreadable_data_files_are_refused_in_one_line(tmp_path, monkeypatch):
    for name, content in (
        ("q.mat", b"no such file\n    58\n" * 9),
        ("q.uff", b"no such file\n"),
        ("q.mat", b"x"),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(CaseFileError, match="data: ") as refused:
            solve.fit(model(), tmp_path / name, ["k"], speed=SPEED)
        assert "\n" not in str(refused.value)
        with pytest.raises(CaseFileError, match="cannot be read"):
            solve.fit(model(), tmp_path / f"no{name}", ["k"], speed=SPEED)
    with pytest.raises(CaseFileError, match=r"data: 'q[.]xlsx' ends in"):
        solve.fit(model(), tmp_path / "q.xlsx", ["k"], speed=SPEED)
    monkeypatch.setitem(sys.modules, "pyuff", None)
    with pytest.raises(MissingLibraryError, match=r'pip install "parametric-vibration\[uff\]"'):
        solve.fit(model(), tmp_path / "q.uff", ["k"], speed=SPEED)


def test_measured_data_are_compared_with_an_orbit(tmp_path, monkeypatch, capsys):
    from solve.commands.app import run

    monkeypatch.chdir(tmp_path)
    solve.periodic(solve.load("manipulator", k1=2e4), "50 rpm").save("m.csv")
    line = ["periodic", "manipulator", "--speed", "50 rpm", "--data", "m.csv"]
    assert run([*line, "--json", "--plot", "m.png"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert {each["name"] for each in record["measured"]} >= {"q1"}
    assert all(each["difference"] > 0 for each in record["measured"])
    assert (tmp_path / "m.png").stat().st_size > 10_000
    assert run(line) == 0
    assert "Computed against measured" in capsys.readouterr().out
    assert run([*line, "--set", "k1=2e4", "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert all(each["difference"] < 1e-6 for each in record["measured"])
    header, *rows = (tmp_path / "m.csv").read_text("utf-8").splitlines()
    (tmp_path / "m.csv").write_text(
        "\n".join([f"{header},speed (rpm)", *(f"{row},60" for row in rows)]), "utf-8"
    )
    assert run(line) == 2
    assert "nothing was measured at 50 rpm; the speeds of the data are: 60 rpm" in capsys.readouterr().err


@pytest.mark.slow
def test_confidence_intervals_have_nominal_coverage(file):
    trials, held = 40, dict.fromkeys(TRUE, 0)
    for seed in range(trials):
        fitted = solve.fit(model(), file(curve(0.01, seed)), list(TRUE), rtol=1e-5)
        for name, value in TRUE.items():
            held[name] += fitted.parameters[name].low <= value <= fitted.parameters[name].high
    # Of 40 trials at 95 %, fewer than 33 are one case in ten thousand.
    assert min(held.values()) >= 33
    assert sum(held.values()) < 3 * trials


def test_unidentifiable_parameters_are_reported(file):
    fitted = solve.fit(model(), file(curve(1e-3)), ["m", "c", "k", "f"])
    (text,) = fitted.unidentifiable
    # All four times a number give the same motion.
    for name in ("m", "c", "k", "f"):
        assert f"{name} by +1" in text
    assert fitted.warnings == [text]
    assert all(
        np.isinf(parameter.high) or parameter.high > 2 * parameter.value
        for parameter in fitted.parameters.values()
    )
    assert "the data do not determine c2" in solve.fit(model(), file(curve()), ["k", "c2"]).unidentifiable


def test_unidentifiable_positive_parameter_has_an_unbounded_interval(file):
    cam, rng = solve.load("cam"), np.random.default_rng(0)
    twist = solve.periodic(cam, "300 rpm").signal("q1")(ANGLES) * (
        1 + 0.02 * rng.standard_normal(len(ANGLES))
    )
    data = file(zip(ANGLES, twist, strict=True), "phase (rad),q1 (rad)")
    fitted = solve.fit(cam, data, ["k1", "c3"], speed="300 rpm")
    assert fitted.unidentifiable == ["the data do not determine c3"]
    value, low, high = fitted.parameters["c3"]
    assert low < 1e-9 * value
    assert high > 1e9 * value


def test_outlier_keeps_a_robust_fit_within_its_intervals(file):
    clean = solve.fit(model(), file(curve(0.01)), list(TRUE), robust=True)
    disturbed = solve.fit(model(), file(curve(0.01, outlier=True)), list(TRUE), robust=True)
    plain = solve.fit(model(), file(curve(0.01, outlier=True)), list(TRUE))
    for name, (value, low, high) in clean.parameters.items():
        assert low <= disturbed.parameters[name].value <= high
        assert abs(plain.parameters[name].value - value) > abs(disturbed.parameters[name].value - value)


def test_fitted_parameter_stays_within_its_bounds(file):
    fitted = solve.fit(model(), file(curve()), ["k"], {"k": (10.5, 20.0)})
    assert fitted.parameters["k"].value >= 10.5
    assert fitted.parameters["k"].value == pytest.approx(10.5, rel=1e-3)


def test_saved_orbit_is_accepted_as_data(tmp_path):
    cam = solve.load("cam")
    solve.periodic(cam.varied({"k1": 8.2e4}), "400 rpm").save(tmp_path / "cam.csv")
    fitted = solve.fit(cam, tmp_path / "cam.csv", "k1", speed="400 rpm")
    assert fitted.parameters["k1"].value == pytest.approx(8.2e4, rel=1e-6)


@pytest.mark.parametrize(
    ("header", "free", "bounds", "error", "words"),
    [
        ("phase (rad),q (1)", ["k"], None, MissingValueError, "no column 'speed (rpm)'"),
        ("phase (rad),speed (rad/s),r (1)", ["k"], None, UnknownNameError, "unknown coordinate or output"),
        ("phase,speed (rad/s),q (1)", ["k"], None, CaseFileError, "has no unit"),
        ("angle (rad),speed (rad/s),q (1)", ["k"], None, UnknownNameError, "first column"),
        ("phase (rad),speed (rad/s),q (kg)", ["k"], None, UnitError, "does not convert"),
        ("phase (rad),q (1),q (1)", ["k"], None, CaseFileError, "two columns of the same name"),
        ("phase (rad),speed (rad/s),q (1)", ["kk"], None, UnknownNameError, "parameter of oscillators"),
        (
            "phase (rad),speed (rad/s),q (1)",
            ["k", "speed"],
            None,
            UnknownNameError,
            "parameter of oscillators",
        ),
        ("phase (rad),speed (rad/s),q (1)", [], None, ValueOutOfBoundsError, "no parameters to fit"),
        (
            "phase (rad),speed (rad/s),q (1)",
            ["k"],
            {"k": (1.0, 2.0)},
            ValueOutOfBoundsError,
            "its initial value is 11",
        ),
        ("phase (rad),speed (rad/s),q (1)", ["k"], {"c": (1.0, 2.0)}, ValueOutOfBoundsError, "not free"),
    ],
)
def test_invalid_fit_input_is_refused(file, header, free, bounds, error, words):
    rows = [row[: header.count(",") + 1] for row in curve()[:50]]
    with pytest.raises(error, match=words.replace("(", r"\(").replace(")", r"\)")):
        solve.fit(model(), file(rows, header), free, bounds)


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (["order (1),q (1)", "1.5,2", "2,3"], "the order 1.5"),
        (["order (1),q (1)", "-1,2", "2,3"], "the order -1"),
        (["speed (rpm),phase (deg),q (1)", "-60,0,2", "-60,9,3"], "above 0"),
        (["phase (deg),q (1)", "0,0", "90,0"], "only zeros for q"),
        (["order (1),q (1)", "1e9,2", "2,3"], "the order 1e+09; allowed: up to 100000"),
        (["order (1),q (1)", "0,-1", "1,-3", "2,3"], "the amplitude -3 for q"),
        (["phase (deg),q (1)", "0,1e308", "90,1"], "1e+308 for q; allowed: below"),
        (["mode (1),frequency (Hz)", "1,0"], "a natural frequency of 0 Hz"),
        (["phase (deg),q (1)", "0,1,5", "90,2,5"], "more values than columns in the row '0, 1, 5'"),
        (["phase (deg),q (1)", "0,nan"], "'nan' in the row '0, nan'"),
        (["phase (deg),q (1)"], "or no rows"),
        ([""], "is empty"),
    ],
)
def test_invalid_measurement_file_is_refused_in_one_line(tmp_path, rows, words):
    (tmp_path / "q.csv").write_text("\n".join(rows), encoding="utf-8")
    with pytest.raises((CaseFileError, ValueOutOfBoundsError)) as refused:
        solve.fit(model(), tmp_path / "q.csv", ["k"], speed=SPEED)
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_speed_may_be_the_first_column(file, tmp_path):
    rows, header = curve(), "phase (rad),speed (rad/s),q (1)"
    usual = solve.fit(model(), file(rows, header), ["k", "c"])
    turned = [f"{speed},{phase},{q}" for phase, speed, q in rows]
    (tmp_path / "first.csv").write_text("\n".join(["speed (rad/s),phase (rad),q (1)", *turned]))
    first = solve.fit(model(), tmp_path / "first.csv", ["k", "c"])
    assert {name: each.value for name, each in first.parameters.items()} == {
        name: each.value for name, each in usual.parameters.items()
    }


def test_command_writes_json_figure_and_case_file(tmp_path, monkeypatch, capsys):
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


def test_fewer_values_than_parameters_is_refused(file):
    with pytest.raises(
        ValueOutOfBoundsError, match="1 parameter requires 2 or more measured values, not 1; fit fewer"
    ):
        solve.fit(model(), file(curve()[:1]), ["k"])


def test_phase_that_is_not_a_number_is_refused(tmp_path):
    from scipy.io import savemat

    units = {"phase": "deg", "q": "1", "speed": "rad/s"}
    phases = np.array([0.0, np.nan, 90.0])
    savemat(tmp_path / "q.mat", {"phase": phases, "q": np.ones(3), "speed": SPEED, "units": units})
    with pytest.raises(ValueOutOfBoundsError, match="has a phase that is not finite"):
        solve.fit(model(), tmp_path / "q.mat", ["k"])
