"""A periodic system whose matrices, outputs and bounds come from a generated module."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from solve.arrays import Array
from solve.errors import MatricesError, UnknownNameError, ValueOutOfBoundsError
from solve.model.cases import Case
from solve.model.conditions import Conditions, checked_parameters, clauses, holds, measured
from solve.model.generated import model_module
from solve.model.options import checked_options
from solve.model.sampling import OutputSampler, PointSampler, Sampler
from solve.statistics import Statistics
from solve.system import PeriodicSystem

if TYPE_CHECKING:
    import casadi

_LOOKS = 128
"""Phases of a period at which the matrices are looked at before a solution."""

_ROUNDING = 1e-9
"""Relative difference of matrices a period apart that counts as none."""


@dataclass(frozen=True)
class Specification:
    """A generated module with the options and the parameters (SI units) that were chosen for it.

    case, case_speed: the case that they come from, and the speed with unit that it names.
    """

    module: ModuleType
    case: str
    case_speed: str | None
    options: Mapping[str, Any]
    parameters: Mapping[str, float]

    @classmethod
    def checked(cls, module: ModuleType, case: Case, options: Mapping[str, Any]) -> "Specification":
        """Options that are not given have their defaults; every parameter needs a value. Raises
        UnknownNameError and ValueOutOfBoundsError."""
        options, parameters = checked_options(module, options), checked_parameters(module, case.parameters)
        found = cls(module, case.name, case.speed, options, parameters)
        found.conditions.require()
        return found

    def varied(self, parameters: Mapping[str, float], options: Mapping[str, Any]) -> "Specification":
        """The same with some of them changed."""
        case = Case(self.case, self.case_speed, {**self.parameters, **parameters})
        return Specification.checked(self.module, case, {**self.options, **options})

    @cached_property
    def conditions(self) -> Conditions:
        """What the parameters must fulfil."""
        return Conditions(self.module, self.own_options, self.parameters)

    @cached_property
    def p(self) -> Array:
        """The parameters in the order of the generated functions."""
        return np.array([self.parameters[name] for name, *_ in self.module.PARAMETERS])

    @property
    def own_options(self) -> dict[str, Any]:
        """Options that the generated functions take; a structure's elements concern its assembly."""
        return {name: self.options[name] for name, *_ in self.module.OPTIONS}


class Model(PeriodicSystem):
    """A system whose matrices, outputs and bounds come from a generated module."""

    def __init__(
        self,
        specification: Specification,
        matrices: Callable[[Array, float], Sequence[Array]],
        coordinates: Sequence[tuple[str, str, str]],
    ):
        """coordinates: name, unit and meaning of each."""
        module = specification.module
        super().__init__(matrices, [name for name, *_ in coordinates], module.PERIOD)
        self.specification, self.module = specification, module
        self.name, self.title = module.NAME, module.TITLE
        self.case, self.case_speed = specification.case, specification.case_speed
        self.options, self.parameters = specification.options, specification.parameters
        self.parameter_labels = {name: (unit, meaning) for name, unit, meaning, _ in module.PARAMETERS}
        self.outputs = tuple(name for name, *_ in module.OUTPUTS)
        self.units = {name: unit for name, unit, _ in (*coordinates, *module.OUTPUTS)}
        self.meanings = {name: meaning for name, _, meaning in (*coordinates, *module.OUTPUTS)}
        self.validity = {name: module.VALIDITY[name] for name in self.coordinates if name in module.VALIDITY}
        self.limits = tuple(module.LIMITS)

    @classmethod
    def of(cls, specification: Specification) -> Self:
        """The model of a specification."""
        sampler = Sampler(specification.module.linearised(**specification.options), specification.p)
        return cls(specification, sampler, specification.module.COORDINATES[: sampler.n])

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies and pickles are built anew: CasADi's memory serves one thread of one process."""
        case = Case(self.specification.case, self.case_speed, self.parameters)
        return _rebuilt, (type(self), self.module.__file__, case, self.options)

    def varied(
        self, parameters: Mapping[str, float] | None = None, options: Mapping[str, Any] | None = None
    ) -> Self:
        """The same model with some parameters (SI units) and options changed. Raises UnknownNameError and
        ValueOutOfBoundsError."""
        return self.of(self.specification.varied(parameters or {}, options or {}))

    def require_bounds(self, parameters: Mapping[str, float]) -> None:
        checked_parameters(self.module, {**self.parameters, **parameters})

    def many_points(self, names: Sequence[str]) -> "ModelPoints | None":
        return ModelPoints(self.specification, names)

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
        values = self._outputs(phase[None], speed, q, qd, qdd, self.specification.p)
        columns = values if isinstance(values, tuple) else (values,)
        return {name: value.full()[0] for name, value in zip(self.outputs, columns, strict=True)}

    @property
    def judged_quantities(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys((*self.validity, *(name for name, *_ in self.limits))))

    def judged(self, figures: Mapping[str, Statistics]) -> list[str]:
        found = []
        for name, bound in self.validity.items():
            if name in figures and figures[name].max_abs > bound:
                found.append(
                    f"the linearisation is not to be trusted: max|{name}| = {figures[name].max_abs:.3g} "
                    f"{self.units[name]}, beyond {bound:g}"
                )
        for name, bound, meaning in self.limits:
            for clause in clauses(bound) if name in figures else ():
                extreme = figures[name].min if clause.startswith(">") else figures[name].max
                if not holds(clause, extreme):
                    reached = measured(extreme, self.units[name], 3)
                    found.append(f"{meaning}: {name} reaches {reached}, bound {clause}")
        return found


class ModelPoints:
    """A model at many points at once, each with its speed and with values (v,) of its own for some of the
    parameters."""

    def __init__(self, specification: Specification, names: Sequence[str]):
        self._specification, self._names = specification, names
        self._free = [list(specification.parameters).index(name) for name in names]
        linearised = specification.module.linearised(**specification.options)
        self._sampler = PointSampler(linearised, specification.p, self._free)

    def entries(self, phase: Array, speeds: Array, values: Array) -> Array:
        P, k, n = len(speeds), len(phase), self._sampler.n
        found = self._sampler(np.tile(phase, P), np.repeat(speeds, k), np.repeat(values, k, axis=0))
        found = found.reshape(P, k, 3 * n**2 + n)
        found[:, :, : n**2] *= (speeds**2)[:, None, None]
        found[:, :, n**2 : 2 * n**2] *= speeds[:, None, None]
        if self._names:
            found[~self._specification.conditions.admit(self._names, values)] = np.nan
        return found

    def outputs(self, phase: Array, speeds: Array, values: Array, q: Array, qd: Array, qdd: Array) -> Array:
        P, n, k = q.shape
        states = (np.swapaxes(part, 1, 2).reshape(P * k, n) for part in (q, qd, qdd))
        found = self._output_sampler(
            phase.ravel(), np.repeat(speeds, k), np.repeat(values, k, axis=0), *states
        )
        return np.swapaxes(found.reshape(P, k, -1), 1, 2)

    @cached_property
    def _output_sampler(self) -> OutputSampler:
        outputs = self._specification.module.outputs(**self._specification.options)
        return OutputSampler(outputs, self._specification.p, self._free)


def _rebuilt(kind: type[Model], path: str, case: Case, options: Mapping[str, Any]) -> Model:
    return kind.of(Specification.checked(model_module(Path(path)), case, options))
