"""Shell completion of commands and flags."""

import os
import subprocess
import sys

import pytest


def completed(line):
    words = line.split(" ")
    requested = {"_SOLVE_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1)}
    program = "import sys; from solve.commands.app import run; sys.exit(run([]))"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, env={**os.environ, **requested}
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("solve ch", ["chart"]),
        ("solve chart mathieu --cu", ["--cut"]),
    ],
)
def test_commands_and_flags_are_completed(line, expected):
    assert completed(line) == expected
