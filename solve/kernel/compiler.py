"""C text of this package compiled for this machine at first use, and kept in the user's cache."""

import ctypes
import hashlib
import logging
import os
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

_FLAGS = ("-O3", "-march=native", "-fno-math-errno", "-std=c11", "-shared", "-fPIC")
_SECONDS = 120.0
_LOGGER = logging.getLogger(__name__)


class CompilerError(Exception):
    """No compiled code: there is no C compiler, or it fails. The message is one line."""


def compiled(source: Path, sizes: Mapping[str, int]) -> ctypes.CDLL:
    """The library of a C file with the sizes as macros; a first compilation is announced by a line of the
    logger of this module. Raises CompilerError."""
    compiler, identity = _compiler()
    macros = [f"-D{name}={value}" for name, value in sizes.items()]
    text = "\0".join((source.read_text(encoding="utf-8"), identity, *_FLAGS, *macros))
    library = _folder() / f"{source.stem}-{hashlib.sha256(text.encode()).hexdigest()[:24]}.so"
    if not library.is_file():
        what = ", ".join(f"{name} = {value}" for name, value in sizes.items())
        _LOGGER.warning("compiling %s for this machine, once: %s", source.stem, what)
        _compile([compiler, *_FLAGS, *macros, str(source), "-lm"], library)
    try:
        return ctypes.CDLL(str(library))
    except OSError as error:
        raise CompilerError(f"compiled code cannot be loaded: {error}") from None


@lru_cache
def _compiler() -> tuple[str, str]:
    """Path of the C compiler, and a text that tells it and this machine's processor from others."""
    wanted = [os.environ["CC"]] if os.environ.get("CC") else ["cc", "gcc", "clang"]
    found = next(filter(None, map(shutil.which, wanted)), None)
    if found is None:
        raise CompilerError(f"no C compiler ({', '.join(wanted)}) on this machine")
    command = [found, "-march=native", "-dM", "-E", "-x", "c", os.devnull]
    return found, _run(command)


def _compile(command: list[str], library: Path) -> None:
    """Write the library whole or not at all."""
    try:
        library.parent.mkdir(parents=True, exist_ok=True)
        handle, part = tempfile.mkstemp(suffix=".so", dir=library.parent)
    except OSError as error:
        raise CompilerError(f"no room for compiled code: {error}") from None
    os.close(handle)
    try:
        _run([*command, "-o", part])
        Path(part).replace(library)
    finally:
        Path(part).unlink(missing_ok=True)


def _run(command: list[str]) -> str:
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_SECONDS, check=True)
    except subprocess.CalledProcessError as error:
        complaint = next(iter(error.stderr.strip().splitlines()), f"status {error.returncode}")
        raise CompilerError(f"C compiler '{command[0]}' failed: {complaint}") from None
    except (OSError, subprocess.TimeoutExpired) as error:
        raise CompilerError(f"C compiler '{command[0]}' failed: {error}") from None
    return done.stdout


def _folder() -> Path:
    """Of compiled code: in the user's cache."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "parametric-vibration"
