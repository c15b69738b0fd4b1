"""Command `python -m models.coupler`: figure of the vibrating coupler at several crank positions."""

import sys
from typing import Annotated

import solve
from models.coupler.picture import checked_magnification, checked_positions, coupler_figure
from solve.commands.groups import Flag, Numbers, Results, Speed
from solve.views.style import save_figure


def command(
    plot: Annotated[str, Flag("Picture to write: .png, .pdf or .svg.", "FILE")],
    numbers: Numbers,
    speed: Speed,
    positions: Annotated[int, Flag("Number of equidistant crank positions: up to 12.", "N")] = 8,
    magnification: Annotated[
        float | None, Flag("Magnification of the deflection; by default, a round number that fits.", "M")
    ] = None,
) -> None:
    """Draw the vibrating coupler at several crank positions, with magnified deflection."""
    (file, _) = Results(plot=plot).files()
    model = numbers.named_model("coupler")
    omega = speed.omega(model)
    checked_positions(positions)
    if magnification is not None:
        checked_magnification(magnification)
    orbit = solve.periodic(model, omega)
    assert file is not None
    save_figure(coupler_figure(model, orbit, positions, magnification), file)
    for line in [*(f"warning: {text}" for text in orbit.warnings), f"wrote {file}"]:
        print(line, file=sys.stderr)
