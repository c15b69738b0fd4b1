"""Export of a system to files for other programs. The ending of the file name selects the format."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from solve.arguments import first_is, require_integer
from solve.arrays import Array
from solve.errors import ValueOutOfBoundsError
from solve.exports.c_code import c_code
from solve.exports.controller_code import controller_code, controller_mat
from solve.exports.controller_fmu import controller_fmu
from solve.exports.fmu import fmu
from solve.exports.state_space import SAMPLES, StateSpace, state_space
from solve.labels import require_motion, require_vibration, speed_or_usual
from solve.results.contents import versions
from solve.results.controller import Controller
from solve.results.files import AtomicFiles, checked
from solve.results.stability import Stability
from solve.single import floquet
from solve.system import PeriodicSystem
from solve.units import speed_in_si


@dataclass(frozen=True)
class Exported:
    """Result of an export.

    Attributes
    ----------
    files : tuple of Path
        Written files.
    warnings : tuple of str
        Warnings, one sentence each.
    """

    files: tuple[Path, ...]
    warnings: tuple[str, ...]


@first_is(PeriodicSystem, Controller, such_as="solve.load('cam')")
def export(
    system: PeriodicSystem | Controller,
    path: str | Path,
    speed: float | str | None = None,
    samples: int = SAMPLES,
) -> Exported:
    """Write a system to a file for another program, completely or not at all.

    Parameters
    ----------
    system : PeriodicSystem or Controller
        System or controller to be exported.
    path : str or Path
        File to be written. Its ending selects the format; see Notes.
    speed : float or str, optional
        Speed Ω in rad/s, or a string with a unit; by default the speed of the case. The C functions have the
        speed as an argument.
    samples : int
        Number of phases per period in a .mat file and in the tables of a controller.

    Returns
    -------
    Exported
        Written files, and warnings.

    Raises
    ------
    FileError
        If the file cannot be written.
    LinearModelError
        If the format is .c or .fmu, and the system has no formulas.
    MissingLibraryError
        If the extra `fmu` or a compiler is missing.

    Notes
    -----
    Formats of a system:

    - ".mat": state space at `samples` phases, and multipliers, for MATLAB.
    - ".c", with a file ".h": linearised and nonlinear equations as functions of phase, speed, states and
      parameters.
    - ".fmu": nonlinear equations as a functional mock-up unit (FMI 3.0, model exchange) for this machine,
      starting on
      the periodic orbit.

    Formats of a controller:

    - ".mat": matrices at `samples` phases.
    - ".c", with a file ".h": tables over the phase, and functions for the inputs and the observer.
    - ".fmu": functional mock-up unit. Its inputs are the phase and either the measured quantities or the
      states.

    Examples
    --------
    >>> import solve, tempfile
    >>> export(solve.load("cam"), tempfile.mkdtemp() + "/cam.c").files[0].name
    'cam.c'
    """
    is_controller = isinstance(system, Controller)
    file = checked(path, ENDINGS, "export")
    require_integer("samples", samples)
    if is_controller:
        contents, warnings = _controller(system, file, speed, samples)
    else:
        require_vibration(system)
        if speed is not None:
            speed_in_si(speed)
        contents, warnings = ENDINGS[file.suffix.lower()](system, file, speed, samples)
    for other in contents.keys() - {file}:
        checked(other, (other.suffix,), "export")
    with AtomicFiles() as files:
        for target, content in contents.items():
            files.write(target, partial(_write, content))
    return Exported(tuple(contents), tuple(warnings))


def _write(content: bytes, stream: BinaryIO) -> None:
    stream.write(content)


def mat_file(space: StateSpace, stability: Stability) -> bytes:
    """Content of a .mat file. In MATLAB, the phase is the last index: A(:,:,k) is A at phase(k)."""
    from scipy.io import savemat

    system, matrices, names = space.system, space.coefficients, space.signals
    arrays = {
        "M": matrices.mass,
        "Cq": matrices.damping,
        "K": matrices.stiffness,
        "d": matrices.d,
        "A": matrices.A,
        "B": matrices.B,
        "C": matrices.C,
        "D": matrices.D,
        "y0": matrices.y0,
    }
    if system.states:
        # The file is read as a first-order system, whose only load is b.
        arrays = {name: arrays[name] for name in "ABCD"} | {
            "d": np.zeros_like(matrices.d),
            "b": matrices.b + (matrices.B @ matrices.d[..., None])[..., 0],
            "y0": matrices.y0 + (matrices.D @ matrices.d[..., None])[..., 0],
        }
    content: dict[str, Any] = {name: np.moveaxis(array, 0, -1) for name, array in arrays.items()}
    texts = {name: _cells(values) for name, values in names._asdict().items()}
    if not system.states:
        texts["coordinates"] = _cells(system.coordinates)
    elif not system.outputs:
        texts["outputs"] = _cells(tuple(f"{name}_output" for name in names.outputs))
    labels = system.labels.parameter_labels
    content |= {
        "phase": space.phase,
        "speed": float(space.speed),
        "period": system.period / space.speed,
        "phase_period": system.period,
        "multipliers": stability.multipliers,
        "exponents": stability.exponents,
        "spectral_radius": stability.spectral_radius,
        "verdict": stability.verdict,
        **texts,
        "parameter_names": _cells(tuple(system.labels.parameters)),
        "parameter_values": np.array(list(system.labels.parameters.values()), dtype=float),
        "parameter_units": _cells(tuple(labels[name][0] for name in system.labels.parameters)),
        "model": system.labels.name,
        "title": system.labels.title,
        "model_case": str(system.labels.case or ""),
        "options": _cells(tuple(f"{name}={value}" for name, value in system.labels.options.items())),
        "warnings": _cells(tuple(stability.warnings)),
        "versions": _cells(tuple(f"{name} {version}" for name, version in versions().items())),
    }
    stream = BytesIO()
    savemat(stream, content, appendmat=False, oned_as="column")
    return stream.getvalue()


def _cells(texts: tuple[str, ...]) -> Array:
    """Texts of different lengths as a column of a MATLAB cell array."""
    return np.array(texts, dtype=object)


_Contents = tuple[Mapping[Path, bytes], list[str]]


def _mat(system: PeriodicSystem, file: Path, speed: float | str | None, samples: int) -> _Contents:
    require_motion(system)
    omega = speed_or_usual(system, speed)
    space, stability = state_space(system, omega, samples), floquet(system, omega)
    return {file: mat_file(space, stability)}, stability.warnings


def _c(system: PeriodicSystem, file: Path, speed: float | str | None, samples: int) -> _Contents:
    source, header = c_code(system, file.stem)
    warnings = list(system.labels.equation_warnings)
    return {file: source.encode(), file.with_suffix(".h"): header.encode()}, warnings


def _fmu(system: PeriodicSystem, file: Path, speed: float | str | None, samples: int) -> _Contents:
    require_motion(system)
    content, warnings = fmu(system, speed_or_usual(system, speed))
    return {file: content}, warnings


def _controller(
    result: Controller, file: Path, speed: float | str | None, samples: int
) -> tuple[Mapping[Path, bytes], list[str]]:
    """Return the contents of the files of a controller, and warnings. Raises ValueOutOfBoundsError for a
    filter without a regulator, and if a speed is given."""
    if speed is not None:
        raise ValueOutOfBoundsError(
            f"speed is {speed!r}, but a controller is exported for its design speed; omit speed"
        )
    if result.kind == "kalman":
        raise ValueOutOfBoundsError(
            "a filter without a regulator cannot be exported; design both by giving lqr weights also"
        )
    if file.suffix.lower() == ".mat":
        return {file: controller_mat(result, samples)}, result.warnings
    if file.suffix.lower() == ".fmu":
        content, warnings = controller_fmu(result, samples)
        return {file: content}, warnings
    source, header, warnings = controller_code(result, file.stem, samples)
    return {file: source.encode(), file.with_suffix(".h"): header.encode()}, warnings


ENDINGS: dict[str, Callable[[PeriodicSystem, Path, float | str | None, int], _Contents]] = {
    ".mat": _mat,
    ".c": _c,
    ".fmu": _fmu,
}
"""Mapping from endings of file names to export functions. These return the contents of the files, and
warnings."""
