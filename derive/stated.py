"""Where in the author's file an expression is stated, so that a fault found later names its line."""

import os
import sys
from collections.abc import Hashable, Mapping
from pathlib import Path
from typing import Any

import sympy

from derive.errors import DeriveError
from derive.switches import switches
from derive.symbols import counted

_HERE = f"{Path(__file__).parent}{os.sep}"
_MADE = "<string>"
"""File of functions that dataclasses make."""


def note(lines: dict[Any, int], expression: Any) -> None:
    """Keep the line outside this package from which an expression is stated."""
    frame: Any = sys._getframe(1)
    while frame and (frame.f_code.co_filename.startswith(_HERE) or frame.f_code.co_filename == _MADE):
        frame = frame.f_back
    if frame and isinstance(expression, Hashable):
        lines[expression] = frame.f_lineno


def line_of(lines: Mapping[Any, int], error: DeriveError) -> int | None:
    """Line, of those noted, on which what an error is about was stated; None where that is not known."""
    about = error.about
    if about is None or not isinstance(about, Hashable):
        return None
    switching = [line for each, line in lines.items() if _switches(each, about)]
    return switching[-1] if switching else lines.get(about)


def _switches(expression: Any, switch: Any) -> bool:
    """Whether a stated expression switches there."""
    if not (isinstance(expression, sympy.Expr) and isinstance(switch, sympy.Expr)):
        return False
    stated = counted(expression)
    return bool({switch, -switch} & {*switches(stated, stated.free_symbols)})
