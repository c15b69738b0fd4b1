"""Store of results of many points in a folder. Results are written in chunks, so that interrupted work can be
resumed.

The folder is a group of zarr arrays. `xarray.open_dataset(folder, engine="zarr", consolidated=False)` reads
it, complete or not. A chunk is complete if its data agree with its checksum, which is written last."""

import json
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.errors import FileError, MissingLibraryError
from solve.period.signals import FIGURES
from solve.results.folder import is_empty, locked, require_same, store_errors
from solve.results.points import Kept, PointResults

_WORK, _FINISHED = "work", "finished"
"""Names of attributes of the group: the description of the calculation, and whether it is complete. A folder
with the second attribute is a store."""

_CODE = np.int8
"""Integer type of the stored methods. A chunk contains a list of method names; each point stores an index
into this list."""

_DIMENSIONS: dict[str, tuple[str, ...]] = {
    "figures": ("point", "quantity", "figure"),
    "amplitudes": ("point", "spectrum", "order"),
    "multipliers": ("point", "multiplier"),
    "errors": ("point", "result"),
    "verdicts": ("point",),
    "steps": ("point",),
    "reductions": ("point", "result"),
    "rigid": ("point",),
    "method": ("point",),
}


class Store:
    """Results of points with N multipliers, in chunks of `size` points. The last chunk may have fewer
    points."""

    def __init__(self, group: Any, N: int, kept: Kept, size: int):
        self._N, self._kept, self.size = N, kept, size
        names = [name for name in _DIMENSIONS if name in group]
        self._group, self._arrays = group, {name: group[name] for name in names}
        self._texts, self._checksums = group["texts"], group["checksum"]

    def read(self, chunk: Array) -> PointResults | None:
        """Results of the chunk with the consecutive point indices `chunk` (k,); None if the chunk is
        incomplete or damaged."""
        number = int(chunk[0]) // self.size
        try:
            checksum = int(self._checksums[number])
            if not checksum:
                return None
            values = {name: array[chunk[0] : chunk[-1] + 1] for name, array in self._arrays.items()}
            text = str(self._texts[number])
        except Exception:
            # The exception for a damaged file depends on the codec.
            return None
        if _checksum(values, text) != checksum:
            return None
        texts = json.loads(text)
        results = PointResults.blank(len(chunk), self._N, self._kept)
        for name in values.keys() - {"method"}:
            getattr(results, name)[:] = values[name]
        results.methods[:] = np.array(texts["methods"], dtype=object)[values["method"]]
        results.warnings.update({int(at): lines for at, lines in texts["warnings"].items()})
        results.failures.update({int(at): line for at, line in texts["failures"].items()})
        return results

    def write(self, chunk: Array, results: PointResults) -> None:
        """Write a complete chunk. Raises FileError."""
        number, place = int(chunk[0]) // self.size, slice(int(chunk[0]), int(chunk[-1]) + 1)
        methods, codes = np.unique(results.methods.astype(str), return_inverse=True)
        values = {name: getattr(results, name, codes.astype(_CODE)) for name in self._arrays}
        texts = {
            "methods": methods.tolist(),
            "warnings": results.warnings,
            "failures": results.failures,
        }
        text = json.dumps(texts, ensure_ascii=False)
        with store_errors():
            for name, array in self._arrays.items():
                array[place] = values[name]
            self._texts[number] = text
            self._checksums[number] = _checksum(values, text)

    def finish(self) -> None:
        """Mark the store as complete. Raises FileError."""
        with store_errors():
            self._group.attrs[_FINISHED] = True


def made_folder(path: str | Path) -> Path:
    """Create a folder for the stores of several calculations, if necessary, and return its path. Raises
    FileError, MissingLibraryError."""
    _require_zarr()
    with store_errors():
        Path(path).mkdir(exist_ok=True)
    return Path(path)


@contextmanager
def opened(
    folder: str | Path, work: Mapping[str, Any], columns: Mapping[str, Array], N: int, kept: Kept, size: int
) -> Iterator[Store]:
    """Open the store in a folder for one writer; create it if necessary.

    work: numbers and strings that identify the calculation. columns: values (P,) of the varied quantities.
    Raises MissingLibraryError. Raises FileError if the folder contains other files or another calculation, is
    used by another process, or cannot be written."""
    _require_zarr()
    place = Path(folder)
    with locked(place):
        with store_errors():
            group: Any = _group(place)
            stored = group.attrs.get(_WORK)
            if stored is None:
                _create(group, N, kept, size, columns)
                group.attrs[_WORK] = {**work, "size": size}
            else:
                require_same(place, stored, work)
                size = stored["size"]
        yield Store(group, N, kept, size)


def _require_zarr() -> None:
    """Raise MissingLibraryError if zarr is not installed. This is checked before a folder is created."""
    try:
        import zarr  # noqa: F401
    except ImportError:
        raise MissingLibraryError.of_extra("a store", "zarr", "store") from None


def _group(place: Path) -> Any:
    """Group of zarr arrays in a folder; a new group in an empty folder. Raises FileError, OSError."""
    import zarr

    if is_empty(place):
        return zarr.create_group(place, attributes={_FINISHED: False})
    try:
        group = zarr.open_group(place, mode="r+")
    except (FileNotFoundError, ValueError):
        group = None
    if group is None or _FINISHED not in group.attrs:
        raise FileError(f"'{place}' contains other files; give a new or an empty folder")
    return group


def _create(group: Any, N: int, kept: Kept, size: int, columns: Mapping[str, Array]) -> None:
    count = len(next(iter(columns.values())))
    blank = PointResults.blank(1, N, kept)
    names = {"quantity": kept.names, "spectrum": kept.spectra, "figure": FIGURES}
    names["result"] = ("orbit", "multipliers")
    for name, dimensions in _DIMENSIONS.items():
        # These are indices of method names. The names are in the texts of the chunk.
        values = getattr(blank, name, np.zeros(1, dtype=_CODE))
        if values.size:
            group.create_array(
                name,
                shape=(count, *values.shape[1:]),
                chunks=(size, *values.shape[1:]),
                dtype=values.dtype,
                fill_value=values.flat[0].item(),
                dimension_names=dimensions,
                attributes={label: list(names[label]) for label in dimensions if label in names},
                overwrite=True,
            )
    parts = -(-count // size)
    for name, kind, fill in (("texts", str, ""), ("checksum", np.int64, 0)):
        group.create_array(
            name,
            shape=(parts,),
            chunks=(1,),
            dtype=kind,
            fill_value=fill,
            dimension_names=("part",),
            overwrite=True,
        )
    for name, values in columns.items():
        group.create_array(name, data=values, chunks=(size,), dimension_names=("point",), overwrite=True)


def _checksum(values: Mapping[str, Array], text: str) -> int:
    """Checksum of a chunk. It is never 0, which marks an incomplete chunk."""
    checksum = zlib.crc32(text.encode())
    for array in values.values():
        checksum = zlib.crc32(np.ascontiguousarray(array).tobytes(), checksum)
    return checksum + 1
