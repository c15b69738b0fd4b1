"""Mechanism files, identified by name (models/NAME/mechanism.py next to this package) or by path. They are
executed, not imported."""

import difflib
import keyword
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from derive.errors import DeriveError, MechanismFileError, UnknownMechanismError
from derive.freshness import sha256

if TYPE_CHECKING:
    from derive.mechanism import MechanismStatement

HOME = Path(__file__).resolve().parent.parent

_NUMERIC = {"cmath", "math", "numpy"}
"""Libraries with functions that accept only numbers."""

BEAM_ELEMENTS = "beam_elements"
"""Name of the generated module of element matrices; its source is beam.py of this package."""


@dataclass(frozen=True)
class Source:
    """Mechanism file, with the name and the path (`target`) of its generated module."""

    name: str
    path: Path
    target: Path
    argument: str
    """Name or path as given on the command line."""
    out: Path | None = None

    @property
    def renewal(self) -> str:
        """Arguments of the command that regenerates the module."""
        return f"{self.argument} --out {self.out}" if self.out else self.argument

    @property
    def installed(self) -> bool:
        """Whether the module belongs to an installed package, not to a checkout or a user's folder."""
        return self.target.parent == HOME / "generated" and not (HOME / "pyproject.toml").is_file()

    @property
    def cases(self) -> Path:
        """Path of the case file; the file may be missing."""
        return (
            self.path.with_suffix(".toml")
            if self.argument.endswith(".py")
            else self.path.with_name("cases.toml")
        )

    @property
    def command(self) -> str:
        """Path of the mechanism, without its folder, in the command that the banner of generated code
        shows."""
        return self.path.name if self.argument.endswith(".py") else self.name

    @property
    def text(self) -> str:
        try:
            return self.path.read_text(encoding="utf-8-sig")
        except (OSError, UnicodeDecodeError) as error:
            raise MechanismFileError(f"{self.path} cannot be read: {error}") from error

    @property
    def sha256(self) -> str:
        return sha256(self.text)


def names() -> list[str]:
    """Names of the mechanisms of the package, and of the beam elements."""
    return sorted([*(path.parent.name for path in (HOME / "models").glob("*/mechanism.py")), BEAM_ELEMENTS])


def find(model: str, out: Path | None = None) -> Source:
    """Return the source of a mechanism, given its name or a path that ends in .py. Raises
    UnknownMechanismError."""
    path = Path(model)
    if model.endswith(".py"):
        if not _is_file(path):
            raise UnknownMechanismError(
                f"there is no file {model}; give a mechanism's name or the path of its file"
            )
        require_own_name(path)
        return Source(path.stem, path, (out or path.parent / "generated") / path.name, model, out)
    if path.name != model or "\\" in model:
        raise UnknownMechanismError(f'"{model}" is neither a name nor a file: a path must end in .py')
    if model not in names():
        nearest = difflib.get_close_matches(model, names(), 1)
        hint = f'; did you mean "{nearest[0]}"?' if nearest else ""
        raise UnknownMechanismError(f'there is no mechanism "{model}"{hint} (known: {", ".join(names())})')
    source = HOME / "models" / model / "mechanism.py"
    if model == BEAM_ELEMENTS:
        source = HOME / "derive" / "beam.py"
    return Source(model, source, (out or HOME / "generated") / f"{model}.py", model, out)


def _is_file(path: Path) -> bool:
    """Whether the file exists. False for names that the file system does not permit."""
    try:
        return path.is_file()
    except OSError:
        return False


def require_own_name(path: Path) -> None:
    """Raise MechanismFileError for a file name that is not an identifier or would shadow a Python module."""
    taken = {*sys.stdlib_module_names, "casadi", "numpy", "scipy", "sympy", "derive", "solve", "models"}
    if path.stem in taken or keyword.iskeyword(path.stem) or path.stem.startswith("_"):
        raise MechanismFileError(
            f'a mechanism cannot be called "{path.stem}": Python has a module or keyword of this name, or '
            f"the name begins with _; rename {path.name} and its mechanism"
        )


def load(source: Source) -> "MechanismStatement":
    """Execute a mechanism file, check the mechanism that its `mechanism()` returns, and return it.

    Raises MechanismFileError if the file cannot be executed or `mechanism()` does not return a mechanism.
    Errors in the statement (DeclarationError, UnitError, …) state the file and the line.
    """
    from derive.checks import check
    from derive.mechanism import MechanismStatement

    stated = _run(source)
    if not isinstance(stated, MechanismStatement):
        raise MechanismFileError(
            f"mechanism() in {source.path} returns {type(stated).__name__}; it must return a derive.Mechanism"
        )
    if stated.name != source.name:
        raise MechanismFileError(
            f'{source.path} states a mechanism "{stated.name}"; it must be called "{source.name}"'
        )
    with located(source, stated):
        check(stated)
    return stated


@contextmanager
def located(source: Source, stated: "MechanismStatement") -> Iterator[None]:
    """Context manager that prefixes messages of errors with the mechanism's file and, if known, the line."""
    from derive.declarations import line_of

    try:
        yield
    except DeriveError as error:
        line = line_of(stated.lines, error)
        where = f"{source.path}, line {line}" if line else f"{source.path}"
        raise type(error)(f"{where}: {error}") from error


def _run(source: Source) -> object:
    """Execute the file, call its function `mechanism`, and return the result."""
    namespace: dict[str, object] = {"__name__": source.name, "__file__": str(source.path)}
    try:
        exec(compile(source.text, str(source.path), "exec"), namespace)
        function = namespace.get("mechanism")
        stated = function() if callable(function) else None
    except DeriveError as error:
        raise type(error)(f"{source.path}{_line(error, source.path)}: {error}") from error
    except BaseException as error:
        # An interruption raises exactly this class; any other exception is due to the mechanism file.
        if type(error) is KeyboardInterrupt:
            raise
        what = ": ".join(filter(None, (type(error).__name__, str(error)))) + _hint(error, namespace)
        raise MechanismFileError(f"{source.path}{_line(error, source.path)}: {what}") from error
    if not callable(function):
        raise MechanismFileError(
            f"{source.path} has no function mechanism(); it must return a derive.Mechanism"
        )
    return stated


def _hint(error: BaseException, namespace: dict[str, object]) -> str:
    """Return the remedy for an error due to numeric functions of symbols; "" for other errors."""
    foreign = [
        name
        for name, value in namespace.items()
        if _NUMERIC
        & {getattr(value, "__module__", ""), getattr(value, "__name__", ""), type(value).__module__}
    ]
    if not foreign or not isinstance(error, TypeError | AttributeError):
        return ""
    return f"; the imported {', '.join(foreign[:3])} cannot take symbols: import functions from derive"


def _line(error: BaseException, path: Path) -> str:
    """Line of the mechanism file that raised an exception, as text such as ", line 12"; "" if unknown."""
    if isinstance(error, SyntaxError):
        return f", line {error.lineno}"
    lines = [
        frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)
    ]
    return f", line {lines[-1]}" if lines else ""
