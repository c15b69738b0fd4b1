"""`derive --new`: the example mechanism and its case file can be derived and solved unchanged."""

import os
import sys

import numpy as np
import pytest

import solve
from derive.__main__ import main
from solve.equations import sketched


@pytest.fixture
def derive(tmp_path, monkeypatch):
    """Function that runs `derive` in an empty folder and returns its exit status."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["derive", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        return int(ended.value.code or 0)

    return run


@pytest.fixture
def mine(derive, capsys):
    """Path of a new mechanism that has been derived."""
    assert derive("--new", "mine.py") == 0
    assert capsys.readouterr().err == (
        "wrote mine.py and mine.toml; next: python -m derive mine.py && python -m solve periodic mine.py\n"
    )
    assert derive("mine.py") == 0
    assert capsys.readouterr().err == "wrote generated/mine.py\n"
    return "mine.py"


@pytest.mark.parametrize("case", ["loaded", "idle"])
def test_new_mechanism_solves_without_a_warning(mine, case):
    orbit = solve.periodic(solve.load(mine, case), "600 rpm")
    assert orbit.verdict == "asymptotically stable"
    assert orbit.warnings == []
    assert orbit.outputs


def test_new_mechanism_has_the_orbit_of_the_table_alone(mine):
    """With a shaft of negligible inertia and large stiffness, the table is a driven oscillator."""
    model = solve.load(mine, "idle", J=1e3, k1=1e9)
    p, speed = model.parameters, 62.8
    expected = p["m"] * p["r"] * speed**2 / np.hypot(p["k2"] - p["m"] * speed**2, p["c2"] * speed)
    orbit = solve.periodic(model, speed)
    assert orbit.harmonics("stretch")[0][1] == pytest.approx(expected, rel=1e-4)


def test_new_mechanism_is_drawn(mine):
    model = solve.load(mine)
    lines = sketched(model, np.zeros(1), 1.0, np.zeros((2, 1)))
    assert list(lines) == ["eccentric", "crank", "table"]
    assert abs(lines["crank"][-1, 0]) == pytest.approx(model.parameters["r"])


@pytest.mark.parametrize("existing", ["mine.py", "mine.toml"])
def test_existing_file_is_not_replaced(derive, capsys, tmp_path, existing):
    (tmp_path / existing).write_text("kept")
    assert derive("--new", "mine.py") == 2
    refusal = f"derive: {existing} exists, and --new does not replace files; give another name\n"
    assert capsys.readouterr().err == refusal
    assert [file.name for file in tmp_path.iterdir()] == [existing]
    assert (tmp_path / existing).read_text() == "kept"


def test_broken_symbolic_link_is_not_followed(derive, tmp_path):
    os.symlink(tmp_path / "elsewhere", tmp_path / "mine.py")
    assert derive("--new", "mine.py") == 2
    assert not (tmp_path / "elsewhere").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["a b.py"], "give a name of letters, digits and _"),
        (["mine.txt"], "give a name of letters, digits and _"),
        (["math.py"], 'a mechanism cannot be called "math"'),
        (["none/mine.py"], "cannot be written (no such file or directory)"),
        (["mine.py", "cam"], "--new takes one file name and no other arguments"),
        (["mine.py", "--check"], "--new takes one file name and no other arguments"),
    ],
)
def test_impossible_name_is_refused_in_one_line(derive, capsys, tmp_path, arguments, message):
    assert derive("--new", *arguments) == 2
    printed = capsys.readouterr().err
    assert message in printed
    assert printed.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
