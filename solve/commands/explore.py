"""Command `explore`: live window."""

from typing import Annotated

from solve.commands.groups import Problem, Speed
from solve.commands.parse import Flag
from solve.views.live.texts import Origin
from solve.views.live.window import run, server


def explore(
    problem: Problem,
    speed: Speed,
    port: Annotated[
        int | None, Flag("Port on this machine for the page; by default, a free one.", "N")
    ] = None,
    no_browser: Annotated[bool, Flag("Print the address of the page without opening it.")] = False,
) -> None:
    """Live window: a local page with sliders for speed and parameters."""
    model = problem.loaded(rigid=True)
    origin = Origin(problem.model, problem.cases)
    run(server(model, origin, speed.speed, 0 if port is None else port), not no_browser)
