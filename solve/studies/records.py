"""Files of measured vibration as columns, each with a title that ends in its unit: CSV tables, MATLAB's
files, and universal files (dataset 58)."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from solve.arguments import require_size
from solve.arrays import Array
from solve.errors import CaseFileError, MissingLibraryError, cause
from solve.model.tables import cells_of, number_in

ENDINGS = ".csv", ".mat", ".uff", ".unv"

AXES = {"phase": "rad", "time": "s", "order": "1", "mode": "1"}
"""Names of the column of which the others are functions, and its unit."""

_ABSCISSAS = {"s": "time", "deg": "phase", "rad": "phase", "order": "order", "1": "order"}
"""What a universal file's abscissa is, by the label of its unit."""


class Record(NamedTuple):
    """Titles of columns, and values (k,) of each; those with numbers that cannot be read are None until they
    are asked for: `texts` then has the rows."""

    path: Path
    titles: Sequence[str]
    columns: Sequence[Array] | None
    texts: Sequence[Sequence[str]] = ()

    def values(self, place: int) -> Array:
        """A column (k,). Raises CaseFileError."""
        if self.columns is not None:
            return self.columns[place]
        return np.array([number_in("data", self.path, row, place) for row in self.texts])


def record(file: str | Path) -> Record:
    """The columns of a file, the axis first. Raises CaseFileError, and MissingLibraryError for universal
    files without pyuff."""
    path = Path(file)
    ending = path.suffix.lower()
    if ending not in ENDINGS:
        raise CaseFileError(f"data: '{path.name or path}' ends in '{ending}'; allowed: {', '.join(ENDINGS)}")
    if ending == ".csv":
        titles, *rows = cells_of("data", path)
        return Record(path, titles, None, rows)
    try:
        require_size(f"bytes in '{path}'", path.stat().st_size, 1)
        return (_matlab if ending == ".mat" else _universal)(path)
    except (OSError, ValueError, TypeError, KeyError, IndexError, NotImplementedError) as error:
        raise CaseFileError(
            f"data: '{path}' cannot be read ({cause(error)}); give a complete {ending} file"
        ) from None


def _matlab(path: Path) -> Record:
    """Of vectors of one length, and a struct `units` with the unit of each; a number holds for all rows."""
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        found = loadmat(str(path), squeeze_me=True, struct_as_record=False, appendmat=False)
    except MatReadError:
        raise ValueError from None
    units: Any = found.get("units")
    vectors = {
        name: np.atleast_1d(value).astype(float)
        for name, value in found.items()
        if not name.startswith("__") and isinstance(value, np.ndarray | float | int) and np.ndim(value) < 2
    }
    axis = next((name for name in AXES if name in vectors), None)
    if axis is None:
        raise CaseFileError(f"data: {path.name} has no vector of one of the names {', '.join(AXES)}; add one")
    count = len(vectors[axis])
    names = [axis, *(name for name in vectors if name not in AXES)]
    other = [name for name in names if len(vectors[name]) not in (1, count)]
    if other:
        raise CaseFileError(f"data: {path.name}: {other[0]} is not as long as {axis}; give one value a row")
    titles = [f"{name} ({getattr(units, name)})" if hasattr(units, name) else name for name in names]
    return Record(path, titles, [np.broadcast_to(vectors[name], count) for name in names])


def _universal(path: Path) -> Record:
    """Of functions at nodal degrees of freedom (dataset 58) on one abscissa, whose first line of text names
    the coordinate or output."""
    try:
        import pyuff
    except ImportError:
        raise MissingLibraryError.of_extra("a universal file", "pyuff", "uff") from None
    if not path.is_file():
        raise OSError
    found = pyuff.UFF(str(path)).read_sets()
    sets = [each for each in (found if isinstance(found, list) else [found]) if each.get("type") == 58]
    if not sets:
        raise CaseFileError(f"data: {path.name} has no dataset 58; export functions of time, angle or order")
    label = _label(sets[0], "abscissa") or "s"
    if label not in _ABSCISSAS:
        raise CaseFileError(
            f"data: {path.name} has an abscissa in '{label}'; allowed: s, deg, rad, or order for spectra"
        )
    axis, x = _ABSCISSAS[label], np.asarray(sets[0]["x"], dtype=float)
    titles, columns = [f"{axis} ({'1' if axis == 'order' else label})"], [x]
    for each in sets:
        if len(each["x"]) != len(x) or not np.allclose(each["x"], x, rtol=1e-9, atol=0.0):
            raise CaseFileError(f"data: {path.name} has functions on several abscissas; give them one")
        name, values = str(each["id1"]).strip(), np.asarray(each["data"])
        titles.append(f"{name} ({_label(each, 'ordinate') or '1'})")
        columns.append(np.abs(values) if np.iscomplexobj(values) else values)
        if np.iscomplexobj(values):
            titles.append(f"{name}_phase (rad)")
            columns.append(np.angle(values))
    return Record(path, titles, columns)


def _label(dataset: dict[str, Any], axis: str) -> str:
    return str(dataset.get(f"{axis}_axis_units_lab") or "").strip().removeprefix("NONE")
