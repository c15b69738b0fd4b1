"""The chapter's three mechanisms: generated code, hand-coded equations, random parameters."""

import importlib
from functools import cache
from types import ModuleType

import casadi as ca
import numpy as np
from hypothesis import strategies as st

GENERATED = {
    name: importlib.import_module(f"generated.{name}") for name in ("cam", "manipulator", "gear_pair")
}
PUBLISHED = {name: importlib.import_module(f"models.{name}.published") for name in GENERATED}
GRID = 2 * np.pi * np.arange(64) / 64


@cache
def built(name: str, function: str, **options: str) -> ca.Function:
    """Return one function of a generated module."""
    return getattr(GENERATED[name], function)(**options)


def magnitudes() -> st.SearchStrategy[float]:
    """Strategy for positive numbers whose logarithm is evenly distributed over four decades."""
    return st.floats(-2.0, 2.0).map(lambda exponent: 10.0**exponent)


def allowed(bound: str) -> st.SearchStrategy[float]:
    if "integer" in bound:
        # Rounding of the argument n z1 φ alone comes near 1e-12 where z1 is 40.
        return st.integers(1, 20).map(float)
    if bound == "> 0":
        return magnitudes()
    assert bound in ("", ">= 0"), f"the tests know no bound {bound!r}"
    return st.floats(0.0 if bound else -100.0, 100.0, allow_subnormal=False)


def parameter_sets(module: ModuleType) -> st.SearchStrategy[dict[str, float]]:
    """Strategy for random values of all parameters within their declared bounds."""
    return st.fixed_dictionaries({name: allowed(bound) for name, _, _, bound in module.PARAMETERS})


def vector(name: str, p: dict[str, float]) -> list[float]:
    """Return the parameters in the order of the generated module."""
    return [p[each] for each, *_ in GENERATED[name].PARAMETERS]


def sampled(function: ca.Function, phases: np.ndarray, speed: float, p: list[float]) -> list[np.ndarray]:
    """Return M, C, K (m, n, n) and d (m, n) from a function of phase, speed and p."""
    *square, d = (part.full() for part in function(phases[None], speed, p))
    n, count = d.shape
    return [part.reshape(n, count, n).transpose(1, 0, 2) for part in square] + [d.T]


def scaled_difference(first: np.ndarray, second: np.ndarray) -> float:
    """Largest difference of any entry over the cycle, divided by that entry's largest value.

    An entry that vanishes in `second` must vanish exactly in `first`.
    """
    scale = np.abs(second).max(axis=0)
    difference = np.abs(first - second).max(axis=0)
    assert np.all(difference[scale == 0] == 0), "an entry that must vanish does not"
    return float((difference / np.where(scale == 0, 1, scale)).max())
