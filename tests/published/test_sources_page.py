"""Page of the sources: every printed number of a caption and every section has an outcome and existing
tests."""

import re
import sys
from itertools import product
from pathlib import Path

import pytest
from printed_numbers import CLAIMS, EQUATIONS, FIGURES, TABLES

from derive.__main__ import main as derive
from models.coupler.__main__ import run as coupler
from models.four_bar.__main__ import run as four_bar
from models.portal_frame.__main__ import run as portal_frame
from solve.commands.app import run as solve

PROGRAMS = {
    "solve": solve,
    "models.coupler": coupler,
    "models.four_bar": four_bar,
    "models.portal_frame": portal_frame,
}
ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "sources.md").read_text(encoding="utf-8")
OUTCOMES = ("met", "corrected", "refuted", "not computable", "no calculation", "open")
SOURCES = dict(zip(("paper", "chapter", "thesis"), re.split(r"^## \w+$", PAGE, flags=re.M)[1:], strict=True))
KINDS = {"Fig": FIGURES, "Table": TABLES, "Eq": EQUATIONS, "§": CLAIMS}


def rows(source):
    """Return the cells of the rows of a source."""
    lines = re.findall(r"^\| (.*)\|$", SOURCES[source], re.M)
    return [[cell.strip() for cell in line.split("|")] for line in lines if not line.startswith("place")]


def numbers(place):
    """Return the single numbers of a place in the form of a row: "Figs. 3.4–3.5", "Fig. 4.6.a–d" or "Eqs.
    (1)–(3)"."""
    _, text = place.split(" ", 1)
    first, _, last = text.replace("(", "").replace(")", "").partition("–")
    if not last:
        return [first]
    if re.fullmatch("[a-z]", last):
        return [first[:-1] + chr(k) for k in range(ord(first[-1]), ord(last) + 1)]
    match = re.fullmatch(r"([3-9A-E]\.)?(\d+)(?:\.[a-z])?(?:–[a-z])?", last)
    start = re.fullmatch(r"([3-9A-E]\.)?(\d+)(?:\.[a-z])?", first)
    chapter = start[1] or ""
    assert match
    assert (match[1] or "") == chapter
    letters = re.search(r"\.([a-z])(?:–([a-z]))?$", last)
    singles = [f"{chapter}{k}" for k in range(int(start[2]), int(match[2]) + 1)]
    if not letters:
        return singles
    if re.search(r"\.[a-z]$", first):
        ends = first[-1], letters[1]
        return [f"{k}.{chr(c)}" for k, c in product(singles, range(ord(ends[0]), ord(ends[1]) + 1))]
    last_letters = [chr(c) for c in range(ord(letters[1]), ord(letters[2] or letters[1]) + 1)]
    return singles[:-1] + [f"{singles[-1]}.{letter}" for letter in last_letters]


def named(source, kind):
    return [n for row in rows(source) if row[0].startswith(kind) for n in numbers(row[0])]


@pytest.mark.parametrize(("source", "kind"), list(product(SOURCES, KINDS)))
def test_page_lists_exactly_the_items_of_each_source(source, kind):
    computed, printed = named(source, kind), KINDS[kind][source]
    assert set(computed) == set(printed), set(computed) ^ set(printed)
    if kind != "§":
        assert len(computed) == len(printed)


@pytest.mark.parametrize("source", SOURCES)
def test_every_row_has_an_outcome_and_a_test(source):
    for row in rows(source):
        outcome, test = row[-2:]
        assert outcome.startswith(OUTCOMES), row
        assert not test or (ROOT / test).is_file(), row
        if outcome.startswith(("met", "corrected", "refuted")):
            assert test, row
        assert outcome not in ("corrected", "refuted", "not computable", "open"), f"says not why: {row}"


COMMANDS = sorted(set(re.findall(r"`python -m ([^`]*)`", PAGE)))


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_commands_on_the_page_run(command, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    name, *given = [part.strip('"') for part in re.findall(r'"[^"]*"|\S+', command.replace(":80", ":4"))]
    if name == "derive":
        monkeypatch.setattr(sys, "argv", [name, *given])
        with pytest.raises(SystemExit) as left:
            derive()
        assert not left.value.code
    else:
        assert PROGRAMS[name](given) == 0, capsys.readouterr().err
    for picture in re.findall(r"--plot (\S+)", command):
        assert (tmp_path / picture).stat().st_size > 10_000
