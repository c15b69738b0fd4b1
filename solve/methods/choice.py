"""Selection of methods: automatic, or by name and settings."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.errors import ValueOutOfBoundsError, require_name
from solve.methods.bahgat_willmert import BahgatWillmert
from solve.methods.fourier import Fourier
from solve.methods.gauss import Gauss
from solve.methods.hill import Hill
from solve.methods.hsu import Hsu
from solve.methods.march import March
from solve.methods.method import Method
from solve.methods.modal import Modal
from solve.methods.newmark import Newmark
from solve.methods.radau import Radau
from solve.methods.runge_kutta import RungeKutta4
from solve.period.frozen import frozen
from solve.period.points import Points

Choice = Callable[[Points], Iterator[tuple[Method, Array]]]
"""Type of functions that assign methods to points. They return pairs of a method and the indices (k,) of its
points."""

Rule = Method | Choice

RESOLVABLE = 512
"""Phase advance ω_max T in rad up to which a grid of moderate size resolves even the fastest mode. A Gauss
method is then safe."""

_FEW = 9
"""Number of coordinates up to which order 13 is faster than order 9. With more coordinates, order 13 also
loses digits to round-off, because the systems of a step are larger."""

RADAU, _RADAU_OF_FEW, _GAUSS = Radau(), Radau(13), Gauss()
"""Methods that are reused for many systems. They cache the constants that depend on their order."""

_PHASES = 32
"""Number of phases at which coefficients are frozen for the selection. Chosen by judgement."""


def auto(points: Points) -> Iterator[tuple[Method, Array]]:
    """Select Gauss or Radau IIA for each point.

    Gauss is selected if the phase advance ω_max T of the fastest frozen mode per period is at most 512 rad;
    with 512 steps, ω_max h is then at most 1. Otherwise, Radau IIA is selected, because it damps modes that
    it does not resolve. For few coordinates, its order is 13, which requires half as many steps and less time
    than order 9."""
    is_stiff = frozen(points, _PHASES).exceeds_rate(RESOLVABLE / points.period)
    stiff, others = is_stiff.nonzero()[0], (~is_stiff).nonzero()[0]
    if len(stiff):
        yield damping(points.n), stiff
    if len(others):
        yield _GAUSS, others


def damping(coordinates: int) -> Radau:
    """Radau IIA method of the order that is faster for this number of coordinates: 13 for few coordinates,
    otherwise 9."""
    return _RADAU_OF_FEW if coordinates <= _FEW else RADAU


def chosen_for(method: Rule, points: Points) -> Iterator[tuple[Method, Array]]:
    """Assign a method to each point: `method` itself or, if it is a function such as `auto`, the method that
    it selects."""
    return iter([(method, np.arange(len(points)))]) if isinstance(method, Method) else method(points)


METHODS: dict[str, Callable[..., Any]] = {
    "auto": auto,
    "radau": Radau,
    "gauss": Gauss,
    "newmark": Newmark,
    "rk4": RungeKutta4,
    "fourier": Fourier,
    "hsu": Hsu,
    "hill": Hill,
    "march": March,
    "modal": Modal,
    "bahgat-willmert": BahgatWillmert,
}
"""Mapping from values of the argument `method` to methods."""


def chosen(method: str | Rule, **settings: Any) -> Rule:
    """Return the method with the name `method` and the given settings; settings that are None keep their
    defaults. For "auto", return the function `auto`. A method object is returned unchanged.

    Raises UnknownNameError for other names. Raises ValueOutOfBoundsError for other objects, and for settings
    that the method does not have."""
    if not isinstance(method, str):
        if not (isinstance(method, Method) or method is auto):
            raise ValueOutOfBoundsError(f"method is {method!r}; give a name or an object such as Radau()")
        return method
    require_name("method", method, METHODS)
    given = {name: value for name, value in settings.items() if value is not None}
    for name in given.keys() - settings_of(method):
        owners = sorted(each for each in METHODS if name in settings_of(each))
        raise ValueOutOfBoundsError(f"method {method} has no {name}; {name} belongs to {', '.join(owners)}")
    return auto if method == "auto" else METHODS[method](**given)


def settings_of(method: str) -> set[str]:
    """Names of the settings of the method with this name."""
    return set(getattr(METHODS[method], "__dataclass_fields__", ()))
