"""Examples in docstrings print what they state."""

import doctest
import importlib
import pkgutil

import pytest

import derive
import solve


def modules():
    """Return the names of all modules of `solve` and `derive`, except those that run as programs."""
    for package in (solve, derive):
        for found in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            if not found.name.endswith("__main__"):
                yield found.name


@pytest.mark.slow
def test_examples_in_docstrings_print_what_they_state():
    failed, attempted = [], 0
    for name in modules():
        result = doctest.testmod(importlib.import_module(name))
        attempted += result.attempted
        if result.failed:
            failed.append(name)
    assert not failed
    assert attempted > 200
