"""A periodic system from generated code and a case file."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from solve.arrays import Array
from solve.errors import (
    CaseFileError,
    MatricesError,
    MissingValueError,
    ModelFileError,
    UnknownNameError,
    ValueOutOfBoundsError,
)
from solve.model.bounds import clauses, holds, measured
from solve.model.cases import Case, read_cases
from solve.model.generated import ROOT, model_module, sha256
from solve.model.sampling import ConditionSampler, Sampler
from solve.system import PeriodicSystem

if TYPE_CHECKING:
    import casadi

    from solve.results.orbit import Turn

_PHASES = 720
"""Phases of a period at which conditions on the parameters are looked at."""

_LOOKS = 128
"""Phases of a period at which the matrices are looked at before a solution."""

_ROUNDING = 1e-9
"""Relative difference of matrices a period apart that counts as none."""

_TOGETHER = 4096
"""Sets of parameters whose conditions are looked at together."""

Options = Mapping[str, Any]


class Model(PeriodicSystem):
    """A system whose matrices, outputs and bounds come from a generated module."""

    def __init__(
        self,
        module: ModuleType,
        case: str,
        options: Options,
        parameters: Mapping[str, float],
        case_speed: str | None = None,
    ):
        """case_speed: that which the case names, with unit."""
        self.module = module
        self.name: str = module.NAME
        self.case, self.case_speed = case, case_speed
        self.options = _checked_options(module, self.declared_options(module), options)
        self.parameters = _checked_parameters(module, parameters)
        self._p = np.array([self.parameters[name] for name, *_ in module.PARAMETERS])
        self._condition_samplers: dict[tuple[str, ...], ConditionSampler] = {}
        self._require_conditions()
        matrices, declared = self._equations()
        super().__init__(matrices, [name for name, *_ in declared], module.PERIOD)
        outputs = self._declared_outputs()
        self.outputs = tuple(name for name, *_ in outputs)
        self.units = {name: unit for name, unit, _ in (*declared, *outputs)}
        self.meanings = {name: meaning for name, _, meaning in (*declared, *outputs)}
        self.validity = {name: module.VALIDITY[name] for name in self.coordinates if name in module.VALIDITY}
        self.limits = tuple(module.LIMITS)

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies and pickles are built anew: CasADi's memory serves one thread of one process."""
        numbers = self.case, self.options, self.parameters, self.case_speed
        return _rebuilt, (type(self), self.module.__file__, *numbers)

    def varied(self, parameters: Mapping[str, float] | None = None, options: Options | None = None) -> Self:
        """The same model with some parameters (SI units) and options changed. Raises UnknownNameError and
        ValueOutOfBoundsError."""
        numbers = {**self.parameters, **(parameters or {})}
        return type(self)(
            self.module, self.case, {**self.options, **(options or {})}, numbers, self.case_speed
        )

    def require_bounds(self, parameters: Mapping[str, float]) -> None:
        """Raise ValueOutOfBoundsError where a value leaves the bounds of its parameter."""
        _checked_parameters(self.module, {**self.parameters, **parameters})

    def admits(self, names: Sequence[str], values: Array) -> Array:
        """Whether bounds and conditions hold (P,) with the parameters of these names at values (P, v)."""
        found = np.asarray(np.isfinite(values).all(axis=1))
        bounds = {name: bound for name, _, _, bound in self.module.PARAMETERS}
        for name, column in zip(names, values.T, strict=True):
            for clause in clauses(bounds[name]):
                found &= holds(clause, column)
        if any(not set(names).isdisjoint(concerned) for *_, concerned in self._conditions):
            found[found] = self._turns(names, values[found])
        return found

    def _turns(self, names: Sequence[str], values: Array) -> Array:
        """Whether the conditions hold all over the period (P,)."""
        sampler = self._condition_sampler(tuple(names))
        phase = self._positions if sampler.over_phase else self._positions[:1]
        different, group = np.unique(values, axis=0, return_inverse=True)
        hold = np.zeros(len(different), dtype=bool)
        for at in np.array_split(np.arange(len(different)), math.ceil(len(different) / _TOGETHER)):
            margins = sampler(np.tile(phase, len(at)), np.repeat(different[at], len(phase), axis=0))
            hold[at] = (margins > 0).reshape(len(at), -1).all(axis=1)
        return hold[group.ravel()]

    def _condition_sampler(self, names: tuple[str, ...]) -> ConditionSampler:
        if names not in self._condition_samplers:
            free = [list(self.parameters).index(name) for name in names]
            conditions = self.module.conditions(**self._own_options)
            self._condition_samplers[names] = ConditionSampler(conditions, self._p, free)
        return self._condition_samplers[names]

    @property
    def _conditions(self) -> Sequence[tuple[str, str, Sequence[str]]]:
        """Text, meaning and parameters of each condition."""
        return getattr(self.module, "CONDITIONS", ())

    @property
    def _positions(self) -> Array:
        return (np.arange(_PHASES) + 0.5) * (self.module.PERIOD / _PHASES)

    def _equations(self) -> tuple[Callable[[Array, float], Sequence[Array]], Sequence[tuple[str, str, str]]]:
        """The matrices over phase and speed, and name, unit and meaning of the coordinates in use."""
        sampler = Sampler(self.module.linearised(**self.options), self._p)
        return sampler, self.module.COORDINATES[: sampler.n]

    def _declared_outputs(self) -> Sequence[tuple[str, str, str]]:
        """Name, unit and meaning of the outputs."""
        return self.module.OUTPUTS

    @staticmethod
    def declared_options(module: ModuleType) -> Sequence[tuple[str, Sequence[Any], Any]]:
        """Name, allowed values and default of the options of a generated module's model."""
        return module.OPTIONS

    @property
    def _own_options(self) -> dict[str, Any]:
        """Options that the generated functions take; a structure's elements concern its assembly."""
        return {name: self.options[name] for name, *_ in self.module.OPTIONS}

    def require_motion(self) -> None:
        """Raise NoMotionError where the model has no equations of motion."""

    def checked(self, speed: float) -> None:
        """Beyond the checks of any system: generated matrices repeat at every phase, and M, which is that
        of a kinetic energy, is positive definite. Raises MatricesError."""
        super().checked(speed)
        phase = (np.arange(_LOOKS) + 0.5) * (self.period / _LOOKS)
        first, second = self.at(phase, speed), self.at(phase + self.period, speed)
        for symbol, part, later in zip("MCKd", first, second, strict=True):
            change = np.abs(later - part).max()
            if change > _ROUNDING * np.abs(part).max():
                raise MatricesError(
                    f"{symbol} is not periodic: after the period {self.period:.6g} it has changed by "
                    f"{change:.3g}; look at the mechanism's period and fundamental motion, and at "
                    "parameters that count (teeth, orders)"
                )
        negative = np.linalg.eigvalsh(first[0]).min(axis=1) <= 0
        if negative.any():
            raise MatricesError(
                f"M is not positive definite at phase {phase[np.argmax(negative)]:.4g}: some motion there "
                "has no or negative kinetic energy; look at the masses and the signs in the kinetic energy"
            )

    def _require_conditions(self) -> None:
        """Refuse parameters that contradict each other, such as lengths of a linkage that cannot turn."""
        if not self._conditions:
            return
        margins = self.module.conditions(**self._own_options)(self._positions[None], self._p).full()
        units = {name: unit for name, unit, *_ in self.module.PARAMETERS}
        for (condition, meaning, names), margin in zip(self._conditions, margins, strict=True):
            if not (margin > 0).all():
                given = ", ".join(
                    f"{name} = {measured(self.parameters[name], units[name])}" for name in names
                )
                raise ValueOutOfBoundsError(
                    f"{meaning}: {condition} does not hold for {given}; choose numbers for which it does"
                )

    def field(self, name: str, position: Array | float) -> Array:
        """Mode functions of a deflection at fractions (k,) of its link's length: (k, n).

        Times the coordinates it is the deflection there: `model.field("w", [0.25, 0.5]) @ orbit.q`.
        Raises UnknownNameError and ValueOutOfBoundsError.
        """
        known = [field for field, *_ in getattr(self.module, "FIELDS", ())]
        if name not in known:
            raise UnknownNameError(f"field of {self.name}", name, known)
        fraction = np.asarray(position, dtype=float)
        if not ((fraction >= 0) & (fraction <= 1)).all():
            raise ValueOutOfBoundsError(f"position is {position}; allowed: fractions of the length, 0 to 1")
        shapes = self.module.fields(**self.options).map(fraction.size)(fraction.reshape(1, -1))
        return shapes.full().T.reshape(*fraction.shape, self.n)

    @cached_property
    def _outputs(self) -> "casadi.Function":
        return self.module.outputs(**self.options)

    def output_values(self, phase: Array, speed: float, q: Array, qd: Array, qdd: Array) -> dict[str, Array]:
        if not self.outputs:
            return {}
        values = self._outputs(phase[None], speed, q, qd, qdd, self._p)
        columns = values if isinstance(values, tuple) else (values,)
        return {name: value.full()[0] for name, value in zip(self.outputs, columns, strict=True)}

    def concerns(self, turn: "Turn") -> list[str]:
        found = []
        for name, bound in self.validity.items():
            largest = turn.statistics(name).max_abs
            if largest > bound:
                found.append(
                    f"the linearisation is not to be trusted: max|{name}| = {largest:.3g} "
                    f"{self.units[name]}, beyond {bound:g}"
                )
        for name, bound, meaning in self.limits:
            range_ = turn.statistics(name)
            for clause in clauses(bound):
                extreme = range_.min if clause.startswith(">") else range_.max
                if not holds(clause, extreme):
                    reached = measured(extreme, self.units[name], 3)
                    found.append(f"{meaning}: {name} reaches {reached}, bound {clause}")
        return found


def load(
    model: str, case: str | int | None = None, options: Options | None = None, **parameters: float
) -> Model:
    """The system of a model (a name, or the path of a mechanism file) and a case.

    Parameters override the case's values, in SI units as the model declares them. The first case is
    the default. Raises UnknownNameError, ModelFileError (no or stale generated code), CaseFileError,
    MissingValueError and ValueOutOfBoundsError.
    """
    return loaded(model, None if case is None else str(case), None, options or {}, parameters)[0]


def loaded(
    model: str, case: str | None, cases: str | None, options: Options, parameters: Mapping[str, float]
) -> tuple[Model, str | None]:
    """The model and the speed that its case names, if any; `cases` is another case file to use."""
    generated, case_file, mechanism = _files(model)
    _refuse_stale(generated, mechanism, model)
    module = model_module(generated)
    chosen = _chosen_case(Path(cases) if cases else case_file, case, module, explicit=cases is not None)
    known = [name for name, *_ in module.PARAMETERS]
    for name in parameters:
        if name not in known:
            raise UnknownNameError(f"parameter of {module.NAME}", name, known)
    values = {**chosen.parameters, **parameters}
    missing = [name for name in known if name not in values]
    if missing:
        where = f"case '{chosen.name}' of {module.NAME}" if chosen.name else f"{module.NAME} has no case and"
        raise MissingValueError(
            f"{where} gives no value for {', '.join(missing[:8])}; add it to the case file or set it: "
            f"{missing[0]}=NUMBER"
        )
    return _kind(module)(module, chosen.name, options, values, chosen.speed), chosen.speed


def _kind(module: ModuleType) -> type[Model]:
    """The class of the model that a generated module describes."""
    if not hasattr(module, "LINKS"):
        return Model
    from solve.beams.model import StructureModel

    return StructureModel


def _rebuilt(
    kind: type[Model],
    path: str,
    case: str,
    options: Options,
    parameters: Mapping[str, float],
    case_speed: str | None,
) -> Model:
    return kind(model_module(Path(path)), case, options, parameters, case_speed)


def model_names() -> list[str]:
    """Models that come with the package."""
    return sorted(path.parent.name for path in (ROOT / "models").glob("*/mechanism.py"))


def _files(model: str) -> tuple[Path, Path, Path]:
    """Generated module, case file and mechanism file."""
    if model.endswith(".py"):
        mechanism = Path(model)
        if not mechanism.is_file():
            raise ModelFileError(f"no mechanism file '{model}'; give the path of a file that exists")
        return mechanism.parent / "generated" / mechanism.name, mechanism.with_suffix(".toml"), mechanism
    if "/" in model or "\\" in model:
        raise ModelFileError(
            f"model '{model}' is neither a name nor a mechanism file; a path must end in .py"
        )
    if model not in model_names():
        raise UnknownNameError("model", model, model_names())
    folder = ROOT / "models" / model
    return ROOT / "generated" / f"{model}.py", folder / "cases.toml", folder / "mechanism.py"


def _refuse_stale(generated: Path, mechanism: Path, model: str) -> None:
    if not generated.is_file():
        raise ModelFileError(f"no generated code for '{model}'; run: python -m derive {model}")
    text = mechanism.read_text(encoding="utf-8-sig", errors="replace")
    if sha256(text) != model_module(generated).MECHANISM_SHA256:
        raise ModelFileError(
            f"'{model}' has changed since its code was generated; run: python -m derive {model}"
        )


def _chosen_case(path: Path, case: str | None, module: ModuleType, explicit: bool) -> Case:
    if not explicit and not path.is_file():
        if case is not None:
            raise CaseFileError(f"no case file '{path}' for case '{case}'; write one, or name no case")
        return Case("", None, {})
    cases = read_cases(path, {name: unit for name, unit, *_ in module.PARAMETERS})
    if case is None:
        return next(iter(cases.values()))
    if case not in cases:
        raise UnknownNameError(f"case of {module.NAME}", case, cases)
    return cases[case]


def _checked_options(
    module: ModuleType, declared: Sequence[tuple[str, Sequence[Any], Any]], given: Options
) -> dict[str, Any]:
    """Every option's value: the given or the default one."""
    link_options = getattr(module, "LINK_OPTIONS", ())
    allowed = {name: values for name, values, _ in declared}
    options: dict[str, Any] = {name: default for name, _, default in declared}
    for name, value in given.items():
        if name not in allowed:
            raise UnknownNameError(f"option of {module.NAME}", name, allowed)
        if name in {each for each, *_ in link_options}:
            options[name] = _link_by_link(module, name, value, allowed[name])
        else:
            options[name] = _checked_option(module, name, value, allowed[name])
    return options


def _link_by_link(module: ModuleType, name: str, value: Any, allowed: Sequence[Any]) -> Any:
    """One value for all links, or a text of one for each, separated by commas."""
    parts = (
        value.split(",") if isinstance(value, str) else value if isinstance(value, list | tuple) else [value]
    )
    links = [link for link, *_ in module.LINKS]
    if len(parts) not in (1, len(links)):
        raise ValueOutOfBoundsError(
            f"option {name} of {module.NAME} has {len(parts)} values; give one for all links, or one for "
            f"each of {','.join(links)}"
        )
    chosen = [_checked_option(module, name, part, allowed) for part in parts]
    return chosen[0] if len(chosen) == 1 else ",".join(map(str, chosen))


def _checked_option(module: ModuleType, name: str, value: Any, allowed: Sequence[Any]) -> Any:
    chosen = _whole(value) if isinstance(allowed, range) else value
    if not any(type(chosen) is type(each) and chosen == each for each in allowed):
        if isinstance(allowed, range):
            bounds = f"a whole number from {allowed[0]} to {allowed[-1]}"
            raise ValueOutOfBoundsError(f"option {name} of {module.NAME} is {value}; allowed: {bounds}")
        raise UnknownNameError(f"value of option {name}", str(value), map(str, allowed))
    return chosen


def _whole(value: Any) -> Any:
    """A whole number that is written as one, or NumPy's; anything else as it is."""
    if isinstance(value, np.integer):
        return int(value)
    return int(value) if isinstance(value, str) and re.fullmatch("-?[0-9]+", value.strip()) else value


def _checked_parameters(module: ModuleType, given: Mapping[str, Any]) -> dict[str, float]:
    checked = {}
    for name, unit, meaning, bound in module.PARAMETERS:
        try:
            value = float(given[name])
        except (TypeError, ValueError):
            raise ValueOutOfBoundsError(
                f"{name} ({meaning}) is {given[name]!r}; give a number in {unit}"
            ) from None
        if not math.isfinite(value) or not all(holds(clause, value) for clause in clauses(bound)):
            raise ValueOutOfBoundsError(
                f"{name} ({meaning}) is {measured(value, unit)}; allowed: {bound or 'any finite number'}"
            )
        checked[name] = value
    return checked
