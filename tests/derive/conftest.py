"""Fixtures: the command `derive` in the test process, and a mechanism file."""

import shutil
import sys
from pathlib import Path

import pytest

from derive.__main__ import main


@pytest.fixture
def rotor(tmp_path: Path) -> Path:
    path = tmp_path / "rotor.py"
    shutil.copy(Path(__file__).parent / "rotor.py", path)
    return path


@pytest.fixture
def derive(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    """Function that runs the command in this process and returns its exit status, standard output and
    standard error."""

    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["derive", *map(str, arguments)])
        with pytest.raises(SystemExit) as exit_:
            main()
        out, err = capsys.readouterr()
        return int(exit_.value.code or 0), out, err

    return run
