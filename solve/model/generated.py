"""Files of models, and generated modules. Modules are located by path and executed once; they are not
imported."""

import hashlib
import re
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

from solve.errors import ModelFileError, UnknownNameError

ROOT = Path(__file__).resolve().parents[2]
"""Folder of the packages `models` and `generated`."""

_COMMON_NAMES = (
    *("NAME", "MECHANISM_SHA256", "FILE_SHA256", "COORDINATES", "PARAMETERS", "OPTIONS", "OUTPUTS"),
    *("LIMITS", "VALIDITY", "PERIOD"),
)
_HASH_LINE = r'^FILE_SHA256 = "(\w*)"\n'
EQUATIONS, STRUCTURE = "equations", "structure"
_NAMES_OF_KIND = {
    STRUCTURE: ("LINKS", "JOINTS", "LINK_OPTIONS", "MOTION_OPTIONS", "OBSERVED", "MOVES", "properties"),
    EQUATIONS: ("linearised", "outputs"),
}
"""Mapping from the kind of a module to the names that modules of this kind define in addition: data of the
links from which matrices are assembled, or functions that return the matrices."""


class Files(NamedTuple):
    """Paths of the files of a model: generated module, case file (which need not exist) and mechanism."""

    generated: Path
    cases: Path
    mechanism: Path


def model_names() -> list[str]:
    """Names of the models in the package."""
    return sorted(path.parent.name for path in (ROOT / "models").glob("*/mechanism.py"))


def model_files(model: str) -> Files:
    """Return the paths of the files of a model. `model` is a name or the path of a mechanism file. Raises
    UnknownNameError; raises ModelFileError if the mechanism or its code is missing, or if the code is out of
    date."""
    files = _located(model)
    if not files.generated.is_file():
        if "\nMECHANISM_SHA256 = " in readable(files.mechanism):
            mechanism = files.mechanism.parent.parent / files.mechanism.name
            raise ModelFileError(f"'{model}' is generated code; give its mechanism, such as '{mechanism}'")
        raise ModelFileError(f"no generated code for '{model}'; run: python -m derive {model}")
    text = readable(files.mechanism)
    if sha256(text) != model_module(files.generated).MECHANISM_SHA256:
        raise ModelFileError(
            f"'{model}' has changed since its code was generated; run: python -m derive {model}"
        )
    return files


def _located(model: str) -> Files:
    if model.endswith(".py"):
        mechanism = Path(model)
        try:
            exists = mechanism.is_file()
        except OSError:
            exists = False
        if not exists:
            raise ModelFileError(f"no mechanism file '{model}'; give the path of a file that exists")
        generated = mechanism.parent / "generated" / mechanism.name
        return Files(generated, mechanism.with_suffix(".toml"), mechanism)
    if "/" in model or "\\" in model:
        raise ModelFileError(
            f"model '{model}' is neither a name nor a mechanism file; a path must end in .py"
        )
    if model not in model_names():
        raise UnknownNameError("model", model, model_names())
    folder = ROOT / "models" / model
    return Files(ROOT / "generated" / f"{model}.py", folder / "cases.toml", folder / "mechanism.py")


def model_module(path: Path) -> ModuleType:
    """Generated module of a model. Raises ModelFileError if the file is not a generated module or has been
    edited."""
    module = _execute_file(path.resolve(), path.stat().st_mtime_ns)
    missing = min((_missing(module, (*_COMMON_NAMES, *names)) for names in _NAMES_OF_KIND.values()), key=len)
    if missing:
        raise ModelFileError(
            f"'{path}' is not generated code (no {missing[0]}); move it away and run derive again"
        )
    return module


def kind_of(module: ModuleType) -> str:
    """Kind of a generated module, EQUATIONS or STRUCTURE, according to the names that the module defines."""
    return next(kind for kind, names in _NAMES_OF_KIND.items() if not _missing(module, names))


def _missing(module: ModuleType, names: Sequence[str]) -> list[str]:
    return [name for name in names if name not in vars(module)]


def sha256(text: str) -> str:
    """SHA-256 of a text with LF line endings, as recorded by `derive`."""
    return hashlib.sha256(text.replace("\r\n", "\n").encode()).hexdigest()


def beam_elements() -> ModuleType:
    """Generated module with the tables of beam elements."""
    path = ROOT / "generated" / "beam_elements.py"
    if not path.is_file():
        raise ModelFileError("no generated beam elements; run: python -m derive beam_elements")
    return _execute_file(path, path.stat().st_mtime_ns)


def _verified(text: str, path: str) -> str:
    """Return the text of generated code after a check of its hash. The hash covers all other lines. Raises
    ModelFileError if the hash is missing or wrong."""
    text = text.replace("\r\n", "\n")
    hashes = re.findall(_HASH_LINE, text, flags=re.MULTILINE)
    if len(hashes) != 1:
        raise ModelFileError(f"'{path}' is not generated code (no hash); move it away and run derive again")
    if sha256(re.sub(_HASH_LINE, "", text, flags=re.MULTILINE)) != hashes[0]:
        raise ModelFileError(f"'{path}' was edited; regenerate it with the command in its header")
    return text


def module_of(code: str) -> ModuleType:
    """Execute generated code in memory as a module. The code becomes the attribute CODE of the module. Raises
    ModelFileError."""
    module = _execute(_verified(code, "<derived>"), "<derived>")
    module.__dict__["CODE"] = code
    return module


def readable(path: Path) -> str:
    """Read a file of a model as text. Raises ModelFileError if it cannot be read."""
    try:
        return path.read_text(encoding="utf-8-sig", errors="replace")
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        raise ModelFileError(f"'{path}' cannot be read: {why}; make it readable") from None


@lru_cache(maxsize=32)
def _execute_file(path: Path, _modified: int) -> ModuleType:
    return _execute(_verified(readable(path), str(path)), str(path))


@lru_cache(maxsize=64)
def _execute(text: str, origin: str) -> ModuleType:
    module = ModuleType(f"_generated_{Path(origin).stem}")
    module.__file__ = origin
    try:
        exec(compile(text, origin, "exec"), module.__dict__)
    except Exception as error:
        raise ModelFileError(
            f"'{origin}' is not generated code ({error}); move it away and run derive again"
        ) from None
    return module
