"""Folders that contain the results of one computation. An interrupted computation can resume from its
folder."""

import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.errors import FileError

_LOCK = ".lock"
"""Name of the file that is locked if the operating system cannot lock folders."""


def digest(*arrays: Array) -> str:
    """Return a hash of arrays."""
    found = hashlib.sha256()
    for array in arrays:
        found.update(np.ascontiguousarray(array).tobytes())
    return found.hexdigest()[:16]


def is_empty(place: Path) -> bool:
    """Return whether a folder contains no files except its lock."""
    return all(file.name == _LOCK for file in place.iterdir())


def require_same(place: Path, stored: Mapping[str, Any], work: Mapping[str, Any]) -> None:
    """Raise FileError if a folder contains results of another computation. `stored` and `work` describe the
    stored and the requested computation."""
    there, here = _entries(stored), _entries(json.loads(json.dumps(work)))
    for name in here:
        if there.get(name) != here[name]:
            raise FileError(
                f"'{place}' contains results of another calculation, with {name} {there.get(name)} "
                f"instead of {here[name]}; give another folder, or delete '{place}'"
            )


def _entries(work: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entries of a description, with a separate entry for each parameter and option."""
    entries: dict[str, Any] = {}
    for name, value in work.items():
        if isinstance(value, dict):
            entries.update({f"{name}: {key}": item for key, item in value.items()})
        else:
            entries[name] = value
    return entries


@contextmanager
def locked(place: Path) -> Iterator[None]:
    """Context manager that locks a folder exclusively. The operating system releases the lock when the
    process ends."""
    with store_errors():
        if place.exists() and not place.is_dir():
            raise FileError(f"'{place}' is a file; give a folder")
        place.mkdir(exist_ok=True)
    descriptor = _lock(place)
    if descriptor is None:
        raise FileError(f"'{place}' is in use by another process; wait for it, or give another folder")
    try:
        yield
    finally:
        os.close(descriptor)
        # This file exists only on Windows, which does not delete it while another process holds the lock.
        with suppress(OSError):
            (place / _LOCK).unlink()


def _lock(place: Path) -> int | None:
    """Lock a folder. Return the descriptor that holds the lock until it is closed; None if another process
    holds the lock. Raises FileError."""
    try:
        import fcntl
    except ImportError:
        return _lock_on_windows(place)
    with store_errors():
        descriptor = os.open(place, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        return None
    return descriptor


def _lock_on_windows(place: Path) -> int | None:
    """Implementation of `_lock` for Windows, where only bytes of files can be locked, not folders."""
    import msvcrt

    lock: Any = msvcrt
    with store_errors():
        descriptor = os.open(place / _LOCK, os.O_RDWR | os.O_CREAT)
    try:
        lock.locking(descriptor, lock.LK_NBLCK, 1)
    except OSError:
        os.close(descriptor)
        return None
    return descriptor


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
