"""Periodic solutions, stability, studies and figures of linear systems with periodic coefficients.

Public names are listed in `__init__.pyi`. A module is imported at the first use of one of its names, so that
a command imports only the modules that it needs.
"""

import ast
import importlib
from pathlib import Path

_HOME = {
    name.name: f"solve.{statement.module}"
    for statement in ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")).body
    if isinstance(statement, ast.ImportFrom)
    for name in statement.names
}
"""Mapping from public names to the modules that define them."""

__all__ = sorted(_HOME)  # pyright: ignore[reportUnsupportedDunderAll]


def __dir__() -> list[str]:
    return __all__


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'solve' has no attribute '{name}'; it has {', '.join(__all__)}")
    if name == "open":  # Files may contain any result; classes are registered by their modules.
        for file in sorted(Path(__file__).with_name("results").glob("[!_]*.py")):
            importlib.import_module(f"solve.results.{file.stem}")
    # Later accesses return this attribute of the module.
    value = globals()[name] = getattr(importlib.import_module(_HOME[name]), name)
    return value
