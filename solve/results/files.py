"""Files found fit before the calculation, and written whole or not at all."""

import os
from collections.abc import Callable, Iterable
from pathlib import Path

from solve.errors import FileError

PICTURES = (".png", ".pdf", ".svg")
"""Endings of pictures."""


def checked(path: str | Path, endings: Iterable[str], kind: str) -> Path:
    """The path of a file that can be written. Raises FileError for an unknown ending, a missing or
    read-only folder, a folder of that name, a read-only file."""
    file, allowed = Path(path), tuple(endings)
    if file.suffix.lower() not in allowed:
        given = f"ends in '{file.suffix}'" if file.suffix else "has no ending"
        raise FileError(f"{kind} file '{path}' {given}; allowed: {', '.join(allowed)}")
    if file.is_dir():
        raise FileError(f"{kind} file '{path}' is a folder; give the name of a file")
    if not file.parent.is_dir():
        raise FileError(f"{kind} file '{path}': there is no folder '{file.parent}'; make it first")
    try:
        # Only trying tells for certain: rights, full disks and read-only file systems alike.
        _part(file).touch(exist_ok=False)
        _part(file).unlink()
        writable = not file.exists() or os.access(file, os.W_OK)
    except OSError:
        writable = False
    if not writable:
        raise FileError(f"{kind} file '{path}' cannot be written; give a place where you may write")
    return file


def write_whole(file: Path, write: Callable[[Path], None]) -> None:
    """Let `write` fill a temporary file beside it, then rename. Raises FileError, leaving no trace."""
    part = _part(file)
    try:
        write(part)
        part.replace(file)
    except OSError as error:
        raise FileError(f"'{file}' cannot be written ({error.strerror or error}); nothing was") from None
    finally:
        part.unlink(missing_ok=True)


def _part(file: Path) -> Path:
    return file.with_name(f".{file.stem}.{os.getpid()}{file.suffix}")
