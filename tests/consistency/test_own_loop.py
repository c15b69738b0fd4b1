"""The page's mechanism with a closed loop, with numbers for which the loop does not close."""

import re
import sys
from pathlib import Path

import pytest

import solve
from derive.__main__ import main
from solve.errors import ValueOutOfBoundsError

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "own_mechanism.md").read_text(encoding="utf-8")
NUMBERS = {"r": 0.1, "L": 0.3, "e": 0.02, "m": 2.0, "k": 8e4, "c": 40.0}


@pytest.fixture
def press(tmp_path, monkeypatch):
    path = tmp_path / "press.py"
    found = re.search(r"```python\n# press.py\n(.*?)```", PAGE, re.DOTALL)
    assert found
    path.write_text(found.group(1), encoding="utf-8")
    monkeypatch.setattr(sys, "argv", ["derive", str(path)])
    with pytest.raises(SystemExit) as finished:
        main()
    assert not finished.value.code
    return str(path)


def test_a_loop_that_does_not_close_is_refused_in_one_line(press):
    message = (
        "the loop of s, beta does not close at every phase: gap of s, beta < 1e-9 does not hold "
        "for r = 0.1 m, L = 0.11 m, e = 0.02 m; choose numbers for which it does"
    )
    with pytest.raises(ValueOutOfBoundsError) as refused:
        solve.load(press, **NUMBERS | {"L": 0.11})
    assert str(refused.value) == message
