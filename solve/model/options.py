"""Options of a model: the value of each, given or by default."""

import re
from collections.abc import Mapping, Sequence
from types import ModuleType
from typing import Any

import numpy as np

from solve.errors import UnknownNameError, ValueOutOfBoundsError

REDUCE = "reduce"
"""Option of every beam structure: number of modes retained per link. It is contained in the options only if
given."""


def checked_options(module: ModuleType, given: Mapping[str, Any]) -> dict[str, Any]:
    """Every option's value: the given or the default one. Raises UnknownNameError and
    ValueOutOfBoundsError."""
    of_links, of_motion = getattr(module, "LINK_OPTIONS", ()), getattr(module, "MOTION_OPTIONS", ())
    declared = (*module.OPTIONS, *of_links, *of_motion)
    allowed = {name: values for name, values, _ in declared}
    options: dict[str, Any] = {name: default for name, _, default in declared}
    for name, value in given.items():
        if name == REDUCE and name not in allowed:
            options[name] = _modes_a_link(module, value)
            continue
        if name not in allowed:
            raise UnknownNameError(f"option of {module.NAME}", name, allowed)
        checked = _link_by_link if name in {each for each, *_ in of_links} else _checked_option
        options[name] = checked(module, name, value, allowed[name])
    return options


def _modes_a_link(module: ModuleType, value: Any) -> int:
    """Number of modes; the elements determine the allowed range when they are assembled."""
    if not hasattr(module, "LINKS"):
        raise ValueOutOfBoundsError(
            f"{module.NAME} is not a beam structure, and reduce requires one; omit reduce"
        )
    modes = _whole(value)
    if type(modes) is not int or modes < 1:
        raise ValueOutOfBoundsError(f"reduce is {value}; allowed: a number of modes per link, 1 or more")
    return modes


def _link_by_link(module: ModuleType, name: str, value: Any, allowed: Sequence[Any]) -> Any:
    """One value for all links, or a text of one for each, separated by commas."""
    parts = (
        value.split(",") if isinstance(value, str) else value if isinstance(value, list | tuple) else [value]
    )
    links = [link for link, *_ in module.LINKS]
    if len(parts) not in (1, len(links)):
        raise ValueOutOfBoundsError(
            f"option {name} of {module.NAME} has {len(parts)} values; give one for all links, or one for "
            f"each of {','.join(links)}"
        )
    chosen = [_checked_option(module, name, part, allowed) for part in parts]
    return chosen[0] if len(chosen) == 1 else ",".join(map(str, chosen))


def _checked_option(module: ModuleType, name: str, value: Any, allowed: Sequence[Any]) -> Any:
    chosen = _whole(value) if isinstance(allowed, range) else value
    if not any(type(chosen) is type(each) and chosen == each for each in allowed):
        if isinstance(allowed, range):
            bounds = f"a whole number from {allowed[0]} to {allowed[-1]}"
            raise ValueOutOfBoundsError(f"option {name} of {module.NAME} is {value}; allowed: {bounds}")
        raise UnknownNameError(f"value of option {name}", str(value), map(str, allowed))
    return chosen


def _whole(value: Any) -> Any:
    """A whole number that is written as one, or NumPy's; anything else as it is."""
    if isinstance(value, np.integer):
        return int(value)
    return int(value) if isinstance(value, str) and re.fullmatch("-?[0-9]+", value.strip()) else value
