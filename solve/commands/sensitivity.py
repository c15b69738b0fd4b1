"""`solve sensitivity`: what matters most."""

from typing import Annotated

import numpy as np

import solve
from solve.commands.deliver import deliver_result
from solve.commands.groups import Flag, Problem, Results, Speed, Speeds, Steps
from solve.errors import NoResultError, ValueOutOfBoundsError


def sensitivity(
    problem: Problem,
    speed: Speed,
    speeds: Speeds,
    accuracy: Steps,
    results: Results,
    of: Annotated[
        list[str] | None,
        Flag("q3.max_abs, spectral_radius, rho1.abs, exponent1.re, …; repeatable.", "QUANTITY"),
    ] = None,
    by: Annotated[list[str] | None, Flag("Parameter, or speed; repeatable; all by default.", "NAME")] = None,
    nonlinear: Annotated[bool, Flag("Of the orbit of the nonlinear equations.")] = False,
    periods: Annotated[
        int | None, Flag("With --nonlinear: an orbit of K periods; 1 by default.", "K")
    ] = None,
) -> None:
    """What matters most: derivatives by parameters and the speed, at one speed or at many."""
    if speed.speed is not None and speeds.speeds is not None:
        raise ValueOutOfBoundsError("--speed and --speeds both say at which speed; give one of them")
    if periods is not None and not nonlinear:
        raise ValueOutOfBoundsError(f"--periods {periods} requires --nonlinear; add it")
    model = problem.loaded()
    asked = of, by, accuracy.rule, accuracy.steps, accuracy.rtol
    if speeds.speeds is not None:
        found = solve.sensitivities_over(model, speeds.omegas(), *asked, nonlinear=nonlinear, periods=periods)
        return deliver_result(results, found, problem.choices)
    result = solve.sensitivities(model, speed.omega(model), *asked, nonlinear=nonlinear, periods=periods)
    if all(each.reason and np.isnan(each.derivatives).all() for each in result.found.values()):
        raise NoResultError("; ".join(each.reason for each in result.found.values()))
    return deliver_result(results, result, problem.choices, result.notes)
