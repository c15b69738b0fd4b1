"""A method from its name and settings."""

from collections.abc import Callable
from typing import Any

from solve.errors import ValueOutOfBoundsError, require_name
from solve.methods.auto import Rule, auto
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
    """Names of what a method can be told."""
    return set(getattr(METHODS[method], "__dataclass_fields__", ()))
