"""The benchmark of large systems prints its table."""

import sys

from tests.benchmarks.large import RTOL, main


def test_every_size_has_errors_below_the_tolerance(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["large", "1", "2"])
    main()
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert [row[:2] for row in rows[1:3]] == [["9", "radau"], ["18", "radau"]]
    assert all(float(error) <= RTOL for row in rows[1:3] for error in row[-2:])
    assert all(float(ratio) > 1 for *_, ratio, _, _ in rows[1:3])
