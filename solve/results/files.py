"""Output files, which are checked before the computation and written either completely or not at all."""

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
"""File name extensions of pictures."""


def checked(path: str | Path, endings: Iterable[str], kind: str) -> Path:
    """Check the path of an output file, before the computation, and return it.

    Raises FileError for an unknown ending, a missing or read-only folder, a read-only file, or a folder or
    device with this name.
    """
    file, allowed = Path(path), tuple(endings)
    if file.suffix.lower() not in allowed:
        ending = f"ends in '{file.suffix}'" if file.suffix else "has no ending"
        raise FileError(f"{kind} file '{path}' {ending}; allowed: {', '.join(allowed)}")
    try:
        target = file.resolve()
        if target.is_dir():
            raise FileError(f"{kind} file '{path}' is a folder; give the name of a file")
        if target.exists() and not target.is_file():
            raise FileError(f"{kind} file '{path}' is a device or a pipe; give the name of a file")
        if not target.parent.is_dir():
            raise FileError(f"{kind} file '{path}': there is no folder '{file.parent}'; create it first")
        # Opening the file is the only reliable test: permissions and read-only file systems can both prevent
        # writing.
        with _temporary(target):
            # A path that is still a link after resolution belongs to a circular chain of links.
            writable = not target.is_symlink() and (not target.exists() or os.access(target, os.W_OK))
    except (OSError, ValueError, RuntimeError):
        writable = False
    if not writable:
        raise FileError(f"{kind} file '{path}' cannot be written; give a path in a writable folder")
    return file


class AtomicFiles:
    """Context manager for a set of files. All files appear at the end of the block, or none if the block
    raises an exception.

    Contents are first collected in memory: on a full disk, a C library may end the process, whereas Python
    raises an exception.
    """

    def __init__(self) -> None:
        self._contents: dict[Path, bytes] = {}

    def write(self, file: Path, write: Callable[[BinaryIO], None]) -> None:
        """Add a checked file, whose content the function `write` writes to a stream."""
        stream = BytesIO()
        write(stream)
        self._contents[file] = stream.getvalue()

    def __enter__(self) -> "AtomicFiles":
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        """Move the files to their final places. Raises FileError."""
        if kind is not None:
            return
        with ExitStack() as temporaries, ExitStack() as undo:
            ready = [temporaries.enter_context(_prepared(*entry)) for entry in self._contents.items()]
            for file, temporary, target, before in ready:
                with _file_errors(file):
                    undo.callback(_restore, target, before)
                    temporary.replace(target)
            undo.pop_all()


def write_atomic(file: Path, write: Callable[[BinaryIO], None]) -> None:
    """Write one file completely or not at all. Raises FileError."""
    with AtomicFiles() as files:
        files.write(file, write)


@contextmanager
def _prepared(file: Path, content: bytes) -> Iterator[tuple[Path, Path, Path, bytes | None]]:
    """Context manager that provides a temporary file with the new content and the permissions of the existing
    file.

    It yields the file, the temporary file, the target of symbolic links, and the current content of the
    target.
    """
    with ExitStack() as cleaning:
        with _file_errors(file):
            target = file.resolve()
            temporary, stream = cleaning.enter_context(_temporary(target))
            with stream:
                stream.write(content)
            before = target.read_bytes() if target.exists() else None
            if before is not None:
                temporary.chmod(stat.S_IMODE(target.stat().st_mode))
        yield file, temporary, target, before


def _restore(target: Path, before: bytes | None) -> None:
    """Restore the previous content of a replaced file, or remove the file if it did not exist before."""
    with suppress(OSError):
        if before is None:
            target.unlink(missing_ok=True)
        elif target.read_bytes() != before:
            target.write_bytes(before)


@contextmanager
def _file_errors(file: Path) -> Iterator[None]:
    """Context manager that converts OSError to FileError."""
    try:
        yield
    except OSError as error:
        raise FileError(
            f"'{file}' cannot be written ({error.strerror or error}); no file was changed"
        ) from None


@contextmanager
def _temporary(file: Path) -> Iterator[tuple[Path, BinaryIO]]:
    """Context manager that provides the name and the stream of a new temporary file in the folder of `file`,
    and removes it at the end. Temporary files of processes that no longer run are removed too."""
    _remove_leftovers(file.parent)
    temporary = file.parent / f"{_prefix(os.getpid())}{secrets.token_hex(8)}"
    stream = temporary.open("xb")
    try:
        with stream:
            yield temporary, stream
    finally:
        temporary.unlink(missing_ok=True)


def _prefix(process: int | str) -> str:
    """Return the common prefix of the names of a process's temporary files on this machine."""
    return f".{platform.node()}-{process}-parametric-"


def _remove_leftovers(folder: Path) -> None:
    before, after = _prefix("*").split("*")
    for path in folder.iterdir() if os.access(folder, os.R_OK) else ():
        number = path.name.removeprefix(before).partition(after)[0]
        if path.name.startswith(before) and number.isdigit() and not _is_alive(int(number)):
            with suppress(OSError):
                path.unlink()


def _is_alive(process: int) -> bool:
    """Return whether a process with this number is running; True if this cannot be determined."""
    if os.name != "posix":
        return True
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True
    return True
