"""Results of many points in a folder, kept part by part as they are finished: what stopped goes on there.

The folder is a group of zarr arrays, a part a chunk; `xarray.open_dataset(folder, engine="zarr",
consolidated=False)` reads it, finished or not. A part counts as finished where its checksum, written last, is
that of what is read.
"""

import json
import os
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.errors import FileError, MissingLibraryError
from solve.period.quantities import FIGURES
from solve.results.points import Kept, PointResults

_WORK, _FINISHED = "work", "finished"
"""Attributes of the group: what is calculated, and whether all of it is there, by which a folder is known to
be a store."""

_CODE = np.int8
"""Of a method's name among those of its part."""

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
    """Parts of `size` points each, the last one shorter, of results of points with n coordinates."""

    def __init__(self, group: Any, n: int, kept: Kept, size: int):
        self._n, self._kept, self.size = n, kept, size
        names = [name for name in _DIMENSIONS if name in group]
        self._group, self._arrays = group, {name: group[name] for name in names}
        self._texts, self._checksums = group["texts"], group["checksum"]

    def read(self, part: Array) -> PointResults | None:
        """Results of a part, the positions (k,) of neighbours; None where it is not finished."""
        number = int(part[0]) // self.size
        try:
            checksum = int(self._checksums[number])
            if not checksum:
                return None
            values = {name: kept[part[0] : part[-1] + 1] for name, kept in self._arrays.items()}
            text = str(self._texts[number])
        except Exception:
            # What a damaged file raises depends on the codec that reads it.
            return None
        if _checksum(values, text) != checksum:
            return None
        texts = json.loads(text)
        found = PointResults.blank(len(part), self._n, self._kept)
        for name in values.keys() - {"method"}:
            getattr(found, name)[:] = values[name]
        found.methods[:] = np.array(texts["methods"], dtype=object)[values["method"]]
        found.warnings.update({int(at): lines for at, lines in texts["warnings"].items()})
        found.failures.update({int(at): line for at, line in texts["failures"].items()})
        return found

    def write(self, part: Array, results: PointResults) -> None:
        """Keep a part that is finished. Raises FileError."""
        number, place = int(part[0]) // self.size, slice(int(part[0]), int(part[-1]) + 1)
        methods, codes = np.unique(results.methods.astype(str), return_inverse=True)
        values = {name: getattr(results, name, codes.astype(_CODE)) for name in self._arrays}
        texts = {
            "methods": methods.tolist(),
            "warnings": results.warnings,
            "failures": results.failures,
        }
        text = json.dumps(texts, ensure_ascii=False)
        with _refusing():
            for name, kept in self._arrays.items():
                kept[place] = values[name]
            self._texts[number] = text
            self._checksums[number] = _checksum(values, text)

    def finish(self) -> None:
        """State that every part is there. Raises FileError."""
        with _refusing():
            self._group.attrs[_FINISHED] = True


def made_folder(path: str | Path) -> Path:
    """A folder that may be there already, for the stores of several calculations. Raises FileError,
    MissingLibraryError."""
    _require_zarr()
    with _refusing():
        Path(path).mkdir(exist_ok=True)
    return Path(path)


@contextmanager
def opened(
    folder: str | Path, work: Mapping[str, Any], columns: Mapping[str, Array], n: int, kept: Kept, size: int
) -> Iterator[Store]:
    """The store in a folder, for one writer, made where there is none.

    work: what is calculated, in numbers and texts, by which a folder of another calculation is known;
    columns: values (P,) of the quantities that vary. Raises FileError for a folder of something else, of
    another calculation, in use by another process, or that cannot be written; MissingLibraryError.
    """
    _require_zarr()
    place = Path(folder)
    with _locked(place):
        with _refusing():
            group: Any = _group(place)
            known = group.attrs.get(_WORK)
            if known is None:
                _create(group, n, kept, size, columns)
                group.attrs[_WORK] = {**work, "size": size}
            else:
                _require_same(place, known, work)
                size = known["size"]
        yield Store(group, n, kept, size)


def _require_zarr() -> None:
    """Raise MissingLibraryError without zarr, before a folder is made."""
    try:
        import zarr  # noqa: F401
    except ImportError:
        raise MissingLibraryError.of_extra("a store", "zarr", "store") from None


def _group(place: Path) -> Any:
    """The group of arrays in a folder, a new one where it is empty. Raises FileError, OSError."""
    import zarr

    if not any(place.iterdir()):
        return zarr.create_group(place, attributes={_FINISHED: False})
    try:
        group = zarr.open_group(place, mode="r+")
    except (FileNotFoundError, ValueError):
        group = None
    if group is None or _FINISHED not in group.attrs:
        raise FileError(f"'{place}' holds other files; give a new or an empty folder")
    return group


def _create(group: Any, n: int, kept: Kept, size: int, columns: Mapping[str, Array]) -> None:
    count = len(next(iter(columns.values())))
    blank = PointResults.blank(1, n, kept)
    names = {"quantity": kept.names, "spectrum": kept.spectra, "figure": FIGURES}
    names["result"] = ("orbit", "multipliers")
    for name, dimensions in _DIMENSIONS.items():
        # Codes of the methods' names, which stand in the texts of the part.
        values = getattr(blank, name, np.zeros(1, dtype=_CODE))
        if values.size:
            group.create_array(
                name,
                shape=(count, *values.shape[1:]),
                chunks=(size, *values.shape[1:]),
                dtype=values.dtype,
                fill_value=values.flat[0].item(),
                dimension_names=dimensions,
                attributes={each: list(names[each]) for each in dimensions if each in names},
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


def _require_same(place: Path, known: Mapping[str, Any], work: Mapping[str, Any]) -> None:
    """Raise FileError where the folder holds another calculation."""
    there, here = _entries(known), _entries(json.loads(json.dumps(work)))
    for name in here:
        if there.get(name) != here[name]:
            raise FileError(
                f"'{place}' holds another calculation: {name} is {there.get(name)} there and {here[name]} "
                "here; give another folder, or delete this one"
            )


def _entries(work: Mapping[str, Any]) -> dict[str, Any]:
    """By name, those of parameters and options one by one."""
    found: dict[str, Any] = {}
    for name, value in work.items():
        found.update(
            {f"{name}: {each}": one for each, one in value.items()}
            if isinstance(value, dict)
            else {name: value}
        )
    return found


def _checksum(values: Mapping[str, Array], text: str) -> int:
    """Never 0, which stands for a part that is not finished."""
    found = zlib.crc32(text.encode())
    for each in values.values():
        found = zlib.crc32(np.ascontiguousarray(each).tobytes(), found)
    return found + 1


@contextmanager
def _locked(place: Path) -> Iterator[None]:
    """The folder, for this process alone; the system takes the lock from a process that ends."""
    with _refusing():
        if place.exists() and not place.is_dir():
            raise FileError(f"'{place}' is a file; give a folder")
        place.mkdir(exist_ok=True)
    if os.name != "posix":
        # Elsewhere folders cannot be locked.
        yield
        return
    import fcntl

    with _refusing():
        descriptor = os.open(place, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise FileError(
            f"'{place}' is in use by another process; wait for it, or give another folder"
        ) from None
    try:
        yield
    finally:
        os.close(descriptor)


@contextmanager
def _refusing() -> Iterator[None]:
    try:
        yield
    except OSError as error:
        what = f" '{error.filename}'" if error.filename else ""
        raise FileError(
            f"the store{what} cannot be written ({error.strerror or error}); what was finished before is kept"
        ) from None
