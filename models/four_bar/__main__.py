"""The commands of the four-bar linkage: `python -m models.four_bar COMMAND`."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from solve.commands.door import door, enter
from solve.errors import SolveError

if TYPE_CHECKING:
    import typer

_NAME = "python -m models.four_bar"


def run(arguments: Sequence[str]) -> int:
    """Run one command and return its exit status: 2 with one line on standard error for bad input."""
    return door(_NAME, _called, arguments, SolveError)


def commands() -> "typer.Typer":
    """All of them, for Typer."""
    from models.four_bar.commands.corrected import corrected
    from models.four_bar.commands.curve import curve
    from models.four_bar.commands.design import design
    from models.four_bar.commands.elements import elements
    from models.four_bar.commands.linkage import linkage
    from models.four_bar.commands.modes import modes
    from models.four_bar.commands.study import study
    from solve.commands.app import application

    every = (linkage, elements, study, corrected, modes, curve, design)
    about = "The four-bar linkage of the thesis."
    example = f'{_NAME} linkage --speed "300 rpm" --coupler-point 0.164,0.1 --plot linkage.png'
    return application(_NAME, every, about, example)


def _called(arguments: Sequence[str]) -> int | None:
    from solve.commands.app import called

    return called(arguments, commands(), _NAME)


def main() -> None:
    """Entry point of the module."""
    enter(_NAME, _called, SolveError)


if __name__ == "__main__":
    main()
