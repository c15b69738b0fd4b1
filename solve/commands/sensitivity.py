"""`solve sensitivity`: what matters most."""

from typing import Annotated

import solve
from solve.commands.deliver import deliver_result
from solve.commands.groups import Flag, Problem, Results, Speed, Steps


def sensitivity(
    problem: Problem,
    speed: Speed,
    accuracy: Steps,
    results: Results,
    of: Annotated[
        list[str] | None,
        Flag("q3.max_abs, spectral_radius, rho1.abs, exponent1.re, …; repeatable.", "QUANTITY"),
    ] = None,
    by: Annotated[list[str] | None, Flag("Parameter, or speed; repeatable; all by default.", "NAME")] = None,
    nonlinear: Annotated[bool, Flag("Of the orbit of the nonlinear equations.")] = False,
) -> None:
    """What matters most: derivatives of quantities by parameters and the speed."""
    model = problem.loaded()
    asked = accuracy.rule, accuracy.steps, accuracy.rtol
    result = solve.sensitivities(model, speed.omega(model), of, by, *asked, nonlinear=nonlinear)
    deliver_result(results, result, problem.choices, result.notes)
