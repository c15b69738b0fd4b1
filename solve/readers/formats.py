"""Files that contain named arrays: MATLAB .mat, NumPy .npz, netCDF and NASTRAN .op4."""

from pathlib import Path

import numpy as np

from solve.arguments import matches_annotations
from solve.array_files import named_arrays
from solve.arrays import Array
from solve.readers.arrays import Read, system_of
from solve.readers.files import checked_path
from solve.units import speed_in_si

_OVER_AZIMUTH = frozenset({"M", "C", "Cq", "K", "d", "A", "B", "D", "b"})
"""Names of arrays whose last index in .mat files is the azimuth. MATLAB calls this index the page."""


@matches_annotations
def read_mat(path: str | Path, speed: float | str | None = None) -> Read:
    """Read a periodic system from a MATLAB file.

    Parameters
    ----------
    path : str or Path
        File (.mat, version 4 to 7.2). Variables of a second-order system are M and K, and optionally C (or
        Cq) for damping and d for a load. Variables of a first-order system are A, and optionally B, C, D for
        inputs and outputs and b for a load. The azimuth is the last index: `M(:,:,k)` and `d(:,k)`. Further
        variables are `phase` (azimuths in rad; by default uniform from 0, without the end of the period),
        `phase_period` (by default 2π), `speed` (rad/s), and the cell arrays of names `coordinates`, `states`,
        `inputs` and `outputs`.
    speed : float or str, optional
        Speed in rad/s or with unit at which the matrices were sampled; by default the speed in the file.

    Returns
    -------
    PeriodicSystem
        System of second order from M and K, or FirstOrderSystem from A. M and K take precedence if a file
        contains all three, like the files written by `solve.export`.

    Raises
    ------
    FileError
        For a file that cannot be read, or arrays that do not fit.

    Examples
    --------
    >>> import solve, tempfile
    >>> file = tempfile.mkdtemp() + "/manipulator.mat"
    >>> written = solve.export(solve.load("manipulator"), file, "50 rpm")
    >>> read_mat(file).coordinates
    ('q1', 'q2')
    """
    return _read(path, ".mat", speed)


@matches_annotations
def read_npz(path: str | Path, speed: float | str | None = None) -> Read:
    """Read a periodic system from a NumPy file.

    Parameters
    ----------
    path : str or Path
        File (.npz) with the arrays of `read_mat`, but with the azimuth as the first index: M (k, n, n), d (k,
        n). Names are arrays of strings. Arrays of objects are rejected, because they can be stored only as
        pickles.
    speed : float or str, optional
        As in `read_mat`.

    Returns
    -------
    PeriodicSystem
        As for `read_mat`.

    Raises
    ------
    FileError
        For a file that cannot be read, or arrays that do not fit.

    Examples
    --------
    >>> import numpy as np, tempfile
    >>> file = tempfile.mkdtemp() + "/oscillator.npz"
    >>> np.savez(file, M=np.ones((8, 1, 1)), K=np.full((8, 1, 1), 4.0), speed=1.0)
    >>> read_npz(file).labels.case_speed
    '1.0 rad/s'
    """
    return _read(path, ".npz", speed)


@matches_annotations
def read_netcdf(path: str | Path, speed: float | str | None = None) -> Read:
    """Read a periodic system from a netCDF file.

    Parameters
    ----------
    path : str or Path
        File (.nc, netCDF 4) with the variables of `read_npz`, at the top level.
    speed : float or str, optional
        As in `read_mat`.

    Returns
    -------
    PeriodicSystem
        As for `read_mat`.

    Raises
    ------
    FileError
        For a file that cannot be read, or arrays that do not fit.

    Examples
    --------
    >>> import numpy as np, tempfile, xarray
    >>> file = tempfile.mkdtemp() + "/oscillator.nc"
    >>> M = (("azimuth", "row", "column"), np.ones((8, 1, 1)))
    >>> xarray.Dataset({"M": M, "K": M, "speed": 1.0}).to_netcdf(file, engine="h5netcdf")
    >>> read_netcdf(file).n
    1
    """
    return _read(path, ".nc", speed)


@matches_annotations
def read_op4(path: str | Path, speed: float | str | None = None) -> Read:
    """Read a system with constant matrices from an OUTPUT4 file of NASTRAN.

    Parameters
    ----------
    path : str or Path
        File (.op4), text or binary, dense or sparse. It contains the mass and stiffness matrices of one set
        of coordinates, such as MAA and KAA, or M and K. For viscous damping, it also contains BAA or CAA.
    speed : float or str, optional
        Default speed of results, in rad/s or with unit.

    Returns
    -------
    PeriodicSystem
        System of second order without load.

    Raises
    ------
    FileError
        If the file cannot be read, or matrices have different sizes.

    Examples
    --------
    >>> import tempfile
    >>> file = tempfile.mkdtemp() + "/oscillator.op4"
    >>> with open(file, "w") as text:
    ...     for name, value in (("MAA", 1.0), ("KAA", 4.0)):
    ...         lines = f"{1:8}{1:8}{6:8}{2:8}{name:8}1P,3E23.16", f"{1:8}{1:8}{1:8}", f"{value:23.16E}"
    ...         end = f"{2:8}{1:8}{1:8}", f"{1:23.16E}"
    ...         print(*lines, *end, sep="\\n", file=text)
    >>> read_op4(file).coordinates
    ('q1',)
    """
    return _read(path, ".op4", speed)


def _read(path: str | Path, ending: str, speed: float | str | None) -> Read:
    """Create a system from the arrays of a file. Raises FileError."""
    file = Path(checked_path(path))
    arrays = named_arrays(file, ending)
    if ending == ".mat":
        arrays = {name: _azimuth_first(name, values) for name, values in arrays.items()}
    return system_of(arrays, file.name, None if speed is None else float(speed_in_si(speed)))


def _azimuth_first(name: str, values: Array) -> Array:
    """Move the azimuth of a MATLAB array from the last index to the first.

    A two-dimensional array is a constant matrix and is returned unchanged, unless its name is d or b (vectors
    over the azimuth)."""
    if name not in _OVER_AZIMUTH or (values.ndim == 2 and name not in "db"):
        return values
    return np.moveaxis(values, -1, 0)
