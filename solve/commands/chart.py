"""`solve chart`: stability over two quantities."""

from collections.abc import Sequence
from typing import Annotated

from solve.commands.deliver import ContradictionError, deliver_result
from solve.commands.groups import Accuracy, Flag, Places, Problem, Results, Speed
from solve.commands.parse import assignments, points, quantities
from solve.errors import MissingValueError
from solve.model.model import Model
from solve.studies.chart import chart as found
from solve.units import speed_in_si, speeds_in_si

_RANGE = '"NAME=A:B:N unit"'


def chart(
    problem: Problem,
    speed: Speed,
    accuracy: Accuracy,
    places: Places,
    results: Results,
    x: Annotated[
        str | None, Flag("N values from A to B on the x axis; a speed needs its unit.", _RANGE)
    ] = None,
    y: Annotated[str | None, Flag("N values from A to B, upwards.", _RANGE)] = None,
    cut: Annotated[
        list[str] | None,
        Flag("Also along the line on which x or y has this value; repeatable.", "NAME=NUMBER[unit]"),
    ] = None,
    of: Annotated[
        str | None, Flag("Draw this over them: q3.max_abs, rho1.re, exponent1.re, …", "QUANTITY")
    ] = None,
    tolerance: Annotated[float, Flag("Accuracy of boundaries, as part of the ranges.", "R")] = 1e-9,
    prove: Annotated[bool, Flag("Prove verdicts on boxes that cover the chart; needs python-flint.")] = False,
) -> None:
    """Stability over two quantities, with named boundaries."""
    across, upwards = _axis("--x", x), _axis("--y", y)
    model = problem.loaded(varied={**across, **upwards})
    lines = [_held(text, model) for text in cut or []]
    omega = None if "speed" in {*across, *upwards} else speed.omega(model)
    asked = {"method": accuracy.rule, "rtol": accuracy.rtol, "tolerance": tolerance, "of": of, "prove": prove}
    with places.given() as given:
        result = found(model, across, upwards, omega, **asked, **given).with_cuts(lines)
    deliver_result(results, result, problem.choices, result.notes)
    if result.contradicted:
        raise ContradictionError(f"proved verdicts contradict {result.contradicted} points of the chart")


def _axis(flag: str, text: str | None) -> dict[str, Sequence[float | str]]:
    """{name: values in the model's own unit}. Raises MissingValueError, ValueOutOfBoundsError, UnitError."""
    if text is None:
        raise MissingValueError(
            f"no {flag} given; add {flag} NAME=A:B:N, N values of a parameter from A to B"
        )
    name, _, values = text.partition("=")
    if name.strip() == "speed":
        return {"speed": speeds_in_si(values)}
    return dict([points(flag, text)])


def _held(text: str, model: Model) -> tuple[str, float]:
    """Name and value, in the unit of the model, from NAME=NUMBER[unit]."""
    ((name, value),) = assignments("--cut", [text], "NAME=NUMBER").items()
    if name == "speed":
        return name, speed_in_si(value)
    return name, model.in_own_unit(name, quantities("--cut", [text])[name])
