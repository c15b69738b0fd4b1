"""Commands as programs: `solve`, and `python -m models.NAME` of a model's own."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple, NoReturn

from solve.errors import SolveError
from solve.terminal import command_line

if TYPE_CHECKING:
    import typer


class Program(NamedTuple):
    """Commands under the name that the user types.

    package: where each has a file and a function of its name. listed: a line about each, for the `--help` of
    all; of several also the first line of its own. about: what they are together, None for one alone.
    example: words of a call behind the name.
    """

    name: str
    package: str
    listed: Mapping[str, str]
    about: str | None
    example: str

    def run(self, arguments: Sequence[str]) -> int:
        """Run one command and return its exit status: 2 with one line on standard error for bad input."""
        return command_line.run_cli(self.name, self._called, arguments, SolveError)

    def main(self) -> NoReturn:
        """Entry point of the module."""
        command_line.main(self.name, self._called, SolveError)

    def commands(self, called: str | None = None) -> "typer.Typer":
        """All of them, for Typer; of several only the one that is called is loaded."""
        # Loaded within: an interruption may come while Python still reads the packages.
        from solve.commands.reading import application

        return application(self.name, self.listed, self.command, self.about, self.example, called)

    def command(self, name: str) -> Callable[..., None]:
        """The function of a command."""
        from importlib import import_module

        return getattr(import_module(f"{self.package}.{name}"), name)

    def _called(self, arguments: Sequence[str]) -> int | None:
        from solve.commands.reading import called

        return called(self.name, self.commands, arguments)


COMMANDS = {
    "periodic": "Periodic vibration, its spectrum and its stability.",
    "floquet": "Floquet multipliers, exponents and the verdict of stability.",
    "compare": "Methods side by side: error, steps and time.",
    "sweep": "Periodic vibration and stability over many speeds, and values of parameters.",
    "bands": "Unstable bands between the lowest and the highest speed, their edges refined.",
    "chart": "Stability over two quantities, with named boundaries.",
    "critical": "Critical speeds: largest response, dominant multiplier, integer divisions of frequencies.",
    "transient": "Start-up from any state, until the periodic vibration is reached; run-up to a speed.",
    "sensitivity": "What matters most: derivatives by parameters and the speed, at one speed or at many.",
    "fit": "Parameters of the model from measured vibration, with intervals.",
    "branch": "Nonlinear orbits over the speed, followed through the speeds where they turn back.",
    "validity": "How far the linear model is off over speed, and up to which speed to trust it.",
    "report": "Everything about a model on one page of HTML.",
    "animate": "The mechanism in motion, its vibration magnified, as an animation or a picture.",
    "export": "The equations for another tool: MATLAB, C, or an FMU.",
    "frequencies": "Natural frequencies and mode shapes with the drive held still.",
}
SOLVE = Program(
    "solve",
    "solve.commands",
    COMMANDS,
    "Steady-state vibration and stability of systems with periodic coefficients.",
    'periodic cam --case 1 --speed "600 rpm" --plot cam.png',
)
run = SOLVE.run
