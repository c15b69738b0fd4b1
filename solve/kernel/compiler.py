"""Compilation of the C files of this package for the machine when they are first used, with a cache per
user."""

import ctypes
import hashlib
import logging
import os
import shutil
import stat
import subprocess
import tempfile
from collections.abc import Mapping
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from solve.errors import counted

_NATIVE = ("-march=native",), ("-mcpu=native",), ()
"""Flags for the instruction set of the processor. The first flags that the compiler accepts are used. Clang
requires the second flag on ARM."""

MACHINE: tuple[str, ...] = ()
"""Further flags, which select another processor."""

_FLAGS = ("-O3", "-fno-math-errno", "-std=c11", "-shared", "-fPIC")
_CONTRACTED = ("-ffp-contract=fast",)
"""Flag that permits fused multiply-add operations with a single rounding. Formulas are compiled without it,
because their terms may cancel exactly."""

_WIDE = ("-mprefer-vector-width=512",)
"""Flag of Clang for AVX-512. Without it, Clang halves the vectors for some Intel processors. Measured for
steps with one coordinate, relative to GCC: 1.23 times the time without the flag, 1.05 times with it (Intel
Xeon, Zig 0.17)."""

_ZIG = ("-fno-sanitize=all",)
"""Flags of Zig's C compiler. Without these flags, the compiled code checks for undefined behaviour at run
time."""

_HEADERS = Path(__file__).parent
_SECONDS = 300.0
"""Time limit of a compilation in seconds. The first compilation by Zig also builds its run-time library,
which took up to 40 s on a busy machine."""

_LOGGER = logging.getLogger(__name__)


class CompilerError(Exception):
    """Raised if compiled code is not available, because there is no C compiler or the compiler fails. The
    message has one line."""


_WHAT = {
    "columns": "a model's formulas, for many cases",
    "curves": "differences of curves",
    "eigenvalues": "eigenvalues of matrices",
    "figures": "extrema and harmonics over a period",
    "lanes": "periodic solutions",
    "multipliers": "Floquet multipliers",
    "pointwise": "a model's formulas, for many points",
    "responses": "the stages of a period's steps",
}
"""Mapping from C files to descriptions, which messages show during compilation."""


def compiled(source: Path, sizes: Mapping[str, int], formulas: str = "") -> ctypes.CDLL:
    """Load the library compiled from a C file, after compilation if necessary. The sizes are passed as
    macros. The macro FORMULAS contains the file of the formulas, if any. Raises CompilerError."""
    library = library_file(source, sizes, formulas)
    try:
        return ctypes.CDLL(str(library))
    except OSError as error:
        raise CompilerError(f"compiled code cannot be loaded: {error}") from None


def library_file(source: Path, sizes: Mapping[str, int], formulas: str = "") -> Path:
    """Path of the library that `compiled` loads. If it must be compiled, a line is logged. Raises
    CompilerError."""
    compiler = c_compiler()
    macros = [f"-D{name}={value}" for name, value in sizes.items()]
    flags = (*compiler.machine, *_FLAGS, *(() if formulas else _CONTRACTED))
    texts = [each.read_text(encoding="utf-8") for each in (source, *sorted(_HEADERS.glob("*.h")))]
    text = "\0".join((*texts, formulas, compiler.macros, *flags, *macros))
    try:
        library = _folder() / f"{source.stem}-{_hash(text.encode())[:24]}.so"
        if not _is_valid(library):
            size_text = f" of {counted(sizes['N'], 'coordinate')}" if "N" in sizes else ""
            _announce(_WHAT.get(source.stem, source.stem) + size_text)
            command = [*compiler.command, *flags, f"-I{_HEADERS}", *macros, str(source), "-lm"]
            _compile(command, library, formulas)
        return library
    except OSError as error:
        raise CompilerError(f"compiled code cannot be stored: {error}") from None


@lru_cache
def _announce(what: str) -> None:
    """Log a compilation: one line for all libraries of one kind."""
    _LOGGER.warning("compiling %s for this machine, once", what)


def _is_valid(library: Path) -> bool:
    """Whether a library exists, belongs to this user, cannot be changed by other users, and has a valid
    checksum.

    A truncated library would crash the process when loaded. Raises CompilerError for files of other users."""
    checksum = library.with_suffix(".sha256")
    for file in (library, checksum):
        if not os.path.lexists(file):
            return False
        _require_own(file)
    return library.is_file() and checksum.read_text(encoding="utf-8", errors="replace") == _hash(
        library.read_bytes()
    )


def _require_own(path: Path) -> None:
    """Raise CompilerError if other users can modify the file or folder."""
    if not hasattr(os, "getuid"):
        return
    found = path.lstat()
    if found.st_uid != os.getuid() or stat.S_IMODE(found.st_mode) & 0o022 or stat.S_ISLNK(found.st_mode):
        raise CompilerError(
            f"'{path}' is a symbolic link, belongs to another user or is writable by others; remove it"
        )


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


class Compiler(NamedTuple):
    """C compiler.

    command: program and its first arguments. machine: flags for the processor. macros: predefined macros,
    which identify compiler and flags."""

    command: tuple[str, ...]
    machine: tuple[str, ...]
    macros: str


@lru_cache
def c_compiler() -> Compiler:
    """C compiler of this machine: GCC or Clang or, if neither is found, Zig's compiler from its Python
    package. Raises CompilerError."""
    named = os.environ.get("CC")
    wanted = [named] if named else ["cc", "gcc", "clang"]
    found = next(filter(None, map(shutil.which, wanted)), None)
    command = (found,) if found else () if named else zig()
    if not command:
        remedy = "" if named else '; pip install "parametric-vibration[compiler]" installs one'
        raise CompilerError(f"no C compiler ({', '.join(wanted)}) on this machine{remedy}")
    failures = []
    for native in _NATIVE:
        machine = (*native, *MACHINE)
        try:
            macros = _run([*command, *machine, "-dM", "-E", "-x", "c", os.devnull])
        except CompilerError as error:
            failures.append(error)
            continue
        wide = _WIDE if "__clang__" in macros and "__AVX512F__" in macros else ()
        return Compiler(command, (*machine, *wide), macros)
    raise failures[0]


def zig() -> tuple[str, ...]:
    """Command of the C compiler in the package `ziglang`; empty if the package is not installed."""
    package = find_spec("ziglang")
    if package is None or package.origin is None:
        return ()
    program = shutil.which("zig", path=str(Path(package.origin).parent))
    return (program, "cc", *_ZIG) if program else ()


def _compile(command: list[str], library: Path, formulas: str) -> None:
    """Compile the library and write it and its checksum. Each file is written atomically."""
    with tempfile.TemporaryDirectory(dir=library.parent) as folder:
        part, checksum, text = (Path(folder) / name for name in (library.name, "checksum", "formulas.h"))
        if formulas:
            text.write_text(formulas, encoding="utf-8")
            command = [*command, f'-DFORMULAS="{text}"']
        _run([*command, "-o", str(part)])
        part.chmod(0o700)
        checksum.touch(mode=0o600)
        checksum.write_text(_hash(part.read_bytes()), encoding="utf-8")
        part.replace(library)
        checksum.replace(library.with_suffix(".sha256"))


def _run(command: list[str]) -> str:
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, errors="replace", timeout=_SECONDS, check=True
        )
    except subprocess.CalledProcessError as error:
        complaint = next(iter(error.stderr.strip().splitlines()), f"status {error.returncode}")
        raise CompilerError(f"C compiler '{command[0]}' failed: {complaint}") from None
    except (OSError, subprocess.TimeoutExpired) as error:
        raise CompilerError(f"C compiler '{command[0]}' failed: {error}") from None
    return done.stdout


def _folder() -> Path:
    """Folder for compiled code in the cache of the user. It is created if necessary. Raises CompilerError."""
    given = Path(os.environ.get("XDG_CACHE_HOME", ""))
    try:
        # According to the XDG Base Directory specification, relative paths must be ignored.
        base = given if given.is_absolute() else Path.home() / ".cache"
    except RuntimeError as error:
        raise CompilerError(f"no folder for compiled code: {error}; set XDG_CACHE_HOME") from None
    folder = base / "parametric-vibration"
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    _require_own(folder)
    return folder
