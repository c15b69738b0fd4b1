"""State of the live window as a command, as Python code, and as a case of a case file."""

import re
import shlex
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any, BinaryIO

from solve.errors import CaseFileError, FileError, SolveError, ValueOutOfBoundsError, cause
from solve.loading import case_numbers, missing_parameters
from solve.model.bounds import checked_options
from solve.model.cases import functions_of, read_cases
from solve.model.generated import model_files
from solve.model.model import Model
from solve.results.files import write_atomic
from solve.views.live.controls import number

SOURCE = "chosen in solve explore"
"""Source that a case file states for a number changed with a slider."""

_NAME = re.compile(r"[A-Za-z0-9_-]{1,40}")
_FILE = re.compile(r"[A-Za-z0-9_-]{1,60}\.toml")
_NUMBERED = re.compile(r"(.*?)([0-9]+)")


@dataclass(frozen=True)
class Origin:
    """Paths of the files of a model.

    `argument` is the name or path of the model in commands; None for a model in memory. `cases` is another
    case file, if one is given.
    """

    argument: str | None = None
    cases: str | None = None

    @classmethod
    def from_model(cls, model: Model) -> "Origin":
        """Origin of a loaded model, determined from the path of its generated code."""
        generated = Path(getattr(model.module, "__file__", None) or "")
        for argument in (model.labels.name, (generated.parent.parent / generated.name).as_posix()):
            try:
                if model_files(argument).generated.resolve() == generated.resolve():
                    return cls(argument)
            except (SolveError, OSError):
                continue
        return cls()

    def stated(self, model: Model) -> Mapping[str, float]:
        """Return the values of the parameters in the case; empty for a model in memory."""
        if self.argument is None:
            return {}
        missing = missing_parameters(self.argument, model.labels.case or None, self.cases, {})
        placeholders = {name: float(model.parameters[name]) for name in missing}
        case = case_numbers(self.argument, model.labels.case or None, self.cases, placeholders)
        return {name: value for name, value in case.parameters.items() if name not in missing}


@dataclass(frozen=True)
class State:
    """State of a window: the model with the values of the sliders, the texts of the changed values, and the
    speed as a string with a unit."""

    origin: Origin
    stated: Mapping[str, float]
    model: Model
    texts: Mapping[str, str]
    speed: str

    @property
    def set(self) -> dict[str, str]:
        """Texts of the values that differ from the case."""
        stated, parameters = self.stated, self.model.parameters
        return {
            name: self.texts.get(name) or number(float(value))
            for name, value in parameters.items()
            if stated.get(name) != value
        }

    @property
    def options(self) -> dict[str, Any]:
        """Options that differ from their defaults."""
        defaults = checked_options(self.model.module, {})
        return {
            name: value for name, value in self.model.labels.options.items() if defaults.get(name) != value
        }

    @property
    def command(self) -> str:
        """Command that computes the same orbit; empty for a model in memory."""
        if self.origin.argument is None:
            return ""
        parts = ["solve", "periodic", _quoted(self.origin.argument)]
        parts += ["--case", _quoted(self.model.labels.case)] if self.model.labels.case else []
        parts += ["--cases", _quoted(self.origin.cases)] if self.origin.cases else []
        for flag, values in (("--option", self.options), ("--set", self.set)):
            parts += (f"{flag} {_quoted(f'{name}={value}')}" for name, value in values.items())
        return " ".join([*parts, "--speed", f'"{self.speed}"'])

    @property
    def python(self) -> str:
        """Python code that computes the same orbit."""
        if self.origin.argument is None or self.origin.cases:
            values = {name: float(value) for name, value in self.model.parameters.items()}
            changed = {name: value for name, value in values.items() if self.stated.get(name) != value}
            load = f"model = model.varied({changed})" if changed else "model"
        else:
            words = [repr(self.origin.argument)]
            words += [f"case={self.model.labels.case!r}"] if self.model.labels.case else []
            words += [f"options={self.options!r}"] if self.options else []
            words += (f"{name}={_value(text)}" for name, text in self.set.items())
            load = f"model = solve.load({', '.join(words)})"
        return f'import solve\n\n{load}\norbit = solve.periodic(model, "{self.speed}")\n'.replace("'", '"')

    def toml(self, name: str) -> str:
        """Return the text of a case with this name and all parameters, in the format of a case file. Raises
        ValueOutOfBoundsError."""
        if not _NAME.fullmatch(name):
            raise ValueOutOfBoundsError(
                f"the case is named '{name}'; allowed: up to 40 letters, digits, - and _, such as 'stiff'"
            )
        title = f'title = "{SOURCE}"\n' if self.set else ""
        head = f'[case.{name}]\n{title}speed = "{self.speed}"\n[case.{name}.parameters]\n'
        return head + "".join(f"{line}\n" for line in self._entries())

    def _entries(self) -> Iterator[str]:
        """Yield the lines of the case. A line states one parameter, or all numbered parameters with the same
        source."""
        model, sources = self.model, self.model.labels.parameter_sources
        rows = []
        for name, value in model.parameters.items():
            source = SOURCE if name in self.set else sources.get(name, SOURCE)
            rows.append((name, number(float(value)), model.labels.parameter_labels[name][0], source))
        for (base, unit, source), group in groupby(rows, lambda row: (_base(row[0]), *row[2:])):
            members = list(group)
            unit_and_source = f'unit = "{_escaped(unit)}", source = "{_escaped(source)}" }}'
            if len(members) > 1 and [member[0] for member in members] == [
                f"{base}{k}" for k in range(1, len(members) + 1)
            ]:
                values = ", ".join(value for _, value, *_ in members)
                yield f"{base} = {{ values = [{values}], {unit_and_source}"
            else:
                yield from (f"{name} = {{ value = {value}, {unit_and_source}" for name, value, *_ in members)


def save_case(state: State, name: str, file: str) -> str:
    """Add a case to a case file. Return a sentence that names the case and the file.

    Parameters
    ----------
    state : State
        State of the window.
    name : str
        Name of the new case.
    file : str
        File in the current folder, or the case file of the model; created if it does not exist.

    Raises
    ------
    ValueOutOfBoundsError, FileError, CaseFileError
        If a name is invalid, or if the file has a case with this name, or cannot be read or written.
    """
    block, path = state.toml(name), Path(file)
    if file != state.origin.cases and not _FILE.fullmatch(file):
        raise ValueOutOfBoundsError(
            f"the file is '{file}'; allowed: a name that ends in .toml, such as mine.toml"
        )
    module = state.model.module
    units = {parameter: unit for parameter, unit, *_ in module.PARAMETERS}
    try:
        old = path.read_text(encoding="utf-8-sig") if path.exists() else ""
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(f"case file '{file}' cannot be read ({cause(error)}); give another file") from None
    if old and name in read_cases(path, units, functions_of(module)):
        raise CaseFileError(f"'{file}' has a case '{name}'; give another name")
    text = f"{old.rstrip()}\n\n{block}" if old else block

    def write(stream: BinaryIO) -> None:
        stream.write(text.encode())

    write_atomic(path, write)
    if state.origin.argument is None:
        return f"case {name} is in {file}"
    return f"case {name} is in {file}: solve periodic {state.origin.argument} --cases {file} --case {name}"


def default_file(origin: Origin, model: Model) -> str:
    """Return the file to which cases are added by default."""
    return origin.cases or f"{model.labels.name}_cases.toml"


def _value(text: str) -> str:
    """Return the text of a TOML value: numbers unchanged, other texts in quotes."""
    try:
        return number(float(text))
    except ValueError:
        return repr(text)


def _base(name: str) -> str:
    numbered = _NUMBERED.fullmatch(name)
    return numbered[1] if numbered else name


def _quoted(text: str) -> str:
    """Return a text, in quotes if a shell would split it. Double quotes are preferred, because Windows
    accepts them too.

    >>> _quoted("k=3 mm"), _quoted("$x"), _quoted("k=3")
    ('"k=3 mm"', "'$x'", 'k=3')
    """
    if re.fullmatch(r"[\w.=+,:/-]+", text):
        return text
    return shlex.quote(text) if re.search(r'["$`\\!]', text) else f'"{text}"'


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace('"', '\\"')
