"""`solve report`: everything about a model in one page."""

from typing import Annotated

from solve.commands.deliver import deliver_page
from solve.commands.groups import Accuracy, Flag, Problem, Speed, Speeds
from solve.commands.parse import out_file
from solve.views.page import ENDINGS
from solve.views.report import report as found


def report(
    problem: Problem,
    speeds: Speeds,
    speed: Speed,
    accuracy: Accuracy,
    out: Annotated[str | None, Flag("Where the page goes.", "FILE.html")] = None,
) -> None:
    """Everything about a model on one page of HTML."""
    file, model = out_file(out, ENDINGS, "report", "report.html"), problem.loaded(still=True)
    made = found(model, speeds.speeds, speed.speed, accuracy.rule, accuracy.rtol)
    deliver_page(made, file)
