"""Command `branch`: orbits of the nonlinear equations versus speed and parameters."""

from typing import Annotated, Any

import solve
from solve.arguments import require_integer
from solve.commands.deliver import deliver_result
from solve.commands.groups import Problem, Results, Speed, Store, stored_in
from solve.commands.parse import Flag, require_with
from solve.errors import MissingValueError, ValueOutOfBoundsError
from solve.labels import in_own_unit
from solve.model.model import Model
from solve.newton.branches import range_of
from solve.results.branch import DOUBLING, FOLD
from solve.units import ramp_in_si


def branch(
    problem: Problem,
    speed: Speed,
    results: Results,
    speeds: Annotated[str | None, Flag("First and last speed of the branch.", '"A:B unit"')] = None,
    over: Annotated[
        list[str] | None,
        Flag("Vary a parameter, instead of the speed, from A to B; unit optional.", '"NAME=A:B unit"'),
    ] = None,
    switch: Annotated[bool, Flag("Also follow the branches that start at period doublings.")] = False,
    follow: Annotated[
        str | None,
        Flag("Follow folds or period doublings as two parameters vary; give --over twice.", "fold|doubling"),
    ] = None,
    scatter: Annotated[
        int | None,
        Flag("Find orbits from N random initial states; with a range, also the branches through them.", "N"),
    ] = None,
    begin: Annotated[
        str | None, Flag("Speed or parameter of the first orbit, within the range.", '"VALUE unit"')
    ] = None,
    seed: Annotated[
        int | None, Flag("With --scatter: seed of the random initial states; 0 by default.", "N")
    ] = None,
    spread: Annotated[
        float | None,
        Flag(
            "With --scatter: half-width of the range of initial states, relative to the linear orbit; 4 by "
            "default.",
            "R",
        ),
    ] = None,
    unforced: Annotated[
        bool, Flag("Follow nonlinear modes versus frequency, from the equations without load or damping.")
    ] = False,
    points: Annotated[int | None, Flag("Maximum number of points; 200 by default.", "N")] = None,
    rtol: Annotated[float, Flag("Relative tolerance of the orbits.", "R")] = 1e-3,
    periods: Annotated[int, Flag("Number of periods per orbit.", "K")] = 1,
    start: Annotated[
        str | None, Flag("Start from a saved orbit, transient, or result of --scatter.", "FILE")
    ] = None,
    store: Store = None,
) -> None:
    """Branch of nonlinear orbits versus speed or a parameter, through its turning points."""
    over, model = over or [], problem.loaded()
    for flag, text in (("--speeds", speeds), *(("--over", each) for each in over)):
        if text is not None and text.count(":") > 1:
            raise ValueOutOfBoundsError(
                f'{flag} is "{text}"; give only the first and last value, A:B, and the maximum number of '
                "points with --points"
            )
    if scatter is not None:
        require_integer("--scatter", scatter)
    if follow not in (None, FOLD, DOUBLING):
        raise ValueOutOfBoundsError(f"--follow is {follow}; allowed: {FOLD}, {DOUBLING}")
    require_with("--scatter N", scatter is not None, {"--seed": seed, "--spread": spread})
    if scatter is not None and (switch or follow or start or unforced):
        raise ValueOutOfBoundsError("--scatter excludes --switch, --follow, --start and --unforced")
    if follow is not None and (switch or unforced or speeds is not None or begin or store):
        raise ValueOutOfBoundsError(
            "--follow excludes --switch, --unforced, --speeds, --begin and --store; give two ranges with "
            "--over NAME=A:B twice"
        )
    if follow is not None and len(over) != 2:
        raise ValueOutOfBoundsError(
            f"--follow {follow} requires two ranges; give --over NAME=A:B twice; one may be the speed, "
            'such as --over "speed=300:600 rpm"'
        )
    if follow is None and len(over) > 1:
        raise ValueOutOfBoundsError("--over is given twice; give it once, or add --follow fold")
    if scatter is not None:
        is_range = bool(over) or speeds is not None
        require_with("--speeds or --over", is_range, {"--points": points, "--store": store})
    if follow is None and (scatter is None or over or speeds is not None):
        _require_one_range(speed, speeds, over)
    over_one, constant = (over[0], speed.speed) if over else (None, speeds)
    found: Any = start
    if scatter is not None:
        at_begin, omega = _at_begin(model, speed.speed, speeds, over_one, begin)
        box: dict[str, Any] = {
            name: value for name, value in (("seed", seed), ("spread", spread)) if value is not None
        }
        found = solve.scatter(at_begin, omega, scatter, periods=max(2, periods), rtol=min(rtol, 1e-6), **box)
    settings: dict[str, Any] = {"start": found, "points": 200 if points is None else points, "rtol": rtol}
    if follow is not None:
        result = solve.special_curves(model, follow, over, speed.speed, periods, **settings)
    elif scatter is not None and not over and speeds is None:
        result = found
    elif scatter is not None:
        with stored_in(store):
            result = solve.branch(model, constant, over_one, **settings, store=store)
    else:
        settings |= {"unforced": unforced, "begin": begin, "store": store}
        with stored_in(store):
            result = solve.branch(model, constant, over_one, switch, periods, **settings)
    deliver_result(results, result, problem.choices)


def _at_begin(
    model: Model, speed: float | str | None, speeds: str | None, over: str | None, begin: str | None
) -> tuple[Model, float | str | None]:
    """Return the model and the speed of the first orbit of a branch. The varied quantity, which is the speed
    or a parameter, has the value of --begin or, by default, the first value of its range."""
    if over is not None:
        name, first, _ = range_of(model, over)
        return model.varied({name: first if begin is None else in_own_unit(model, name, begin)}), speed
    if speeds is not None:
        return model, ramp_in_si(speeds)[0] if begin is None else begin
    if begin is not None:
        raise ValueOutOfBoundsError(
            "--begin requires a range; add --speeds or --over, or replace --begin by --speed"
        )
    return model, speed


def _require_one_range(speed: Speed, speeds: str | None, over: list[str]) -> None:
    """Raise MissingValueError or ValueOutOfBoundsError unless either the speed or one parameter varies."""
    if speeds is None and not over:
        raise MissingValueError(
            'no speeds given; add a range, such as --speeds "300:600 rpm", or a parameter: --over NAME=A:B'
        )
    if not over and speed.speed is not None:
        raise ValueOutOfBoundsError(
            "--speed is a constant speed, and nothing varies; add --over NAME=A:B, or give --speeds instead"
        )
    if over and speeds is not None:
        raise ValueOutOfBoundsError(
            "--over and --speeds are both given; give --over, with --speed if needed, or --speeds"
        )
