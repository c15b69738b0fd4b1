"""`solve floquet`: stability alone."""

from solve.commands.deliver import deliver_result
from solve.commands.groups import OnePoint, Problem, Proving, Results, Speed
from solve.single import floquet as found


def floquet(problem: Problem, speed: Speed, accuracy: OnePoint, proving: Proving, results: Results) -> None:
    """Floquet multipliers, exponents and the verdict of stability."""
    model = problem.loaded()
    proving.require_provable(model)
    result = accuracy.solved(found, model, speed.omega(model))
    deliver_result(results, result, problem.choices, proof=proving.proof(result))
