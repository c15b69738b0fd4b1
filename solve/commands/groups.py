"""Flags that several commands share, each group stated once as a dataclass.

A command takes whole groups as its parameters; `flattened` shows their fields to Typer as the
command's own flags, so that a new command is a short file.
"""

import inspect
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, get_args, get_type_hints

import typer

from solve.commands.parse import assignments, number, quantities, spread, whole
from solve.errors import DesiredMotionError, MatricesError, MissingValueError, ValueOutOfBoundsError
from solve.labels import SPEED
from solve.loading import case_numbers, missing_parameters, model_of, parameter_units, setup_of
from solve.methods.choice import Rule, chosen
from solve.model.bounds import measured
from solve.model.cases import Case
from solve.model.model import Model
from solve.model.options import REDUCE
from solve.model.setup import Setup
from solve.results.files import PICTURES, checked
from solve.results.save import checked_data
from solve.sizes import MOST, limited
from solve.units import speeds_in_si

if TYPE_CHECKING:
    from solve.proof.result import Proof
    from solve.results.bands import Bands
    from solve.results.critical_speeds import CriticalSpeeds
    from solve.results.result import Result
    from solve.results.stability import Stability


class Flag(NamedTuple):
    """What a flag is for, and the form of its value, as `--help` shows them; default: what stands there for a
    default that is chosen later; read: how its value is read, if not as a number or text. Flags of truth have
    no value."""

    help: str
    form: str | None = None
    default: str | None = None
    read: Callable[[str], Any] | None = None

    def option(self, name: str, kind: Any) -> Any:
        """For Typer, the flag of a parameter of this kind. Numbers are read in one way."""
        names = [f"--{name.strip('_').replace('_', '-')}"] if kind is bool else []
        parser = next((read for each, read in ((int, whole), (float, number)) if _holds(kind, each)), None)
        parser = self.read or parser
        shown = self.default or True
        return typer.Option(*names, help=self.help, metavar=self.form, parser=parser, show_default=shown)


def _holds(kind: Any, wanted: type) -> bool:
    return kind is wanted or any(_holds(part, wanted) for part in get_args(kind))


Varied = Mapping[str, Sequence[float | str]]
"""Values of parameters, or of the speed, by name."""

_NONE: Varied = MappingProxyType({})
_NO_VALUES: Mapping[str, float | str] = MappingProxyType({})

_MOST_TRIALS = 4096
"""Largest number of combinations of varied parameters that are tried as the values of the model: a choice,
which limits the time until a study is refused."""


@dataclass(frozen=True)
class CaseNumbers:
    """The numbers of a model that the command itself names."""

    case: Annotated[str | None, Flag("Case of the case file; the first by default.", "NAME")] = None
    cases: Annotated[str | None, Flag("Another case file (.toml).", "FILE")] = None
    set: Annotated[
        list[str] | None, Flag('Set a parameter, in its unit or as "30mm"; repeatable.', "NAME=NUMBER")
    ] = None

    def case_of(self, model: str) -> Case:
        """The case with its numbers. Raises SolveError subclasses for bad input."""
        return case_numbers(model, self.case, self.cases, self.parameters)

    @property
    def parameters(self) -> dict[str, float | str]:
        """Numbers that replace those of the case, or texts with unit. Raises ValueOutOfBoundsError."""
        return quantities("--set", self.set or [])


@dataclass(frozen=True)
class Numbers(CaseNumbers):
    """The numbers and options of a model that the command itself names."""

    option: Annotated[list[str] | None, Flag("Choose an option of the model; repeatable.", "NAME=VALUE")] = (
        None
    )
    reduce: Annotated[
        int | None, Flag("Beam structures: retain K modes per link; the error is estimated.", "K")
    ] = None

    def of(self, name: str, still: bool = False, rigid: bool = False, varied: Varied = _NONE) -> Model:
        """Model of that name. Raises NoMotionError for a model without equations of motion and
        NoVibrationError for a rigid one, unless the study allows them."""
        model = self._first_model(name, varied)
        if not still and (model.vibrates or not rigid):
            model.require_motion()
        return model

    def _first_model(self, name: str, varied: Varied) -> Model:
        """Model with the first values of the varied parameters that it allows. Raises the error of the first
        values if it allows none."""
        try:
            return model_of(self.setup(name, {each: values[0] for each, values in varied.items()}))
        except (ValueOutOfBoundsError, DesiredMotionError):
            unset = self.unset(name)
            ranges = {each: values for each, values in varied.items() if each in unset}
            for trial in spread(ranges, _MOST_TRIALS):
                with suppress(ValueOutOfBoundsError, DesiredMotionError):
                    return model_of(self.setup(name, trial))
            raise

    def unset(self, name: str) -> list[str]:
        """Parameters of the model of that name to which neither the case nor --set gives a value."""
        return missing_parameters(name, self.case, self.cases, self.parameters)

    def setup(self, name: str, values: Mapping[str, float | str] = _NO_VALUES) -> Setup:
        """Setup of the model of that name; values: of parameters that neither the case nor --set gives.
        Raises SolveError subclasses for bad input."""
        options: dict[str, Any] = assignments("--option", self.option or [])
        if self.reduce is not None:
            if REDUCE in options:
                raise ValueOutOfBoundsError("--reduce and --option reduce are both given; give one of them")
            options[REDUCE] = self.reduce
        others = {parameter: value for parameter, value in values.items() if parameter != SPEED}
        return setup_of(name, self.case, self.cases, options, self.parameters, others)

    @property
    def choices(self) -> list[str]:
        """What the user set beyond the case."""
        return [*(self.set or []), *(self.option or [])]


@dataclass(frozen=True, kw_only=True)
class Problem(Numbers):
    """The model and its numbers."""

    model: Annotated[
        str, typer.Argument(metavar="MODEL", help="A model's name, or the path of a mechanism file (.py).")
    ]

    def loaded(self, still: bool = False, rigid: bool = False, varied: Varied = _NONE) -> Model:
        """As `of`, the model that the user names."""
        return self.of(self.model, still, rigid, varied)

    def numbers_set(self) -> str:
        """Numbers of --set in the model's units, with the case's units where these differ; empty if the model
        needs further numbers."""
        try:
            case, parts = self.case_of(self.model), []
        except MissingValueError:
            return ""
        units = parameter_units(self.model)
        for name, given in self.parameters.items():
            text, own = measured(case.parameters[name], units[name]), case.units.get(name)
            other = isinstance(given, float) and own not in (None, units[name])
            parts.append(
                f"{text} for {name}, which the case gives in {own}" if other else f"{text} for {name}"
            )
        return "; ".join(parts)


@dataclass(frozen=True)
class Speed:
    """One speed of rotation."""

    speed: Annotated[str | None, Flag("Speed with unit: rpm, rad/s or Hz; else the case's.", '"600 rpm"')] = (
        None
    )

    def omega(self, model: Model) -> float:
        """Ω in rad/s. Raises MissingValueError where neither the flag nor the model's case gives it."""
        return model.speed_or_usual(self.speed)


@dataclass(frozen=True)
class Speeds:
    """Many speeds of rotation."""

    speeds: Annotated[
        str | None, Flag('N speeds from A to B, or a list: "600 900 1200 rpm".', '"A:B:N unit"')
    ] = None

    def omegas(self) -> Sequence[float]:
        """Speeds in rad/s. Raises MissingValueError, UnitError, ValueOutOfBoundsError."""
        if self.speeds is None:
            raise MissingValueError('no speeds given; add a range, such as --speeds "100:900:81 rpm"')
        return speeds_in_si(self.speeds)


@dataclass(frozen=True)
class Settings:
    """Settings that some methods have."""

    gamma: Annotated[float | None, Flag("newmark: γ, 1/2 by default.", "G")] = None
    beta: Annotated[float | None, Flag("newmark: β, 1/4 by default.", "B")] = None
    order: Annotated[int | None, Flag("Order, of methods that have several.", "P")] = None

    @property
    def settings(self) -> dict[str, float | None]:
        """By name, None where a setting is not given."""
        return {field.name: getattr(self, field.name) for field in fields(Settings)}


@dataclass(frozen=True)
class Accuracy(Settings):
    """The method, and how exact its result shall be."""

    method: Annotated[str, Flag("Method; auto chooses.", "NAME")] = "auto"
    rtol: Annotated[float, Flag("Relative error of orbit and multipliers to reach.", "R")] = 1e-8

    @property
    def rule(self) -> Rule:
        """The method with its settings. Raises UnknownNameError, ValueOutOfBoundsError."""
        return chosen(self.method, **self.settings)


@dataclass(frozen=True)
class Steps(Accuracy):
    """The same where the steps can be given."""

    steps: Annotated[int | None, Flag("Steps a period; by default as many as --rtol needs.", "N")] = None


@dataclass(frozen=True)
class OnePoint(Steps):
    """The same for a single speed."""

    all_multipliers: Annotated[bool, Flag("Every multiplier to --rtol of itself, however small.")] = False

    def solved(self, solve: Callable[..., Any], model: "Model", omega: float) -> Any:
        """What a function such as `solve.periodic` gives."""
        return solve(model, omega, self.rule, self.steps, self.rtol, all_multipliers=self.all_multipliers)


@dataclass(frozen=True)
class Proving:
    """Whether the verdict of a single speed is proved."""

    prove: Annotated[bool, Flag("Prove verdict and bounds by ball arithmetic; needs python-flint.")] = False
    digits: Annotated[
        int | None, Flag("With --prove: decimal digits of multipliers; 20 by default.", "N")
    ] = None
    rounded: Annotated[bool, Flag("With --prove: for all numbers that are rounded to the given ones.")] = (
        False
    )

    def require_provable(self, model: Model) -> None:
        """Raise SolveError subclasses for what cannot be proved, before anything is solved."""
        given = [f"--digits {self.digits}"] if self.digits is not None else []
        given += ["--rounded"] if self.rounded else []
        if given and not self.prove:
            raise ValueOutOfBoundsError(f"{given[0]} requires --prove; add it")
        if len(given) > 1:
            raise ValueOutOfBoundsError("--rounded has the digits of the numbers; leave out --digits")
        if self.prove:
            from solve.proof.prove import checked_digits, require_provable

            checked_digits(self.digits)
            require_provable(model)

    def proof(self, result: "Stability") -> "Proof | None":
        """The proof of a result, if it was requested."""
        if not self.prove:
            return None
        from solve.proof.prove import prove

        return prove(result, digits=self.digits, rounded=self.rounded)


@dataclass(frozen=True)
class Moved:
    """Parameters that move speeds which were found."""

    by: Annotated[
        list[str] | None, Flag("Give derivatives of these speeds by a parameter instead; repeatable.", "NAME")
    ] = None

    def require_known(self, model: "Model") -> None:
        """Raise SolveError subclasses for what moves no speed, before anything is solved."""
        if self.by:
            from solve.studies.sensitivities import moving_parameters

            moving_parameters(model, self.by)

    def of(self, found: "Bands | CriticalSpeeds", accuracy: Accuracy) -> "Result":
        """The derivatives where any are asked for, else what was found."""
        if not self.by:
            return found
        from solve.studies.sensitivities import speed_sensitivities

        return speed_sensitivities(found, self.by, accuracy.rule, accuracy.rtol)


@dataclass(frozen=True)
class Places:
    """Where many points are solved, and kept as they are finished."""

    store: Annotated[
        str | None, Flag("Keep finished points in this folder; the same command goes on from there.", "DIR")
    ] = None
    workers: Annotated[int | None, Flag("Processes of this machine that share the points.", "N")] = None
    scheduler: Annotated[
        str | None, Flag("A running dask scheduler, whose workers share the points.", "tcp://HOST:PORT")
    ] = None

    @contextmanager
    def given(self) -> Iterator[dict[str, Any]]:
        """Keywords `executor` and `store` of functions such as `solve.sweep`. Raises ValueOutOfBoundsError,
        WorkersError, MissingLibraryError."""
        if self.workers is not None and self.scheduler is not None:
            raise ValueOutOfBoundsError("--workers and --scheduler name two places to work; give one of them")
        from solve.batch.executors import cluster, processes

        with ExitStack() as opening:
            executor = None
            if self.workers is not None:
                executor = opening.enter_context(processes(self.workers))
            if self.scheduler is not None:
                executor = opening.enter_context(cluster(self.scheduler))
            try:
                yield {"executor": executor, "store": self.store}
            except KeyboardInterrupt:
                if self.store is not None:
                    print(f"solve: what is finished is kept in '{self.store}'", file=sys.stderr)
                raise


@dataclass(frozen=True)
class Results:
    """Where the results go."""

    plot: Annotated[str | None, Flag("Draw them: .png, .pdf or .svg by the file's ending.", "FILE")] = None
    save: Annotated[str | None, Flag("Save them: .npz, .csv, .mat or .nc by the file's ending.", "FILE")] = (
        None
    )
    json: Annotated[bool, Flag("Print one JSON object instead of tables.")] = False

    def __post_init__(self) -> None:
        """Raises FileError before anything is calculated."""
        self.files()

    def files(self) -> tuple[Path | None, Path | None]:
        """The files of --plot and --save. Raises FileError."""
        picture = None if self.plot is None else checked(self.plot, PICTURES, "picture")
        return picture, None if self.save is None else checked_data(self.save)


@dataclass(frozen=True)
class Common:
    """What every command takes."""

    limit: Annotated[float | None, Flag(f"Most numbers to hold at once; by default {MOST}.", "N")] = None
    debug: Annotated[bool, Flag("Show the traceback of an internal error.")] = False


def flattened(command: Callable[..., None]) -> Callable[..., None]:
    """The command with the fields of its groups, and of `Common`, as parameters of its own, for Typer to
    read."""
    hints = get_type_hints(command, include_extras=True)
    groups = {name: hint for name, hint in hints.items() if isinstance(hint, type) and is_dataclass(hint)}
    parameters, common = [], inspect.signature(Common).parameters
    for name, parameter in inspect.signature(command).parameters.items():
        alone = [parameter.replace(annotation=hints[name])]
        group = inspect.signature(groups[name]).parameters.values() if name in groups else alone
        parameters += [_for_typer(each) for each in group]

    parameters += [_for_typer(each) for each in common.values()]

    def flat(**values: Any) -> None:
        chosen = Common(**{name: values.pop(name) for name in common})
        for name, group in groups.items():
            values[name] = group(**{field.name: values.pop(field.name) for field in fields(group)})
        with limited(chosen.limit), _naming_what_is_set(values.values()):
            command(**values)

    flat.__doc__ = command.__doc__
    flat.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    flat.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return flat


@contextmanager
def _naming_what_is_set(groups: Iterable[Any]) -> Iterator[None]:
    """Add the numbers of --set to errors that name no parameter to change."""
    try:
        yield
    except (MatricesError, DesiredMotionError) as error:
        given = next((each.numbers_set() for each in groups if isinstance(each, Problem)), "")
        raise type(error)(f"{error}; values set: {given}" if given else str(error)) from None


def _for_typer(parameter: inspect.Parameter) -> inspect.Parameter:
    kind, stated = get_args(parameter.annotation)
    option = stated.option(parameter.name, kind) if isinstance(stated, Flag) else stated
    return parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY, annotation=Annotated[kind, option])
