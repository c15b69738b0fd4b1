"""State of the live window as a command, as Python code and as a case; each reproduces the orbit."""

import json
import shlex
import tomllib

import numpy as np
import pytest

import solve
from solve.commands.app import run
from solve.labels import in_own_unit
from solve.views.live.texts import Origin, State, save_case


def state(model, texts, speed="300 rpm", origin=None):
    origin = Origin.from_model(model) if origin is None else origin
    values = {name: in_own_unit(model, name, text) for name, text in texts.items()}
    return State(origin, origin.stated(model), model.varied(values), texts, speed)


def test_command_contains_only_differences_from_the_case():
    model = solve.load("gear_pair", options={"load": "constant"})
    assert state(model, {"k0": "400 MN/m"}).command == (
        'solve periodic gear_pair --case 1 --option load=constant --set "k0=400 MN/m" --speed "300 rpm"'
    )


@pytest.mark.parametrize("texts", [{}, {"k1": "90 kN m/rad", "m2": "27.5"}, {"a3": "-12.25 mm"}])
def test_command_and_python_reproduce_the_orbit(capsys, texts):
    made = state(solve.load("cam"), texts, "312.5 rpm")
    here = solve.periodic(made.model, "312.5 rpm")
    assert run([*shlex.split(made.command)[1:], "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["coordinates"]
    assert [found[name]["max_abs"] for name in here.coordinates] == [
        here.statistics(name).max_abs for name in here.coordinates
    ]
    names: dict = {}
    exec(made.python, names)
    assert np.array_equal(names["orbit"].q, here.q)


def test_python_code_of_a_model_in_memory_varies_the_model():
    model = solve.load("mathieu")
    made = state(model, {"delta": "1.5"}, "1 rad/s", Origin())
    assert made.command == ""
    names = {"model": model}
    exec(made.python, names)
    expected = solve.periodic(solve.load("mathieu", delta=1.5), "1 rad/s")
    assert names["orbit"].spectral_radius == expected.spectral_radius


def test_mechanism_file_is_given_by_its_path(spring, folder):
    made = state(solve.load(spring), {"k": "60"}, "3 rad/s")
    assert made.command == f'solve periodic {folder}/spring.py --case only --set k=60 --speed "3 rad/s"'


def test_saved_case_has_all_numbers_with_units_and_sources(folder):
    model = solve.load("cam", case="2")
    made = state(model, {"k1": "95 kN m/rad"}, "250 rpm")
    sentence = save_case(made, "stiff", "mine.toml")
    assert sentence == "case stiff is in mine.toml: solve periodic cam --cases mine.toml --case stiff"
    entries = tomllib.loads((folder / "mine.toml").read_text("utf-8"))["case"]["stiff"]
    assert entries["speed"] == "250 rpm"
    assert entries["parameters"]["k1"] == {
        "value": 95000,
        "unit": "N m/rad",
        "source": "chosen in solve explore",
    }
    assert entries["parameters"]["a"]["source"] == "chapter Table 2"
    again = solve.case_numbers("cam", "stiff", str(folder / "mine.toml"))
    assert dict(again.parameters) == dict(made.model.parameters)


def test_saving_adds_a_case_and_never_replaces_one(folder):
    made = state(solve.load("mathieu"), {"delta": "1.5"}, "1 rad/s")
    save_case(made, "one", "mine.toml")
    save_case(made, "two", "mine.toml")
    before = (folder / "mine.toml").read_bytes()
    with pytest.raises(solve.SolveError, match="has a case 'one'; give another name"):
        save_case(made, "one", "mine.toml")
    assert (folder / "mine.toml").read_bytes() == before
    assert set(tomllib.loads(before.decode())["case"]) == {"one", "two"}


@pytest.mark.parametrize("file", ["../mine.toml", "/etc/mine.toml", "mine.py", "a/b.toml", ""])
def test_case_is_saved_in_the_current_folder_only(folder, file):
    with pytest.raises(solve.SolveError, match=r"ends in \.toml"):
        save_case(state(solve.load("mathieu"), {}), "one", file)


@pytest.mark.parametrize("name", ["", "a b", 'x"]', "x\n[y", "é"])
def test_case_requires_a_plain_name(folder, name):
    with pytest.raises(solve.SolveError, match="allowed: up to 40 letters"):
        save_case(state(solve.load("mathieu"), {}), name, "mine.toml")
