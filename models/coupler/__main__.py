"""The command of the flexible coupler: `python -m models.coupler`."""

import sys
from collections.abc import Sequence
from typing import Annotated

from solve.commands.app import application
from solve.commands.app import run as run_commands
from solve.commands.groups import Flag, Numbers, Results, Speed

_NAME = "python -m models.coupler"


def picture(
    plot: Annotated[str, Flag("The picture: .png, .pdf or .svg.", "FILE")],
    numbers: Numbers,
    speed: Speed,
    positions: Annotated[int, Flag("Crank positions, evenly over the turn: up to 12.", "N")] = 8,
    magnification: Annotated[
        float | None, Flag("Factor of the deflection; by default a round number that fits.", "M")
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


app = application(_NAME, (picture,), None, f'{_NAME} --speed "600 rpm" --plot bent.png')


def run(arguments: Sequence[str]) -> int:
    """Run the command and return its exit status: 2 with one line on standard error for bad input."""
    return run_commands(arguments, app, _NAME)


def main() -> None:
    """Entry point of the module."""
    sys.exit(run(sys.argv[1:]))


if __name__ == "__main__":
    main()
