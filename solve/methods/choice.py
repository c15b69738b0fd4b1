"""A method from its name and settings."""

from typing import Any

from solve.errors import UnknownNameError, ValueOutOfBoundsError
from solve.methods.auto import Auto
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

METHODS: dict[str, type] = {
    "auto": Auto,
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


def chosen(method: str | Method, **settings: Any) -> Method:
    """The method of a name, with its settings (those that are None left out); a method object as it is.

    Raises UnknownNameError, and ValueOutOfBoundsError for what is no method or a setting that the method
    does not have.
    """
    if not isinstance(method, str):
        if isinstance(method, type) or not hasattr(method, "solution"):
            raise ValueOutOfBoundsError(f"method is {method!r}; give a name or an object such as Radau()")
        return method
    if method not in METHODS:
        raise UnknownNameError("method", method, METHODS)
    kind = METHODS[method]
    given = {name: value for name, value in settings.items() if value is not None}
    known = set(kind.__dataclass_fields__)
    for name in given.keys() - known:
        owners = sorted(n for n, k in METHODS.items() if name in k.__dataclass_fields__)
        raise ValueOutOfBoundsError(f"method {method} has no {name}; {name} belongs to {', '.join(owners)}")
    return kind(**given)
