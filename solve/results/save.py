"""Results as files: .npz for NumPy, .csv for spreadsheets, .mat for MATLAB, .nc for xarray; found fit before
the calculation, and written whole or not at all."""

import csv
import os
import platform
import secrets
import stat
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from io import BytesIO, TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Protocol

import numpy as np

from solve.argument import first_is
from solve.arrays import Array
from solve.errors import FileError
from solve.results.contents import Column, Contents, is_of_the_state
from solve.results.lasting import packed, unpacked

if TYPE_CHECKING:
    import xarray


class Saved(Protocol):
    """A result."""

    def contents(self) -> Contents: ...


PICTURES = (".png", ".pdf", ".svg")
"""Endings of pictures."""


def checked(path: str | Path, endings: Iterable[str], kind: str) -> Path:
    """The path of a file that can be written. Raises FileError for an unknown ending, a missing or
    read-only folder, a folder or device of that name, a read-only file."""
    file, allowed = Path(path), tuple(endings)
    if file.suffix.lower() not in allowed:
        given = f"ends in '{file.suffix}'" if file.suffix else "has no ending"
        raise FileError(f"{kind} file '{path}' {given}; allowed: {', '.join(allowed)}")
    try:
        target = file.resolve()
        if target.is_dir():
            raise FileError(f"{kind} file '{path}' is a folder; give the name of a file")
        if target.exists() and not target.is_file():
            raise FileError(f"{kind} file '{path}' is a device or a pipe; give the name of a file")
        if not target.parent.is_dir():
            raise FileError(f"{kind} file '{path}': there is no folder '{file.parent}'; make it first")
        # Only trying tells for certain: rights and read-only file systems alike.
        with _beside(target):
            writable = not target.exists() or os.access(target, os.W_OK)
    except (OSError, ValueError, RuntimeError):
        writable = False
    if not writable:
        raise FileError(f"{kind} file '{path}' cannot be written; give a place where you may write")
    return file


class Whole:
    """Files that appear together at the end of the block, or not at all where it raises.

    They are made in memory first: a library of C may end the process where a disk is full, Python says so.
    """

    def __init__(self) -> None:
        self._contents: dict[Path, bytes] = {}

    def write(self, file: Path, write: Callable[[BinaryIO], None]) -> None:
        """Keep what `write` fills a stream with for a checked file."""
        stream = BytesIO()
        write(stream)
        self._contents[file] = stream.getvalue()

    def __enter__(self) -> "Whole":
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        """Raises FileError."""
        if kind is not None:
            return
        with ExitStack() as parts:
            ready = [parts.enter_context(_filled(*entry)) for entry in self._contents.items()]
            with ExitStack() as undo:
                for file, part, target, before in ready:
                    with _refusing(file):
                        undo.callback(_put_back, target, before)
                        part.replace(target)
                undo.pop_all()


@contextmanager
def _filled(file: Path, content: bytes) -> Iterator[tuple[Path, Path, Path, bytes | None]]:
    """The file, a temporary file with the content and the rights of what it will replace, the target of its
    links, and what that holds."""
    with _refusing(file), ExitStack() as cleaning:
        target = file.resolve()
        part, stream = cleaning.enter_context(_beside(target))
        with stream:
            stream.write(content)
        before = None
        if target.exists():
            before = target.read_bytes()
            part.chmod(stat.S_IMODE(target.stat().st_mode))
        later = cleaning.pop_all()
    with later:
        yield file, part, target, before


def _put_back(target: Path, before: bytes | None) -> None:
    """Undo that a file was replaced: what came before it, if anything."""
    with suppress(OSError):
        if before is None:
            target.unlink(missing_ok=True)
        elif target.read_bytes() != before:
            target.write_bytes(before)


@contextmanager
def _refusing(file: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise FileError(f"'{file}' cannot be written ({error.strerror or error}); nothing was") from None


def write_whole(file: Path, write: Callable[[BinaryIO], None]) -> None:
    """One file, whole or not at all. Raises FileError, leaving no trace."""
    with Whole() as files:
        files.write(file, write)


@contextmanager
def _beside(file: Path) -> Iterator[tuple[Path, BinaryIO]]:
    """A new temporary file in the folder of another, with its stream, removed at the end; what processes
    that died left there is removed too."""
    _remove_leftovers(file.parent)
    part = file.parent / f"{_part_of(os.getpid())}{secrets.token_hex(8)}"
    stream = part.open("xb")
    try:
        with stream:
            yield part, stream
    finally:
        part.unlink(missing_ok=True)


def _part_of(process: int | str) -> str:
    """How the temporary files of a process of this machine begin."""
    return f".{platform.node()}-{process}-parametric-"


def _remove_leftovers(folder: Path) -> None:
    before, after = _part_of("*").split("*")
    for part in folder.iterdir() if os.access(folder, os.R_OK) else ():
        number = part.name.removeprefix(before).partition(after)[0]
        if part.name.startswith(before) and number.isdigit() and not _alive(int(number)):
            with suppress(OSError):
                part.unlink()


def _alive(process: int) -> bool:
    """Whether a process of this number runs; in doubt, yes."""
    if os.name != "posix":
        return True
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True
    return True


def checked_data(path: str | Path) -> Path:
    """The path of a data file that can be written. Raises FileError."""
    return checked(path, DATA, "data")


def writer(result: Saved, file: Path) -> Callable[[BinaryIO], None]:
    """What fills a stream with the result as the file's ending says."""
    return partial(DATA[file.suffix.lower()], result)


@first_is(str, Path, such_as="'orbit.nc'")
def opened(path: str | Path) -> Any:
    """The result that `save` wrote to a file .nc or .npz, bit for bit: everything that it holds, and what was
    calculated with it. No code is run, and there are no equations in it: what needs them is refused.

    Raises FileError for other files, damaged ones, and kinds of results that are not known.
    """
    file = Path(path)
    kind = file.suffix.lower()
    if kind in DATA and kind not in _READ:
        raise FileError(f"'{path}' is an export, which cannot be read back; open the result's .nc or .npz")
    if kind not in _READ:
        raise FileError(f"'{path}' is no file of results; allowed: {', '.join(_READ)}")
    if not file.is_file():
        raise FileError(f"there is no file '{path}'; give the path of a result that was saved")
    try:
        return unpacked(_READ[kind](file))
    except FileError as error:
        raise FileError(f"'{path}' cannot be opened: {error}") from None
    except PermissionError:
        raise FileError(f"'{path}' cannot be read; its rights do not allow it") from None
    except Exception:  # The libraries raise whatever they meet in a damaged file.
        raise FileError(
            f"'{path}' is no result of this program, or it is damaged; save the result again"
        ) from None


def _read_npz(file: Path) -> dict[str, Array]:
    with np.load(file, allow_pickle=False) as arrays:
        return {name: arrays[name] for name in arrays.files if is_of_the_state(name)}


def _read_nc(file: Path) -> dict[str, Array]:
    import h5py

    with h5py.File(file) as whole:
        group = whole[_STATE]
        return {name: group[name][()] for name in group if is_of_the_state(name)}  # type: ignore[index,union-attr]


_STATE = "state"
_READ = {".nc": _read_nc, ".npz": _read_npz}


def dataset(contents: Contents) -> "xarray.Dataset":
    """A variable a column, with `units` and `long_name`; those that are named as an axis, and the time, are
    coordinates."""
    import xarray

    entries = {name: _entry(column) for name, column in {**contents.columns, **contents.further}.items()}
    named = [name for name, (axis, *_) in entries.items() if name == "time" or axis == (name,)]
    axes = {name: entries.pop(name) for name in named}
    # netCDF has no truth values; as numbers they are 0 and 1.
    known = {
        key: int(value) if isinstance(value, bool) else value
        for key, value in contents.metadata.items()
        if isinstance(value, str | int | float)
    }
    return xarray.Dataset(entries, axes, {**known, "metadata": contents.metadata_text})


def _entry(column: Column) -> tuple[Any, ...]:
    """Axes, values, attributes, and how they are written: what is missing is NaN anyway."""
    attributes = {"units": column.unit, "long_name": column.meaning}
    known = {key: text for key, text in attributes.items() if text}
    return column.axes, column.array, known, {"_FillValue": None}


def _write_npz(result: Saved, stream: BinaryIO) -> None:
    contents = result.contents()
    arrays: dict[str, Any] = {**contents.numbers, "metadata": np.array(contents.metadata_text)}
    np.savez(stream, allow_pickle=False, **arrays, **packed(result))


def _write_csv(result: Saved, stream: BinaryIO) -> None:
    contents = result.contents()
    titles = [f"{name} ({v.unit})" if v.unit else name for name, v in contents.columns.items()]
    rows = zip(*(column.tolist() for column in contents.table.values()), strict=True)
    text = TextIOWrapper(stream, encoding="utf-8", newline="")
    table = csv.writer(text, lineterminator="\n")
    table.writerow(titles)
    table.writerows(rows)
    text.detach()


def _write_mat(result: Saved, stream: BinaryIO) -> None:
    from scipy.io import savemat

    contents = result.contents()

    # MATLAB knows cells of texts, not arrays of them.
    arrays = {
        name: values.astype(object) if values.dtype.kind == "U" else values
        for name, values in contents.numbers.items()
    }
    savemat(stream, {**arrays, "metadata": contents.metadata_text}, appendmat=False)


def _write_nc(result: Saved, stream: Any) -> None:
    import xarray

    state = {name: (f"length_of_{name}", array) for name, array in packed(result).items()}
    groups = {"/": dataset(result.contents()), f"/{_STATE}": xarray.Dataset(state)}
    xarray.DataTree.from_dict(groups).to_netcdf(stream, engine="h5netcdf")


DATA: dict[str, Callable[[Saved, BinaryIO], None]] = {
    ".npz": _write_npz,
    ".csv": _write_csv,
    ".mat": _write_mat,
    ".nc": _write_nc,
}
"""Writers by the file's ending."""
