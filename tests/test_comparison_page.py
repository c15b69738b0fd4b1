"""The comparison page has no empty cell, and its column "here" agrees with docs/abilities.toml, in which
every entry is verified."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

import derive
import derive.mechanism
import solve
from derive import Mechanism, rate
from tests.solve.newton.mechanisms import duffing, model_of

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "comparison.md").read_text(encoding="utf-8")
ABILITIES = tomllib.loads((ROOT / "docs" / "abilities.toml").read_text(encoding="utf-8"))


def tables():
    """Return the rows of cells of each table, headings first."""
    for table in re.findall(r"(?:^\|.*\|\n)+", PAGE, re.M):
        rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()]
        yield [row for row in rows if not set("".join(row)) <= set("- ")]


BESIDE = [row for table in tables() if table[0][1] == "here" for row in table[1:]]
PACKAGES = [row for table in tables() if table[0][0] == "package" for row in table[1:]]


def test_table_has_no_empty_cell():
    assert len(BESIDE) > 20
    assert {len(row) for row in BESIDE} == {8}
    assert len(PACKAGES) == 9
    assert {len(row) for row in PACKAGES} == {4}
    for row in BESIDE + PACKAGES:
        assert all(row), row[0]


def test_column_here_matches_the_listed_abilities():
    assert {row[0]: row[1] for row in BESIDE} == {row: entry["text"] for row, entry in ABILITIES.items()}
    assert all(("absent" in entry) == (entry["text"] == "no") for entry in ABILITIES.values())
    assert all(len(entry.keys() & {"run", "absent"}) == 1 for entry in ABILITIES.values())


def test_equivalent_commands_exist():
    from solve.commands.app import COMMANDS

    named = {name for row in PACKAGES for name in re.findall(r"`([a-z]+)`", row[3])}
    assert named
    assert named <= set(COMMANDS)


def spring():
    made = Mechanism("spring", "A mass on a spring")
    (q,) = made.coordinates(q=("m", "way"))
    m, k = made.parameters(m=("kg", "mass", "> 0"), k=("N/m", "spring", "> 0"))
    made.kinetic, made.potential = m * rate(q) ** 2 / 2, k * q**2 / 2
    return made


def refused(work, *arguments, **keywords):
    with pytest.raises(solve.SolveError):
        work(*arguments, **keywords)


@pytest.fixture
def names(tmp_path):
    """Return the names available to entries of docs/abilities.toml."""
    oscillator = model_of(duffing(), zeta=0.1, k=1.0, alpha=1.0, f=1.0)
    rows = solve.periodic(oscillator, 0.5)
    file = tmp_path / "q.csv"
    lines = [f"{at!r},{value!r}" for at, value in zip(rows.phase.tolist(), rows.q[0].tolist(), strict=True)]
    file.write_text("\n".join(["phase (rad),q (1)", *lines]))
    return {
        "solve": solve,
        "derive": derive,
        "np": np,
        "Path": Path,
        "root": ROOT,
        "folder": tmp_path,
        "spring": spring,
        "refused": refused,
        "duffing": oscillator,
        "measured": file,
    }


@pytest.mark.parametrize("row", [row for row, entry in ABILITIES.items() if "run" in entry])
def test_listed_features_work(row, names):
    exec(ABILITIES[row]["run"], names)


@pytest.mark.parametrize("row", [row for row, entry in ABILITIES.items() if "absent" in entry])
def test_absent_features_have_no_name(row):
    """If a new feature has this name, the test fails as a reminder to update the page."""
    from solve.commands.app import COMMANDS

    public = [*dir(solve), *dir(derive), *dir(derive.Mechanism), *COMMANDS]
    assert [name for name in public if re.search(ABILITIES[row]["absent"], name.lower())] == []
