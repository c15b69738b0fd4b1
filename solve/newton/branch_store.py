"""Folder that stores the steps of branches, so that an interrupted continuation can resume.

`branches.json` describes the calculation. The file NUMBER-STEP.npz contains step STEP of branch NUMBER; both
are counted from 0. Stored steps are read up to the first damaged or missing file."""

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from solve.arrays import Array
from solve.errors import FileError
from solve.newton.branch_points import ContinuationParameters, Point
from solve.results.contents import model_info
from solve.results.files import write_atomic
from solve.results.folder import digest, is_empty, locked, require_same, store_errors
from solve.results.serialization import from_arrays, serializable, to_arrays

_DESCRIPTION = "branches.json"

_PROBES = 7
"""Number of phases at which the matrices are sampled for the hash that identifies the calculation. Chosen by
judgement."""


@serializable
@dataclass(frozen=True)
class BranchStep:
    """Step of a branch.

    points: points of the branch that the step adds. length: length of the next step. largest, resting:
    attributes of the `Manifold` after the step. ended: reason why the branch ends with this step; empty at
    the end of the range or of a closed branch, and None if the branch continues."""

    points: tuple[Point, ...]
    length: float
    largest: Array
    resting: bool
    ended: str | None = None


class SavedBranch:
    """Stored steps of one branch. Without a folder, nothing is stored."""

    def __init__(self, folder: Path | None = None, number: int = 0):
        self._folder, self._number = folder, number

    def _file(self, step: int) -> Path:
        assert self._folder is not None
        return self._folder / f"{self._number}-{step}.npz"

    def read(self, step: int) -> BranchStep | None:
        """Return the stored step with number `step`; None if it is missing or damaged."""
        if self._folder is None:
            return None
        try:
            with np.load(self._file(step), allow_pickle=False) as arrays:
                found = from_arrays(dict(arrays))
        except Exception:
            # NumPy and zipfile raise various exceptions for a damaged file.
            return None
        return found if isinstance(found, BranchStep) else None

    def write(self, step: int, contents: BranchStep) -> None:
        """Store `contents` as the step with number `step`. Raises FileError."""
        if self._folder is not None:
            write_atomic(self._file(step), partial(_write, to_arrays(contents)))


class BranchStore:
    """Stored steps of several branches, numbered in the order in which the branches are followed."""

    def __init__(self, folder: Path | None):
        self._folder, self._count = folder, 0

    def next(self) -> SavedBranch:
        """Return the stored steps of the next branch."""
        self._count += 1
        return SavedBranch(self._folder, self._count - 1)


@contextmanager
def opened_branches(folder: str | Path | None, work: Mapping[str, Any]) -> Iterator[BranchStore]:
    """Open a store in `folder` for a single writer; the folder is created if necessary. Without a folder, the
    store saves nothing.

    work: description of the calculation. Raises FileError if the folder contains other files or another
    calculation, if another process uses it, or if it cannot be written."""
    if folder is None:
        yield BranchStore(None)
        return
    place = Path(folder)
    with locked(place):
        file = place / _DESCRIPTION
        with store_errors():
            stored = json.loads(file.read_text("utf-8")) if file.is_file() else None
            if stored is None and not is_empty(place):
                raise FileError(f"'{place}' contains other files; give a new or an empty folder")
        if stored is None:
            text = json.dumps(work, ensure_ascii=False)
            write_atomic(file, lambda stream: _write_text(text, stream))
        else:
            require_same(place, stored, work)
        yield BranchStore(place)


def description_of(parameters: ContinuationParameters, **choices: Any) -> dict[str, Any]:
    """Return a description of everything that determines the points of branches, except their number. The
    keyword arguments `choices` are added to it."""
    task = parameters.task
    phase = (np.arange(_PROBES) + 0.37) * (task.system.period / _PROBES)
    return {
        **model_info(task.system),
        "speed": float(task.speed),
        "over": [*parameters.names],
        "range": parameters.ranges.tolist(),
        "periods": task.periods,
        "rtol": task.rtol,
        "engine": task.engine,
        "matrices": digest(*task.system.at(phase, task.speed)),
        **choices,
        "version": version("parametric-vibration"),
    }


def _write(arrays: Mapping[str, Array], stream: BinaryIO) -> None:
    np.savez(stream, **arrays)  # pyright: ignore[reportArgumentType]


def _write_text(text: str, stream: BinaryIO) -> None:
    stream.write(text.encode())
