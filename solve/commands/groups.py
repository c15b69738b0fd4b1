"""Groups of flags that several commands share. Each group is a dataclass.

The parameters of a command are groups. `flattened.py` converts the fields of the groups to flags of the
command, for Typer.
"""

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from dataclasses import dataclass, fields
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from solve.commands.parse import Flag, assignments, quantities, require_with, spread
from solve.errors import DesiredMotionError, MissingValueError, ValueOutOfBoundsError
from solve.labels import SPEED, require_motion, speed_or_usual
from solve.loading import case_numbers, load, missing_parameters, model_of, parameter_units, setup_of
from solve.methods.choice import Rule, chosen
from solve.model.bounds import REDUCE, measured
from solve.model.cases import Case
from solve.model.model import Model
from solve.model.setup import Setup
from solve.readers.files import is_system_file
from solve.results.files import PICTURES, checked
from solve.results.save import checked_data
from solve.system import PeriodicSystem
from solve.units import speeds_in_si

if TYPE_CHECKING:
    from solve.proof.result import Proof
    from solve.results.stability import Stability


Varied = Mapping[str, Sequence[float | str]]
"""Type of mappings from names of parameters, or "speed", to values."""

_NONE: Varied = MappingProxyType({})
_NO_VALUES: Mapping[str, float | str] = MappingProxyType({})

_MOST_TRIALS = 4096
"""Maximum number of combinations of varied parameters that are tried to find one for which the model is
valid. Chosen by judgement, to limit the computing time."""


@dataclass(frozen=True)
class CaseNumbers:
    """Flags for the case and the parameter values, for commands whose model is fixed."""

    case: Annotated[str | None, Flag("Case of the case file; the first by default.", "NAME")] = None
    cases: Annotated[str | None, Flag("Case file (.toml) to use instead of the model's own.", "FILE")] = None
    set: Annotated[
        list[str] | None, Flag('Set a parameter, in its unit or as "30mm"; repeatable.', "NAME=NUMBER")
    ] = None

    def case_of(self, model: str) -> Case:
        """Return the selected case of a model, with its parameter values. Raises SolveError subclasses for
        bad input."""
        return case_numbers(model, self.case, self.cases, self.parameters)

    @property
    def parameters(self) -> dict[str, float | str]:
        """Mapping from the names in --set to values: numbers, or strings with a unit. Raises
        ValueOutOfBoundsError."""
        return quantities("--set", self.set or [])


@dataclass(frozen=True)
class Numbers(CaseNumbers):
    """Flags for the case, the parameter values and the options, for commands whose model is fixed."""

    option: Annotated[list[str] | None, Flag("Choose an option of the model; repeatable.", "NAME=VALUE")] = (
        None
    )

    def named_model(
        self, name: str, still: bool = False, rigid: bool = False, varied: Varied = _NONE
    ) -> Model:
        """Return the model with this name. Raises NoMotionError for a model without equations of motion
        unless `still` is True, and NoVibrationError for a model without coordinates unless `rigid` is
        True."""
        model = self._first_model(name, varied)
        if not still and (model.labels.vibrates or not rigid):
            require_motion(model)
        return model

    def _first_model(self, name: str, varied: Varied) -> Model:
        """Return the model for the first combination of values of the varied parameters that is within the
        bounds. If no combination is within the bounds, the exception for the first combination is raised."""
        try:
            return model_of(self.setup(name, {parameter: values[0] for parameter, values in varied.items()}))
        except (ValueOutOfBoundsError, DesiredMotionError):
            unset = self.unset(name)
            ranges = {parameter: values for parameter, values in varied.items() if parameter in unset}
            for trial in spread(ranges, _MOST_TRIALS):
                with suppress(ValueOutOfBoundsError, DesiredMotionError):
                    return model_of(self.setup(name, trial))
            raise

    def unset(self, name: str) -> list[str]:
        """Return the parameters of the named model that have a value neither in the case nor in --set."""
        return missing_parameters(name, self.case, self.cases, self.parameters)

    def setup(self, name: str, values: Mapping[str, float | str] = _NO_VALUES) -> Setup:
        """Return the setup of the named model. `values` supplies parameters that neither the case nor --set
        specifies. Raises SolveError subclasses for bad input."""
        missing = {parameter: value for parameter, value in values.items() if parameter != SPEED}
        return setup_of(name, self.case, self.cases, self.options, self.parameters, missing)

    @property
    def options(self) -> dict[str, Any]:
        """Mapping from the names in --option to values. Raises ValueOutOfBoundsError."""
        return assignments("--option", self.option or [])

    @property
    def choices(self) -> list[str]:
        """List of the texts given with --set and --option."""
        return [*(self.set or []), *(self.option or [])]


@dataclass(frozen=True, kw_only=True)
class Problem(Numbers):
    """Argument and flags that select a model, its case, parameters and options."""

    model: Annotated[
        str,
        typer.Argument(
            metavar="MODEL",
            help="A model's name, the path of a mechanism file or of a system in Python (.py), or a path or "
            "pattern of matrices (.lin, .mat, .npz, .nc, .mtx, .op4) or an FMU (.fmu).",
        ),
    ]
    reduce: Annotated[
        int | None, Flag("For structures of beams: retain K modes per link; the error is estimated.", "K")
    ] = None

    @property
    def options(self) -> dict[str, Any]:
        options = super().options
        if self.reduce is None:
            return options
        if REDUCE in options:
            raise ValueOutOfBoundsError("--reduce and --option reduce are both given; give one of them")
        return {**options, REDUCE: self.reduce}

    def loaded(self, still: bool = False, rigid: bool = False, varied: Varied = _NONE) -> Any:
        """Return the named model, see `named_model`, or the system read from other files, see `solve.load`.
        Raises SolveError subclasses."""
        if not is_system_file(self.model):
            return self.named_model(self.model, still, rigid, varied)
        if self.cases is not None:
            raise ValueOutOfBoundsError(f"'{self.model}' has no cases; omit --cases")
        options = assignments("--option", self.option or [])
        return load(self.model, self.case, options, self.reduce, **self.parameters)

    def numbers_set(self) -> str:
        """Return a string with the values of --set in the model's units, and in the case's units where these
        differ; empty if the model needs further values."""
        if is_system_file(self.model):
            return ""
        try:
            case, texts = self.case_of(self.model), []
        except MissingValueError:
            return ""
        units = parameter_units(self.model)
        for name, value in self.parameters.items():
            text = f"{measured(case.parameters[name], units[name])} for {name}"
            case_unit = case.units.get(name)
            if isinstance(value, float) and case_unit not in (None, units[name]):
                text += f", which the case gives in {case_unit}"
            texts.append(text)
        return "; ".join(texts)


@dataclass(frozen=True, kw_only=True)
class Loop(Problem):
    """Argument and flags that select a model and a saved controller."""

    controller: Annotated[
        str | None, Flag("Close the loop with a controller saved by solve control: .npz or .nc.", "FILE")
    ] = None

    def loaded(self, still: bool = False, rigid: bool = False, varied: Varied = _NONE) -> Any:
        model = super().loaded(still, rigid, varied)
        if self.controller is None:
            return model
        from solve.studies.control.closed_loop import closed_loop

        return closed_loop(model, self.controller)


@dataclass(frozen=True)
class Speed:
    """Flag for one speed of rotation."""

    speed: Annotated[
        str | None, Flag("Speed with unit (rpm, rad/s, Hz); by default the speed of the case.", '"600 rpm"')
    ] = None

    def omega(self, model: PeriodicSystem) -> float:
        """Return Ω in rad/s, from the flag or, if it is absent, from the case. Raises MissingValueError."""
        return speed_or_usual(model, self.speed)


@dataclass(frozen=True)
class Speeds:
    """Flag for several speeds of rotation."""

    speeds: Annotated[
        str | None, Flag('N speeds from A to B, or a list: "600 900 1200 rpm".', '"A:B:N unit"')
    ] = None

    def omegas(self) -> Sequence[float]:
        """Return the speeds in rad/s. Raises MissingValueError, UnitError, ValueOutOfBoundsError."""
        if self.speeds is None:
            raise MissingValueError('no speeds given; add a range, such as --speeds "100:900:81 rpm"')
        return speeds_in_si(self.speeds)


@dataclass(frozen=True)
class SpeedOrSpeeds(Speeds, Speed):
    """Flags for one speed or several speeds. At most one of the two flags is given."""

    def __post_init__(self) -> None:
        """Raise ValueOutOfBoundsError if both flags are given."""
        if self.speed is not None and self.speeds is not None:
            raise ValueOutOfBoundsError("--speed and --speeds are both given; give one of them")

    def given(self, model: PeriodicSystem) -> float | str:
        """Return the text of --speeds or, if it is absent, one speed in rad/s. Raises MissingValueError."""
        return self.omega(model) if self.speeds is None else self.speeds


@dataclass(frozen=True)
class Settings:
    """Flags for settings that only some methods have."""

    gamma: Annotated[float | None, Flag("newmark: γ, 1/2 by default.", "G")] = None
    beta: Annotated[float | None, Flag("newmark: β, 1/4 by default.", "B")] = None
    order: Annotated[int | None, Flag("Order, for methods that have several.", "P")] = None

    @property
    def settings(self) -> dict[str, float | None]:
        """Mapping from names to settings; None for settings that are not given."""
        return {field.name: getattr(self, field.name) for field in fields(Settings)}


@dataclass(frozen=True)
class Accuracy(Settings):
    """Flags for the method and the tolerance."""

    method: Annotated[str, Flag("Method; auto selects one.", "NAME")] = "auto"
    rtol: Annotated[float, Flag("Relative tolerance of the orbit and the multipliers.", "R")] = 1e-8

    @property
    def rule(self) -> Rule:
        """Return the method with its settings. Raises UnknownNameError, ValueOutOfBoundsError."""
        return chosen(self.method, **self.settings)


@dataclass(frozen=True)
class Steps(Accuracy):
    """Flags for the method, the tolerance and the number of steps."""

    steps: Annotated[int | None, Flag("Steps per period; by default chosen for --rtol.", "N")] = None


@dataclass(frozen=True)
class PointAccuracy(Steps):
    """Flags for the method, the tolerance and the number of steps at a single speed."""

    all_multipliers: Annotated[bool, Flag("Apply --rtol to each multiplier individually.")] = False

    def solved(self, solve: Callable[..., Any], model: "Model", omega: float) -> Any:
        """Call `solve`, a function such as `solve.periodic`, with these settings, and return its result."""
        return solve(model, omega, self.rule, self.steps, self.rtol, all_multipliers=self.all_multipliers)


@dataclass(frozen=True)
class Proving:
    """Flags for the proof of a verdict at a single speed."""

    prove: Annotated[
        bool, Flag("Prove the verdict and error bounds by ball arithmetic; requires python-flint.")
    ] = False
    digits: Annotated[
        int | None, Flag("With --prove: number of decimal digits of the multipliers; 20 by default.", "N")
    ] = None
    rounded: Annotated[
        bool, Flag("With --prove: prove the results for all parameter values that round to the given values.")
    ] = False
    workers: Annotated[
        int | None, Flag("With --prove: number of processes on this machine that compute steps.", "N")
    ] = None

    def require_provable(self, model: Model, nonlinear: bool = False) -> None:
        """Raise SolveError subclasses, before the computation, if a proof is impossible."""
        flags = {"--digits": self.digits, "--rounded": self.rounded, "--workers": self.workers}
        require_with("--prove", self.prove, flags)
        if self.rounded and self.digits is not None:
            raise ValueOutOfBoundsError(
                "--rounded limits the precision to that of the given numbers; omit --digits"
            )
        if self.prove:
            from solve.proof.prove import checked_digits, require_provable

            checked_digits(self.digits)
            require_provable(model, nonlinear)

    def proof(self, result: "Stability") -> "Proof | None":
        """Return the proof of a result if it is requested, and otherwise None."""
        if not self.prove:
            return None
        from solve.batch.task import processes
        from solve.proof.prove import prove

        with nullcontext() if self.workers is None else processes(self.workers) as executor:
            return prove(result, digits=self.digits, rounded=self.rounded, executor=executor)


@contextmanager
def stored_in(store: str | None) -> Iterator[None]:
    """Context manager that prints the folder with the finished points if the command is interrupted."""
    try:
        yield
    except KeyboardInterrupt:
        if store is not None and Path(store).exists():
            print(f"solve: finished points are stored in '{store}'", file=sys.stderr)
        raise


Store = Annotated[str | None, Flag("Folder of finished points, from which the same command resumes.", "DIR")]


@dataclass(frozen=True)
class Execution:
    """Flags for solving many points: the processes that solve them, and the folder of finished points."""

    store: Store = None
    workers: Annotated[int | None, Flag("Number of processes on this machine that solve points.", "N")] = None
    scheduler: Annotated[
        str | None, Flag("Address of a running dask scheduler whose workers solve points.", "tcp://HOST:PORT")
    ] = None

    @contextmanager
    def given(self) -> Iterator[dict[str, Any]]:
        """Context manager that provides the keyword arguments `executor` and `store` of functions such as
        `solve.sweep`. Raises ValueOutOfBoundsError, WorkersError, MissingLibraryError."""
        if self.workers is not None and self.scheduler is not None:
            raise ValueOutOfBoundsError("--workers and --scheduler are both given; give one of them")
        from solve.batch.task import cluster, processes

        with ExitStack() as opening:
            executor = None
            if self.workers is not None:
                executor = opening.enter_context(processes(self.workers))
            if self.scheduler is not None:
                executor = opening.enter_context(cluster(self.scheduler))
            with stored_in(self.store):
                yield {"executor": executor, "store": self.store}


@dataclass(frozen=True)
class Results:
    """Flags for the output of a result."""

    plot: Annotated[str | None, Flag("Write a picture of the result: .png, .pdf or .svg.", "FILE")] = None
    save: Annotated[str | None, Flag("Write the data of the result: .npz, .csv, .mat or .nc.", "FILE")] = None
    json: Annotated[bool, Flag("Print one JSON object instead of tables.")] = False

    def __post_init__(self) -> None:
        """Raise FileError, before the computation, for files that cannot be written."""
        self.files()

    def files(self) -> tuple[Path | None, Path | None]:
        """Files of --plot and --save; None where a flag is absent. Raises FileError."""
        picture = None if self.plot is None else checked(self.plot, PICTURES, "picture")
        return picture, None if self.save is None else checked_data(self.save)
