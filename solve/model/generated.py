"""Generated modules: found by path, run once, never imported by name."""

import hashlib
import importlib.util
import re
import sys
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from types import ModuleType

from solve.errors import ModelFileError

ROOT = Path(__file__).resolve().parents[2]
"""Folder of the packages `models` and `generated`."""

_EVERY = (
    *("NAME", "MECHANISM_SHA256", "BODY_SHA256", "COORDINATES", "PARAMETERS", "OPTIONS", "OUTPUTS"),
    *("LIMITS", "VALIDITY", "PERIOD"),
)
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
            f"'{path}' is no generated code (no {missing[0]}); move it away and run derive again"
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


def _refuse_edited(path: Path) -> None:
    """Raise ModelFileError where the text is not the one whose hash it bears."""
    text = path.read_text(encoding="utf-8", errors="replace").replace("\r\n", "\n")
    _, *sealed = re.split(r'^BODY_SHA256 = "(\w*)"\n', text, maxsplit=1, flags=re.MULTILINE)
    if sealed and sha256(sealed[1]) != sealed[0]:
        raise ModelFileError(f"'{path}' was edited; its first lines name the command that renews it")


@lru_cache(maxsize=32)
def _executed(path: Path, _modified: int) -> ModuleType:
    _refuse_edited(path)
    spec = importlib.util.spec_from_file_location(f"_generated_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise ModelFileError(f"'{path.name}' cannot be read as generated code")
    module = importlib.util.module_from_spec(spec)
    written, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise ModelFileError(
            f"'{path}' is no generated code ({type(error).__name__}); move it away and run derive again"
        ) from None
    finally:
        sys.dont_write_bytecode = written
    return module
