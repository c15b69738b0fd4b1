"""Periodic solutions, stability, studies and figures of linear systems with periodic coefficients.

Public names are listed in `solve.public` and loaded at their first use, so that a command can be interrupted
before its packages are imported.
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from solve.public import *  # noqa: F403


def __getattr__(name: str) -> object:
    public = importlib.import_module("solve.public")
    if name == "__all__" or name in public.__all__:
        return getattr(public, name)
    if name in globals():
        return globals()[name]
    raise AttributeError(f"module 'solve' has no attribute '{name}'; it has {', '.join(public.__all__)}")


def __dir__() -> list[str]:
    return [*globals(), *importlib.import_module("solve.public").__all__]
