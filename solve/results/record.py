"""Plain data, the keys of `--json`: NaN and infinity become None, complex numbers [re, im] or None."""

import cmath
import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from solve.system import PeriodicSystem


def plain(value: Any) -> Any:
    """Python's own numbers, lists and dictionaries.

    >>> plain({"rho": np.array([0.5 + 0.25j]), "error": math.nan})
    {'rho': [[0.5, 0.25]], 'error': None}
    """
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, complex | np.complexfloating):
        return [float(value.real), float(value.imag)] if cmath.isfinite(value) else None
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, np.integer | np.bool_):
        return value.item()
    if isinstance(value, Iterable) and not isinstance(value, str):
        return [plain(item) for item in value]
    return value


def model_record(system: PeriodicSystem) -> dict[str, Any]:
    """Which model, with which numbers; a system of a user's own has neither case nor parameters."""
    return {
        "model": system.name,
        "case": system.case,
        "parameters": dict(system.parameters),
        "options": dict(system.options),
    }
