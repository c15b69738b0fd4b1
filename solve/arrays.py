"""The array type of this package: NumPy, float64 unless a docstring says complex."""

from typing import Any

from numpy.typing import NDArray

Array = NDArray[Any]
