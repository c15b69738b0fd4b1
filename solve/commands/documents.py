"""Commands that write documents: `report`, `animate` and `export`."""

from typing import Annotated

import solve
from solve.commands.deliver import deliver_animation, deliver_page, print_warnings
from solve.commands.groups import Accuracy, Loop, Speed, Speeds
from solve.commands.parse import Flag, out_file, require_with
from solve.exports import export as exports
from solve.exports.state_space import SAMPLES
from solve.results.files import PICTURES
from solve.views import animation, page


def report(
    problem: Loop,
    speeds: Speeds,
    speed: Speed,
    accuracy: Accuracy,
    out: Annotated[str | None, Flag("File to write.", "FILE.html")] = None,
) -> None:
    """Report with all results of a model, as one HTML page."""
    file, model = out_file(out, page.ENDINGS, "report", "report.html"), problem.loaded(still=True)
    deliver_page(solve.report(model, speeds.speeds, speed.speed, accuracy.rule, accuracy.rtol), file)


def animate(
    problem: Loop,
    speed: Speed,
    accuracy: Accuracy,
    out: Annotated[
        str | None,
        Flag(
            "File to write: animation (.gif, .html), or picture of several positions (.png, .pdf, .svg).",
            "FILE",
        ),
    ] = None,
    scale: Annotated[
        float | None, Flag("Magnification of the vibration; by default, one that makes it visible.", "S")
    ] = None,
    frames: Annotated[
        int | None, Flag("Number of frames (default 90), or of positions in a picture (default 6).", "N")
    ] = None,
    show: Annotated[
        list[str] | None, Flag("Coordinate or output to draw as a curve; repeatable.", "NAME")
    ] = None,
    nonlinear: Annotated[bool, Flag("Use the orbit of the nonlinear equations.")] = False,
) -> None:
    """Animation or picture of the moving mechanism, with magnified vibration."""
    file = out_file(out, animation.ENDINGS, "animation", "cam.gif")
    animation.frame_count(frames, False, file.suffix.lower() in PICTURES)
    model, rule = problem.loaded(rigid=True), accuracy.rule
    result = solve.animate(model, speed.speed, scale, frames, show, nonlinear, rule, accuracy.rtol)
    deliver_animation(result, file)


def export(
    problem: Loop,
    speed: Speed,
    out: Annotated[str | None, Flag("File to write: .mat, .c or .fmu.", "FILE")] = None,
    samples: Annotated[
        int | None, Flag(f"Number of phases per period in a .mat file; {SAMPLES} by default.", "N")
    ] = None,
) -> None:
    """Equations exported to another tool: MATLAB, C, or an FMU."""
    file = out_file(out, exports.ENDINGS, "export", "cam.mat")
    require_with("--out FILE.mat", file.suffix.lower() == ".mat", {"--samples": samples})
    result = solve.export(problem.loaded(), file, speed.speed, SAMPLES if samples is None else samples)
    print_warnings(result.warnings, result.files)
