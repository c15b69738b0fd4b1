"""`solve branch`: nonlinear orbits over the speed, through the speeds where they turn back."""

from typing import Annotated

from solve.commands.deliver import deliver_result
from solve.commands.groups import Flag, Problem, Results
from solve.errors import MissingValueError
from solve.newton.branches import branch as found


def branch(
    problem: Problem,
    results: Results,
    speeds: Annotated[str | None, Flag("From which speed, and up to which.", '"A:B unit"')] = None,
    points: Annotated[int, Flag("Points after which it ends.", "N")] = 200,
    rtol: Annotated[float, Flag("Error of the orbits, relative, to keep below.", "R")] = 1e-3,
    periods: Annotated[int, Flag("Orbits of K periods.", "K")] = 1,
    start: Annotated[str | None, Flag("Saved orbit or transient as the start.", "FILE")] = None,
) -> None:
    """Nonlinear orbits over the speed, followed through the speeds where they turn back."""
    if speeds is None:
        raise MissingValueError('no speeds given; add a range, such as --speeds "300:600 rpm"')
    result = found(problem.loaded(), speeds, start, points, rtol, periods=periods)
    deliver_result(results, result, problem.choices)
