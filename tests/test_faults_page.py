"""The page of refusals and faults: each row names a test that there is."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
ROWS = [
    [cell.strip() for cell in line.strip("|").split(" | ")]
    for line in (ROOT / "docs" / "faults.md").read_text(encoding="utf-8").splitlines()
    if line.startswith("| ") and not line.startswith("| given ")
]
BAD_INPUT = "test_bad_input_is_refused_in_one_line"


@cache
def functions_of(file: str) -> set[str]:
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    return {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0])
def test_each_row_names_a_test_that_there_is(row):
    given, happens, test = row
    found = re.fullmatch(r"`(tests/[\w/]+\.py)::(test_\w+)(?:\[(.*)\])?`", test)
    assert found, f"{given}: {test}"
    file, name, case = found.groups()
    assert name in functions_of(file)
    assert given
    assert happens
    if case:
        from tests.solve.commands.test_bad_input import BAD

        assert name == BAD_INPUT
        assert case in BAD


def test_the_page_is_complete_and_says_nothing_twice():
    from tests.solve.commands.test_bad_input import BAD

    tests = [row[2] for row in ROWS]
    assert len(set(tests)) == len(tests) >= 120
    assert {name for name in BAD if not any(f"{BAD_INPUT}[{name}]" in test for test in tests)} == set()
