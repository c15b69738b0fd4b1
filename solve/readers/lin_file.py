"""Reader of a linearisation file of OpenFAST (`.lin`, format of versions 2 to 4): operating point and
matrices A, B, C, D."""

import itertools
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.errors import FileError, cause

_FACT = re.compile(
    r"\s*(Rotor Speed|Azimuth|Number of continuous states|Number of inputs|Number of outputs):\s+(\S+)"
    r"\s*(\S*)"
)
_UNITS = {"Rotor Speed": "rad/s", "Azimuth": "rad"}
_SECTION = re.compile(r"\s*Order of (continuous states|inputs|outputs):")
_ROW = re.compile(r"\s*(\d+)\s+(.+?)\s+([TF])\s+(?:(\d+)\s+)?(\S.*?)\s*$")
"""Row of a section: number, operating point, rotating frame (T or F), order of the derivative,
description."""

_MATRIX = re.compile(r"\s*([A-Za-z]\w*):\s+(\d+)\s+x\s+(\d+)\s*$")
_COUNTS = {"continuous states": "states", "inputs": "inputs", "outputs": "outputs"}


class Signal(NamedTuple):
    """State, input or output: description with unit, operating point, and whether it is in the rotating
    frame."""

    description: str
    operating_point: float
    rotating: bool


@dataclass
class LinFile:
    """Content of a file: azimuth (rad) and rotor speed (rad/s) as printed, signals by kind, and matrices by
    name."""

    path: Path
    title: str = ""
    azimuth: float = math.nan
    speed: float = math.nan
    counts: dict[str, int] = field(default_factory=dict)
    signals: dict[str, list[Signal]] = field(default_factory=dict)
    matrices: dict[str, Array] = field(default_factory=dict)

    @classmethod
    def read(cls, path: Path) -> "LinFile":
        """Read a file. Raises FileError with the file and the line in the message."""
        try:
            lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
        except OSError as error:
            raise FileError(f"'{path}' cannot be read: {cause(error)}") from None
        file = cls(path)
        _Parser(file, enumerate(lines, start=1)).parse()
        return file


class _Parser:
    """Parser of a file, line by line."""

    def __init__(self, file: LinFile, lines: Iterator[tuple[int, str]]):
        self.file, self.lines, self.number = file, lines, 0

    def parse(self) -> None:
        """Read all lines. Raises FileError."""
        readers = ((_FACT, self._fact), (_SECTION, self._section), (_MATRIX, self._matrix))
        is_title = False
        for number, line in self.lines:
            self.number = number
            if is_title:
                self.file.title, is_title = line.strip(), False
            is_title = line.startswith("Description from the FAST input file:")
            if is_title and line.split(":", 1)[1].strip():
                self.file.title, is_title = line.split(":", 1)[1].strip(), False
            for pattern, read in readers:
                found = pattern.match(line)
                if found is not None:
                    read(found)
        self._check()

    def _fact(self, found: re.Match[str]) -> None:
        name, text, unit = found.groups()
        if name in _UNITS:
            setattr(self.file, "azimuth" if name == "Azimuth" else "speed", self._numbers(text, 1)[0])
            if unit not in ("", _UNITS[name]):
                raise self._error(f"{name} in {_UNITS[name]}, not in {unit}")
        else:
            kind = _COUNTS[name.removeprefix("Number of ")]
            self.file.counts[kind] = self._integer(text)

    def _section(self, found: re.Match[str]) -> None:
        kind = _COUNTS[found[1]]
        count = self.file.counts.get(kind)
        if count is None:
            raise self._error(f"'Number of {found[1]}' above the section")
        self.file.signals[kind] = []
        for number, line in itertools.islice(self.lines, 2):
            self.number = number
            if "Operating Point" not in line and set(line.strip()) - {"-", " "}:
                raise self._error("the two header lines of the section")
        for row in range(1, count + 1):
            self.number, line = next(self.lines, (self.number + 1, ""))
            match = _ROW.match(line)
            if match is None or int(match[1]) != row:
                raise self._error(
                    f"row {row} of {count} {kind}: number, operating point, T or F, description"
                )
            point = self._numbers(match[2].replace(",", " "), None)[0]
            self.file.signals[kind].append(Signal(match[5], point, match[3] == "T"))

    def _matrix(self, found: re.Match[str]) -> None:
        name, rows, columns = found[1], int(found[2]), int(found[3])
        if name not in "ABCD":
            return
        expected = self._shape(name)
        if (rows, columns) != expected:
            raise self._error(f"{name} of {expected[0]} x {expected[1]}")
        values = np.empty((rows, columns))
        for row in range(rows):
            self.number, line = next(self.lines, (self.number + 1, ""))
            values[row] = self._numbers(line, columns)
        self.file.matrices[name] = values

    def _shape(self, name: str) -> tuple[int, int]:
        """Shape of a matrix, from the numbers of states, inputs and outputs."""
        states, inputs, outputs = (self.file.counts.get(kind, 0) for kind in _COUNTS.values())
        return {
            "A": (states, states),
            "B": (states, inputs),
            "C": (outputs, states),
            "D": (outputs, inputs),
        }[name]

    def _numbers(self, text: str, count: int | None) -> Sequence[float]:
        """Finite numbers in a string. Raises FileError."""
        try:
            values = [float(word) for word in text.split()]
        except ValueError:
            values = []
        if not values or not all(map(math.isfinite, values)) or count not in (None, len(values)):
            raise self._error(f"{count or 'some'} finite number{'s' * (count != 1)}")
        return values

    def _integer(self, text: str) -> int:
        if not text.isdecimal() or len(text) > 6:
            raise self._error("a count below a million")
        return int(text)

    def _check(self) -> None:
        """Raise FileError if the file lacks data that are required for a system."""
        file, missing = self.file, "is not a linearisation file of OpenFAST, or is truncated: it has no"
        for name, value in (("'Azimuth'", file.azimuth), ("'Rotor Speed'", file.speed)):
            if math.isnan(value):
                raise FileError(f"'{file.path}' {missing} {name}")
        if not file.counts.get("states") or "states" not in file.signals:
            raise FileError(f"'{file.path}' {missing} continuous states")
        if "A" not in file.matrices:
            raise FileError(f"'{file.path}' {missing} matrix A")

    def _error(self, expected: str) -> FileError:
        return FileError(f"'{self.file.path}', line {self.number}: expected {expected}")
