"""Files that are found fit before the calculation, and written whole or not at all."""

import os
import platform
import secrets
import stat
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from solve.errors import FileError

PICTURES = (".png", ".pdf", ".svg")
"""Endings of pictures."""


def checked(path: str | Path, endings: Iterable[str], kind: str) -> Path:
    """The path of a file that can be written. Raises FileError for an unknown ending, a missing or
    read-only folder, a folder or device of that name, a read-only file."""
    file, allowed = Path(path), tuple(endings)
    if file.suffix.lower() not in allowed:
        given = f"ends in '{file.suffix}'" if file.suffix else "has no ending"
        raise FileError(f"{kind} file '{path}' {given}; allowed: {', '.join(allowed)}")
    try:
        target = file.resolve()
        if target.is_dir():
            raise FileError(f"{kind} file '{path}' is a folder; give the name of a file")
        if target.exists() and not target.is_file():
            raise FileError(f"{kind} file '{path}' is a device or a pipe; give the name of a file")
        if not target.parent.is_dir():
            raise FileError(f"{kind} file '{path}': there is no folder '{file.parent}'; make it first")
        # Only trying tells for certain: rights and read-only file systems alike.
        with _beside(target):
            # Where links lead has no end if it is a link.
            writable = not target.is_symlink() and (not target.exists() or os.access(target, os.W_OK))
    except (OSError, ValueError, RuntimeError):
        writable = False
    if not writable:
        raise FileError(f"{kind} file '{path}' cannot be written; give a place where you may write")
    return file


class Whole:
    """Files that appear together at the end of the block, or not at all where it raises.

    They are made in memory first: a library of C may end the process where a disk is full, Python says so.
    """

    def __init__(self) -> None:
        self._contents: dict[Path, bytes] = {}

    def write(self, file: Path, write: Callable[[BinaryIO], None]) -> None:
        """Keep what `write` fills a stream with for a checked file."""
        stream = BytesIO()
        write(stream)
        self._contents[file] = stream.getvalue()

    def __enter__(self) -> "Whole":
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        """Raises FileError."""
        if kind is not None:
            return
        with ExitStack() as parts:
            ready = [parts.enter_context(_filled(*entry)) for entry in self._contents.items()]
            with ExitStack() as undo:
                for file, part, target, before in ready:
                    with _refusing(file):
                        undo.callback(_put_back, target, before)
                        part.replace(target)
                undo.pop_all()


@contextmanager
def _filled(file: Path, content: bytes) -> Iterator[tuple[Path, Path, Path, bytes | None]]:
    """The file, a temporary file with the content and the rights of what it will replace, the target of its
    links, and what that holds."""
    with _refusing(file), ExitStack() as cleaning:
        target = file.resolve()
        part, stream = cleaning.enter_context(_beside(target))
        with stream:
            stream.write(content)
        before = None
        if target.exists():
            before = target.read_bytes()
            part.chmod(stat.S_IMODE(target.stat().st_mode))
        later = cleaning.pop_all()
    with later:
        yield file, part, target, before


def _put_back(target: Path, before: bytes | None) -> None:
    """Undo that a file was replaced: what came before it, if anything."""
    with suppress(OSError):
        if before is None:
            target.unlink(missing_ok=True)
        elif target.read_bytes() != before:
            target.write_bytes(before)


@contextmanager
def _refusing(file: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise FileError(f"'{file}' cannot be written ({error.strerror or error}); nothing was") from None


def write_whole(file: Path, write: Callable[[BinaryIO], None]) -> None:
    """One file, whole or not at all. Raises FileError, leaving no trace."""
    with Whole() as files:
        files.write(file, write)


@contextmanager
def _beside(file: Path) -> Iterator[tuple[Path, BinaryIO]]:
    """A new temporary file in the folder of another, with its stream, removed at the end; what processes
    that died left there is removed too."""
    _remove_leftovers(file.parent)
    part = file.parent / f"{_part_of(os.getpid())}{secrets.token_hex(8)}"
    stream = part.open("xb")
    try:
        with stream:
            yield part, stream
    finally:
        part.unlink(missing_ok=True)


def _part_of(process: int | str) -> str:
    """How the temporary files of a process of this machine begin."""
    return f".{platform.node()}-{process}-parametric-"


def _remove_leftovers(folder: Path) -> None:
    before, after = _part_of("*").split("*")
    for part in folder.iterdir() if os.access(folder, os.R_OK) else ():
        number = part.name.removeprefix(before).partition(after)[0]
        if part.name.startswith(before) and number.isdigit() and not _alive(int(number)):
            with suppress(OSError):
                part.unlink()


def _alive(process: int) -> bool:
    """Whether a process of this number runs; in doubt, yes."""
    if os.name != "posix":
        return True
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True
    return True
