"""Libraries that only some exports need, from the extras of this package."""

import importlib
from typing import Any

from solve.errors import MissingLibraryError


def library(name: str, extra: str, what: str) -> Any:
    """A library that comes with an extra, loaded when it is asked for. Raises MissingLibraryError."""
    try:
        return importlib.import_module(name)
    except ImportError:
        raise MissingLibraryError(
            f"{what} needs {name}; install it with: pip install parametric-vibration[{extra}]"
        ) from None
