"""`solve export`: the equations for another tool."""

from typing import Annotated

from solve.commands.deliver import print_warnings
from solve.commands.groups import Flag, Problem, Speed
from solve.commands.parse import out_file
from solve.exports.export import ENDINGS
from solve.exports.export import export as exported
from solve.exports.state_space import SAMPLES


def export(
    problem: Problem,
    speed: Speed,
    out: Annotated[str | None, Flag("Where they go: .mat, .c or .fmu by the file's ending.", "FILE")] = None,
    samples: Annotated[int, Flag("Phases of a period in a .mat file.", "N")] = SAMPLES,
) -> None:
    """The equations for another tool: MATLAB, C, or an FMU."""
    file = out_file(out, ENDINGS, "export", "cam.mat")
    made = exported(problem.loaded(), file, speed.speed, samples)
    print_warnings(made.warnings, made.files)
