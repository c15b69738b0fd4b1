"""C text of this package compiled for this machine at first use, and kept in the user's cache."""

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
from pathlib import Path
from typing import NamedTuple

_NATIVE = ("-march=native",), ("-mcpu=native",), ()
"""Flags that let a compiler use all that the processor can do; the first ones that it knows are taken. Clang
has the second ones for ARM."""

MACHINE: tuple[str, ...] = ()
"""Flags behind these, of what the processor is to be taken for."""

_FLAGS = ("-O3", "-fno-math-errno", "-std=c11", "-shared", "-fPIC")
_CONTRACTED = ("-ffp-contract=fast",)
"""Lets products and sums be rounded once, where no formulas are: terms of these that cancel exactly would
leave a remainder."""

_HEADERS = Path(__file__).parent
_SECONDS = 120.0
_LOGGER = logging.getLogger(__name__)


class CompilerError(Exception):
    """No compiled code: there is no C compiler, or it fails. The message is one line."""


_WHAT = {
    "columns": "a model's formulas, for many cases",
    "curves": "differences of curves",
    "eigenvalues": "eigenvalues of matrices",
    "figures": "extremes and harmonics over a turn",
    "lanes": "periodic solutions",
    "multipliers": "Floquet multipliers",
    "pointwise": "a model's formulas, for many points",
    "responses": "the stages of a turn's steps",
}
"""What is in the C files, for those who wait for them."""


def compiled(source: Path, sizes: Mapping[str, int], formulas: str = "") -> ctypes.CDLL:
    """The library of a C file with the sizes as macros, and a file with the formulas as another, FORMULAS,
    where there are some; a first compilation is announced by a line of the logger of this module. Raises
    CompilerError."""
    compiler = c_compiler()
    macros = [f"-D{name}={value}" for name, value in sizes.items()]
    flags = (*compiler.machine, *_FLAGS, *(() if formulas else _CONTRACTED))
    texts = [each.read_text(encoding="utf-8") for each in (source, *sorted(_HEADERS.glob("*.h")))]
    text = "\0".join((*texts, formulas, compiler.macros, *flags, *macros))
    try:
        library = _folder() / f"{source.stem}-{_hash(text.encode())[:24]}.so"
        if not _sound(library):
            of = f" of {sizes['N']} coordinates" if "N" in sizes else ""
            _LOGGER.warning("compiling %s%s for this machine, once", _WHAT.get(source.stem, source.stem), of)
            command = [compiler.path, *flags, f"-I{_HEADERS}", *macros, str(source), "-lm"]
            _compile(command, library, formulas)
        return ctypes.CDLL(str(library))
    except OSError as error:
        raise CompilerError(f"compiled code cannot be kept or loaded: {error}") from None


def _sound(library: Path) -> bool:
    """Whether there is a library of this user that nobody else may change, as long as it was when it was
    compiled: a cut one would end the process, which nothing can catch. Raises CompilerError for what belongs
    to others."""
    seal = library.with_suffix(".sha256")
    for file in (library, seal):
        if not os.path.lexists(file):
            return False
        _require_own(file)
    return library.is_file() and seal.read_text(encoding="utf-8", errors="replace") == _hash(
        library.read_bytes()
    )


def _require_own(path: Path) -> None:
    """Raise CompilerError where others than the user may change a file or a folder."""
    if not hasattr(os, "getuid"):
        return
    found = path.lstat()
    if found.st_uid != os.getuid() or stat.S_IMODE(found.st_mode) & 0o022 or stat.S_ISLNK(found.st_mode):
        raise CompilerError(f"'{path}' belongs to others, or others may change it; remove it")


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


class Compiler(NamedTuple):
    """The C compiler. machine: flags that tell it about the processor. macros: those that it defines then,
    which tell both from others."""

    path: str
    machine: tuple[str, ...]
    macros: str


@lru_cache
def c_compiler() -> Compiler:
    """The one of this machine. Raises CompilerError."""
    wanted = [os.environ["CC"]] if os.environ.get("CC") else ["cc", "gcc", "clang"]
    found = next(filter(None, map(shutil.which, wanted)), None)
    if found is None:
        raise CompilerError(f"no C compiler ({', '.join(wanted)}) on this machine")
    failures = []
    for native in _NATIVE:
        machine = (*native, *MACHINE)
        try:
            return Compiler(found, machine, _run([found, *machine, "-dM", "-E", "-x", "c", os.devnull]))
        except CompilerError as error:
            failures.append(error)
    raise failures[0]


def _compile(command: list[str], library: Path, formulas: str) -> None:
    """Write the library and its hash, each whole or not at all."""
    with tempfile.TemporaryDirectory(dir=library.parent) as folder:
        part, seal, text = (Path(folder) / name for name in (library.name, "seal", "formulas.h"))
        if formulas:
            text.write_text(formulas, encoding="utf-8")
            command = [*command, f'-DFORMULAS="{text}"']
        _run([*command, "-o", str(part)])
        part.chmod(0o700)
        seal.touch(mode=0o600)
        seal.write_text(_hash(part.read_bytes()), encoding="utf-8")
        part.replace(library)
        seal.replace(library.with_suffix(".sha256"))


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
    """Of compiled code, made where it is missing: in the user's cache. Raises CompilerError."""
    given = Path(os.environ.get("XDG_CACHE_HOME", ""))
    try:
        # A relative path counts as none, as the specification of base directories says.
        base = given if given.is_absolute() else Path.home() / ".cache"
    except RuntimeError as error:
        raise CompilerError(f"no folder for compiled code: {error}; set XDG_CACHE_HOME") from None
    folder = base / "parametric-vibration"
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    _require_own(folder)
    return folder
