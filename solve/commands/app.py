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
        Name of the program on the command line.
    package : str
        Package that contains the modules of the commands.
    listed : mapping of str to str
        Mapping from commands to descriptions for `--help`: the first lines of the docstrings of the commands.
    about : str or None
        Description of the program; None for a program with a single command.
    example : str
        Arguments of an example for `--help`.
    modules : mapping of str to str
        Mapping from commands to modules, for commands whose module has another name.
    """

    name: str
    package: str
    listed: Mapping[str, str]
    about: str | None
    example: str
    modules: Mapping[str, str] = MappingProxyType({})

    def run(self, arguments: Sequence[str]) -> int:
        """Run one command and return its exit status. For invalid input, one line is printed on standard
        error, and the status is 2."""
        return command_line.run_cli(self.name, self._run_command, arguments, SolveError)

    def main(self) -> NoReturn:
        """Entry point of the program when its module is executed."""
        command_line.main(self.name, self._run_command, SolveError)

    def commands(self, called: str | None = None) -> "typer.Typer":
        """Return the commands as a Typer application. If there are several commands, only the called one is
        loaded."""
        # Imported here, so that an interruption by the user during the import is handled.
        from solve.commands.reading import application

        return application(self.name, self.listed, self.command, self.about, self.example, called)

    def command(self, name: str) -> Callable[..., None]:
        """Return the function that implements a command."""
        from importlib import import_module

        return getattr(import_module(f"{self.package}.{self.modules.get(name, name)}"), name)

    def _run_command(self, arguments: Sequence[str]) -> int | None:
        from solve.commands.reading import run_command

        return run_command(self.name, self.commands, arguments)


COMMANDS = {
    "periodic": "Periodic vibration, its spectrum and its stability.",
    "floquet": "Floquet multipliers, exponents and the stability verdict.",
    "compare": "Comparison of methods: error, steps and time.",
    "sweep": "Periodic vibration and stability at many speeds and parameter values.",
    "bands": "Unstable bands between the lowest and the highest speed, with refined edges.",
    "chart": "Stability as a function of two quantities, with labelled boundaries.",
    "critical": "Critical speeds: maxima of response and of multipliers, divisions ω̄/k of mean frequencies.",
    "modes": "Floquet modes versus speed or a parameter: frequencies, damping, veerings.",
    "transient": "Transient from initial conditions to the periodic orbit at constant speed; run-up or "
    "run-down.",
    "sensitivity": "Derivatives of quantities with respect to parameters and speed, at one or many speeds.",
    "fit": "Fit of parameters to measured vibration, with confidence intervals.",
    "optimise": "Optimal parameters: least vibration at several speeds, with stability and within bounds.",
    "tolerances": "Effects of parameter tolerances: probability of instability, Sobol indices, worst points.",
    "control": "Periodic feedback: optimal regulator and Kalman filter, and the closed loop.",
    "branch": "Branch of nonlinear orbits versus speed or a parameter, through its turning points.",
    "validity": "Linearisation error versus speed, and the speed up to which the linear model is valid.",
    "report": "Report with all results of a model, as one HTML page.",
    "animate": "Animation or picture of the moving mechanism, with magnified vibration.",
    "explore": "Live window: a local page with sliders for speed and parameters.",
    "export": "Equations exported to another tool: MATLAB, C, or an FMU.",
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
