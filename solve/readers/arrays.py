"""Systems from named arrays over the azimuth: M, C, K and d for a second-order system; A, B, C, D and b for a
first-order system."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.errors import FileError
from solve.readers.sampled import SampledMixed, SampledStates, SampledSystem, Source

_TEXTS = "coordinates", "states", "inputs", "outputs"
"""Names of arrays that contain strings."""

_KNOWN = "M, C (or Cq), K, d; A, B, C, D, b; phase, phase_period, speed, " + ", ".join(_TEXTS)

Read = SampledSystem | SampledStates | SampledMixed


def system_of(arrays: Mapping[str, Any], file: str, speed: float | None = None) -> Read:
    """Create a system from the arrays of a file. The first index of the arrays is the azimuth.

    The arrays must contain M and K for a second-order system, or A for a first-order system. speed: speed in
    rad/s, by default the speed in the file. Raises FileError and MatricesError."""
    phase = _phases(arrays, file)
    period = _number(arrays, "phase_period", file)
    omega = _number(arrays, "speed", file) if speed is None else speed
    source = Source(file, speed=omega)
    options = {"phases": phase, "period": 2 * math.pi if period is None else period}
    if "M" in arrays or "K" in arrays:
        return _second_order(arrays, source, options)
    if "A" in arrays:
        return _first_order(arrays, source, options)
    raise FileError(
        f"'{file}' has the arrays {', '.join(sorted(arrays)[:8]) or 'none'}; give M and K, or A; known "
        f"names: {_KNOWN}"
    )


def _second_order(
    arrays: Mapping[str, Any], source: Source, options: Mapping[str, Any]
) -> SampledSystem | SampledMixed:
    """Second-order system from M, C, K and d."""
    M, K = (_matrix(arrays, name, source.name) for name in "MK")
    n = K.shape[-1]
    damping = next((name for name in ("Cq", "C") if name in arrays), None)
    C = np.zeros_like(K) if damping is None else _matrix(arrays, damping, source.name)
    _require_shapes({"K": K, "M": M, damping or "C": C}, (n, n), source.name)
    d = _vector(arrays, "d", len(K), n, source.name)
    count = max(map(len, (M, C, K, d)))
    M, C, K, d = (_repeated(array, count) for array in (M, C, K, d))
    coordinates, states = (_texts(arrays, name, source.name) for name in _TEXTS[:2])
    if states and coordinates and len(coordinates) + len(states) == n:
        mixed = SampledMixed.from_samples((M, C, K, d), coordinates, states, **options)
        assert isinstance(mixed, SampledMixed)
        mixed.of_source(source)
        return mixed
    names = _checked_names(coordinates or _numbered("q", n), n, "coordinates", source.name)
    system = SampledSystem.from_samples(M, C, K, d, names, **options)
    system.of_source(source)
    return system


def _first_order(arrays: Mapping[str, Any], source: Source, options: Mapping[str, Any]) -> SampledStates:
    """First-order system from A and b and, if present, B, C and D."""
    A = _matrix(arrays, "A", source.name)
    N = A.shape[-1]
    _require_shapes({"A": A}, (N, N), source.name)
    b = _repeated(_vector(arrays, "b", len(A), N, source.name), len(A))
    states = _texts(arrays, "states", source.name) or _numbered("x", N)
    _checked_names(states, N, "states", source.name)
    signals, missing = None, [name for name in "BCD" if name not in arrays]
    if len(missing) in (1, 2):
        raise FileError(f"'{source.name}' has no {missing[0]}; give all of B, C and D, or none")
    if not missing:
        B, C, D = (_repeated(_matrix(arrays, name, source.name), len(A)) for name in "BCD")
        inputs = _texts(arrays, "inputs", source.name) or _numbered("u", B.shape[-1])
        outputs = _texts(arrays, "outputs", source.name) or _numbered("y", C.shape[-2])
        _require_shapes({"B": B}, (N, len(inputs)), source.name)
        _require_shapes({"C": C}, (len(outputs), N), source.name)
        _require_shapes({"D": D}, (len(outputs), len(inputs)), source.name)
        signals = B, C, D, inputs, outputs
    system = SampledStates.from_samples(A, b, states, **options, signals=signals)
    assert isinstance(system, SampledStates)
    system.of_source(source)
    return system


def _matrix(arrays: Mapping[str, Any], name: str, file: str) -> Array:
    """Array (k, …, …) of this name, over k azimuths. A two-dimensional array is a constant matrix, with k =
    1. Raises FileError."""
    if name not in arrays:
        raise FileError(f"'{file}' has no {name}; give M and K, or A")
    values = _real(arrays[name], name, file)
    values = values[None] if values.ndim == 2 else values
    if values.ndim != 3 or not values.size:
        raise FileError(
            f"'{file}': {name} has shape {np.shape(arrays[name])}; expected azimuths × rows × columns"
        )
    return values


def _vector(arrays: Mapping[str, Any], name: str, count: int, size: int, file: str) -> Array:
    """Array (k, n) of this name, over k azimuths; zero if it is missing. Raises FileError."""
    if name not in arrays:
        return np.zeros((count, size))
    values = _real(arrays[name], name, file)
    # A single vector, in MATLAB a row or column, is constant over the azimuth.
    if values.size == size and values.shape in ((size,), (size, 1)):
        values = values.reshape(1, -1)
    if values.ndim == 3 and values.shape[-1] == 1:
        values = values[..., 0]
    if values.ndim != 2 or values.shape[1] != size:
        raise FileError(f"'{file}': {name} has shape {values.shape}; expected azimuths × {size}")
    return values


def _real(values: Any, name: str, file: str) -> Array:
    """Values as an array. Raises FileError unless they are finite real numbers."""
    array = np.asarray(values)
    if array.dtype.kind not in "fiub":
        raise FileError(f"'{file}': {name} contains {array.dtype}; expected real numbers")
    array = array.astype(float)
    if not np.isfinite(array).all():
        raise FileError(f"'{file}': {name} has NaN or infinite entries; expected finite numbers")
    return array


def _require_shapes(arrays: Mapping[str, Array], shape: tuple[int, int], file: str) -> None:
    """Raise FileError unless the matrices at each azimuth have this shape."""
    for name, array in arrays.items():
        if array.shape[1:] != shape:
            raise FileError(
                f"'{file}': {name} has {array.shape[1]} × {array.shape[2]} entries; expected "
                f"{shape[0]} × {shape[1]}"
            )


def _repeated(array: Array, count: int) -> Array:
    """Repeat a constant array at every azimuth; return other arrays unchanged."""
    return np.repeat(array, count, axis=0) if len(array) == 1 else array


def _phases(arrays: Mapping[str, Any], file: str) -> Array | None:
    """Azimuths in rad; None if the file contains none."""
    return _real(arrays["phase"], "phase", file).ravel() if np.size(arrays.get("phase", ())) else None


def _number(arrays: Mapping[str, Any], name: str, file: str) -> float | None:
    """Number of this name; None if it is missing. Raises FileError."""
    if name not in arrays:
        return None
    values = _real(arrays[name], name, file).ravel()
    if len(values) != 1:
        raise FileError(f"'{file}': {name} has {len(values)} numbers; expected one")
    return float(values[0])


def _texts(arrays: Mapping[str, Any], name: str, file: str) -> list[str]:
    """Texts in the array of this name; empty if it is missing. Raises FileError."""
    if name not in arrays:
        return []
    texts = [np.asarray(text).ravel() for text in np.asarray(arrays[name]).ravel()]
    if any(len(text) != 1 or text.dtype.kind not in "US" for text in texts):
        raise FileError(f"'{file}': {name} must be an array of strings, one for each name")
    return [text[0].decode() if isinstance(text[0], bytes) else str(text[0]).strip() for text in texts]


def _checked_names(names: Sequence[str], count: int, kind: str, file: str) -> Sequence[str]:
    """Return the names. Raises FileError unless there are `count` of them."""
    if len(names) != count:
        raise FileError(f"'{file}' names {len(names)} {kind}; expected {count}, one for each row")
    return names


def _numbered(letter: str, count: int) -> list[str]:
    return [f"{letter}{number}" for number in range(1, count + 1)]
