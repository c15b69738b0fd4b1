"""The command of the portal frame: `python -m models.portal_frame`."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from solve.commands.door import door, enter
from solve.errors import SolveError

if TYPE_CHECKING:
    import typer

_NAME = "python -m models.portal_frame"


def run(arguments: Sequence[str]) -> int:
    """Run the command and return its exit status: 2 with one line on standard error for bad input."""
    return door(_NAME, _called, arguments, SolveError)


def commands() -> "typer.Typer":
    """The one that there is, for Typer."""
    from models.portal_frame.command import determinant
    from solve.commands.app import application

    return application(_NAME, (determinant,), None, f"{_NAME} --plot determinant.png")


def _called(arguments: Sequence[str]) -> int | None:
    from solve.commands.app import called

    return called(arguments, commands(), _NAME)


def main() -> None:
    """Entry point of the module."""
    enter(_NAME, _called, SolveError)


if __name__ == "__main__":
    main()
