"""Terminal output: no control characters, errors in one line, list of written files, units of ranges."""

import json
import os
import pty
import re
import shlex
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import solve
from solve.errors import ValueOutOfBoundsError
from solve.terminal.command_line import run_cli
from solve.units import evenly
from tests.random_commands.run import complaint, inside, random_commands
from tests.random_commands.values import prepare

ROOT = Path(__file__).resolve().parents[3]
CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069]")
ESCAPES = "\x1b]0;t\x07", "\x1b[2J", "\x9b31m", "\r", "\x7f", "\x08", "\u202e", "\u2067", "\u2028"
APP = "solve.commands.app"
FIT = ("fit", "cam", "--free", "k1", "--speed", "100 rpm")

TYPED = {
    "a command": ("per{}",),
    "a model": ("periodic", "cam{}", "--speed", "600 rpm"),
    "a file of a mechanism": ("periodic", "{}.py"),
    "a number": ("periodic", "cam", "--set", "k1={}3", "--speed", "600 rpm"),
    "a unit": ("floquet", "cam", "--speed", "600 {}rpm"),
    "a flag": ("sweep", "cam", "--{}over", "k1=1:2:3"),
    "a range": ("chart", "mathieu", "--x", "{}delta=0:1:3", "--y", "epsilon=0:1:3"),
    "a picture": ("bands", "cam", "--speeds", "1:2:3 rpm", "--plot", "{}.png"),
    "data": (*FIT, "--data", "{}.csv"),
    "a whole number": ("periodic", "cam", "--speed", "600 rpm", "--steps", "{}5"),
    "a scheduler": ("sweep", "cam", "--speeds", "1:2:3 rpm", "--scheduler", "tcp://{}"),
}


@pytest.mark.parametrize("escape", ESCAPES, ids=ascii)
@pytest.mark.parametrize("what", TYPED)
def test_control_characters_in_arguments_are_refused_and_escaped(command, what, escape):
    ran = command(*(argument.format(escape) for argument in TYPED[what]))
    assert (ran.status, ran.out, ran.err.count("\n")) == (2, "", 1)
    assert not CONTROL.search(ran.err)
    assert f"\\u{ord(escape[0]):04x}" in ran.err
    assert "contains a control character" in ran.err


def on_a_terminal(*arguments, cwd):
    """Return the output of a program on a terminal."""
    controlling, terminal = pty.openpty()
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "TERM": "xterm", "COLUMNS": "80"}
    process = subprocess.Popen(
        [sys.executable, "-m", *arguments], cwd=cwd, env=environment, stdout=terminal, stderr=terminal
    )
    os.close(terminal)
    written = b""
    try:
        while chunk := os.read(controlling, 65536):
            written += chunk
    except OSError:
        pass
    os.close(controlling)
    process.wait()
    return written.decode()


def test_control_characters_in_files_do_not_reach_a_terminal(tmp_path):
    """The files contain an exception message of a mechanism and a name in a case file. Text styles remain."""
    (tmp_path / "bad.py").write_text(
        "def mechanism():\n    raise ValueError('\x1b]0;t\x07 \\x1b[2J \\x9bm')\n"
    )
    shown = on_a_terminal("derive", "bad.py", cwd=tmp_path)
    assert "\\u001b[2J" in shown
    progress = r"\x1b\[([0-9;]*m|\?25[lh]|2K|1A)|\r"
    assert not CONTROL.search(re.sub(progress, "", shown))
    case = (ROOT / "models" / "cam" / "cases.toml").read_text().replace("[case.1", '[case."\\u001b[2J"')
    (tmp_path / "c.toml").write_text(case)
    line = ("solve", "floquet", "cam", "--cases", "c.toml", "--speed", "100 rpm")
    shown = on_a_terminal(*line, cwd=tmp_path)
    assert "case \\u001b[2J" in re.sub(r"\x1b\[[0-9;]*m", "", shown)
    assert "\x1b[2J" not in shown
    assert "\x1b[1m" in shown


def test_internal_error_and_traceback_contain_no_control_characters(capsys):
    def work(_):
        raise ZeroDivisionError("\x1b[2J\x9b")

    assert run_cli("program", work, ["--debug"], ValueError) == 70
    error = capsys.readouterr().err
    assert error.count("\\u001b[2J\\u009b") == 2
    assert not CONTROL.search(error)


def test_json_with_control_characters_remains_valid(capsys):
    run_cli("program", lambda _: print(json.dumps({"a": "\x7f\x9b"}, ensure_ascii=False)), [], ValueError)
    out = capsys.readouterr().out
    assert not CONTROL.search(out)
    assert json.loads(out) == {"a": "\x7f\x9b"}


def test_brackets_and_colons_in_names_are_shown_unchanged(command, tmp_path):
    name = "a:b:[bold].csv"
    rows = "".join(f"{at},{1e-3 * np.cos(at)!r}\n".replace("np.float64(", "") for at in range(4))
    (tmp_path / name).write_text("phase (rad),q1 (rad)\n" + rows.replace(")", ""))
    ran = command(*FIT, "--data", name)
    assert ran.status == 0, ran.err
    assert re.search(r"^data +" + re.escape(name), ran.out, re.M)


@pytest.mark.parametrize(
    ("given", "own"),
    [
        (("--over", "k1=40:80:3 kN m/rad"), ("--over", "k1=4e4:8e4:3")),
        (("--over", "m2=2e4:3e4:2g"), ("--over", "m2=20:30:2")),
    ],
)
def test_ranges_accept_a_unit(command, given, own):
    both = []
    for over in (given, own):
        ran = command("sweep", "cam", "--speed", "100 rpm", *over, "--json")
        assert ran.status == 0, ran.err
        both.append([point["spectral_radius"] for point in json.loads(ran.out)["points"]])
    assert both[0] == pytest.approx(both[1], rel=1e-12)


def test_axes_cuts_bounds_and_frequencies_accept_a_unit(command, tmp_path):
    axes = ("--y", "epsilon=0:0.5:3", "--tolerance", "1e-3", "--json")
    plain = json.loads(command("chart", "mathieu", "--x", "delta=0.5:1.5:3", "--cut", "delta=1", *axes).out)
    x, cut = "delta=0.5e-6:1.5e-6:3 1/ms^2", "delta=1e-6 1/ms^2"
    in_unit = json.loads(command("chart", "mathieu", "--x", x, "--cut", cut, *axes).out)
    assert in_unit["x"]["values"] == pytest.approx(plain["x"]["values"], rel=1e-14)
    places = [[each["at"] for each in computed["cuts"][0]["crossings"]] for computed in (plain, in_unit)]
    assert places[0]
    assert places[1] == pytest.approx(places[0], rel=1e-6)
    values = [
        json.loads(command("frequencies", "cam", "--over", over, "--position", "0 deg", "--json").out)
        for over in ("k1=60:80:2 kN m/rad", "k1=6e4:8e4:2")
    ]
    assert values[0]["over"] == values[1]["over"]


def test_range_with_an_invalid_unit_or_form_is_refused(command):
    for over, words in (
        ("k1=60:80:2 kN", ("k1: unit 'kN'", "N m/rad")),
        ("k1=60:80 kN m/rad", ("k1=A:B:N", '--over "k1=60:80:11 kN m/rad"')),
        ("k9=60:80:2 kN", ("k9", "did you mean 'k3'")),
    ):
        ran = command("sweep", "cam", "--speed", "100 rpm", "--over", over)
        assert (ran.status, ran.err.count("\n")) == (2, 1)
        assert all(word in ran.err for word in words), ran.err
    with pytest.raises(ValueOutOfBoundsError, match="N > 1"):
        evenly("1:2:1 mm", "r")


@pytest.mark.parametrize(
    "line",
    [
        ("sweep", "cam", "--speed", "100 rpm", "--rtol", "1e-2", "--over", "k2=6e8:8e8"),
        ("chart", "mathieu", "--y", "epsilon=0:1:2", "--rtol", "1e-2", "--x", "delta=1:2 1/s^2"),
        ("frequencies", "cam", "--position", "0 deg", "--over", "k3=260:280kN/mm"),
        (
            "optimise",
            "cam",
            "--minimise",
            "q3.max_abs",
            "--speed",
            "90 rpm",
            "--rtol",
            "1e-2",
            "--free",
            "k2=600:900 kN/mm",
        ),
    ],
    ids=["over", "x", "over a unit", "free"],
)
def test_suggested_correction_of_a_message_is_accepted(command, line):
    ran = command(*line)
    assert ran.status == 2
    remedy = shlex.split(ran.err[ran.err.index(f'{line[-2]} "' if "free" not in line[-2] else "--free k2") :])
    again = command(*line[:-2], *remedy)
    assert again.status == 0, again.err


@pytest.mark.parametrize(("speed", "more"), [("3 Hz", ("--over", "delta=0.5:1.5:3")), ("2 rad/s", ())])
def test_sweep_accepts_a_single_speed(command, speed, more):
    def points(flag):
        return json.loads(command("sweep", "mathieu", flag, speed, *more, "--json").out)["points"]

    assert points("--speed") == points("--speeds")


def test_sweep_with_speed_and_speeds_is_refused(command):
    ran = command("sweep", "mathieu", "--speed", "3 Hz", "--speeds", "1:2:2 Hz")
    assert (ran.status, ran.err.count("\n")) == (2, 1)
    assert "--speed and --speeds are both given" in ran.err


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (("chart", "mathieu", "--x", "delta=0:1:3", "--y", "epsilon=0:1:3", "--cut", "epsilon=nan"), "= nan"),
        (("chart", "meissner", "--x", "w1=1:2:2", "--y", "w2=1:2:2", "--cut", "w2=-1"), "w2 = -1 has"),
        (("validity", "cam", "--speeds", "100 200 rpm", "--set", "c1=1e30"), "2 speeds, none with a result"),
        (("frequencies", "cam", "--over", "k1=-3:-1:3"), "3 values of k1, none with a result"),
        (("compare", "mathieu", "--method", "march", "--set", "zeta=0"), "no method has a result"),
        (("sensitivity", "cam", "--speeds", "100 110 rpm", "--set", "c1=1e30"), "no speed has a result"),
    ],
)
def test_study_without_any_result_is_refused(command, line, words):
    ran = command(*line)
    assert (ran.status, ran.out, ran.err.count("\n")) == (2, "", 1), ran
    assert words in ran.err


def test_errors_at_many_speeds_are_reported_once(command):
    """Above 21 rad/s, the reference of the pendulum has no matrices at any speed, for the same reason."""
    ran = command("validity", "manipulator", "--speeds", "50:2000:4 rpm")
    reasons = [line.split(": ", 2)[2] for line in ran.err.splitlines() if "no result" in line]
    assert len(reasons) == len(set(reasons))


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no /dev/full")
@pytest.mark.parametrize(
    ("program", "line", "files"),
    [
        (APP, ("periodic", "mathieu", "--plot", "m.svg", "--save", "m.csv"), ["m.svg", "m.csv"]),
        (APP, ("animate", "mathieu", "--out", "m.png"), ["m.png"]),
        ("models.portal_frame.__main__", ("--plot", "f.svg"), ["f.svg"]),
    ],
)
def test_written_files_are_listed_if_later_output_fails(tmp_path, monkeypatch, capsys, program, line, files):
    monkeypatch.chdir(tmp_path)
    with open("/dev/full", "w") as full:
        monkeypatch.setattr(sys, "stdout", full)
        status = import_module(program).run(line)
    assert status == 2
    *named, last = capsys.readouterr().err.splitlines()
    assert [line for line in named if line.startswith("wrote")] == [f"wrote {file}" for file in files]
    assert last.endswith("standard output cannot be written: No space left on device")
    assert all((tmp_path / file).stat().st_size for file in files)


def test_long_units_are_on_a_separate_line(command):
    ran = command("sweep", "cam", "--over", "k1=40:80:3 kN m/rad", "--speed", "100 rpm")
    head = ran.out[ran.out.index("Response versus k1") :].splitlines()[1:3]
    assert head[0].split() == ["k1", "max|q1|", "max|q2|", "max|q3|"]
    assert head[1].startswith("(N m/rad)  rpm")
    assert max(map(len, ran.out.splitlines())) <= 80


ROOTED = """
from derive import Mechanism, cos, rate, sqrt


def mechanism():
    made = Mechanism("rooted", "A mass whose guide ends at the length l")
    (q,) = made.coordinates(q=("m", "way"))
    m, k, r, l = made.parameters(
        m=("kg", "mass", "> 0"), k=("N/m", "spring", "> 0"), r=("m", "crank", "> 0"), l=("m", "rod", "> 0"))
    made.kinetic = m * rate(q)**2 / 2 * sqrt(l**2 - r**2 * cos(made.phase)**2) / l
    made.potential = k * q**2 / 2
    return made
"""
CASE = """
[case.1]
speed = "2 rad/s"
[case.1.parameters]
m = { value = 1, unit = "kg", source = "s" }
k = { value = 20, unit = "N/m", source = "s" }
r = { value = 50, unit = "mm", source = "s" }
l = { value = 10, unit = "cm", source = "s" }
"""


@pytest.fixture
def rooted(tmp_path, request):
    from derive.command import run

    (tmp_path / "rooted.py").write_text(
        ROOTED.replace("sqrt(l**2 - r**2 * cos(made.phase)**2)", request.param)
    )
    (tmp_path / "rooted.toml").write_text(CASE)
    assert run([str(tmp_path / "rooted.py")]) in (None, 0)
    return str(tmp_path / "rooted.py")


@pytest.mark.parametrize(
    ("rooted", "fault"),
    [
        ("sqrt(l**2 - r**2 * cos(made.phase)**2)", "the kinetic energy is not real and finite: "),
        ("(l - r)", "M is not positive definite at phase "),
    ],
    indirect=["rooted"],
)
def test_errors_without_a_parameter_report_set_values_and_units(command, rooted, fault, capsys):
    capsys.readouterr()
    ran = command("floquet", rooted, "--set", "r=50", "--set", "l=20cm", "--set", "k=3")
    assert (ran.status, ran.err.count("\n")) == (2, 1)
    set_here = "values set: 50 m for r, which the case gives in mm; 0.2 m for l; 3 N/m for k\n"
    assert ran.err.startswith(f"solve: {fault}")
    assert ran.err.endswith(set_here)
    assert "r=0.03 m" in command("floquet", rooted, "--set", "r=0.03").out


@pytest.mark.parametrize(
    "call", ["from math import cos", "import numpy as np\ncos = np.cos", "import math\ncos = math.cos"]
)
def test_numeric_functions_in_a_mechanism_give_a_hint(tmp_path, capsys, call):
    from derive.command import run
    from derive.errors import DeriveError

    text = ROOTED.replace(" cos,", "").replace("\n\n\ndef", f"\n{call}\n\n\ndef")
    (tmp_path / "rooted.py").write_text(text)
    assert run_cli("derive", run, [str(tmp_path / "rooted.py")], DeriveError) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "cannot take symbols: import functions from derive" in error


def test_unreadable_files_are_reported_without_exception_names(command, tmp_path):
    (tmp_path / "b.csv").write_bytes(b"\xff\xfe\x00")
    for file, words in (("none.csv", "no such file or directory"), ("b.csv", "not text in UTF-8")):
        ran = command(*FIT, "--data", file)
        assert words in ran.err
        assert "Error" not in ran.err
    assert "no such file or directory" in command("floquet", "cam", "--cases", "none.toml").err


@pytest.mark.parametrize("seed", [37])
def test_random_control_characters_do_not_reach_the_terminal(tmp_path, seed):
    prepare(tmp_path)
    for number, (program, arguments) in enumerate(random_commands(seed, 60)):
        at = number % len(arguments)
        arguments[at] = arguments[at][:2] + ESCAPES[number % len(ESCAPES)] + arguments[at][2:]
        ended = inside(program, arguments, tmp_path)
        assert ended.status == 2
        assert complaint(ended) == ""
        assert not CONTROL.search(ended.error)


def test_bounds_of_a_fit_accept_a_unit(command, tmp_path):
    """The data are exact for k1 = 85 kN m/rad, which lies outside the bounds. The result is the nearer
    bound."""
    solve.periodic(solve.load("cam", k1=8.5e4), "100 rpm").save(tmp_path / "cam.csv")
    line = (*FIT, "--data", "cam.csv", "--json")
    for bounds, value in (("70:82 kN m/rad", 8.2e4), ("7e4:8.2e4", 8.2e4), ("70kN m/rad:82", None)):
        ran = command(*line, "--bounds", f"k1={bounds}")
        if value is None:
            assert (ran.status, ran.err.count("\n")) == (2, 1)
            assert "--bounds k1=1e4:1e6, or with one unit after both" in ran.err
        else:
            assert json.loads(ran.out)["parameters"]["k1"]["value"] == pytest.approx(value, rel=1e-3)


def test_unit_after_the_last_value_applies_to_all_values():
    from models.four_bar.studies.study import _values

    assert _values("L4=500,600 mm") == ("L4", ["500 mm", "600 mm"])
    assert _values("L4=0.5,600 mm,0.7") == ("L4", ["0.5", "600 mm", "0.7"])
    assert _values("element=cubic,quintic") == ("element", ["cubic", "quintic"])
    assert _values("L4=500:600:2 mm") == ("L4", ["500.0 mm", "600.0 mm"])
    varied = solve.variants(solve.load("four_bar"), "L4", ["550 mm", 0.6])
    assert [model.parameters["L4"] for model in varied.values()] == pytest.approx([0.55, 0.6], rel=1e-15)
