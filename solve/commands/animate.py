"""`solve animate`: the mechanism in motion, its vibration magnified."""

from typing import Annotated

from solve.commands.deliver import deliver_animation
from solve.commands.groups import Accuracy, Flag, Problem, Speed
from solve.commands.parse import out_file
from solve.results.files import PICTURES
from solve.views.animation import ENDINGS, frame_count
from solve.views.animation import animate as made


def animate(
    problem: Problem,
    speed: Speed,
    accuracy: Accuracy,
    out: Annotated[
        str | None, Flag("The animation: .gif or .html; .png, .pdf or .svg for some positions.", "FILE")
    ] = None,
    scale: Annotated[
        float | None, Flag("Magnification of the vibration; by default so that it can be seen.", "S")
    ] = None,
    frames: Annotated[
        int | None, Flag("Frames, 90 by default; positions in a still, 6 by default.", "N")
    ] = None,
    show: Annotated[list[str] | None, Flag("Coordinate or output beside it; repeatable.", "NAME")] = None,
    nonlinear: Annotated[bool, Flag("The orbit of the nonlinear equations.")] = False,
) -> None:
    """The mechanism in motion, its vibration magnified, as an animation or a picture."""
    file = out_file(out, ENDINGS, "animation", "cam.gif")
    frame_count(frames, False, file.suffix.lower() in PICTURES)
    model, rule = problem.loaded(rigid=True), accuracy.rule
    animation = made(model, speed.speed, scale, frames, show, nonlinear, rule, accuracy.rtol)
    deliver_animation(animation, file)
