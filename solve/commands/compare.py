"""`solve compare`: methods side by side on one problem."""

from collections.abc import Mapping, Sequence
from typing import Annotated

from solve.commands.deliver import deliver_result
from solve.commands.groups import Flag, Problem, Results, Settings, Speed
from solve.errors import NoResultError
from solve.methods.choice import METHODS, Rule, chosen, settings_of
from solve.studies.compare import TARGETS
from solve.studies.compare import compare as compared


def compare(
    problem: Problem,
    speed: Speed,
    settings: Settings,
    results: Results,
    method: Annotated[
        list[str] | None, Flag("Method to compare; repeatable; all by default.", "NAME")
    ] = None,
    steps: Annotated[list[int] | None, Flag("Equal number of steps a period; repeatable.", "N")] = None,
    rtol: Annotated[
        list[float] | None,
        Flag(
            "Error to reach, of the orbit (multipliers, where there is no load); repeatable; 1e-3 and 1e-6 "
            "by default.",
            "R",
        ),
    ] = None,
) -> None:
    """Methods side by side: error, steps and time."""
    model = problem.loaded()
    omega, methods = speed.omega(model), _methods(method, settings.settings)
    result = compared(model, omega, methods, steps, rtol or TARGETS)
    if all(row.reason for row in result.rows):
        raise NoResultError(f"no method gives a result; {result.rows[0].method}: {result.rows[0].reason}")
    deliver_result(results, result, problem.choices)


def _methods(names: Sequence[str] | None, settings: Mapping[str, float | None]) -> list[Rule]:
    """The methods, each with those of the settings that it knows. Raises UnknownNameError, and
    ValueOutOfBoundsError for a setting that none of them knows."""
    asked = list(dict.fromkeys(names or [name for name in METHODS if name != "auto"]))
    known = {name: settings_of(name) for name in asked if name in METHODS}
    for setting, value in settings.items():
        if value is not None and not any(setting in fields for fields in known.values()):
            chosen(asked[0], **{setting: value})
    return [
        chosen(name, **{key: value for key, value in settings.items() if key in known.get(name, ())})
        for name in asked
    ]
