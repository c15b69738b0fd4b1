"""Results as plain data and arrays, and back: what a file holds so that it can be opened again. Reading runs
no code: of classes it makes those alone that are declared `lasting`, of a system what labels it."""

import dataclasses
import hashlib
import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, TypeVar

import numpy as np

from solve.arrays import Array
from solve.contracts import DrawnLink, Matrices, ModeShape, Statistics
from solve.errors import FileError, ReopenedError, ResultKindError
from solve.period.curve import Curve, FourierCurve
from solve.period.floquet_modes import FloquetMode
from solve.period.named import Named
from solve.system import PeriodicSystem
from solve.units import GivenSpeed, ShownUnit

FORMAT = 2
"""Of the state within a file; a reader knows its own and earlier ones."""

_KNOWN: dict[str, type] = {}
Kind = TypeVar("Kind", bound=type)
_NUMBERS = "fciub"
_LABELS = (
    *("name", "title", "case", "case_speed", "model_hash", "options", "parameters", "parameter_labels"),
    *(
        "links",
        "moves",
        "vibrates",
        "outputs",
        "equation_warnings",
        "largest_of",
        "units",
        "meanings",
        "period",
    ),
    *("coordinates", "breaks", "freedoms", "judged_quantities", "speed_unit"),
)


def lasting(kind: Kind) -> Kind:
    """Declare a dataclass or a named tuple that files may hold, under its name."""
    _KNOWN[_name_of(kind)] = kind
    return kind


def _name_of(kind: type) -> str:
    """Of `solve` by its name alone, of a model with the model's."""
    package, _, rest = kind.__module__.partition(".")
    return kind.__name__ if package == "solve" else f"{rest.partition('.')[0]}.{kind.__name__}"


class Lasting:
    """What files may hold: a dataclass's fields, but for those `_of_solver`, and the values of the cached
    properties `_calculated`, which need the equations or the solver."""

    _calculated: ClassVar[tuple[str, ...]] = ()
    _of_solver: ClassVar[tuple[str, ...]] = ()

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        lasting(cls)

    def __getattr__(self, name: str) -> Any:
        if name in type(self)._of_solver:
            raise ReopenedError(
                f"'{name}' of a result that was read from a file needs the equations, which no file holds; "
                "load the model and solve again"
            )
        raise AttributeError(f"'{type(self).__name__}' has no attribute '{name}'")


for _kind in (Curve, FourierCurve, FloquetMode, Named, Statistics, ModeShape, DrawnLink, ShownUnit):
    lasting(_kind)


class StoredSystem(PeriodicSystem):
    """What a file tells of a system: its names, numbers, units and meanings, not its equations."""

    solvable = False
    freedoms = 0  # type: ignore[assignment]
    judged_quantities = ()  # type: ignore[assignment]

    def __init__(self, labels: Mapping[str, Any]):
        self.vibrates = labels.get("vibrates", True)
        super().__init__(self._refused, labels["coordinates"], labels["period"], labels["breaks"])
        vars(self).update(labels)

    def _refused(self, *_: Any, **__: Any) -> Matrices:
        raise ReopenedError(
            f"{self.name} was read from a file, which holds no equations; load the model and solve again"
        )

    output_values = varied = along = marcher = varying = _refused  # type: ignore[assignment]
    structure = derivatives = property(_refused)  # type: ignore[assignment]


class _Packing:
    """Values as plain data, in which arrays and systems are numbers."""

    def __init__(self) -> None:
        self._flat: dict[np.dtype[Any], list[Array]] = {}
        self._ends: Counter[np.dtype[Any]] = Counter()
        self.systems: list[Any] = []
        self._places: dict[int, int] = {}
        self._kept: list[PeriodicSystem] = []

    @property
    def arrays(self) -> list[Array]:
        """One of each kind of numbers: files take longer for many."""
        return [np.concatenate(parts, dtype=kind) for kind, parts in self._flat.items()]

    def plain(self, value: Any) -> Any:
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
        if _KNOWN.get(name := _name_of(type(value))) is type(value):
            return [name, {name: self.plain(each) for name, each in _parts(value).items()}]
        if isinstance(value, Mapping):
            return ["mapping", [[self.plain(key), self.plain(each)] for key, each in value.items()]]
        kind = "tuple" if isinstance(value, tuple) else "list"
        return [kind, [self.plain(each) for each in value]]

    def _array(self, array: Array) -> list[Any]:
        if array.dtype.kind not in _NUMBERS:
            texts, codes = np.unique(array.astype(str), return_inverse=True)
            return ["texts", texts.tolist(), self._array(codes.reshape(array.shape)), array.dtype.kind]
        flat = np.ascontiguousarray(array).ravel()
        flat = flat.view({"c": float, "b": np.uint8}.get(array.dtype.kind, flat.dtype))
        self._flat.setdefault(flat.dtype, []).append(flat)
        start = self._ends[flat.dtype]
        self._ends[flat.dtype] += flat.size
        return ["array", list(self._flat).index(flat.dtype), array.dtype.str, list(array.shape), start]

    def _system(self, system: PeriodicSystem) -> int:
        if id(system) not in self._places:
            labels = {name: self.plain(getattr(system, name)) for name in _LABELS}
            self._kept.append(system)
            self._places[id(system)] = len(self.systems)
            self.systems.append(labels)
        return self._places[id(system)]


def _parts(value: Any) -> Mapping[str, Any]:
    if hasattr(value, "_asdict"):
        return value._asdict()
    kind = type(value)
    names = [field.name for field in dataclasses.fields(value)]
    if issubclass(kind, Lasting):
        names = [*(name for name in names if name not in kind._of_solver), *kind._calculated]
    return {name: getattr(value, name) for name in names}


class _Unpacking:
    """The values of plain data."""

    def __init__(self, arrays: Sequence[Array], systems: Sequence[Mapping[str, Any]]):
        self._arrays = arrays
        self._systems = [
            StoredSystem({name: self.value(value) for name, value in each.items() if name in _LABELS})
            for each in systems
        ]

    def value(self, plain: Any) -> Any:
        if not isinstance(plain, list):
            return plain
        kind, *parts = plain
        if kind in _KNOWN:
            return _made(_KNOWN[kind], {name: self.value(each) for name, each in parts[0].items()})
        return getattr(self, f"_{kind}")(*parts)

    def _complex(self, real: float, imaginary: float) -> complex:
        return complex(real, imaginary)

    def _speed(self, omega: float, unit: list[Any]) -> GivenSpeed:
        return GivenSpeed(omega, self.value(unit))

    def _system(self, place: int) -> StoredSystem:
        return self._systems[place]

    def _array(self, place: int, dtype: str, shape: list[int], start: int = 0) -> Array:
        """Format 1 has an array of its own for each."""
        kind, among = np.dtype(dtype), self._arrays[place]
        stop = start + math.prod(shape) * kind.itemsize // among.itemsize
        # Without axes it is a number.
        return among[start:stop].view(kind).reshape(shape)[()]

    def _texts(self, texts: list[str], codes: list[Any], kind: str) -> Array:
        made = np.array(texts, dtype=object if kind == "O" else str)
        return made[self.value(codes)]

    def _mapping(self, pairs: list[Any]) -> dict[Any, Any]:
        return {self.value(key): self.value(each) for key, each in pairs}

    def _list(self, values: list[Any]) -> list[Any]:
        return [self.value(each) for each in values]

    def _tuple(self, values: list[Any]) -> tuple[Any, ...]:
        return tuple(self._list(values))


def _made(kind: type, values: dict[str, Any]) -> Any:
    if not dataclasses.is_dataclass(kind):
        return kind(**values)
    made = object.__new__(kind)
    # Beside fields, figures that only the solver could give anew: they are read, not calculated.
    vars(made).update(values)
    return made


def packed(result: Any) -> dict[str, Array]:
    """A result as arrays by name, of numbers alone: JSON as its bytes, what it refers to, and a checksum of
    all."""
    packing = _Packing()
    value = packing.plain(result)
    whole = {"format": FORMAT, "systems": packing.systems, "result": value}
    state = {"state": np.frombuffer(json.dumps(whole, ensure_ascii=False).encode(), dtype=np.uint8)}
    state |= {f"state{number}": array for number, array in enumerate(packing.arrays)}
    return {**state, "seal": _checksum(state)}


def unpacked(found: Mapping[str, Array]) -> Any:
    """The result of these arrays. Raises FileError for a state of another format, or of a kind that is not
    known; whatever Python may raise for what is no state, or damaged."""
    state = {name: found[name] for name in ("state", *(f"state{k}" for k in range(len(found) - 2)))}
    if not np.array_equal(_checksum(state), found["seal"]):
        raise ValueError("its content is not what was written")
    whole = json.loads(state.pop("state").tobytes())
    if whole["format"] > FORMAT:
        raise FileError(
            f"it is of format {whole['format']}, known up to {FORMAT}; use the version that wrote it"
        )
    kind = whole["result"][0]
    if kind not in _KNOWN:
        raise ResultKindError(kind)
    return _Unpacking([*state.values()], whole["systems"]).value(whole["result"])


def _checksum(state: Mapping[str, Array]) -> Array:
    """A checksum, which no file of the formats has of all its content."""
    digest = hashlib.sha256()
    for name, array in state.items():
        digest.update(f"{name} {array.dtype.str} {array.shape}".encode())
        digest.update(array.tobytes())
    return np.frombuffer(digest.digest(), dtype=np.uint8)
