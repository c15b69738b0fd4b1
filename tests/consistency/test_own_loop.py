"""Mechanism of the page with a closed loop, with values for which the loop does not close."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

import solve
from derive.__main__ import main
from solve.errors import ValueOutOfBoundsError

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "own_mechanism.md").read_text(encoding="utf-8")
NUMBERS = {"r": 0.1, "L": 0.3, "e": 0.02, "m": 2.0, "k": 8e4, "c": 40.0}


@pytest.fixture
def press(tmp_path, monkeypatch):
    path = tmp_path / "press.py"
    match = re.search(r"```python\n# press.py\n(.*?)```", PAGE, re.DOTALL)
    assert match
    path.write_text(match.group(1), encoding="utf-8")
    monkeypatch.setattr(sys, "argv", ["derive", str(path)])
    with pytest.raises(SystemExit) as finished:
        main()
    assert not finished.value.code
    return str(path)


def test_loop_unknowns_may_reuse_names_of_generated_code(tmp_path, monkeypatch):
    """The unknowns of the press are called x0 and x1."""
    match = re.search(r"```python\n# press.py\n(.*?)```", PAGE, re.DOTALL)
    assert match
    other = match.group(1)
    for theirs, ours in (
        ("s, beta = press", "x0, x1 = press"),
        ('{"s": "m", "beta": "rad"}', '{"x0": "m", "x1": "rad"}'),
        ("rate(s + q)", "rate(x0 + q)"),
        ('"slide", s,', '"slide", x0,'),
    ):
        assert theirs in other
        other = other.replace(theirs, ours)
    texts = match.group(1), other
    values = []
    for name, text in zip(("press", "other"), texts, strict=True):
        path = tmp_path / f"{name}.py"
        path.write_text(text.replace('"press"', f'"{name}"'), encoding="utf-8")
        monkeypatch.setattr(sys, "argv", ["derive", str(path)])
        with pytest.raises(SystemExit) as finished:
            main()
        assert not finished.value.code
        values.append(solve.load(str(path), **NUMBERS).at(np.linspace(0.0, 6.0, 5), 40.0))
    for ours, theirs in zip(*values, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-12, atol=1e-12 * np.abs(theirs).max())


def test_loop_that_does_not_close_is_refused_in_one_line(press):
    message = (
        "the loop of s, beta does not close at every phase: gap of s, beta < 1e-9 does not hold "
        "for r = 0.1 m, L = 0.11 m, e = 0.02 m; choose values for which it holds"
    )
    with pytest.raises(ValueOutOfBoundsError) as refused:
        solve.load(press, **NUMBERS | {"L": 0.11})
    assert str(refused.value) == message
