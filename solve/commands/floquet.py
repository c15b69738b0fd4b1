"""`solve floquet`: stability alone."""

import solve
from solve.commands.deliver import deliver_result
from solve.commands.groups import Problem, Results, Speed, Steps


def floquet(problem: Problem, speed: Speed, accuracy: Steps, results: Results) -> None:
    """Floquet multipliers, exponents and the verdict of stability."""
    model = problem.loaded()
    result = solve.floquet(model, speed.omega(model), accuracy.rule, accuracy.steps, accuracy.rtol)
    deliver_result(results, result, problem.choices)
