"""Command `python -m models.portal_frame`: figure of a determinant that is nonzero at some of the natural
frequencies."""

import sys
from typing import Annotated

from models.portal_frame.determinant import determinants, determinants_figure
from solve.beams.structure import StructureModel
from solve.commands.groups import Flag, Numbers, Results
from solve.errors import ValueOutOfBoundsError
from solve.views.style import save_figure

_MOST = 1200.0


def command(
    plot: Annotated[str, Flag("Picture to write: .png, .pdf or .svg.", "FILE")],
    numbers: Numbers,
    most: Annotated[float, Flag("Largest frequency in rad/s.", "W")] = _MOST,
) -> None:
    """Draw the determinant of the frame's dynamic stiffness, with one and with two exact elements per bar."""
    (file, _) = Results(plot=plot).files()
    model = numbers.named_model("portal_frame", still=True)
    if not 1.0 <= most <= 1e5:
        raise ValueOutOfBoundsError(f"--most is {most}; allowed: 1 … 100000 rad/s, such as {_MOST:g}")
    assert isinstance(model, StructureModel)
    result = determinants(model, most)
    assert file is not None
    save_figure(determinants_figure(result), file)
    try:
        print(
            f"natural frequencies (rad/s): {', '.join(f'{value:.3f}' for value in result.found)}", flush=True
        )
    finally:
        print(f"wrote {file}", file=sys.stderr)
