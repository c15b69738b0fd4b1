"""A model's commands as a program of their own: `python -m models.NAME`."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple, NoReturn

from solve.commands.door import door, enter
from solve.errors import SolveError

if TYPE_CHECKING:
    import typer


class Program(NamedTuple):
    """Commands under the name that the user types; listed: loads them, when one is called; about: what they
    are together, None for one alone; example: words of a call behind the name."""

    name: str
    listed: Callable[[], Sequence[Callable[..., None]]]
    about: str | None
    example: str

    def run(self, arguments: Sequence[str]) -> int:
        """Run one command and return its exit status: 2 with one line on standard error for bad input."""
        return door(self.name, self._called, arguments, SolveError)

    def main(self) -> NoReturn:
        """Entry point of the module."""
        enter(self.name, self._called, SolveError)

    def commands(self) -> "typer.Typer":
        """All of them, for Typer."""
        # Loaded within: an interruption may come while Python still reads the packages.
        from solve.commands.app import application

        return application(self.name, self.listed(), self.about, f"{self.name} {self.example}")

    def _called(self, arguments: Sequence[str]) -> int | None:
        from solve.commands.app import called

        return called(arguments, self.commands(), self.name)
