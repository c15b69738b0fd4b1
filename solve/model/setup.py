"""Setup of a model: generated module, case and options."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from solve.arrays import Array, Plane
from solve.contracts import Formulas
from solve.errors import ValueOutOfBoundsError
from solve.labels import Labels
from solve.model.bounds import checked_options, checked_parameters, measured
from solve.model.cases import Case
from solve.model.domain import Domain
from solve.model.events import MAX_CACHED, EventFinder, switches
from solve.model.formulas import c_text, roundoff_bound
from solve.model.sampling import Sampler, folded, inputs_of
from solve.threads import symbolic

if TYPE_CHECKING:
    import casadi

_CONDITION_PHASES = 720
"""Number of phases per period at which conditions on the parameters are checked. Chosen by judgement."""

_SAMPLES = {"points": 1, "curve": 361, "beam": 33}
"""Number of points per element of a sketched line, for each kind of line."""


def samples_of(kind: str, fineness: float = 1.0) -> int:
    """Number of points that are drawn per element of a line of this kind.

    >>> samples_of("curve", 0.2), samples_of("points", 0.2)
    (73, 1)
    """
    return 1 + max(round(fineness * (_SAMPLES[kind] - 1)), min(1, _SAMPLES[kind] - 1))


@dataclass(frozen=True)
class Setup:
    """Setup of a model: generated module, case and options. The case has a value, in the declared unit, for
    every parameter; `options` has a value for every option."""

    module: ModuleType
    case: Case
    options: Mapping[str, Any]

    @classmethod
    def checked(cls, module: ModuleType, case: Case, options: Mapping[str, Any]) -> "Setup":
        """Setup with defaults for the options that are not in `options`. Every parameter must have a value.
        Raises UnknownNameError, ValueOutOfBoundsError and DesiredMotionError."""
        case = replace(case, parameters=checked_parameters(module, case.parameters))
        setup = cls(module, case, checked_options(module, options))
        setup._require_conditions()
        if setup.domain is not None:
            setup.domain.require()
        return setup

    def varied(self, parameters: Mapping[str, float], options: Mapping[str, Any]) -> "Setup":
        """Setup with changed parameters or options."""
        return Setup.checked(self.module, self.case.replaced(parameters), {**self.options, **options})

    @cached_property
    def p(self) -> Array:
        """Parameter values in the order of the generated functions."""
        return np.array(list(self.case.parameters.values()))

    @cached_property
    def ratios(self) -> Array | None:
        """Damping ratios (k,) of the modes in order of frequency; None if the mechanism states no ratios. The
        last ratio applies to all higher modes."""
        if not hasattr(self.module, "damping_ratios"):
            return None
        return self.function("damping_ratios")(self.p).full().ravel()

    @property
    def moves_breaks(self) -> bool:
        """Whether the phases of the breaks depend on parameters."""
        return hasattr(self.module, "breaks")

    @cached_property
    def breaks(self) -> tuple[float, ...]:
        """Phases, in ascending order, at which the generated matrices have jumps or kinks. Raises
        ValueOutOfBoundsError."""
        return self.breaks_with(self.p)

    def breaks_with(self, p: Array) -> tuple[float, ...]:
        """Breaks for other values of the parameters, `p`, in the order of the generated functions."""
        phases = getattr(self.module, "BREAKS", ())
        if self.moves_breaks:
            try:
                phases = self.module.breaks(None, p.tolist(), **self._module_options)
            except ValueError as error:
                raise ValueOutOfBoundsError(f"{self.module.NAME}: {error}") from None
        return tuple(sorted(set(phases)))

    @property
    def _module_options(self) -> dict[str, Any]:
        """Options of the generated functions. For a structure, options of its elements are excluded, because
        they affect only the assembly."""
        return {option: self.options[option] for option, *_ in self.module.OPTIONS}

    def function(self, name: str) -> "casadi.Function":
        """Generated function with this name."""
        return _function_of(self.module, tuple(self._module_options.items()), name)

    def sampler(self, name: str, free: Sequence[str]) -> Sampler:
        """Sampler of the generated function `name` at many phases. The parameters named in `free` have
        separate values at each phase."""
        order = list(self.case.parameters)
        return Sampler(folded(self.function(name), self.p, [order.index(parameter) for parameter in free]))

    @cached_property
    def residual_roundoff(self) -> Sampler:
        """Sampler of bounds (k, n) on the round-off in the nonlinear residual, in units of the machine
        precision. Inputs are phases, speeds, states q, qd, qdd (k, n), and the parameters (p,)."""
        return Sampler(_roundoff_of(self.module, tuple(self._module_options.items())), shared=1)

    @cached_property
    def event_finder(self) -> EventFinder | None:
        """Finder of the events of switches that depend on the motion; None if there are no such switches."""
        function = switches(self.module, tuple(self._module_options.items()))
        return None if function is None else EventFinder(function, self.p)

    def formulas(
        self,
        name: str,
        varied: Sequence[str],
        transform: "Callable[[casadi.Function, Array, Sequence[int]], casadi.Function]" = folded,
    ) -> Formulas | None:
        """C code of the generated function `name` after `transform`. Parameters with value 0 are substituted,
        except those in `varied`."""
        order = list(self.case.parameters)
        free = [k for k, parameter in enumerate(order) if self.p[k] != 0 or parameter in varied]
        options = tuple(self._module_options.items())
        text, count = _text_of(self.module, options, name, transform, tuple(free), len(order))
        names = tuple(order[k] for k in free)
        return Formulas(text, count, names, self.p[free]) if text else None

    @cached_property
    def domain(self) -> Domain | None:
        """Conditions for the existence of the fundamental motion; None if the motion is real and finite
        everywhere."""
        return self.domain_with(())

    def exist(self, speeds: Array) -> Array:
        """Return a mask of those `speeds` (P,), in rad/s, at which the fundamental motion exists."""
        domain = self.domain
        if domain is None or not domain.by_speed:
            return np.ones(len(speeds), dtype=bool)
        return domain.holds(speeds, np.zeros((len(speeds), 0)))

    def domain_with(self, free: Sequence[str]) -> Domain | None:
        """Conditions for the existence of the fundamental motion, with separate values of the parameters
        `free` at each point."""
        rows = getattr(self.module, "DOMAIN", ())
        if not rows:
            return None
        return Domain(self.function("domain"), self.sampler("domain", free), rows, self.module.PERIOD)

    @property
    def conditions(self) -> Sequence[tuple[str, str, Sequence[str]]]:
        """Conditions on several parameters, for example lengths that allow a linkage to rotate. Each row
        contains the condition, its meaning, and the parameters in it."""
        return getattr(self.module, "CONDITIONS", ())

    @cached_property
    @symbolic
    def condition_phases(self) -> Array:
        """Phases at which the conditions are checked; a single phase if no condition depends on the phase."""
        over_phase = self.function("conditions").jac_sparsity(0, 0).nnz() > 0
        return (np.arange(_CONDITION_PHASES if over_phase else 1) + 0.5) * (
            self.module.PERIOD / _CONDITION_PHASES
        )

    def _require_conditions(self) -> None:
        """Raise ValueOutOfBoundsError if the parameters violate a condition."""
        if not self.conditions:
            return
        margins = self.function("conditions")(self.condition_phases[None], self.p).full()
        units = {name: unit for name, unit, *_ in self.module.PARAMETERS}
        for (condition, meaning, names), margin in zip(self.conditions, margins, strict=True):
            if not (margin > 0).all():
                values = ", ".join(
                    f"{name} = {measured(self.case.parameters[name], units[name])}" for name in names
                )
                raise ValueOutOfBoundsError(
                    f"{meaning}: {condition} does not hold for {values}; choose values for which it holds"
                )


def stated_lines(
    setup: Setup, phase: Array, speed: float, q: Array, fineness: float = 1.0
) -> dict[str, Plane]:
    """Mapping from names of sketched lines to points x + iy (points, k) in coherent units, for q (n, k) at
    phases (k,).

    fineness: fraction of the default number of points of curves. Raises ValueOutOfBoundsError for a line
    without finite points."""
    lines: dict[str, Plane] = {}
    if not getattr(setup.module, "SKETCH", ()):
        return lines
    for number, (name, _, kind) in enumerate(setup.module.SKETCH):
        samples = samples_of(kind, fineness)
        fractions = np.tile(np.linspace(0.0, 1.0, samples), len(phase))
        columns = np.repeat(np.vstack((phase, np.full(len(phase), speed), q)), samples, axis=1)
        line = _line_of(setup.module, tuple(setup._module_options.items()), number)
        coordinates = line(columns[:1], columns[1:2], columns[2:], fractions[None], setup.p).full()
        points = coordinates[::2] + 1j * coordinates[1::2]
        if not np.isfinite(points).all():
            raise ValueOutOfBoundsError(
                f"sketch {name} of {setup.module.NAME} is not defined at some phase; check the parameters"
            )
        lines[name] = points if samples == 1 else points.reshape(len(phase), samples).T
    return lines


@lru_cache(MAX_CACHED)
@symbolic
def _function_of(module: ModuleType, options: tuple[tuple[str, Any], ...], name: str) -> "casadi.Function":
    """Generated function. Models that differ only in parameter values share it."""
    return getattr(module, name)(**dict(options))


@lru_cache(MAX_CACHED)
@symbolic
def _line_of(module: ModuleType, options: tuple[tuple[str, Any], ...], number: int) -> "casadi.Function":
    """Function that returns one line of a generated sketch. It has the inputs of the sketch."""
    import casadi

    sketch = _function_of(module, options, "sketch")
    inputs = list(inputs_of(sketch).values())
    return casadi.Function("line", inputs, [sketch.call(inputs, True, False)[number]])


@lru_cache(MAX_CACHED)
@symbolic
def _text_of(
    module: ModuleType,
    options: tuple[tuple[str, Any], ...],
    name: str,
    transform: "Callable[[casadi.Function, Array, Sequence[int]], casadi.Function]",
    free: tuple[int, ...],
    count: int,
) -> tuple[str | None, int]:
    """Return the C code of a generated function after `transform`, and its number of outputs.

    The parameters with the indices `free` are inputs; all other parameters are 0. count: number of all
    parameters."""
    function = transform(getattr(module, name)(**dict(options)), np.zeros(count), free)
    return c_text(function), function.size1_out(0)


@lru_cache(MAX_CACHED)
@symbolic
def _roundoff_of(module: ModuleType, options: tuple[tuple[str, Any], ...]) -> "casadi.Function":
    """Function that returns bounds on the round-off in the residual."""
    return roundoff_bound(module.residual(**dict(options)), ("speed", "p"))


def left_out(setup: Setup) -> tuple[str, ...]:
    """Sentences that state which nonlinear terms the linearised equations neglect."""
    sentences, switched = (getattr(setup.module, name, ()) for name in ("NONLINEAR", "SWITCHED"))
    # Terms with switches may depend on options.
    return (*sentences, *switched) if switched and setup.event_finder is not None else sentences


def labels_of(setup: Setup, described: Sequence[tuple[str, str, str]]) -> Labels:
    """Labels of the model. described: name, unit and meaning of each coordinate, output and input."""
    module, case = setup.module, setup.case
    return Labels(
        name=module.NAME,
        title=module.TITLE,
        case=case.name,
        case_speed=case.speed,
        model_hash=module.FILE_SHA256,
        options=setup.options,
        parameters=case.parameters,
        parameter_labels={name: (unit, meaning) for name, unit, meaning, _ in module.PARAMETERS},
        parameter_sources=case.sources,
        equations=getattr(module, "EQUATIONS", (getattr(module, "NO_EQUATIONS", ""),)),
        sketch_unit=next((unit for _, unit, _ in getattr(module, "SKETCH", ())), "m"),
        equation_warnings=(*left_out(setup), *(fit.sentence for fit in case.fits.values())),
        units={name: unit for name, unit, _ in described},
        meanings={name: meaning for name, _, meaning in described},
    )
