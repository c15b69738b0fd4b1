"""Paths and patterns of files from which systems are read."""

import ast
import glob
import re
from collections.abc import Sequence
from pathlib import Path

from solve.array_files import require_file
from solve.errors import FileError

ENDINGS = ".lin", ".mat", ".npz", ".nc", ".mtx", ".op4", ".fmu"
"""Endings of the names of files with matrices, and of functional mock-up units."""

_MOST_FILES = 10_000
"""Largest number of files that a pattern may match. Chosen by judgement."""


def matching_files(paths: str | Path | Sequence[str | Path]) -> list[Path]:
    """Find the files that match paths and patterns. Files of one pattern are ordered by the numbers in their
    names. Raises FileError if no file matches."""
    given = list(paths) if isinstance(paths, Sequence) and not isinstance(paths, str) else [paths]
    found: list[Path] = []
    for path in given:
        text = str(checked_path(path))
        if is_pattern(text):
            matches = [Path(name) for name in glob.glob(text)]
            found += sorted((match for match in matches if match.is_file()), key=_by_number)
        else:
            require_file(path)
            found.append(Path(path))
    if not found:
        shown = ", ".join(f"'{path}'" for path in given[:3])
        message = f"no file matches {shown}" if given else "the sequence of paths is empty"
        raise FileError(f"{message}; give paths or patterns of files that exist")
    if len(found) > _MOST_FILES:
        raise FileError(f"{len(found)} files match; allowed: up to {_MOST_FILES}")
    return found


def checked_path(path: object) -> str | Path:
    """Return the object if it is a path or a string. Raises FileError otherwise."""
    if not isinstance(path, str | Path):
        raise FileError(f"path is {path!r}; give the path of a file")
    return path


def is_system_file(text: str) -> bool:
    """Whether a string is the path of a file from which a system is read, or a pattern of such files.

    The files contain matrices, an FMU, or Python code that defines `system` and not a mechanism. The code is
    not executed.

    >>> is_system_file("run.*.lin"), is_system_file("cam"), is_system_file("cam.py")
    (True, False, False)
    """
    ending = Path(text).suffix.lower()
    return ending in ENDINGS or (ending == ".py" and _defines_system(Path(text)))


def _defines_system(file: Path) -> bool:
    try:
        tree = ast.parse(file.read_bytes())
    except (OSError, SyntaxError, ValueError):
        return False
    names: set[str] = set()
    for statement in tree.body:
        if isinstance(statement, ast.FunctionDef):
            names.add(statement.name)
        elif isinstance(statement, ast.Assign):
            names |= {target.id for target in statement.targets if isinstance(target, ast.Name)}
    return "system" in names and "mechanism" not in names


def is_pattern(text: str) -> bool:
    """Whether a path contains wildcards.

    >>> is_pattern("run.*.lin"), is_pattern("run.1.lin")
    (True, False)
    """
    return any(character in text for character in "*?[")


def _by_number(path: Path) -> list[tuple[int, str]]:
    parts = re.split(r"(\d+)", path.name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts]
