"""Published numbers, reproduced through the public interface; docs/wall.md lists them."""

import re
from pathlib import Path

import pytest

from tests.digits import half_a_digit
from tests.foreign.cases import CASES

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "wall.md").read_text(encoding="utf-8")
ROWS = [
    [cell.strip() for cell in line.split(" | ")] for line in re.findall(r"^\| (.*) \|$", PAGE, re.MULTILINE)
]
MARKED = [
    pytest.param(case, marks=[pytest.mark.slow] * case.slow, id=f"{case.what}-{case.source.author}")
    for case in CASES
]


@pytest.mark.parametrize("case", MARKED)
def test_published_number_is_reproduced(case):
    """The tolerance is half a unit of the last digit, or the known accuracy of the number. The page shows the
    results of this run."""
    computed = case.computed()
    assert computed == pytest.approx(float(case.printed), rel=0, abs=case.tolerance)
    (shown,) = (row[2] for row in ROWS if (row[0], row[1], row[-1]) == (case.what, case.printed, case.place))
    assert computed == pytest.approx(float(shown), rel=0, abs=2.02 * half_a_digit(shown))


def test_page_contains_every_source():
    for source in {case.source for case in CASES}:
        assert f"**{source.author}, {source.title}, {source.year}** ({source.where})" in PAGE


def test_page_states_the_number_of_cases():
    counted = re.search(r"(\d+) numbers of (\d+) sources", PAGE)
    assert counted
    sources = {case.source for case in CASES}
    assert (int(counted[1]), int(counted[2])) == (len(CASES), len(sources))
    assert len(CASES) >= 25
    assert len(sources) >= 12
