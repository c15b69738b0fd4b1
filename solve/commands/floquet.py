"""`solve floquet`: stability alone."""

import solve
from solve.commands.deliver import deliver
from solve.commands.groups import Accuracy, Problem, Results, Settings, Speed
from solve.results.orbit_report import stability_record, stability_report


def floquet(problem: Problem, speed: Speed, accuracy: Accuracy, settings: Settings, results: Results) -> None:
    """Floquet multipliers, exponents and the verdict of stability."""
    results.files()
    model, of_case = problem.loaded()
    result = solve.floquet(
        model, speed.omega(model, of_case), accuracy.chosen(settings), accuracy.steps, accuracy.rtol
    )
    deliver(
        results,
        result.warnings,
        record=lambda: stability_record(result),
        report=lambda: stability_report(result, problem.choices),
        figure=result.plot,
        contents=result.contents,
    )
