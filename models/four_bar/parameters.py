"""The parameters of the four-bar, and their values from a case file."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from solve.errors import MissingValueError, UnknownNameError, ValueOutOfBoundsError
from solve.loading import holds
from solve.model.cases import read_cases
from solve.model.generated import ROOT, model_module

PARAMETERS = model_module(ROOT / "generated" / "four_bar.py").PARAMETERS
"""Name, unit, meaning and bound of each."""

CASES = Path(__file__).with_name("cases.toml")


class Chosen(NamedTuple):
    """The case's name, the speed that it names (a text with unit) or None, the values in SI units."""

    case: str
    speed: str | None
    parameters: dict[str, float]


def chosen(case: str | None, cases: Path, overrides: Mapping[str, float]) -> Chosen:
    """The values of a case, the file's first by default, and what replaces some of them.

    Raises UnknownNameError, CaseFileError, MissingValueError and ValueOutOfBoundsError.
    """
    units = {name: unit for name, unit, *_ in PARAMETERS}
    found = read_cases(cases, units)
    name = next(iter(found)) if case is None else case
    if name not in found:
        raise UnknownNameError(f"case of {cases.name}", name, found)
    for parameter in overrides:
        if parameter not in units:
            raise UnknownNameError("parameter of four_bar", parameter, units)
    values = {**found[name].parameters, **overrides}
    missing = [parameter for parameter in units if parameter not in values]
    if missing:
        raise MissingValueError(
            f"case '{name}' gives no value for {', '.join(missing)}; add it to the case file or set it: "
            f"{missing[0]}=NUMBER"
        )
    for parameter, unit, meaning, bound in PARAMETERS:
        value = values[parameter]
        if not (math.isfinite(value) and holds(bound, value)):
            raise ValueOutOfBoundsError(f"{parameter} ({meaning}) is {value:g} {unit}; allowed: {bound}")
    return Chosen(name, found[name].speed, {parameter: values[parameter] for parameter in units})
