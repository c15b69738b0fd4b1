"""`solve frequencies` at a position, over a period and versus a parameter; files, JSON and errors."""

import json
import math

import numpy as np
import pytest

import solve

EXACT = ("--option", "element=dynamic")


def record(command, *arguments):
    ran = command("frequencies", *arguments, "--json")
    assert ran.status == 0, ran.err
    assert ran.err == ""
    return json.loads(ran.out)


def test_json_contains_frequencies_at_a_position(command):
    computed = record(command, "four_bar", *EXACT, "--position", "70 deg", "--count", "3")
    assert (computed["model"], computed["case"]) == ("four_bar", "table41")
    assert computed["options"].items() >= {"branch": "open", "elements": 1, "element": "dynamic"}.items()
    assert computed["position"] == pytest.approx(math.radians(70))
    model = solve.load("four_bar", options={"element": "dynamic"})
    expected = solve.frequencies(model, math.radians(70), 3).values[0]
    np.testing.assert_allclose(computed["frequencies"], expected, rtol=1e-12)
    assert computed["frequencies"] == sorted(computed["frequencies"])
    assert computed["freedoms"] == 9
    assert computed["warnings"] == []


def test_default_is_four_frequencies_at_position_0(command):
    computed = record(command, "four_bar")
    assert computed["position"] == 0
    assert len(computed["frequencies"]) == 4


def test_systems_with_few_coordinates_list_all_frequencies(command):
    assert len(record(command, "manipulator")["frequencies"]) == 2


def test_frozen_frequencies_follow_from_m_and_k_at_speed_zero(command):
    computed = record(command, "cam", "--position", "1.2 rad")
    M, _, K, _ = solve.load("cam").at(np.array([1.2]), 0.0)
    expected = np.sort(np.sqrt(np.linalg.eigvals(np.linalg.inv(M[0]) @ K[0]).real))
    np.testing.assert_allclose(computed["frequencies"], expected, rtol=1e-9)


def test_frequencies_over_a_period_have_means(command):
    computed = record(command, "four_bar", "--turn", "12")
    turn = computed["turn"]
    np.testing.assert_allclose(turn["positions"], 2 * np.pi * np.arange(12) / 12)
    values = np.array(turn["frequencies"])
    assert values.shape == (12, 4)
    np.testing.assert_allclose(turn["mean"], values.mean(axis=0))
    np.testing.assert_allclose(turn["min"], values.min(axis=0))
    np.testing.assert_allclose(turn["max"], values.max(axis=0))


def test_parameter_range_reports_impossible_linkages(command):
    ran = command("frequencies", "four_bar", "--over", "L2=0.1:0.5:3", "--count", "2", "--json")
    over = json.loads(ran.out)["over"]
    assert over["values"] == pytest.approx([0.1, 0.3, 0.5])
    assert len(over["positions"]) == 36
    assert over["mean"][0] == [None, None]
    assert over["errors"][0].startswith("the crank cannot turn fully")
    assert over["errors"][1:] == [None, None]
    assert "1 of 3 values has no result" in ran.err
    model = solve.load("four_bar", L2=0.5)
    values = solve.frequencies(model, over["positions"], 2).values
    for key, expected in (
        ("mean", values.mean(axis=0)),
        ("min", values.min(axis=0)),
        ("max", values.max(axis=0)),
    ):
        np.testing.assert_allclose(over[key][2], expected, rtol=1e-12)
    alone = model.pinned_frequencies()["coupler"]
    assert over["pinned"]["coupler"][2] == pytest.approx(alone)
    assert alone == pytest.approx((np.pi / 0.5) ** 2 * np.sqrt(210e9 * 83.34e-12 / (7850 * 85.5e-6)))


def test_parameter_range_at_a_position_is_solved(command):
    computed = record(command, "four_bar", "--over", "mA=0:0.4:2", "--position", "30 deg")
    assert computed["over"]["positions"] == [pytest.approx(math.pi / 6)]
    assert computed["over"]["mean"][0][1] > computed["over"]["mean"][1][1]


def test_parameter_range_of_a_mechanism_is_solved(command):
    over = record(command, "cam", "--over", "k1=8e4:9e4:2", "--turn", "8")["over"]
    assert (over["pinned"], len(over["positions"])) == ({}, 8)


def test_mode_shapes_of_a_structure_are_listed_by_link(command):
    modes = record(command, "portal_frame", *EXACT, "--count", "4", "--modes")["modes"]
    assert len(modes) == 4
    assert set(modes[3]["links"]) == {"left", "beam", "right"}
    curve = modes[0]["links"]["beam"]
    assert len(curve["x"]) == len(curve["dy"]) == len(curve["transverse"]) > 40
    assert modes[0]["modal_mass"] > 0


def test_tables_fit_80_columns(command):
    for arguments in (
        ("four_bar", *EXACT, "--modes", "--count", "8", "--position", "200 deg"),
        ("four_bar", "--turn", "72"),
        ("four_bar", "--over", "L2=0.2:0.7:11"),
        ("portal_frame", "--modes"),
        ("coupler", "--turn", "6"),
    ):
        ran = command("frequencies", *arguments)
        assert ran.status == 0, ran.err
        assert max(map(len, ran.out.splitlines())) <= 80
        assert "Natural frequencies" in ran.out


def test_table_states_the_total_number_of_frequencies(command):
    assert "Natural frequencies: the lowest 4 of 9\n" in command("frequencies", "four_bar").out
    assert "Natural frequencies\n" in command("frequencies", "four_bar", "--count", "9").out


def test_report_of_the_portal_frame_contains_no_position(command):
    out = command("frequencies", "portal_frame", *EXACT, "--count", "4").out
    assert "56.60311" in out
    assert "395.1845" in out
    assert "°" not in out, "a frame that stands still has no position"


def test_figures_and_data_are_written(command, tmp_path):
    for number, arguments in enumerate(
        (
            ("four_bar", "--position", "60 deg"),
            ("four_bar", "--turn", "9"),
            ("four_bar", "--over", "L2=0.3:0.4:3"),
        )
    ):
        ran = command("frequencies", *arguments, "--plot", f"{number}.png", "--save", f"{number}.csv")
        assert ran.status == 0, ran.err
        assert (tmp_path / f"{number}.png").stat().st_size > 10_000
    rows = [(tmp_path / f"{n}.csv").read_text().splitlines() for n in range(3)]
    assert [sum(line[0].isdigit() for line in row) for row in rows] == [1, 9, 3]
    assert any("frequency4" in line for line in rows[0])
    assert any("coupler_pinned" in line for line in rows[2])


BAD = {
    "no element": (("four_bar", "--option", "elements=0"), ("elements", "is 0", "1 to 100")),
    "unknown element": (("four_bar", "--option", "element=cubik"), ("'cubik'", "'cubic'")),
    "elements of some links": (
        ("four_bar", "--option", "elements=1,2"),
        ("2 values", "crank,coupler,follower"),
    ),
    "a crank that cannot turn": (
        ("four_bar", "--set", "L1=0.4"),
        ("the crank cannot turn fully", "L1 = 0.4 m"),
    ),
    "zero length": (("four_bar", "--set", "L2=0"), ("L2", "is 0 m", "> 0")),
    "position without unit": (("four_bar", "--position", "70"), ("'70'", "no unit", "'70 deg'")),
    "a position where there is none": (("portal_frame", "--position", "3 deg"), ("is a structure at rest",)),
    "a turn where there is none": (("portal_frame", "--turn", "4"), ("at rest; omit turn",)),
    "no frequency": (("four_bar", "--count", "0"), ("count is 0", "1 … 9")),
    "too many": (("portal_frame", "--count", "4"), ("count is 4", "1 … 3")),
    "a turn of one position": (("four_bar", "--turn", "1"), ("turn is 1", "2 or more")),
    "over an unknown parameter": (("four_bar", "--over", "L5=1:2:3"), ("'L5'", "did you mean")),
    "over two parameters": (
        ("four_bar", "--over", "L2=0.3:0.4:2", "--over", "L3=0.5:0.6:2"),
        ("given 2 times", "one parameter"),
    ),
    "over no range": (("four_bar", "--over", "L2=1:2"), ("L2=1:2", "L2=A:B:N")),
    "modes of no structure": (("cam", "--modes"), ("cam has no links",)),
    "a picture of nothing": (("cam", "--plot", "cam.png"), ("no mode shapes to draw", "--turn 36")),
}


def test_many_positions_are_solved_in_chunks(monkeypatch):
    from solve.beams import structure

    model = solve.load("four_bar", options={"elements": 3})
    phases = np.linspace(0.0, 6.0, 11)
    together = solve.frequencies(model, phases).values
    looked_at = []
    at_positions = type(model).at_positions
    monkeypatch.setattr(
        type(model), "at_positions", lambda self, p: (looked_at.append(len(p)), at_positions(self, p))[1]
    )
    monkeypatch.setattr(structure, "_CHUNK_ENTRIES", 3 * solve.frequencies(model).freedoms ** 2)
    looked_at.clear()
    in_parts = solve.frequencies(model, phases).values
    assert max(looked_at) <= 3
    np.testing.assert_allclose(in_parts, together, rtol=1e-12)


def test_figure_states_the_total_number_of_modes():
    model = solve.load("four_bar", options={"elements": 3})
    titles = [solve.frequencies(model, 0.5, count).plot().get_suptitle() for count in (8, 10)]
    assert titles[0].endswith("mode shapes at 28.65°")
    assert titles[1].endswith("mode shapes at 28.65°, the lowest 8 of 10")


@pytest.mark.parametrize("name", BAD)
def test_invalid_input_is_refused_in_one_line(command, tmp_path, name):
    arguments, words = BAD[name]
    ran = command("frequencies", *arguments)
    assert ran.status == 2
    assert ran.out == ""
    assert ran.err.startswith("solve: ")
    assert ran.err.count("\n") == 1, f"not one line: {ran.err}"
    assert [word for word in words if word not in ran.err] == [], ran.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["periodic", "floquet", "sweep", "bands", "compare"])
def test_other_commands_refuse_a_stationary_frame(command, name):
    speeds = ("--speeds", "10:20:3 rpm") if name in ("sweep", "bands") else ()
    ran = command(name, "portal_frame", *speeds)
    assert ran.status == 2
    assert ran.err.count("\n") == 1
    assert "python -m solve frequencies portal_frame" in ran.err


def test_unstable_positions_are_omitted_with_a_warning(command):
    """A negative stiffness has no natural frequency."""
    ran = command(
        "frequencies", "mathieu", "--set", "delta=0.1", "--set", "epsilon=1", "--turn", "8", "--json"
    )
    record = json.loads(ran.out)
    assert None in [value for row in record["turn"]["frequencies"] for value in row]
    assert "static stiffness is not positive" in ran.err
