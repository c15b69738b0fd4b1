"""Command `branch`: orbits of the nonlinear equations over the speed and parameters."""

from typing import Annotated, Any

import solve
from solve.commands.deliver import deliver_result
from solve.commands.groups import Flag, Problem, Results, Speed
from solve.errors import MissingValueError, ValueOutOfBoundsError


def branch(
    problem: Problem,
    speed: Speed,
    results: Results,
    speeds: Annotated[str | None, Flag("First and last speed.", '"A:B unit"')] = None,
    over: Annotated[
        list[str] | None,
        Flag("Vary a parameter from A to B instead of the speed; unit optional.", '"NAME=A:B unit"'),
    ] = None,
    switch: Annotated[bool, Flag("Also follow the branches that begin at period doublings.")] = False,
    follow: Annotated[
        str | None, Flag("Follow folds or doublings over two parameters; give --over twice.", "fold|doubling")
    ] = None,
    scatter: Annotated[
        int | None, Flag("Instead of a branch: orbits reached from N random initial states.", "N")
    ] = None,
    seed: Annotated[int, Flag("Seed of the random initial states.", "N")] = 0,
    spread: Annotated[
        float, Flag("Half width of the range of initial states, relative to the linear orbit.", "R")
    ] = 4.0,
    unforced: Annotated[
        bool, Flag("Nonlinear modes over their frequency: equations without load and damping.")
    ] = False,
    points: Annotated[int, Flag("Maximum number of points.", "N")] = 200,
    rtol: Annotated[float, Flag("Relative tolerance of the orbits.", "R")] = 1e-3,
    periods: Annotated[int, Flag("Number of periods per orbit.", "K")] = 1,
    start: Annotated[
        str | None, Flag("Saved orbit or transient from which the branch starts.", "FILE")
    ] = None,
) -> None:
    """Branch of nonlinear orbits over the speed or a parameter, through its turning points."""
    over, model = over or [], problem.loaded()
    if scatter is not None:
        if over or speeds or switch or follow or start or unforced:
            raise ValueOutOfBoundsError(
                "--scatter excludes --over, --speeds, --switch, --follow, --start and --unforced; give one "
                "speed with --speed or --case"
            )
        scattered = solve.scatter(
            model, speed.speed, scatter, seed, periods=max(2, periods), rtol=min(rtol, 1e-6)
        )
        deliver_result(results, scattered, problem.choices)
        return
    if follow is not None and (switch or unforced or speeds is not None):
        raise ValueOutOfBoundsError(
            "--follow excludes --switch, --unforced and --speeds; give two ranges with --over NAME=A:B twice"
        )
    if follow is None and len(over) > 1:
        raise ValueOutOfBoundsError("--over is given twice; give it once, or add --follow fold")
    if follow is None:
        _require_one_range(speed, speeds, over)
    settings: dict[str, Any] = {"periods": periods, "start": start, "points": points, "rtol": rtol}
    if follow is not None:
        result = solve.special_curves(model, follow, over, speed.speed, **settings)
    else:
        constant = speed.speed if over else speeds
        over_one = over[0] if over else None
        result = solve.branch(model, constant, over_one, switch, **settings, unforced=unforced)
    deliver_result(results, result, problem.choices)


def _require_one_range(speed: Speed, speeds: str | None, over: list[str]) -> None:
    """Raise MissingValueError or ValueOutOfBoundsError unless exactly one of speed and parameter varies."""
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
