"""Linearisations of a wind turbine by OpenFAST over the azimuth of the rotor."""

import itertools
import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from solve.arguments import matches_annotations
from solve.arrays import Array
from solve.errors import FileError, require_name
from solve.first_order import Signals
from solve.readers.files import matching_files
from solve.readers.lin_file import LinFile, Signal
from solve.readers.sampled import SampledStates, Source

_SAME_SPEED = 0.01
"""Relative difference between the rotor speeds of files up to which the files count as one operating point.
In a periodic steady state, the rotor speed varies within a revolution. Chosen by judgement."""

_PRINTED = 6e-4
"""Allowed difference in rad between the printed azimuth, which has three or four decimals, and the azimuth
computed from the states."""

_DOF = re.compile(r"\(internal DOF index = DOF_([^()]*(?:\([^()]*\))?)\)")
_UNIT = re.compile(r",\s*[(\[]?([^,()\[\]]+)[)\]]?$")
_RATE = "First time derivative of "
_AZIMUTH_STATES = "Variable speed generator DOF", "Drivetrain rotational-flexibility DOF"


@matches_annotations
def read_openfast(paths: str | Path | Sequence[str | Path], exclude: Sequence[str] = ()) -> SampledStates:
    """Read a set of OpenFAST linearisation files over the azimuth.

    Parameters
    ----------
    paths : str, Path or sequence of these
        Files (`.lin`), or a pattern such as "run.*.lin". A pattern does not match files of single modules,
        such as "run.1.ED.lin".
    exclude : sequence of str
        Names of states whose rows and columns are omitted, for example the azimuth of the generator, "GeAz",
        and its rate "GeAz_rate".

    Returns
    -------
    FirstOrderSystem
        System of small deviations from the periodic motion, without load. The names of states, inputs and
        outputs are derived from their descriptions. `meanings` contains the descriptions, and `units`
        contains the units in the file. `source` contains the rotor speed, the names of the states in the
        rotating frame, and the operating points.

    Raises
    ------
    FileError
        If a file cannot be read or is malformed, or the files do not belong to one run and operating point.
    MatricesError
        If there are fewer than three azimuths, or azimuths coincide.

    Notes
    -----
    Azimuths are printed with four decimals. If the states in the file include the angle of the
    generator and the twist of the drive train, the azimuth is computed as their sum, with twelve digits.
    Between the azimuths, the matrices are interpolated by trigonometric polynomials. The error estimates of
    results include the interpolation error.

    Examples
    --------
    >>> read_openfast("no_such_file.*.lin")
    Traceback (most recent call last):
    solve.errors.FileError: no file matches 'no_such_file.*.lin'; give paths or patterns of files that exist
    """
    files = [LinFile.read(path) for path in _whole_turbine(matching_files(paths))]
    first = files[0]
    _require_same(files)
    names = {kind: _names(first.signals.get(kind, []), kind) for kind in ("states", "inputs", "outputs")}
    kept = _kept(names["states"], exclude)
    azimuths = np.array([_azimuth(file) for file in files])
    matrices = {
        name: np.array([file.matrices[name] for file in files]) for name in "ABCD" if name in first.matrices
    }
    A = matrices["A"][:, kept][:, :, kept]
    signals = _signals(matrices, names, kept)
    states = [names["states"][k] for k in kept]
    system = SampledStates.from_samples(A, np.zeros(A.shape[:2]), states, azimuths, signals=signals)
    assert isinstance(system, SampledStates)
    system.of_source(_source(files, names))
    return system


def _whole_turbine(paths: Sequence[Path]) -> list[Path]:
    """Paths without the files of individual modules, unless all files are of this kind."""
    whole = [path for path in paths if not re.search(r"\.\d+\.[A-Za-z]\w*\.lin$", path.name)]
    return whole or list(paths)


def _require_same(files: Sequence[LinFile]) -> None:
    """Raise FileError for files of different models or operating points."""
    first = files[0]
    for file in files[1:]:
        for kind in ("states", "inputs", "outputs"):
            here, there = (
                [signal.description for signal in each.signals.get(kind, [])] for each in (file, first)
            )
            if here != there:
                raise FileError(
                    f"'{file.path}' has {kind} that differ from those in '{first.path}'; give "
                    "files of one run"
                )
        if file.matrices.keys() != first.matrices.keys():
            raise FileError(
                f"'{file.path}' has matrices that differ from those in '{first.path}'; give files of one run"
            )
    speeds = np.array([file.speed for file in files])
    if np.ptp(speeds) > _SAME_SPEED * np.abs(speeds).max():
        raise FileError(
            f"rotor speeds of the files range from {speeds.min():g} to {speeds.max():g} rad/s; give files of "
            "one operating point"
        )
    if speeds.mean() <= 0:
        raise FileError(
            f"the rotor speed is {speeds.mean():g} rad/s; give files that were linearised with a rotating "
            "rotor"
        )


def _names(signals: Sequence[Signal], kind: str) -> list[str]:
    """Unique short names of signals, derived from their descriptions."""
    names: list[str] = []
    for signal in signals:
        name = _name(signal.description)
        name = f"{name}_input" if kind == "inputs" else name
        repeated = (f"{name}_{count}" for count in itertools.count(2))
        names.append(name if name not in names else next(each for each in repeated if each not in names))
    return names


def _name(description: str) -> str:
    """Short name derived from a description: the label of the degree of freedom or, without a label, the
    first words.

    >>> _name("ED First time derivative of 1st tower mode (internal DOF index = DOF_TFA1), m/s")
    'TFA1_rate'
    >>> _name("AD vind (axial) at blade 1, node 2, m/s")
    'AD_vind_axial_at_blade_1_node_2'
    """
    rate = "_rate" if _RATE in description else ""
    text = _UNIT.sub("", description.replace(_RATE, ""))
    index = _DOF.search(description)
    words = index[1] if index else text
    return re.sub(r"\W+", "_", words).strip("_") + rate


def _unit(description: str) -> str:
    """Unit at the end of a description; empty if there is none."""
    found = _UNIT.search(description)
    return found[1].strip() if found else ""


def _kept(states: Sequence[str], exclude: Sequence[str]) -> list[int]:
    """Indices of the states that are not excluded. Raises UnknownNameError."""
    for name in exclude:
        require_name("state", name, states)
    return [k for k, name in enumerate(states) if name not in exclude]


def _azimuth(file: LinFile) -> float:
    """Azimuth in rad within a revolution. It is computed from the states if they agree with the printed
    value."""
    angles = []
    for text in _AZIMUTH_STATES:
        angles += [
            signal.operating_point
            for signal in file.signals["states"]
            if text in signal.description and _RATE not in signal.description
        ]
    # ElastoDyn measures the azimuth of blade 1 from the vertical. The angle of the generator is smaller by a
    # quarter of a revolution.
    exact = sum(angles) + math.pi / 2
    is_same = angles and abs(math.remainder(exact - file.azimuth, 2 * math.pi)) < _PRINTED
    return (exact if is_same else file.azimuth) % (2 * math.pi)


def _signals(matrices: dict[str, Array], names: dict[str, list[str]], kept: Sequence[int]) -> Signals | None:
    """Matrices B, C, D for the remaining states, with names; None unless all three are present."""
    if not {"B", "C", "D"} <= matrices.keys() or not (names["inputs"] or names["outputs"]):
        return None
    states = {names["states"][k] for k in kept}
    outputs = [f"{name}_output" if name in states else name for name in names["outputs"]]
    return (matrices["B"][:, kept], matrices["C"][:, :, kept], matrices["D"], names["inputs"], outputs)


def _source(files: Sequence[LinFile], names: dict[str, list[str]]) -> Source:
    """Origin of the samples in a set of files: title, mean speed, and data of the signals."""
    first = files[0]
    labelled = [
        (name, signal)
        for kind, labels in names.items()
        for name, signal in zip(labels, first.signals.get(kind, []), strict=True)
    ]
    points = {
        name: np.array([file.signals[kind][k].operating_point for file in files])
        for kind, labels in names.items()
        for k, name in enumerate(labels)
    }
    return Source(
        re.sub(r"(\.\d+)?\.lin$", "", first.path.name),
        first.title,
        float(np.mean([file.speed for file in files])),
        {name: _unit(signal.description) for name, signal in labelled},
        {name: signal.description for name, signal in labelled},
        [name for name, signal in labelled if signal.rotating],
        points,
    )
