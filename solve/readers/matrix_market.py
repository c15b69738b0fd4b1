"""Matrices in Matrix Market files. There is one file per matrix and azimuth."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from solve.arguments import matches_annotations
from solve.array_files import matrix_market
from solve.arrays import Array
from solve.errors import FileError, counted
from solve.readers.arrays import Read, system_of
from solve.readers.files import matching_files
from solve.units import speed_in_si

_SYMBOL = re.compile(r"(?:^|[._-])(M|Cq|C|K|d|A|B|D|b)(?:[._-]?(\d+))?\.mtx$")
"""End of the name of a file: the symbol of the matrix and the number of the azimuth."""


@matches_annotations
def read_matrix_market(
    paths: str | Path | Sequence[str | Path],
    speed: float | str | None = None,
    phases: Sequence[float] | Array | None = None,
    coordinates: Sequence[str] | None = None,
) -> Read:
    """Read a periodic system from Matrix Market files.

    Parameters
    ----------
    paths : str, Path or sequence of these
        Files (.mtx), or a pattern such as "run.*.mtx". Each name ends with the symbol of the matrix (M, C, K,
        d or A, B, C, D, b) and the number of the azimuth, for example `run.K.007.mtx`. Without a number, the
        matrix is constant.
    speed : float or str, optional
        Speed in rad/s or with unit at which the matrices were sampled.
    phases : sequence of float, optional
        Azimuths in rad; by default uniform from 0, without the end of the period.
    coordinates : sequence of str, optional
        Names of the coordinates or states.

    Returns
    -------
    PeriodicSystem
        System of second order from M and K, or FirstOrderSystem from A.

    Raises
    ------
    FileError
        If a file cannot be read, a name lacks the symbol of a matrix, or matrices do not fit together.

    Examples
    --------
    >>> import numpy as np, scipy.io, tempfile
    >>> folder = tempfile.mkdtemp()
    >>> for symbol, value in (("M", 1.0), ("K", 4.0)):
    ...     scipy.io.mmwrite(f"{folder}/run.{symbol}.mtx", np.array([[value]]))
    >>> read_matrix_market(f"{folder}/run.*.mtx", speed=1.0).n
    1
    """
    files = matching_files(paths)
    series: dict[str, dict[int, Path]] = {}
    for file in files:
        found = _SYMBOL.search(file.name)
        if found is None:
            raise FileError(
                f"the name of '{file}' lacks the symbol of its matrix before .mtx; give names such as "
                "run.K.mtx, or run.K.007.mtx for azimuth 7"
            )
        numbers = series.setdefault(found[1], {})
        number = -1 if found[2] is None else int(found[2])
        if number in numbers:
            raise FileError(
                f"'{file}' and '{numbers[number]}' contain the same matrix; give one of these files"
            )
        numbers[number] = file
    _require_same_azimuths(series, uniform=phases is None)
    arrays: dict[str, Any] = {symbol: _stacked(numbers) for symbol, numbers in series.items()}
    for symbol in "db":
        if symbol in arrays:
            arrays[symbol] = arrays[symbol].reshape(len(arrays[symbol]), -1)
    if phases is not None:
        arrays["phase"] = np.asarray(phases)
    if coordinates is not None:
        arrays["states" if "A" in arrays else "coordinates"] = np.array(list(coordinates))
    name = files[0].name[: _SYMBOL.search(files[0].name).start()] or files[0].parent.name  # type: ignore[union-attr]
    return system_of(arrays, name, None if speed is None else float(speed_in_si(speed)))


def _require_same_azimuths(series: dict[str, dict[int, Path]], uniform: bool) -> None:
    """Raise FileError unless all matrices that are not constant have files with the same numbers. If the
    azimuths are `uniform`, the numbers must be equidistant, such as 1, 2, 3, or equidistant numbers rounded
    to integers, such as 0, 51, 103 degrees. The differences of rounded numbers may vary by 1, whereas a
    missing file at least doubles a difference.
    """
    numbered = {symbol: sorted(numbers) for symbol, numbers in series.items() if [*numbers] != [-1]}
    if not numbered:
        return
    (first, expected), *others = numbered.items()
    for symbol, numbers in others:
        if len(numbers) != len(expected):
            texts = ", ".join(f"{counted(len(each), 'file')} of {name}" for name, each in numbered.items())
            raise FileError(
                f"the numbered files are {texts}; give every matrix at the same azimuths, or as one file "
                "without number if it is constant"
            )
        if numbers != expected:
            number = min(set(numbers) ^ set(expected))
            raise FileError(
                f"only one of {first} and {symbol} has a file with number {number}; give every matrix at the "
                "same azimuths, or as one file without number if it is constant"
            )
    if -1 in expected:
        raise FileError(
            f"'{series[first][-1]}' has no number, but other files of {first} do; give a file without number "
            "for a constant matrix, or numbered files"
        )
    steps = np.diff(expected)
    if uniform and len(steps) and steps.max() > steps.min() + (steps.min() > 1):
        gap = expected[int(np.argmax(steps))]
        raise FileError(
            f"the numbers of the files of {first} are not equidistant: {gap} is followed by "
            f"{gap + steps.max()}; give all azimuths of the period, or the argument phases"
        )


def _stacked(numbers: dict[int, Path]) -> Array:
    """Stack the matrices as (k, …), in ascending order of their numbers. Raises FileError."""
    matrices = [matrix_market(numbers[number]) for number in sorted(numbers)]
    first = next(iter(numbers.values()))
    if len({matrix.shape for matrix in matrices}) > 1:
        raise FileError(
            f"'{first}' and the files of other azimuths have matrices of different sizes; give equal sizes"
        )
    return np.array(matrices)
