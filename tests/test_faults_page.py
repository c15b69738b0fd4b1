"""The page on invalid input and failures: a list of rules that names error classes and no tests."""

import re
from pathlib import Path

import pytest

import derive.errors
import solve.errors

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "faults.md").read_text(encoding="utf-8")
HEADINGS = ("event", "input", "exit status", "---")
RULES = [
    [cell.strip() for cell in line.strip("|").split(" | ")]
    for line in PAGE.splitlines()
    if line.startswith("| ") and not line.startswith(tuple(f"| {heading}" for heading in HEADINGS))
]
SECTIONS = re.split(r"^## ", PAGE, flags=re.MULTILINE)


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule[0])
def test_each_rule_states_an_event_and_its_result(rule):
    event, result = rule
    assert event
    assert result


def test_no_rule_is_listed_twice():
    for section in SECTIONS:
        events = re.findall(r"^\| (.*?) \|", section, flags=re.MULTILINE)
        assert len(set(events)) == len(events)
    assert len(RULES) >= 120


def test_page_names_no_tests():
    assert not re.search(r"tests/|test_", PAGE)


def test_named_errors_exist():
    named = set(re.findall(r"`(\w+Error)`", PAGE))
    assert len(named) > 10
    assert all(hasattr(solve.errors, name) or hasattr(derive.errors, name) for name in named)


@pytest.mark.parametrize("status", [0, 1, 2, 70, 130])
def test_all_exit_statuses_are_explained(status):
    assert re.search(rf"^\| {status} \| \w+", PAGE, flags=re.MULTILINE)
