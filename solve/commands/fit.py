"""`solve fit`: parameters from measured vibration."""

from typing import Annotated

import solve
from solve.commands.deliver import deliver_result
from solve.commands.groups import Accuracy, Flag, Problem, Results, Speed
from solve.commands.parse import assignments
from solve.errors import MissingValueError, ValueOutOfBoundsError
from solve.results.files import checked
from solve.units import apart, quantity


def fit(
    problem: Problem,
    speed: Speed,
    accuracy: Accuracy,
    results: Results,
    data: Annotated[str | None, Flag("Measured vibration (.csv, .mat, .uff), with units.", "FILE")] = None,
    free: Annotated[str | None, Flag("Parameters to fit, with commas between.", "k1,k2")] = None,
    bounds: Annotated[
        list[str] | None, Flag("Bounds of a parameter, unit optional; repeatable.", '"NAME=A:B unit"')
    ] = None,
    robust: Annotated[bool, Flag("Outliers count by their moduli, not their squares.")] = False,
    toml: Annotated[str | None, Flag("Write the fitted model as a case file (.toml).", "FILE")] = None,
) -> None:
    """Parameters of the model from measured vibration, with intervals."""
    if data is None or free is None:
        missing = "--data FILE" if data is None else "--free NAME,NAME"
        raise MissingValueError(f"a fit needs what was measured and what is free; add {missing}")
    case = None if toml is None else checked(toml, [".toml"], "case")
    names, limits = [name.strip() for name in free.split(",") if name.strip()], _bounds(bounds)
    model = problem.loaded()
    given = speed.speed or model.case_speed
    result = solve.fit(model, data, names, limits, given, robust, accuracy.rule, accuracy.rtol)
    deliver_result(
        results, result, problem.choices, beside={} if case is None else {case: lambda: result.toml}
    )


def _bounds(texts: list[str] | None) -> dict[str, tuple[float | str, float | str]]:
    """Lower and upper bound by name, as texts if a unit follows. Raises ValueOutOfBoundsError."""
    found = {}
    for name, text in assignments("--bounds", texts or [], "NAME=A:B").items():
        try:
            numbers, _, unit = apart(text).partition(" ")
            low, high = (quantity(f"{each} {unit}".strip()) for each in numbers.split(":"))
        except ValueError:
            raise ValueOutOfBoundsError(
                f"--bounds {name}={text}: write two numbers in the model's unit, such as "
                f"--bounds {name}=1e4:1e6, or with a unit, such as '20:40 mm'"
            ) from None
        found[name] = low, high
    return found
