"""Compiled kernels of lanes.c. Their vector registers contain points, or segments of one period."""

import ctypes
import logging
from collections.abc import Callable, Mapping
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from solve.arrays import Array
from solve.kernel.compiler import CompilerError, compiled

INSTEAD = "NumPy is used, several times slower"
"""Consequence of a missing compiler, in messages."""

_LOGGER = logging.getLogger(__name__)
_SOURCE = Path(__file__).with_name("lanes.c")
_first: Callable[[Any], ctypes.c_char] = ctypes.c_char.from_buffer
_address: Callable[[Any], int] = ctypes.addressof


class Size(NamedTuple):
    """Sizes for which a library is compiled.

    n: number of coordinates. stages: number of stages. nodes: number of accelerations per step that define
    the curve. stiff: whether a step ends at a stage. orbit: whether orbits are computed. first_order: number
    of first-order coordinates, which come last."""

    n: int
    stages: int
    nodes: int
    stiff: bool
    orbit: bool
    first_order: int = 0


class _Problem(ctypes.Structure):
    """Structure `problem` of lanes.c."""

    _fields_ = (
        ("groups", ctypes.c_long),
        ("steps", ctypes.c_long),
        ("jumps", ctypes.c_int),
        ("terms", ctypes.c_int),
        ("own", ctypes.c_int),
        *((name, ctypes.c_void_p) for name in ("entry", "stages", "nodes", "h", "coefficients")),
        *((name, ctypes.c_void_p) for name in ("A", "A2", "b", "bA", "c", "powers")),
        *((name, ctypes.c_void_p) for name in ("Phi", "units", "condition", "curves", "maps")),
    )


@lru_cache
def library(size: Size) -> ctypes.CDLL:
    """Library for the given sizes. Raises CompilerError."""
    names = ("N", "S", "NODES", "STIFF", "ORBIT", "P")
    sizes = *size[:-1], size.n - size.first_order
    return compiled(_SOURCE, dict(zip(names, map(int, sizes), strict=True)))


def lanes(size: Size) -> int:
    """Number of values per vector register in a library for this machine. Raises CompilerError."""
    return ctypes.c_int.in_dll(library(size), "lanes").value


@lru_cache
def trouble() -> str:
    """Reason why compilation is impossible on this machine, or an empty string."""
    try:
        library(Size(1, 1, 2, True, False))
    except CompilerError as error:
        return str(error)
    return ""


@lru_cache
def available(size: Size) -> bool:
    """Whether a library for the given sizes is available. If not, the reason is logged."""
    try:
        library(size)
    except CompilerError as error:
        _LOGGER.warning("%s; %s", error, INSTEAD)
        return False
    return True


@lru_cache
def loaded(source: str, sizes: tuple[tuple[str, int], ...], formulas: str = "") -> ctypes.CDLL | None:
    """Library from another C file of this package. If it is not available, the reason is logged and None is
    returned."""
    try:
        return compiled(_SOURCE.with_name(source), dict(sizes), formulas)
    except CompilerError as error:
        _LOGGER.warning("%s; %s", error, INSTEAD)
        return None


def address(numbers: Array) -> int:
    """Memory address of a contiguous array. `ndarray.ctypes` would take four times as long."""
    try:
        return ctypes.addressof(_first(numbers))
    except (TypeError, ValueError):
        # The buffer protocol, as used above, rejects read-only and empty arrays.
        return numbers.ctypes.data


def addresses(arrays: Mapping[str, Array]) -> dict[str, int]:
    """Mapping from names to the addresses of arrays."""
    try:
        return {name: _address(_first(numbers)) for name, numbers in arrays.items()}
    except (TypeError, ValueError):
        return {name: address(numbers) for name, numbers in arrays.items()}


class Constants(dict[str, Array]):
    """Mapping from names to contiguous arrays that do not change. Their addresses are computed once."""

    @cached_property
    def addresses(self) -> dict[str, int]:
        """Mapping from names to addresses."""
        return addresses(self)


def run(
    kernel: str, size: Size, constants: Constants, arrays: Mapping[str, Array], entry: Array, **numbers: float
) -> None:
    """Call a kernel. Arrays and numbers are passed by their names in the C structure `problem`; the kernel
    writes results into the arrays.

    Raises CompilerError, MemoryError."""
    indices = np.ascontiguousarray(entry, dtype=np.intc)
    problem = _Problem(entry=address(indices), **constants.addresses, **addresses(arrays), **numbers)
    if getattr(library(size), kernel)(ctypes.byref(problem)):
        raise MemoryError(f"not enough memory for {numbers['steps']} steps of {size.n} coordinates")


__all__ = [
    "INSTEAD",
    "CompilerError",
    "Constants",
    "Size",
    "address",
    "addresses",
    "available",
    "lanes",
    "library",
    "loaded",
    "run",
    "trouble",
]
