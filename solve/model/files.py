"""Where the files of a model are, and whether its generated code is that of its mechanism."""

from pathlib import Path
from typing import NamedTuple

from solve.errors import ModelFileError, UnknownNameError
from solve.model.generated import ROOT, model_module, readable, sha256


class Files(NamedTuple):
    """Of a model: generated module, case file (it may be missing) and mechanism."""

    generated: Path
    cases: Path
    mechanism: Path


def model_names() -> list[str]:
    """Models that come with the package."""
    return sorted(path.parent.name for path in (ROOT / "models").glob("*/mechanism.py"))


def model_files(model: str) -> Files:
    """By the name of a model of the package or the path of a mechanism file. Raises UnknownNameError, and
    ModelFileError where there is no mechanism, or its code is missing or stale."""
    files = _located(model)
    if not files.generated.is_file():
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
            found = mechanism.is_file()
        except OSError:
            found = False
        if not found:
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
