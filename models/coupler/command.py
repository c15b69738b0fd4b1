"""`python -m models.coupler`: the vibrating coupler at several crank positions."""

import sys
from typing import Annotated

import typer

from solve.commands.groups import Numbers, Results, Speed
from solve.commands.parse import number, whole


def picture(
    plot: Annotated[str, typer.Option(metavar="FILE", help="The picture: .png, .pdf or .svg.")],
    numbers: Numbers,
    speed: Speed,
    positions: Annotated[
        int, typer.Option(metavar="N", parser=whole, help="Crank positions, evenly over the turn: up to 12.")
    ] = 8,
    magnification: Annotated[
        float | None,
        typer.Option(
            metavar="M", parser=number, help="Factor of the deflection; by default a round number that fits."
        ),
    ] = None,
) -> None:
    """Draw the vibrating coupler at several crank positions, its deflection magnified."""
    (file, _) = Results(plot=plot).files()
    model = numbers.of("coupler")
    omega = speed.omega(model)

    import solve
    from models.coupler.picture import checked_magnification, checked_positions, coupler_figure
    from solve.results.style import save_figure

    checked_positions(positions)
    if magnification is not None:
        checked_magnification(magnification)
    orbit = solve.periodic(model, omega)
    assert file is not None
    save_figure(coupler_figure(model, orbit, positions, magnification), file)
    for line in [*(f"warning: {text}" for text in orbit.warnings), f"wrote {file}"]:
        print(line, file=sys.stderr)
