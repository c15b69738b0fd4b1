"""The page that sets this software beside others: no cell of it is left empty."""

import re
from pathlib import Path

PAGE = (Path(__file__).resolve().parents[1] / "docs" / "comparison.md").read_text(encoding="utf-8")


def test_every_feature_is_judged_for_everybody():
    rows = [line.strip("|").split("|") for line in re.findall(r"^\|.*\|$", PAGE, re.M)]
    rows = [[cell.strip() for cell in row] for row in rows if not set("".join(row)) <= set("- ")]
    assert len(rows) > 20
    assert {len(row) for row in rows} == {8}
    for row in rows:
        assert row[0] == "" or all(row), row[0]
