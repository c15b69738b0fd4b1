"""`solve report`: everything about a model in one page."""

from typing import Annotated

from solve.commands.deliver import deliver_page
from solve.commands.groups import Accuracy, Flag, Problem, Speed, Speeds
from solve.errors import MissingValueError
from solve.reports.page import ENDINGS
from solve.reports.report import report as found
from solve.results.save import checked


def report(
    problem: Problem,
    speeds: Speeds,
    speed: Speed,
    accuracy: Accuracy,
    out: Annotated[str | None, Flag("Where the page goes.", "FILE.html")] = None,
) -> None:
    """Everything about a model on one page of HTML."""
    if out is None:
        raise MissingValueError("no file given; add one, such as --out report.html")
    file, model = checked(out, ENDINGS, "report"), problem.loaded(still=True)
    made = found(model, speeds.speeds, speed.speed, accuracy.rule, accuracy.rtol)
    deliver_page(made, file)
