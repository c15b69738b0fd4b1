"""The counts of code lines and named numbers."""

from tests.code_size import code_lines, named_numbers

MODULE = '''"""Docstring
of two lines."""

import math  # Comment.

_MOST, _NAME = 4, "text"
LIMIT = 1e-3
"""Reason."""
RANGE: tuple[float, float] = (LIMIT, 2 * math.pi)


def function():
    """Docstring."""
    inner = 3
    return """text
of two lines"""
'''


def test_comments_and_docstrings_are_not_counted_as_code():
    assert code_lines(MODULE) == 8


def test_numbers_are_counted_by_name():
    assert named_numbers(MODULE) == ["_MOST", "LIMIT", "RANGE"]
