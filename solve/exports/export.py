"""A system in the file of another tool, by the file's ending."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import BinaryIO

from solve.argument import require_whole
from solve.exports.c_code import c_code
from solve.exports.fmu import fmu
from solve.exports.mat_file import mat_file
from solve.exports.state_space import SAMPLES, state_space
from solve.results.files import AtomicFiles, checked
from solve.single import floquet
from solve.system import PeriodicSystem, of_system
from solve.units import speed_in_si


@dataclass(frozen=True)
class Exported:
    """files: what was written. warnings: what is doubtful about it, a sentence each."""

    files: tuple[Path, ...]
    warnings: tuple[str, ...]


@of_system
def export(
    system: PeriodicSystem, path: str | Path, speed: float | str | None = None, samples: int = SAMPLES
) -> Exported:
    """Write a system for another tool, as the file's ending says, whole or not at all.

    .mat: the state space over `samples` phases with its multipliers, for MATLAB, of any system. .c, with a .h
    beside it: the linearised and the nonlinear equations as functions of phase, speed, states and parameters.
    .fmu: the nonlinear equations as a functional mock-up unit (FMI 3.0, model exchange) for the machine on
    which it is made, starting on the periodic orbit.

    speed: in rad/s, or a text with unit, by default that of the case; the functions of C take any. Raises
    FileError, LinearModelError where there are no formulas for .c and .fmu,
    MissingLibraryError where the extra `fmu` or a compiler is missing, and other SolveError subclasses.
    """
    file = checked(path, ENDINGS, "export")
    require_whole("samples", samples)
    if speed is not None:
        speed_in_si(speed)
    contents, warnings = ENDINGS[file.suffix.lower()](system, file, speed, samples)
    for each in contents.keys() - {file}:
        checked(each, (each.suffix,), "export")
    with AtomicFiles() as files:
        for each, content in contents.items():
            files.write(each, partial(_into, content))
    return Exported(tuple(contents), tuple(warnings))


def _into(content: bytes, stream: BinaryIO) -> None:
    stream.write(content)


_Made = tuple[Mapping[Path, bytes], list[str]]


def _mat(system: PeriodicSystem, file: Path, speed: float | str | None, samples: int) -> _Made:
    system.require_motion()
    omega = system.speed_or_usual(speed)
    space, stability = state_space(system, omega, samples), floquet(system, omega)
    return {file: mat_file(space, stability)}, stability.warnings


def _c(system: PeriodicSystem, file: Path, speed: float | str | None, samples: int) -> _Made:
    source, header = c_code(system, file.stem)
    warnings = list(system.equation_warnings)
    return {file: source.encode(), file.with_suffix(".h"): header.encode()}, warnings


def _fmu(system: PeriodicSystem, file: Path, speed: float | str | None, samples: int) -> _Made:
    system.require_motion()
    content, warnings = fmu(system, system.speed_or_usual(speed))
    return {file: content}, warnings


ENDINGS: dict[str, Callable[[PeriodicSystem, Path, float | str | None, int], _Made]] = {
    ".mat": _mat,
    ".c": _c,
    ".fmu": _fmu,
}
"""By the file's ending, what makes the contents of the files, and the warnings."""
