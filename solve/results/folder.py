"""Folders that hold the results of one calculation, from which it resumes."""

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from solve.errors import FileError


def require_same(place: Path, stored: Mapping[str, Any], work: Mapping[str, Any]) -> None:
    """Raise FileError if a folder contains another calculation. stored, work: descriptions in numbers and
    texts."""
    there, here = _entries(stored), _entries(json.loads(json.dumps(work)))
    for name in here:
        if there.get(name) != here[name]:
            raise FileError(
                f"'{place}' contains results of another calculation, with {name} {there.get(name)} "
                f"instead of {here[name]}; give another folder, or delete '{place}'"
            )


def _entries(work: Mapping[str, Any]) -> dict[str, Any]:
    """Entries of a description by name, with a separate entry for each parameter and option."""
    entries: dict[str, Any] = {}
    for name, value in work.items():
        if isinstance(value, dict):
            entries.update({f"{name}: {key}": item for key, item in value.items()})
        else:
            entries[name] = value
    return entries


@contextmanager
def locked(place: Path) -> Iterator[None]:
    """Context manager with an exclusive lock of a folder. The operating system releases the lock when the
    process ends."""
    with store_errors():
        if place.exists() and not place.is_dir():
            raise FileError(f"'{place}' is a file; give a folder")
        place.mkdir(exist_ok=True)
    if os.name != "posix":
        # Other systems cannot lock folders.
        yield
        return
    import fcntl

    with store_errors():
        descriptor = os.open(place, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise FileError(
            f"'{place}' is in use by another process; wait for it, or give another folder"
        ) from None
    try:
        yield
    finally:
        os.close(descriptor)


@contextmanager
def store_errors() -> Iterator[None]:
    """Context manager that converts OSError to FileError."""
    try:
        yield
    except OSError as error:
        what = f" '{error.filename}'" if error.filename else ""
        raise FileError(
            f"the store{what} cannot be written ({error.strerror or error}); finished chunks are kept"
        ) from None
