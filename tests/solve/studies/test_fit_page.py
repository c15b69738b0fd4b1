"""The page on fits: its examples give what it says."""

import doctest
from pathlib import Path

PAGE = Path(__file__).parents[3] / "docs" / "fit.md"


def test_the_examples_give_what_the_page_says():
    found = doctest.testfile(str(PAGE), module_relative=False)
    assert found.failed == 0
    assert found.attempted >= 20
