"""docs/readers.md: its examples run, and the table lists the functions."""

import re
from pathlib import Path

import solve
from solve.readers.paths import READERS
from tests.solve.readers.lin_files import write_set

PAGE = (Path(__file__).parents[3] / "docs" / "readers.md").read_text(encoding="utf-8")


def test_examples_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_set(tmp_path)
    for example in re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL):
        exec(example, {})
    assert capsys.readouterr().out.startswith("asymptotically stable")


def test_table_lists_every_reader():
    listed = set(re.findall(r"`solve\.(read_\w+)`", PAGE))
    assert listed == {reader.__name__ for reader in READERS.values()}
    assert listed == {name for name in solve.__all__ if name.startswith("read_")}
