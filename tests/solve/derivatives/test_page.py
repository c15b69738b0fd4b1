"""The table on the page on sensitivities matches the program."""

import re
from pathlib import Path

import solve

PAGE = Path(__file__).parents[3] / "docs" / "sensitivities.md"


def test_table_lists_the_largest_elasticities():
    shown = re.findall(r"^\| (\w+) \| (−?[0-9.]+) \|$", PAGE.read_text("utf-8"), flags=re.MULTILINE)
    every = solve.sensitivities(solve.load("cam"), "600 rpm", "q3.max_abs").elasticities("q3.max_abs")
    most = sorted(every, key=lambda name: -abs(every[name]))[: len(shown)]
    assert [(name, f"{every[name]:.3f}".replace("-", "−")) for name in most] == shown
