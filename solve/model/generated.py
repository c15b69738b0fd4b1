"""Generated modules: found by path, run once, never imported by name."""

import hashlib
import re
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from types import ModuleType

from solve.errors import ModelFileError

ROOT = Path(__file__).resolve().parents[2]
"""Folder of the packages `models` and `generated`."""

_EVERY = (
    *("NAME", "MECHANISM_SHA256", "FILE_SHA256", "COORDINATES", "PARAMETERS", "OPTIONS", "OUTPUTS"),
    *("LIMITS", "VALIDITY", "PERIOD"),
)
_SEAL = r'^FILE_SHA256 = "(\w*)"\n'
EQUATIONS, STRUCTURE = "equations", "structure"
_KINDS = {
    STRUCTURE: ("LINKS", "JOINTS", "LINK_OPTIONS", "MOTION_OPTIONS", "OBSERVED", "MOVES", "properties"),
    EQUATIONS: ("linearised", "outputs"),
}
"""What modules of each kind state besides: links, from which matrices are assembled, or the matrices."""


def model_module(path: Path) -> ModuleType:
    """The generated module of a model. Raises ModelFileError where the file is something else, or edited."""
    module = _executed(path.resolve(), path.stat().st_mtime_ns)
    missing = min((_missing(module, (*_EVERY, *names)) for names in _KINDS.values()), key=len)
    if missing:
        raise ModelFileError(
            f"'{path}' is not generated code (no {missing[0]}); move it away and run derive again"
        )
    return module


def kind_of(module: ModuleType) -> str:
    """EQUATIONS or STRUCTURE: of which kind a generated module states everything."""
    return next(kind for kind, names in _KINDS.items() if not _missing(module, names))


def _missing(module: ModuleType, names: Sequence[str]) -> list[str]:
    return [name for name in names if name not in vars(module)]


def sha256(text: str) -> str:
    """Hash of a text with LF line endings, as derive records it."""
    return hashlib.sha256(text.replace("\r\n", "\n").encode()).hexdigest()


def beam_elements() -> ModuleType:
    """The generated tables of beam elements."""
    path = ROOT / "generated" / "beam_elements.py"
    if not path.is_file():
        raise ModelFileError("no generated beam elements; run: python -m derive beam_elements")
    return _executed(path, path.stat().st_mtime_ns)


def _sealed(text: str, path: str) -> str:
    """The text of generated code, of which the seal covers all but its own line. Raises ModelFileError where
    it bears no seal, or another."""
    text = text.replace("\r\n", "\n")
    seals = re.findall(_SEAL, text, flags=re.MULTILINE)
    if len(seals) != 1:
        raise ModelFileError(f"'{path}' is not generated code (no seal); move it away and run derive again")
    if sha256(re.sub(_SEAL, "", text, flags=re.MULTILINE)) != seals[0]:
        raise ModelFileError(f"'{path}' was edited; regenerate it with the command in its header")
    return text


def module_of(code: str) -> ModuleType:
    """The module of generated code that is in no file; it holds its code as CODE. Raises ModelFileError."""
    module = _of_text(_sealed(code, "<derived>"), "<derived>")
    module.__dict__["CODE"] = code
    return module


def readable(path: Path) -> str:
    """The text of a file of a model. Raises ModelFileError where its rights, or its disk, forbid it."""
    try:
        return path.read_text(encoding="utf-8-sig", errors="replace")
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        raise ModelFileError(f"'{path}' cannot be read: {why}; make it readable or give another") from None


@lru_cache(maxsize=32)
def _executed(path: Path, _modified: int) -> ModuleType:
    return _of_text(_sealed(readable(path), str(path)), str(path))


@lru_cache(maxsize=64)
def _of_text(text: str, origin: str) -> ModuleType:
    module = ModuleType(f"_generated_{Path(origin).stem}")
    module.__file__ = origin
    try:
        exec(compile(text, origin, "exec"), module.__dict__)
    except Exception as error:
        raise ModelFileError(
            f"'{origin}' is not generated code ({error}); move it away and run derive again"
        ) from None
    return module
