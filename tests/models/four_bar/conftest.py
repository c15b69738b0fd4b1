"""Fixtures: commands of the four-bar linkage, run in the test process."""

import pytest

from models.four_bar.__main__ import run


@pytest.fixture
def answer(capsys, monkeypatch):
    """Function that runs a command, which must succeed, and returns standard output and standard error."""
    monkeypatch.setenv("COLUMNS", "80")

    def ask(*arguments: str) -> tuple[str, str]:
        assert run(arguments) == 0
        written = capsys.readouterr()
        return written.out, written.err

    return ask


@pytest.fixture
def refusal(capsys):
    """Function that runs a command, which must fail, and returns the message without progress reports."""

    def ask(*arguments: str) -> str:
        assert run(arguments) == 2
        written = capsys.readouterr()
        assert written.out == ""
        (line,) = (line for line in written.err.splitlines() if " so far" not in line)
        program, message = line.split(": ", 1)
        assert program == "python -m models.four_bar"
        return message

    return ask
