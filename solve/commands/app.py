"""Programs with commands: `solve`, and `python -m models.NAME` for the commands of a model."""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple, NoReturn

from solve.errors import SolveError
from solve.terminal import command_line

if TYPE_CHECKING:
    import typer


class Program(NamedTuple):
    """Program with several commands.

    Parameters
    ----------
    name : str
        Name that the user types.
    package : str
        Package with a module for each command.
    listed : mapping of str to str
        Description of each command for `--help`: the first line of its docstring.
    about : str or None
        Description of the program; None for a program with a single command.
    example : str
        Arguments of an example.
    modules : mapping of str to str
        Module of each command; by default the module has the command's name.
    """

    name: str
    package: str
    listed: Mapping[str, str]
    about: str | None
    example: str
    modules: Mapping[str, str] = MappingProxyType({})

    def run(self, arguments: Sequence[str]) -> int:
        """Run one command and return its exit status. Invalid input prints one line on standard error and
        returns 2."""
        return command_line.run_cli(self.name, self._run_command, arguments, SolveError)

    def main(self) -> NoReturn:
        """Entry point of the program when its module is executed."""
        command_line.main(self.name, self._run_command, SolveError)

    def commands(self, called: str | None = None) -> "typer.Typer":
        """Commands as a Typer application. If there are several commands, only the called command is
        loaded."""
        # Imported here, so that an interruption during the import is handled.
        from solve.commands.reading import application

        return application(self.name, self.listed, self.command, self.about, self.example, called)

    def command(self, name: str) -> Callable[..., None]:
        """Function that implements a command."""
        from importlib import import_module

        return getattr(import_module(f"{self.package}.{self.modules.get(name, name)}"), name)

    def _run_command(self, arguments: Sequence[str]) -> int | None:
        from solve.commands.reading import run_command

        return run_command(self.name, self.commands, arguments)


COMMANDS = {
    "periodic": "Periodic vibration, its spectrum and its stability.",
    "floquet": "Floquet multipliers, exponents and the stability verdict.",
    "compare": "Comparison of methods: error, steps and time.",
    "sweep": "Periodic vibration and stability over many speeds, and values of parameters.",
    "bands": "Unstable bands between the lowest and the highest speed, with refined edges.",
    "chart": "Stability over two quantities, with named boundaries.",
    "critical": "Critical speeds: maxima of response and multipliers, divisions ω̄/k of mean frequencies.",
    "modes": "Floquet modes followed over the speed or a parameter: frequencies, damping, veerings.",
    "transient": "Transient at constant speed from given initial conditions to the periodic orbit; "
    "run-up, run-down.",
    "sensitivity": "Derivatives of quantities with respect to parameters and speed, at one or many speeds.",
    "fit": "Parameters of the model from measured vibration, with confidence intervals.",
    "optimise": "Optimum of parameters: least vibration over speeds, stable, within bounds.",
    "tolerances": "Tolerances of parameters: probability of instability, Sobol indices, worst points.",
    "control": "Periodic feedback: optimal regulator and Kalman filter, and the closed loop.",
    "branch": "Branch of nonlinear orbits over the speed or a parameter, through its turning points.",
    "validity": "Linearisation error over speed, and the speed up to which the linear model is valid.",
    "report": "Everything about a model on one page of HTML.",
    "animate": "Mechanism in motion with magnified vibration, as an animation or a picture.",
    "explore": "Live window: a local page with sliders for speed and parameters.",
    "export": "Equations for another tool: MATLAB, C, or an FMU.",
    "frequencies": "Natural frequencies and mode shapes with the drive held still.",
}
MODULES = {
    **dict.fromkeys(("periodic", "floquet", "compare", "transient"), "one_speed"),
    **dict.fromkeys(("sweep", "chart", "bands", "critical", "modes", "validity"), "many_speeds"),
    "branch": "branches",
    **dict.fromkeys(("sensitivity", "fit", "optimise", "tolerances", "frequencies"), "parameters"),
    **dict.fromkeys(("report", "animate", "export"), "documents"),
}
SOLVE = Program(
    "solve",
    "solve.commands",
    COMMANDS,
    "Steady-state vibration and stability of systems with periodic coefficients.",
    'periodic cam --case 1 --speed "600 rpm" --plot cam.png',
    MODULES,
)
run = SOLVE.run
