"""Output, files, figures and errors of `solve sweep`."""

import csv
import json
import math

import numpy as np
import pytest

import solve
from derive.command import run as derive_run
from solve.errors import UnitError, ValueOutOfBoundsError

TABLE_2_MM = {
    600: (0.2750, 0.0090, 0.0011),
    900: (0.6309, 0.0204, 0.0025),
    1200: (1.1583, 0.0364, 0.0046),
    1500: (1.8704, 0.0572, 0.0072),
}
LIST = "600 900 1200 1500 rpm"
POINT = {
    "speed", "coordinates", "outputs", "spectral_radius", "verdict", "stable", "method", "steps",
    "error_estimate", "warnings",
}  # fmt: skip


def record(ran):
    assert ran.status == 0, ran.err
    return json.loads(ran.out, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))


@pytest.mark.parametrize("speeds", [LIST, "600:1500:4 rpm", "10 15 20 25 Hz", "10:25:4 Hz"])
def test_all_forms_of_speeds_give_table_2(command, speeds):
    computed = record(command("sweep", "coupler", "--speeds", speeds, "--json"))
    assert computed["speeds"] == pytest.approx([rpm * math.pi / 30 for rpm in TABLE_2_MM], rel=1e-14)
    maxima = [
        [1e3 * point["coordinates"][name]["max_abs"] for name in ("q1", "q2", "q3")]
        for point in computed["points"]
    ]
    np.testing.assert_allclose(maxima, list(TABLE_2_MM.values()), rtol=0, atol=0.5e-4)


def test_json_has_the_documented_keys(command):
    computed = record(command("sweep", "coupler", "--speeds", "600 900 rpm", "--json"))
    assert computed.keys() >= {"model", "case", "parameters", "options", "speeds", "points"}
    for point in computed["points"]:
        assert point.keys() >= POINT
        assert point["error_estimate"].keys() == {"orbit", "multipliers"}
        assert "midpoint_deflection" in point["outputs"]
        for quantity in (*point["coordinates"].values(), *point["outputs"].values()):
            assert quantity.keys() >= {"unit", "max", "min", "max_abs", "mean"}


def test_single_speed_in_radians_is_accepted(command):
    computed = record(command("sweep", "coupler", "--speeds", "62.8 rad/s", "--json"))
    assert computed["speeds"] == [62.8]
    assert len(computed["points"]) == 1


def test_failed_point_reports_its_reason_and_the_sweep_continues(command):
    """Without damping, the constant stiffness is resonant at Ω = sqrt(delta), and I - Φ is singular."""
    ran = command(
        "sweep", "mathieu", "--set", "delta=4", "--set", "epsilon=0", "--set", "zeta=0",
        "--speeds", "1 1.3 rad/s", "--json",
    )  # fmt: skip
    failed, good = record(ran)["points"]
    assert failed.keys() == {"speed", "error"}
    assert failed["speed"] == 1.0
    assert good["stable"] is True
    assert f"warning: no result: {failed['error']} (at 1 rad/s)" in ran.err


def test_each_kind_of_warning_is_printed_once_in_full(command):
    ran = command("sweep", "cam", "--speeds", "400 200 300 rpm", "--json")
    first, _, last = record(ran)["points"]
    lines = ran.err.splitlines()
    assert len(lines) == 2, ran.err
    for line, text in zip(lines, first["warnings"], strict=True):
        assert line.startswith(f"warning: {text} (at 400 rpm; similar warnings at ")
    trusted = [line for line in lines if "max|q1|" in line]
    assert trusted[0].endswith("similar warnings at 2 of 3 speeds, from 300 to 400 rpm)")
    assert len(last["warnings"]) == 2


def test_table_shows_the_requested_quantity(command):
    ran = command("sweep", "coupler", "--speeds", LIST, "--show", "q1")
    assert ran.status == 0, ran.err
    assert "max|q1|" in ran.out
    assert "max|q2|" not in ran.out
    shown = {row[0]: row[1] for row in map(str.split, ran.out.splitlines()) if len(row) > 1}
    for rpm, (q1, _, _) in TABLE_2_MM.items():
        assert any(float(shown[str(rpm)]) == pytest.approx(q1 * scale, rel=1e-3) for scale in (1, 1e3))
    assert max(map(len, ran.out.splitlines())) <= 80


def test_long_table_shows_one_speed_in_four(command):
    ran = command("sweep", "coupler", "--speeds", "600:900:121 rpm", "--show", "q1")
    assert "one row in 4 of 121" in ran.out
    assert len(ran.out.splitlines()) < 60


def test_figure_and_data_are_written(command, tmp_path):
    arguments = ("sweep", "coupler", "--speeds", LIST, "--plot", "s.svg", "--save", "s.csv", "--json")
    computed = record(command(*arguments))
    assert "<svg" in (tmp_path / "s.svg").read_text()
    rows = list(csv.DictReader((tmp_path / "s.csv").read_text().splitlines()))
    for name in ("q1", "q2", "q3"):
        saved = [float(row[f"{name}_max_abs (m)"]) for row in rows]
        shown = [point["coordinates"][name]["max_abs"] for point in computed["points"]]
        assert saved == pytest.approx(shown, rel=1e-12)


def test_waterfall_figure_is_drawn(command, tmp_path):
    ran = command("sweep", "coupler", "--speeds", "600:900:5 rpm", "--waterfall", "q1", "--plot", "w.svg")
    assert ran.status == 0, ran.err
    assert "<svg" in (tmp_path / "w.svg").read_text()


USAGE = ("give 'A:B:N unit' or numbers with one unit", "'600 900 1200 rpm'")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), ("no speeds given", '--speeds "100:900:81 rpm"')),
        *(
            (("--speeds", text), (f"'{text}'", *USAGE))
            for text in (
                "", "600", "600 900", "rpm", "fast rpm", "600 rpm 900 rpm", "600, 900 rpm", "600,900 rpm",
                "600:900 rpm", "600:900:1 rpm", "600:900:2.5 rpm", "600:900:4", "1:2:3:4 rpm",
            )
        ),
        (("--speeds", "600 900 kg"), ("'kg'", "'rad/s'", "allowed: rpm, rad/s or Hz")),
        (("--speeds", "600 900 1/min"), ("'1/min'", "revolutions or radians")),
        (("--speeds", "0:900:4 rpm"), ("0.0 rpm", "> 0")),
        (("--speeds", "600 nan rpm"), ("nan rpm", "finite")),
        (("--speeds", LIST, "--show", "q9"), ("'q9'", "did you mean 'q3'")),
        (("--speeds", LIST, "--waterfall", "q9", "--plot", "w.png"), ("'q9'", "did you mean 'q3'")),
        (("--speeds", LIST, "--waterfall", "q1"), ("--waterfall q1", "--plot waterfall.png")),
        (("--speeds", LIST, "--harmonics", "0"), ("--harmonics is 0",)),
        (("--speeds", LIST, "--plot", "s.jpeg"), ("s.jpeg", ".png")),
        (("--speeds", LIST, "--save", "s.xlsx"), ("s.xlsx", ".csv")),
    ],
)  # fmt: skip
def test_invalid_arguments_are_refused_in_one_line(command, arguments, words):
    ran = command("sweep", "coupler", *arguments)
    assert (ran.status, ran.out, ran.err.count("\n")) == (2, "", 1), ran.err
    assert [word for word in words if word not in ran.err] == [], ran.err
    assert "Error)" not in ran.err


def test_python_accepts_one_speed_a_text_or_several_speeds():
    coupler = solve.load("coupler")
    assert list(solve.sweep(coupler, 62.8).speeds) == [62.8]
    assert list(solve.sweep(coupler, np.float64(62.8)).speeds) == [62.8]
    texts = solve.sweep(coupler, "600 900 rpm").speeds
    assert list(texts) == pytest.approx([20 * math.pi, 30 * math.pi], rel=1e-14)
    assert list(texts) == list(solve.sweep(coupler, ["600 rpm", "900 rpm"]).speeds)


@pytest.mark.parametrize(
    ("speeds", "error", "message"),
    [
        ([], ValueOutOfBoundsError, "no speeds given; give speeds, such as '100:900:81 rpm'"),
        (np.array([]), ValueOutOfBoundsError, "no speeds given"),
        (None, ValueOutOfBoundsError, "speeds are None; give a sequence of numbers in rad/s or of texts"),
        ([[1.0, 2.0]], ValueOutOfBoundsError, r"speed is \[1.0, 2.0\]; allowed: finite and > 0"),
        ("600", UnitError, "speeds are '600'; give 'A:B:N unit'"),
        ([62.8, -1.0], ValueOutOfBoundsError, "speed is -1.0; allowed: finite and > 0"),
    ],
)
def test_sweep_refuses_invalid_speeds(speeds, error, message):
    with pytest.raises(error, match=message):
        solve.sweep(solve.load("coupler"), speeds)


def test_table_of_twenty_modes_includes_the_speeds(command):
    ran = command("sweep", "coupler", "--speeds", "3000:4000:3 rpm", "--option", "modes=20")
    assert ran.status == 0, ran.err
    lines = ran.out.splitlines()
    assert max(map(len, lines)) <= 80
    rows = [line for line in lines if line.startswith(("3000", "3500", "4000"))]
    assert [row.split()[0] for row in rows] == ["3000", "3500", "4000"]
    assert all(row.endswith("  asympt. stable") for row in rows)
    assert "--show NAME" in ran.out


def test_every_combination_of_parameter_and_speed_is_solved(command, tmp_path):
    ran = command("sweep", "cam", "--speeds", "200:300:2 rpm", "--over", "k1=6e4:9e4:2", "--json")
    points = json.loads(ran.out)["points"]
    assert [point["parameters"]["k1"] for point in points] == [6e4, 6e4, 9e4, 9e4]
    ran = command("sweep", "mathieu", "--over", "epsilon=0:2:3", "--plot", str(tmp_path / "over.png"))
    assert "Response versus ε, speed" in ran.out
    for what in ("--turn", "--waterfall"):
        picture = tmp_path / f"{what}.svg"
        command(
            "sweep",
            "cam",
            "--speeds",
            "300 rpm",
            "--over",
            "k1=6e4:9e4:3",
            what,
            "q1",
            "--plot",
            str(picture),
        )
        drawn = picture.read_text(encoding="utf-8")
        assert ("k1 = 75000 N m/rad" if what == "--turn" else "k1") in drawn
    for flags, words in (
        (["--over", "epsilon=0:2:3", "--over", "epsilon=0:2:3"], "is given 2 times; give it once"),
        (
            ["--over", "epsilon=0:2:3", "--over", "delta=1:2:2", "--waterfall", "q"],
            "versus one quantity, but several vary",
        ),
        (["--over", "epsilon=0:2:13", "--turn", "q", "--plot", "t.png"], "13 curves"),
        (["--over", "epsilon"], "write --over NAME=A:B:N"),
    ):
        ran = command("sweep", "mathieu", *flags)
        assert (ran.status, ran.out) == (2, "")
        assert words in ran.err


WITHOUT_CASE = """
from derive import Mechanism, cos, rate


def mechanism():
    made = Mechanism("spring", "Mass on a spring")
    q = made.coordinate("q", "m", "deflection")
    m, k = made.parameters(m=("kg", "mass", "> 0"), k=("N/m", "spring", "> 0"))
    F, c = made.parameters(F=("N", "force"), c=("N s/m", "damper", ">= 0"))
    made.kinetic = m * rate(q) ** 2 / 2
    made.potential = k * q**2 / 2
    made.dissipation = c * rate(q) ** 2 / 2
    made.force(F * cos(made.phase), along=q)
    return made
"""
NUMBERS = "--set", "m=2", "--set", "F=3", "--set", "c=0.1"


@pytest.mark.parametrize(
    ("study", "read"),
    [
        (
            ("sweep", "--speed", "3 rad/s", "--over", "k=10:40:2"),
            lambda computed: [point["parameters"]["k"] for point in computed["points"]],
        ),
        (("chart", "--x", "speed=3:4:2 rad/s", "--y", "k=10:40:2"), lambda computed: computed["y"]["values"]),
        (("frequencies", "--over", "k=10:40:2"), lambda computed: computed["over"]["values"]),
    ],
)
def test_varied_parameter_requires_no_fixed_value(command, tmp_path, study, read):
    (tmp_path / "spring.py").write_text(WITHOUT_CASE)
    derive_run(["spring.py"])
    name, *flags = study
    assert read(record(command(name, "spring.py", *flags, *NUMBERS, "--json"))) == [10, 40]
    refused = command(name, "spring.py", *flags, *NUMBERS[2:])
    assert (refused.status, refused.err.count("\n")) == (2, 1)
    assert "gives no value for m;" in refused.err


def test_parameter_range_does_not_change_the_given_value(command):
    for flags in ((), ("--set", "k1=7e4")):
        computed = record(command("frequencies", "cam", "--over", "k1=6e4:9e4:2", "--json", *flags))
        alone = record(command("frequencies", "cam", "--json", *flags))
        assert computed["frequencies"] == alone["frequencies"]


STIFFNESS_OF_PHASE = WITHOUT_CASE.replace(
    "import Mechanism, cos, rate", "import Mechanism, cos, rate, sqrt"
).replace(
    "made.potential = k * q**2 / 2",
    "b = made.parameter('b', '1', 'variation')\n"
    "    made.potential = k * q**2 / 2 * sqrt(1 + b * cos(made.phase) ** 3)",
)


@pytest.fixture
def spring(command, tmp_path, capsys):
    """Return a function that runs a study of this mechanism without a value of b. If |b| > 1, 1 + b cos³φ is
    negative at some phases."""
    (tmp_path / "spring.py").write_text(STIFFNESS_OF_PHASE)
    derive_run(["spring.py"])
    capsys.readouterr()

    def ran(name, *flags):
        return command(name, "spring.py", *NUMBERS, *flags)

    return ran


@pytest.mark.parametrize("values", ["1.5:0.5:5", "0.5:1.5:5"])
def test_order_of_values_does_not_matter(spring, values):
    swept = record(spring("sweep", "--set", "k=20", "--speed", "3 rad/s", "--over", f"b={values}", "--json"))
    failed = ["error" in point for point in swept["points"]]
    still = record(spring("frequencies", "--set", "k=20", "--over", f"b={values}", "--json"))["over"]
    assert (
        failed == [value > 1 for value in still["values"]] == [error is not None for error in still["errors"]]
    )
    assert sum(failed) == 2


def test_chart_may_begin_at_a_value_without_motion(spring):
    flags = "--x", "k=20:30:2", "--y", "b=-1.5:0.5:5", "--speed", "3 rad/s"
    computed = record(spring("chart", *flags, "--json"))
    assert [row[0] == "failed" for row in computed["verdicts"]] == [True, False, False, False, False]


def test_study_without_any_valid_value_is_refused(spring):
    for name, *flags in (("frequencies",), ("sweep", "--speed", "3 rad/s")):
        ran = spring(name, *flags, "--set", "k=20", "--over", "b=1.5:1.1:3")
        assert (ran.status, ran.out, ran.err.count("\n")) == (2, "", 1)
        assert "is -0.4998 at phase 3.132" in ran.err


def test_frequencies_state_a_value_from_the_range(spring):
    """If no value is given, the first table is for the first possible value of the range."""
    flags = "frequencies", "--set", "k=20", "--over", "b=1.5:0.5:5"
    assert "at        b=1, the first possible value of the range" in spring(*flags).out
    assert "the first possible" not in spring(*flags, "--set", "b=0.3").out


def test_range_ends_exactly_at_its_last_value(spring):
    computed = record(spring("sweep", "--set", "k=20", "--speed", "3 rad/s", "--over", "b=0.2:0:4", "--json"))
    assert [point["parameters"]["b"] for point in computed["points"]][::3] == [0.2, 0.0]
