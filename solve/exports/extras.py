"""Libraries that only some exports need, from the extras of this package."""

import importlib
from collections.abc import Iterable
from typing import Any

from solve.errors import MissingLibraryError


def library(name: str, extra: str, what: str) -> Any:
    """A library that comes with an extra, loaded when it is asked for. Raises MissingLibraryError."""
    try:
        return importlib.import_module(name)
    except ImportError:
        raise MissingLibraryError.of_extra(what, name, extra) from None


def labels(names: Iterable[str]) -> list[str]:
    """Names of signals as python-control takes them: without dots.

    >>> labels(["force_q.1"])
    ['force_q_1']
    """
    return [name.replace(".", "_") for name in names]
