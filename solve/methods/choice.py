"""A method from its name and settings, or the rule that chooses one for a user who names none."""

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
"""From points to methods, each with the positions (k,) of the points that it is to solve."""

Rule = Method | Choice

RESOLVABLE = 512
"""ω_max T up to which a grid of moderate size follows even the fastest mode, so that Gauss is safe."""

_FEW = 9
"""Coordinates up to which a higher order takes less time; with more, rounding in the larger systems of a step
costs digits too."""

_PHASES = 32
"""At which the coefficients are frozen to see how fast their modes are."""


def auto(points: Points) -> Iterator[tuple[Method, Array]]:
    """Gauss where ω_max T, the angle that the fastest frozen mode turns in one period, is at most 512:
    then 512 steps have ω_max h ≤ 1. Radau IIA otherwise, which keeps no mode that it does not resolve; of
    order 13 where the stages of a step are few equations, which take half the steps and less time."""
    stiff = frozen(points, _PHASES).exceeds_rate(RESOLVABLE / points.period)
    damping = Radau(13) if points.n <= _FEW else Radau()
    for method, chosen in ((damping, stiff), (Gauss(), ~stiff)):
        if chosen.any():
            yield method, np.flatnonzero(chosen)


def chosen_for(method: Rule, points: Points) -> Iterator[tuple[Method, Array]]:
    """The method for all of the points, or those that a choice makes."""
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
"""Names that `method` takes."""


def chosen(method: str | Rule, **settings: Any) -> Rule:
    """The method of a name, with its settings (those that are None left out), or the choice `auto`; a method
    object as it is.

    Raises UnknownNameError, and ValueOutOfBoundsError for what is no method or a setting that the method
    does not have.
    """
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
    """Names of a method's settings."""
    return set(getattr(METHODS[method], "__dataclass_fields__", ()))
