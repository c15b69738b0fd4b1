"""Names of the code are terms of the field, and documentation does not personify data."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SOURCES = [file for folder in ("solve", "derive", "models") for file in sorted((ROOT / folder).rglob("*.py"))]
NAMES = re.compile(
    r"(^|_)(ladders?|rungs?|pace|trail|witness(es)?|burdens?|seal(ed)?|doors?|heard)(_|$)", re.I
)
PROSE = re.compile(r'\b(tells?|told|said|says|knows|believed)\b(?! ")', re.I)  # A quotation may follow.


def _names(tree):
    for node in ast.walk(tree):
        for field in ("id", "name", "attr", "arg"):
            if isinstance(name := getattr(node, field, None), str):
                yield name


def _docstrings(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            yield str(node.value.value)


def test_patterns_match_unwanted_words():
    assert NAMES.search("next_rung")
    assert not NAMES.search("space")
    assert PROSE.search("The grid tells the error.")


@pytest.mark.parametrize("file", SOURCES, ids=lambda file: str(file.relative_to(ROOT)))
def test_names_and_docstrings_use_terms_of_the_field(file):
    tree = ast.parse(file.read_text("utf-8"))
    assert [name for name in _names(tree) if NAMES.search(name)] == []
    assert [text for text in _docstrings(tree) if PROSE.search(text)] == []


def test_pages_do_not_personify_data():
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
    found = {page.name: PROSE.findall(page.read_text("utf-8")) for page in pages}
    assert {name: words for name, words in found.items() if words} == {}
