"""Imports of `solve.terminal`, and of `derive` from `solve`."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
IMPORT_DERIVE = """
import importlib, pkgutil, sys, derive
for module in pkgutil.iter_modules(derive.__path__, "derive."):
    importlib.import_module(module.name)
"""
IMPORT_TERMINAL = "import sys, solve.terminal.command_line, solve.terminal.progress"
TERMINAL = ["solve", "solve.terminal", "solve.terminal.command_line", "solve.terminal.progress"]


def modules_of_solve(program, *options):
    """Return the modules of `solve` that a program loads."""
    program += "\nprint(*sorted(name for name in sys.modules if name.partition('.')[0] == 'solve'))"
    command = [sys.executable, *options, "-c", program]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()


def test_terminal_imports_only_the_standard_library():
    # With -S, Python finds no installed package.
    assert modules_of_solve(IMPORT_TERMINAL, "-S") == TERMINAL


def test_derive_imports_only_the_terminal_from_solve():
    assert modules_of_solve(IMPORT_DERIVE) == TERMINAL
