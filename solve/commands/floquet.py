"""`solve floquet`: stability alone."""

from solve.commands.groups import Accuracy, Problem, Results, Settings, Speed


def floquet(problem: Problem, speed: Speed, accuracy: Accuracy, settings: Settings, results: Results) -> None:
    """Floquet multipliers, exponents and the verdict of stability."""
    results.files()
    model, of_case = problem.loaded()

    import solve
    from solve.commands.deliver import deliver
    from solve.results import contents, record, report

    result = solve.floquet(
        model, speed.omega(model, of_case), accuracy.chosen(settings), accuracy.steps, accuracy.rtol
    )

    def figure():
        from solve.results.plot import stability_figure

        return stability_figure(result)

    deliver(
        results,
        result.warnings,
        record=lambda: record.stability_record(result),
        report=lambda: report.stability_report(result, problem.choices),
        figure=figure,
        contents=lambda: contents.stability_contents(result),
    )
