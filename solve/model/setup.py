"""A generated module with the case and the options that were chosen for it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from solve.arrays import Array
from solve.contracts import Formulas
from solve.errors import ValueOutOfBoundsError
from solve.model.bounds import checked_parameters, measured
from solve.model.cases import Case
from solve.model.domain import Domain
from solve.model.formulas import c_text
from solve.model.options import checked_options
from solve.model.roundoff import roundoff_bound
from solve.model.sampling import Sampler, folded

if TYPE_CHECKING:
    import casadi

_PHASES = 720
"""Phases of a period at which conditions on the parameters are looked at."""

_ALIKE = 1e-12
"""Part of the period up to which breaks are one."""


@dataclass(frozen=True)
class Setup:
    """A generated module, a case with a value for every parameter in its own unit, every option's value."""

    module: ModuleType
    case: Case
    options: Mapping[str, Any]

    @classmethod
    def checked(cls, module: ModuleType, case: Case, options: Mapping[str, Any]) -> "Setup":
        """Setup with defaults for options that are not given; every parameter needs a value. Raises
        UnknownNameError, ValueOutOfBoundsError and DesiredMotionError."""
        case = replace(case, parameters=checked_parameters(module, case.parameters))
        setup = cls(module, case, checked_options(module, options))
        setup.require_conditions()
        if setup.domain is not None:
            setup.domain.require()
        return setup

    def varied(self, parameters: Mapping[str, float], options: Mapping[str, Any]) -> "Setup":
        """The same with some of them changed."""
        return Setup.checked(self.module, self.case.replaced(parameters), {**self.options, **options})

    @cached_property
    def p(self) -> Array:
        """The parameters in the order of the generated functions."""
        return np.array(list(self.case.parameters.values()))

    @cached_property
    def ratios(self) -> Array | None:
        """Damping ratios (k,) of the modes in the order of rising frequencies, the last of all others; None
        where the mechanism states none."""
        if not hasattr(self.module, "damping_ratios"):
            return None
        return self.function("damping_ratios")(self.p).full().ravel()

    @property
    def moves_breaks(self) -> bool:
        """Whether the phases of the breaks depend on parameters."""
        return hasattr(self.module, "breaks")

    @cached_property
    def breaks(self) -> tuple[float, ...]:
        """Phases at which the generated matrices jump or have kinks, rising. Raises ValueOutOfBoundsError."""
        return self.breaks_with(self.p)

    def breaks_with(self, p: Array) -> tuple[float, ...]:
        """The same with other parameters, in the order of the generated functions."""
        found = getattr(self.module, "BREAKS", ())
        if self.moves_breaks:
            try:
                found = self.module.breaks(None, p.tolist(), **self._module_options)
            except ValueError as error:
                raise ValueOutOfBoundsError(f"{self.module.NAME}: {error}") from None
        return tuple(sorted(set(found)))

    @property
    def _module_options(self) -> dict[str, Any]:
        """Options of the generated functions; a structure's elements concern its assembly, not these."""
        return {option: self.options[option] for option, *_ in self.module.OPTIONS}

    def function(self, name: str) -> "casadi.Function":
        """A generated function."""
        return getattr(self.module, name)(**self._module_options)

    def sampler(self, name: str, free: Sequence[str]) -> Sampler:
        """A generated function at many phases, each with values of its own for the free parameters."""
        order = list(self.case.parameters)
        return Sampler(folded(self.function(name), self.p, [order.index(each) for each in free]))

    @cached_property
    def residual_roundoff(self) -> Sampler:
        """Bounds (k, n) on the round-off in the nonlinear residual, in units of the machine precision, at
        phases, speeds and states q, qd, qdd (k, n), with parameters (p,)."""
        return Sampler(roundoff_bound(self.function("residual"), ("speed", "p")), shared=1)

    def formulas(
        self,
        name: str,
        varied: Sequence[str],
        made: "Callable[[casadi.Function, Array, Sequence[int]], casadi.Function]" = folded,
    ) -> Formulas | None:
        """What is made of a generated function as C, with the parameters that are 0 folded in unless they are
        `varied`."""
        order = list(self.case.parameters)
        kept = [k for k, each in enumerate(order) if self.p[k] != 0 or each in varied]
        function = made(self.function(name), self.p, kept)
        text = c_text(function)
        names = tuple(order[k] for k in kept)
        return Formulas(text, function.size1_out(0), names, self.p[kept]) if text else None

    @cached_property
    def domain(self) -> Domain | None:
        """Domain conditions of the fundamental motion; None if it is real and finite everywhere."""
        return self.domain_with(())

    def exist(self, speeds: Array) -> Array:
        """Whether the fundamental motion exists at speeds (P,) in rad/s."""
        domain = self.domain
        if domain is None or not domain.by_speed:
            return np.ones(len(speeds), dtype=bool)
        return domain.holds(speeds, np.zeros((len(speeds), 0)))

    def domain_with(self, free: Sequence[str]) -> Domain | None:
        """Domain conditions with separate values of the free parameters at each point."""
        rows = getattr(self.module, "DOMAIN", ())
        if not rows:
            return None
        return Domain(self.function("domain"), self.sampler("domain", free), rows, self.module.PERIOD)

    @property
    def conditions(self) -> Sequence[tuple[str, str, Sequence[str]]]:
        """What the module demands of its parameters beyond the bound of each, such as lengths with which a
        linkage can turn: the condition, its meaning, and the parameters that it concerns."""
        return getattr(self.module, "CONDITIONS", ())

    @cached_property
    def condition_phases(self) -> Array:
        """Phases all over the period at which the conditions must hold; one where none depends on it."""
        over_phase = self.function("conditions").jac_sparsity(0, 0).nnz() > 0
        return (np.arange(_PHASES if over_phase else 1) + 0.5) * (self.module.PERIOD / _PHASES)

    def require_conditions(self) -> None:
        """Raise ValueOutOfBoundsError where parameters contradict each other."""
        if not self.conditions:
            return
        margins = self.function("conditions")(self.condition_phases[None], self.p).full()
        units = {name: unit for name, unit, *_ in self.module.PARAMETERS}
        for (condition, meaning, names), margin in zip(self.conditions, margins, strict=True):
            if not (margin > 0).all():
                given = ", ".join(
                    f"{name} = {measured(self.case.parameters[name], units[name])}" for name in names
                )
                raise ValueOutOfBoundsError(
                    f"{meaning}: {condition} does not hold for {given}; choose numbers for which it does"
                )


def followed(breaks: Array, moved: Array, period: float) -> Array:
    """The breaks (b,) where they have moved to (c,), each to the nearest around the period. Raises
    ValueOutOfBoundsError where some have met or parted."""
    ends = _different(moved, period)
    apart = (ends - breaks[:, None] + period / 2) % period - period / 2
    nearest = np.abs(apart).argmin(axis=1)
    if not len(set(nearest.tolist())) == len(ends) == len(_different(breaks, period)):
        raise ValueOutOfBoundsError("jumps meet, or part; change what moves them a little")
    return breaks + apart[np.arange(len(breaks)), nearest]


def _different(breaks: Array, period: float) -> Array:
    """Those that differ by more than rounding around the period."""
    phases = np.sort(breaks % period)
    return phases[np.diff(phases, append=phases[:1] + period) > _ALIKE * period]
