"""Conversion of results to plain data and arrays, and back. Files contain these data and arrays, from which a
result is restored.

Reading runs no code from the file. It constructs only classes that are declared `serializable`. Of a system,
it restores the labels but not the equations.
"""

import dataclasses
import hashlib
import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from solve.arrays import Array
from solve.capabilities import Capabilities, Outputs
from solve.contracts import DrawnLink, Limit, Matrices, ModeShape, Statistics
from solve.equations import freedoms_of, judged_quantities
from solve.errors import FileError, ReopenedError, ResultKindError
from solve.labels import Labels
from solve.period.curve import Curve, FourierCurve
from solve.period.floquet_modes import FloquetMode
from solve.period.grid import Grid
from solve.period.named import Named
from solve.system import PeriodicSystem
from solve.units import GivenSpeed, ShownUnit

FORMAT = 2
"""Version of the format of stored results. Earlier formats can be read."""

CLASSES: dict[str, type] = {}
"""Mapping from names to the classes whose objects files may contain."""

_LABELS = (
    *("name", "title", "case", "case_speed", "model_hash", "options", "parameters", "parameter_labels"),
    *("links", "moves", "vibrates", "equation_warnings", "largest_of", "units", "meanings", "speed_unit"),
)
"""Names of those labels of a system that files contain."""

_DATA = "period", "coordinates", "breaks", "outputs", "states", "inputs"
"""Names of those attributes of a system that files contain. Files of earlier versions lack the last names."""

Kind = TypeVar("Kind", bound=type)
Value = TypeVar("Value")

_NUMERIC_KINDS = "fciub"
"""Kinds of data types (`numpy.dtype.kind`) that are stored as numbers."""


def serializable(kind: Kind) -> Kind:
    """Register a dataclass or named tuple whose objects files may contain."""
    CLASSES[_name_of(kind)] = kind
    return kind


def _name_of(kind: type) -> str:
    """Return the name of a class, preceded by the model's name unless the class belongs to `solve`."""
    package, _, rest = kind.__module__.partition(".")
    return kind.__name__ if package == "solve" else f"{rest.partition('.')[0]}.{kind.__name__}"


class stored_property(cached_property[Value]):  # noqa: N801 - named as the decorator that it extends
    """Cached property whose value is written to files, because its computation requires the equations or the
    solver."""


NOT_STORED = {"stored": False}
"""Metadata of a dataclass field that files do not contain."""


class Serializable:
    """Base class of dataclasses that can be written to files. A file contains all fields, except fields with
    the metadata NOT_STORED, and the value of each `stored_property`."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        serializable(cls)

    def __getattr__(self, name: str) -> Any:
        if dataclasses.is_dataclass(self) and name in _field_names(type(self), stored=False):
            raise ReopenedError(
                f"'{name}' of a result that was read from a file requires the equations, which files do not "
                "contain; load the model and solve again"
            )
        raise AttributeError(f"'{type(self).__name__}' has no attribute '{name}'")


def _field_names(kind: type, stored: bool) -> list[str]:
    """Return the names of the fields of a dataclass that are written to files; if `stored` is False, the
    names of all other fields."""
    fields = dataclasses.fields(kind)
    return [field.name for field in fields if field.metadata.get("stored", True) is stored]


def _stored_properties(kind: type) -> list[str]:
    """Return the names of the properties that a class or one of its base classes declares as
    `stored_property`."""
    declared = {
        name
        for base in kind.__mro__
        for name, item in vars(base).items()
        if isinstance(item, stored_property)
    }
    return sorted(name for name in declared if isinstance(getattr(kind, name), cached_property))


def _contents_of(value: Any) -> Mapping[str, Any]:
    """Return a mapping from names to the values of an object of a serializable class."""
    if hasattr(value, "_asdict"):
        return value._asdict()
    names = [*_field_names(type(value), stored=True), *_stored_properties(type(value))]
    return {name: getattr(value, name) for name in names}


def _restored(kind: type, values: dict[str, Any]) -> Any:
    """Return an object of a serializable class, from its values."""
    if not dataclasses.is_dataclass(kind):
        return kind(**values)
    fields, missing = set(_field_names(kind, stored=True)), _field_names(kind, stored=False)
    restored = kind(
        **{name: value for name, value in values.items() if name in fields}, **dict.fromkeys(missing)
    )
    for name in missing:
        # Access to values that were not stored raises ReopenedError.
        del vars(restored)[name]
    vars(restored).update(values)
    return restored


for _kind in (Curve, FourierCurve, Grid, FloquetMode, Named, Statistics, ModeShape, DrawnLink, ShownUnit):
    serializable(_kind)


class StoredSystem(PeriodicSystem, Outputs):
    """Labels of a system, read from a file. Methods that need the equations raise ReopenedError."""

    _FEWEST = 0
    freedoms = 0
    judged_quantities: tuple[str, ...] = ()

    def __init__(self, stored: Mapping[str, Any]):
        super().__init__(self._refused, stored["coordinates"], stored["period"], stored["breaks"])
        vars(self).update({name: value for name, value in stored.items() if name not in _LABELS})
        self.labels = Labels(**{name: stored[name] for name in _LABELS if name in stored}, solvable=False)

    def _refused(self, *_: Any, **__: Any) -> Matrices:
        raise ReopenedError(
            f"{self.labels.name} was read from a file, which contains no equations; load the model and "
            "solve again"
        )

    varied = output_values = frequencies = mode_shapes = pinned_frequencies = _refused  # type: ignore[assignment]
    require_bounds = many_points = _refused
    derivatives = moves_breaks = property(_refused)

    @property
    def most_frequencies(self) -> int:
        """Maximum number of natural frequencies."""
        return self.freedoms

    def limits(self, quantities: Iterable[str], linear: bool = True) -> list[Limit]:
        """Return an empty list, because the file contains the warnings about limits."""
        return []

    def warnings(self, speed: float, linear: bool = True) -> list[str]:
        """Warnings about the equations."""
        return list(self.labels.equation_warnings)

    @property
    def capabilities(self) -> Capabilities:
        return Capabilities(outputs=self, validity=self, structure=self, variation=self)  # type: ignore[arg-type]


class _Encoder:
    """Encoder that converts values to plain data, in which arrays and systems are replaced by indices."""

    def __init__(self) -> None:
        self._flat: dict[np.dtype[Any], list[Array]] = {}
        self._sizes: Counter[np.dtype[Any]] = Counter()
        self.systems: list[Any] = []
        self._encoded: list[PeriodicSystem] = []

    @property
    def arrays(self) -> list[Array]:
        """Arrays to store, joined to one array per data type, because files with many arrays are slow to read
        and write."""
        return [np.concatenate(parts, dtype=kind) for kind, parts in self._flat.items()]

    def plain(self, value: Any) -> Any:
        """Convert a value to JSON data. The first element of a list is the kind of value that the list
        contains."""
        if isinstance(value, GivenSpeed) and value.unit:
            return ["speed", float(value), self.plain(value.unit)]
        if value is None or isinstance(value, str | bool | int | float):
            return value.item() if isinstance(value, np.generic) else value
        if isinstance(value, np.ndarray | np.generic):
            return self._array(np.asarray(value))
        if isinstance(value, complex):
            return ["complex", value.real, value.imag]
        if isinstance(value, PeriodicSystem):
            return ["system", self._system(value)]
        name = _name_of(type(value))
        if CLASSES.get(name) is type(value):
            return [name, {key: self.plain(item) for key, item in _contents_of(value).items()}]
        if isinstance(value, Mapping):
            return ["mapping", [[self.plain(key), self.plain(item)] for key, item in value.items()]]
        kind = "tuple" if isinstance(value, tuple) else "list"
        return [kind, [self.plain(item) for item in value]]

    def _array(self, array: Array) -> list[Any]:
        if array.dtype.kind not in _NUMERIC_KINDS:
            texts, codes = np.unique(array.astype(str), return_inverse=True)
            return ["texts", texts.tolist(), self._array(codes.reshape(array.shape)), array.dtype.kind]
        flat = np.ascontiguousarray(array).ravel()
        flat = flat.view({"c": float, "b": np.uint8}.get(array.dtype.kind, flat.dtype))
        self._flat.setdefault(flat.dtype, []).append(flat)
        start = self._sizes[flat.dtype]
        self._sizes[flat.dtype] += flat.size
        return ["array", list(self._flat).index(flat.dtype), array.dtype.str, list(array.shape), start]

    def _system(self, system: PeriodicSystem) -> int:
        for number, encoded in enumerate(self._encoded):
            if encoded is system:
                return number
        self._encoded.append(system)
        labels = {name: self.plain(getattr(system.labels, name)) for name in _LABELS}
        data = {name: getattr(system, name) for name in _DATA}
        data |= {"freedoms": freedoms_of(system), "judged_quantities": judged_quantities(system)}
        self.systems.append(labels | {name: self.plain(value) for name, value in data.items()})
        return len(self.systems) - 1


class _Decoder:
    """Decoder of plain data. Each method except `value` decodes the lists whose first element is its name."""

    def __init__(self, arrays: Sequence[Array], systems: Sequence[Mapping[str, Any]]):
        self._arrays = arrays
        self._systems = [
            StoredSystem({name: self.value(label) for name, label in labels.items()}) for labels in systems
        ]

    def value(self, plain: Any) -> Any:
        if not isinstance(plain, list):
            return plain
        name, *parts = plain
        if name in CLASSES:
            return _restored(CLASSES[name], {key: self.value(item) for key, item in parts[0].items()})
        return getattr(self, f"_{name}")(*parts)

    def _complex(self, real: float, imaginary: float) -> complex:
        return complex(real, imaginary)

    def _speed(self, omega: float, unit: list[Any]) -> GivenSpeed:
        return GivenSpeed(omega, self.value(unit))

    def _system(self, number: int) -> StoredSystem:
        return self._systems[number]

    def _array(self, number: int, dtype: str, shape: list[int], start: int = 0) -> Array:
        """Return an array from its data type, its shape and the index of its first element. In format 1, each
        array is stored separately."""
        kind, flat = np.dtype(dtype), self._arrays[number]
        stop = start + math.prod(shape) * kind.itemsize // flat.itemsize
        # The index () converts a zero-dimensional array to a number.
        return flat[start:stop].view(kind).reshape(shape)[()]

    def _texts(self, texts: list[str], codes: list[Any], kind: str) -> Array:
        return np.array(texts, dtype=object if kind == "O" else str)[self.value(codes)]

    def _mapping(self, pairs: list[Any]) -> dict[Any, Any]:
        return {self.value(key): self.value(item) for key, item in pairs}

    def _list(self, values: list[Any]) -> list[Any]:
        return [self.value(item) for item in values]

    def _tuple(self, values: list[Any]) -> tuple[Any, ...]:
        return tuple(self._list(values))


def to_arrays(result: Any) -> dict[str, Array]:
    """Convert a result to a mapping from names to numeric arrays: the JSON data as bytes, the arrays to which
    these data refer, and a checksum."""
    encoder = _Encoder()
    plain = encoder.plain(result)
    content = {"format": FORMAT, "systems": encoder.systems, "result": plain}
    state = {"state": np.frombuffer(json.dumps(content, ensure_ascii=False).encode(), dtype=np.uint8)}
    state |= {f"state{number}": array for number, array in enumerate(encoder.arrays)}
    return {**state, "seal": _checksum(state)}


def from_arrays(arrays: Mapping[str, Array]) -> Any:
    """Restore a result from the arrays that `to_arrays` returned.

    Raises FileError for a later format, ResultKindError for an unknown class, and arbitrary exceptions for
    damaged arrays.
    """
    state = {name: arrays[name] for name in ("state", *(f"state{k}" for k in range(len(arrays) - 2)))}
    if not np.array_equal(_checksum(state), arrays["seal"]):
        raise ValueError(
            "the checksum of the contents does not match the checksum stored in the file: the file is "
            "damaged or was edited"
        )
    content = json.loads(state.pop("state").tobytes())
    if content["format"] > FORMAT:
        raise FileError(
            f"it has format {content['format']}, and this version reads formats up to {FORMAT}; use "
            "the version that wrote it"
        )
    name = content["result"][0]
    if name not in CLASSES:
        raise ResultKindError(name)
    return _Decoder([*state.values()], content["systems"]).value(content["result"])


def _checksum(state: Mapping[str, Array]) -> Array:
    """Return a SHA-256 checksum of all arrays. The checksums of the file formats cover only a part of the
    content."""
    digest = hashlib.sha256()
    for name, array in state.items():
        digest.update(f"{name} {array.dtype.str} {array.shape}".encode())
        digest.update(array.tobytes())
    return np.frombuffer(digest.digest(), dtype=np.uint8)
