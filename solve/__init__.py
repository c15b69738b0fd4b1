"""Numbers from a linear system with periodic coefficients: orbits, stability, studies, pictures.

What it offers is listed in `solve.public` and loaded at the first use, so that a command is ready for an
interruption before it has read the packages that it needs.
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
